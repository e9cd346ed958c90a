#include "server/supervisor.hpp"

#include <fcntl.h>
#include <signal.h>
#include <spdlog/spdlog.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <future>
#include <memory>
#include <optional>
#include <system_error>
#include <utility>
#include <vector>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "server/answers.hpp"
#include "server/arm_process.hpp"
#include "server/black_box.hpp"
#include "server/doorkeeper.hpp"
#include "server/ending_signals.hpp"
#include "server/inbox.hpp"
#include "server/part_record.hpp"
#include "server/plugins.hpp"
#include "server/recorder.hpp"
#include "server/refused.hpp"
#include "server/roles.hpp"
#include "server/shared_memory.hpp"
#include "server/sockets.hpp"
#include "server/system_call.hpp"
#include "server/wakeful_clock.hpp"

namespace server {
namespace {

namespace proto = frankapy::proto;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kTick = 50ms;
constexpr int kFirstFreeFd = 16;   // in a child, for a moment
constexpr std::size_t kMaxStatus = 64 << 10;       // bytes
constexpr std::int64_t kMaxRequest = 1 << 20;  // bytes

// The configuration as the child's standard input.
int text_file(const std::string& text) {
  const int fd = make_memory_file("configuration", text.size());
  if (pwrite(fd, text.data(), text.size(), 0) != static_cast<ssize_t>(text.size())) failed("pwrite");
  return fd;
}

// None where nothing is to be recorded.
std::optional<BlackBoxOwner> owner_of_box(const Config& config, const ArmConfig& arm) {
  if (config.recordings.mode == RecordingsConfig::Mode::kOff) return std::nullopt;
  return BlackBoxOwner{arm.name, config.recordings.folder, config.recordings.max_gb};
}

class Child {
 public:
  Child(const Config& config, int index, const std::string& toml, const std::vector<std::string>& arguments,
        const SupervisorTimes& times)
      : times_(times),
        first_word_(times.first_word + (config.load.empty() ? 0s : kLoadTime)),
        index_(index),
        listen_(config.listen),
        recordings_(config.recordings),
        toml_(toml),
        arguments_(arguments),
        record_fd_(make_part_record_file()),
        record_(map_part_record(record_fd_)),
        box_owner_(owner_of_box(config, config.arms[index])),
        box_fd_(make_black_box_file(box_owner_)),
        walls_fd_(make_memory_file("walls", 0)),
        limits_fd_(make_memory_file("limits", 0)) {
    const ArmConfig& arm = config.arms[index];
    info_.set_name(arm.name);
    info_.set_address(arm.address);
    info_.set_status("starting");
  }
  ~Child() {
    if (pid_ > 0) end(SIGKILL);
    close(record_fd_);
    forget_black_box(box_fd_);
    close(box_fd_);
    close(walls_fd_);
    close(limits_fd_);
  }
  Child(const Child&) = delete;

  const proto::Arms::Arm& info() const { return info_; }
  int fd() const { return fd_; }
  bool alive() const { return pid_ > 0; }
  void stop() const {
    if (pid_ > 0) kill(pid_, SIGTERM);
  }

  // Reads what the child says, and starts it where it does not run.
  void look_after(bool stopping) {
    now_ = clock_.now();
    if (pid_ > 0) listen_to();
    if (pid_ > 0 && !stopping && now_ - heard_ > (spoken_ ? times_.silence : first_word_)) {
      spdlog::error("arm {}: its process hangs{} and is started again", info_.name(), record_->where());
      end(SIGKILL);
    }
    if (pid_ == 0 && !stopping && Clock::now() >= next_start_) try_to_start();
  }

 private:
  // Where this computer has no room for it, others go on, and it is tried again.
  void try_to_start() {
    int ends[] = {-1, -1}, config = -1;
    try {
      if (socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends) != 0) failed("socketpair");
      config = text_file(toml_);
      start(config, ends[1]);
      fd_ = std::exchange(ends[0], -1);
    } catch (const std::system_error& error) {
      spdlog::error("arm {}: its process could not be started: {}", info_.name(), error.what());
      info_.set_status(fmt::format("starting again: its process could not be started ({})", error.what()));
      next_start_ = Clock::now() + times_.short_life;
    }
    for (const int fd : {ends[0], ends[1], config}) {
      if (fd >= 0) close(fd);
    }
  }

  // With the configuration as its standard input, and the end of a socket where it tells of itself.
  void start(int config, int told) {
    std::vector<std::string> words = {
        "franka-interface", "arm", "--index", std::to_string(index_), "--listen", listen_, "--port",
        std::to_string(port_), "--state-port", std::to_string(state_port_), "--sensor-port",
        std::to_string(sensor_port_), "--supervised"};
    words.insert(words.end(), arguments_.begin(), arguments_.end());
    std::vector<char*> argv;
    for (const auto& word : words) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);

    record_->clear();
    const pid_t pid = fork();
    if (pid < 0) failed("fork");
    if (pid == 0) {
      // Only what is allowed between fork and exec.
      sigset_t none;
      sigemptyset(&none);
      sigprocmask(SIG_SETMASK, &none, nullptr);
      if (dup2(config, STDIN_FILENO) < 0) _exit(127);
      // Through numbers that are nobody's: dup2() would close one for the other, and keep FD_CLOEXEC on itself.
      const int status = fcntl(told, F_DUPFD, kFirstFreeFd), record = fcntl(record_fd_, F_DUPFD, kFirstFreeFd),
                box = fcntl(box_fd_, F_DUPFD, kFirstFreeFd), walls = fcntl(walls_fd_, F_DUPFD, kFirstFreeFd),
                limits = fcntl(limits_fd_, F_DUPFD, kFirstFreeFd);
      if (dup2(status, ArmOptions::kStatusFd) < 0 || dup2(record, ArmOptions::kRecordFd) < 0 ||
          dup2(box, ArmOptions::kBlackBoxFd) < 0 || dup2(walls, ArmOptions::kWallsFd) < 0 ||
          dup2(limits, ArmOptions::kLimitsFd) < 0) {
        _exit(127);
      }
      syscall(SYS_close_range, ArmOptions::kLimitsFd + 1, ~0U, 0);
      execv("/proc/self/exe", argv.data());
      _exit(127);
    }
    pid_ = pid;
    spoken_ = false;
    started_ = Clock::now();
    heard_ = now_;
    info_.set_status("starting");
    info_.set_starts(info_.starts() + 1);
  }

  void listen_to() {
    std::vector<char> bytes(kMaxStatus);
    for (;;) {
      const ssize_t size = recv(fd_, bytes.data(), bytes.size(), MSG_DONTWAIT);
      if (size < 0 && (errno == EAGAIN || errno == EINTR)) return;
      if (size <= 0) break;
      proto::Arms::Arm info;
      if (!info.ParseFromArray(bytes.data(), static_cast<int>(size))) continue;
      if (info.status() != info_.status()) spdlog::info("arm {}: {}", info.name(), info.status());
      info.set_starts(info_.starts());
      info.set_ended(info_.ended());
      info_ = info;
      spoken_ = true;
      heard_ = now_;
      if (info.has_endpoint()) port_ = port_of(info.endpoint());
      if (info.has_state_endpoint()) state_port_ = port_of(info.state_endpoint());
      if (info.has_sensor_endpoint()) sensor_port_ = port_of(info.sensor_endpoint());
    }
    end(0);
  }

  // Collects the process, killed first if it does not end by itself.
  void end(int signal) {
    const auto deadline = Clock::now() + 200ms;
    int status = 0;
    if (signal != 0) kill(pid_, signal);
    while (waitpid(pid_, &status, WNOHANG) == 0) {
      if (Clock::now() > deadline) kill(pid_, SIGKILL);
      usleep(1000);
    }
    close(fd_);
    fd_ = -1;
    pid_ = 0;
    info_.clear_endpoint();
    info_.clear_state_endpoint();
    info_.clear_sensor_endpoint();
    std::string how = "ended";
    if (WIFSIGNALED(status)) how = fmt::format("was killed by signal {} ({})", WTERMSIG(status), strsignal(WTERMSIG(status)));
    if (WIFEXITED(status) && WEXITSTATUS(status) != 0) how = fmt::format("ended with status {}", WEXITSTATUS(status));
    if (WIFEXITED(status) && WEXITSTATUS(status) == ArmOptions::kHangs) how = "hung and gave up";
    if (status != 0) how += record_->where();
    info_.set_status("starting again: its process " + how);
    info_.set_ended(how);
    if (signal == 0 && status == 0) spdlog::info("arm {}: its process {}", info_.name(), how);
    if (signal == 0 && status != 0) spdlog::error("arm {}: its process {}", info_.name(), how);
    try {
      if (status != 0) write_down(how);
    } catch (const std::system_error& error) {
      spdlog::error("arm {}: the black box was not written: {}", info_.name(), error.what());
    }
    next_start_ = Clock::now() - started_ < times_.short_life ? started_ + times_.short_life : Clock::now();
  }

  // While the next process begins with another.
  void write_down(const std::string& how) {
    const int fd = std::exchange(box_fd_, make_black_box_file(box_owner_));
    std::erase_if(writing_, [](const auto& writing) { return writing.wait_for(0s) == std::future_status::ready; });
    writing_.push_back(std::async(std::launch::async, [fd, how, name = info_.name(), recordings = recordings_] {
      try {
        const auto path = write_black_box(fd, recordings, name, how);
        if (!path.empty()) spdlog::info("arm {}: the black box is in {}", name, path.string());
        forget_black_box(fd);
      } catch (const std::exception& error) {
        spdlog::error("arm {}: the black box was not written: {}. {}", name, error.what(), leave_black_box(fd));
      }
      close(fd);
    }));
  }

  const SupervisorTimes times_;
  const std::chrono::milliseconds first_word_;
  const int index_;
  const std::string& listen_;
  const RecordingsConfig& recordings_;
  const std::string& toml_;
  const std::vector<std::string>& arguments_;
  const int record_fd_;
  const std::shared_ptr<PartRecord> record_;
  const std::optional<BlackBoxOwner> box_owner_;
  int box_fd_;
  const int walls_fd_, limits_fd_;
  std::vector<std::future<void>> writing_;  // a disk that hangs holds up nothing else
  proto::Arms::Arm info_;
  pid_t pid_ = 0;
  int fd_ = -1;
  bool spoken_ = false;
  std::uint16_t port_ = 0, state_port_ = 0, sensor_port_ = 0;  // a restarted arm is found where it was
  Clock::time_point started_{}, next_start_{};
  WakefulClock clock_{2 * kTick};
  Clock::duration now_{}, heard_{};  // by it
};

class Supervisor {
 public:
  Supervisor(const Config& config, const std::string& toml, const std::vector<std::string>& arguments, Keys* keys,
             const SupervisorTimes& times)
      : times_(times), socket_(context_, zmq::socket_type::router), inbox_(socket_, keys), answers_(socket_) {
    if (keys != nullptr) {
      doorkeeper_.emplace(context_, *keys);
      guard(socket_, *keys);
      spdlog::info("clients need keys: those of {}", keys->folder().string());
    }
    socket_.set(zmq::sockopt::linger, 0);
    socket_.set(zmq::sockopt::maxmsgsize, kMaxRequest);
    notice_the_gone(socket_);
    try {
      socket_.bind(fmt::format("tcp://{}:{}", config.listen, config.port == 0 ? "*" : std::to_string(config.port)));
    } catch (const zmq::error_t& error) {
      throw std::runtime_error(fmt::format("cannot listen on {}:{} ({}){}", config.listen, config.port, error.what(),
                                           error.num() == EADDRINUSE ? ": does another franka-interface run? Stop it, or choose another --port"
                                           : error.num() == EADDRNOTAVAIL || error.num() == ENODEV
                                               ? ": it is no address of this computer, of which `ip address` lists all"
                                               : ""));
    }
    connections_.emplace(context_, socket_);
    for (std::size_t i = 0; i < config.arms.size(); ++i) {
      children_.push_back(std::make_unique<Child>(config, static_cast<int>(i), toml, arguments, times));
    }
  }

  // `signals` are blocked in all threads.
  int run(const sigset_t& signals) {
    const int signal_fd = signalfd(-1, &signals, SFD_CLOEXEC);
    std::printf("listening on %s\n", socket_.get(zmq::sockopt::last_endpoint).c_str());
    std::fflush(stdout);

    const auto left = std::async(std::launch::async, write_left_black_boxes);
    bool stopping = false;
    Clock::time_point stop_until{};
    for (;;) {
      bool any = false;
      std::vector<zmq::pollitem_t> items = {{socket_.handle(), 0, ZMQ_POLLIN, 0}, {nullptr, signal_fd, static_cast<short>(stopping ? 0 : ZMQ_POLLIN), 0}};
      for (const auto& child : children_) {
        child->look_after(stopping);
        any |= child->alive();
        if (child->fd() >= 0) items.push_back({nullptr, child->fd(), ZMQ_POLLIN, 0});
      }
      if (stopping && !any) return 0;
      if (stopping && Clock::now() > stop_until) {
        spdlog::error("an arm's process does not end: it is killed");
        return EXIT_FAILURE;  // by ~Child
      }
      zmq::poll(items, kTick);
      connections_->look();
      if (items[1].revents != 0) {
        spdlog::info("stopping: the arms brake and finish");
        stopping = true;
        stop_until = Clock::now() + times_.stop;
        for (const auto& child : children_) child->stop();
      }
      if (items[0].revents != 0) {
        // A client that has lost an arm asks how: that is known here when it is known there.
        for (const auto& child : children_) child->look_after(stopping);
        answer();
      }
    }
  }

 private:
  void answer() {
    constexpr int kAtOnce = 32;  // and then it looks after the arms again
    for (int n = 0; n < kAtOnce; ++n) {
      const auto arrived = inbox_.receive();
      if (!arrived) return;
      const zmq::message_t& frame = arrived->frame;
      proto::Request request;
      if (!request.ParsePartialFromArray(frame.data(), static_cast<int>(frame.size())) || !request.has_request_id()) {
        inbox_.count_garbage(fmt::format("{} bytes that are no Request with a request_id", frame.size()));
        continue;
      }
      const Address from{arrived->client, request.request_id(), arrived->who};
      try {
        require_role(from.who, request);  // a key may have been removed since it connected
        if (!request.has_list_arms()) {
          refuse("this is the supervisor, which answers ListArms: everything else is for the arm's own endpoint");
        }
        proto::Reply reply;
        for (const auto& child : children_) *reply.mutable_arms()->add_arms() = child->info();
        reply.mutable_arms()->set_version(proto::CURRENT);
        if (doorkeeper_) reply.mutable_arms()->set_refused_keys(doorkeeper_->refused());
        answers_.send(from, reply);
      } catch (...) {
        answers_.refuse(from, std::current_exception());
      }
    }
  }

  const SupervisorTimes times_;
  zmq::context_t context_;
  std::optional<Doorkeeper> doorkeeper_;
  zmq::socket_t socket_;
  Inbox inbox_;
  Answers answers_;
  std::optional<ConnectionLimit> connections_;
  std::vector<std::unique_ptr<Child>> children_;
};

}  // namespace

int run_supervisor(const Config& config, const std::string& toml, const std::vector<std::string>& arguments, Keys* keys,
                   const SupervisorTimes& times) {
  // Before there is a thread that one of them could end all by.
  const sigset_t signals = ending_signals();
  sigprocmask(SIG_BLOCK, &signals, nullptr);
  return Supervisor(config, toml, arguments, keys, times).run(signals);
}

}  // namespace server
