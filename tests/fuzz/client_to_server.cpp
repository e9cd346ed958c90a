// Anything that clients and publishers can send to an arm's server: an answer to each request, never a crash, and nothing that
// leaves for the robot but what it may be told. Transport, sensors and loop are the server's; the robot is an ideal one.

#include <spdlog/spdlog.h>

#include <array>
#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <zmq.hpp>

#include "frankapy/proto/service.pb.h"
#include "models/arm.hpp"
#include "realtime/loop.hpp"
#include "require.hpp"
#include "script.hpp"
#include "server/publisher.hpp"
#include "server/recorder.hpp"
#include "server/sensor_hub.hpp"
#include "server/skill_builder.hpp"
#include "server/transport.hpp"
#include "tests/realtime/mock_driver.hpp"

namespace {

namespace proto = frankapy::proto;
using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

// Steps of a script; beside a request, what is sent is a sensor message, and the first byte of kCycles says how many tens.
enum Step { kRequest, kRequestOfAnother, kSensor, kCycles, kSteps };

constexpr auto kLongest = 30s;      // that an answer may take, on a computer with much else to do
constexpr int kMostRequests = 40;   // of one input
constexpr int kCyclesToEnd = 20'000;
const models::Arm& kArm = models::arm("fr3");
constexpr fci::Version kVersion = 10;

using fuzz::are_numbers;
using fuzz::require;

std::unique_ptr<realtime::Model> make_model() { return std::make_unique<realtime::Model>(models::urdf(kArm, kVersion)); }

class Server {
 public:
  Server() {
    for (std::size_t i = 0; i < clients_.size(); ++i) {
      clients_[i].set(zmq::sockopt::linger, 0);
      clients_[i].connect(transport_.endpoint());
    }
    publisher_socket_.set(zmq::sockopt::linger, 0);
    publisher_socket_.connect(sensors_.endpoint());
    thread_ = std::thread([this] { transport_.run(quit_); });
  }
  ~Server() {
    quit_ = true;
    thread_.join();
  }

  void run(fuzz::Script script) {
    connect();
    for (int i = 0; i < 2; ++i) {
      proto::Request hello;
      hello.mutable_hello()->set_version(proto::CURRENT);
      ask(i, hello);
    }
    int what = 0, requests = 0;
    std::span<const std::byte> bytes;
    while (requests < kMostRequests && script.next(what, bytes)) {
      switch (what % kSteps) {
        case kSensor: publish(bytes); break;
        case kCycles: cycles(bytes.empty() ? 1 : 10 * std::to_integer<int>(bytes[0])); break;
        default: ++requests; send(what % kSteps, bytes);
      }
    }
    end();
  }

 private:
  void connect() {
    const models::Limits limits = models::limits(kArm, kVersion);
    robot_ = std::make_unique<testing_tools::MockRobot>(kArm, kVersion);
    model_ = make_model();
    realtime::Loop::Options options;
    options.hold_time = 0.05;
    loop_ = std::make_unique<realtime::Loop>(*robot_, *model_, limits, options, door_);
    proto::Welcome welcome;
    welcome.set_model(std::string(kArm.name));
    transport_.connected(std::make_shared<server::SkillBuilder>(make_model(), limits), welcome);
    cycles(1);
  }

  // What clients have set goes, and the arm.
  void end() {
    proto::Request request;
    request.mutable_stop_skill();
    ask(0, request);
    for (int i = 0; i < 2; ++i) {
      request.mutable_goodbye();
      ask(i, request);
    }
    request.mutable_hello()->set_version(proto::CURRENT);
    ask(0, request);
    request.mutable_change_limits()->set_reset(true);
    ask(0, request);
    request.mutable_change_walls();
    const auto walls = ask(0, request).walls();
    for (const auto& wall : walls.walls()) request.mutable_change_walls()->add_remove(wall.name());
    ask(0, request);
    request.mutable_goodbye();
    ask(0, request);
    door_.quit = true;
    int most = kCyclesToEnd;
    while (most > 0 && loop_->cycle()) --most;
    require(most > 0, "the loop does not end");
    look();
    loop_.reset();
    door_.quit = false;
    transport_.disconnected("the next arm comes");
    request.mutable_alive();
    ask(0, request);  // so that it notices at once
  }

  // The server's answers are waited for, so that an input does the same each time.
  void send(int client, std::span<const std::byte> bytes) {
    clients_[static_cast<std::size_t>(client)].send(zmq::buffer(bytes.data(), bytes.size()), zmq::send_flags::none);
    proto::Request request;
    request.ParsePartialFromArray(bytes.data(), static_cast<int>(bytes.size()));
    if (request.has_request_id()) wait_for_answer(client, request.request_id());
  }
  proto::Reply ask(int client, proto::Request& request) {
    request.set_request_id(~0ull);
    const std::string bytes = request.SerializeAsString();
    clients_[static_cast<std::size_t>(client)].send(zmq::buffer(bytes), zmq::send_flags::none);
    return wait_for_answer(client, ~0ull);
  }
  // The arm goes on meanwhile: some are for it to give.
  proto::Reply wait_for_answer(int client, std::uint64_t id) {
    const auto until = Clock::now() + kLongest;
    for (;;) {
      zmq::message_t message;
      if (clients_[static_cast<std::size_t>(client)].recv(message, zmq::recv_flags::dontwait)) {
        proto::Reply reply;
        require(reply.ParseFromArray(message.data(), static_cast<int>(message.size())), "an answer that is none");
        require(reply.has_request_id() && reply.answer_case() != proto::Reply::ANSWER_NOT_SET, "an empty answer");
        require(!reply.has_error() || !reply.error().message().empty(), "an error that says nothing");
        if (reply.request_id() == id) return reply;
        continue;
      }
      if (loop_) cycles(1);
      std::this_thread::sleep_for(50us);
      require(Clock::now() < until, "no answer to a request");
    }
  }

  void publish(std::span<const std::byte> bytes) {
    const auto arrived = [this] {
      proto::Topics topics;
      sensors_.describe(topics);
      std::uint64_t all = topics.garbage();
      for (const auto& topic : topics.topics()) all += topic.received();
      return all;
    };
    const std::uint64_t before = arrived();
    publisher_socket_.send(zmq::buffer(bytes.data(), bytes.size()), zmq::send_flags::none);
    const auto until = Clock::now() + kLongest;
    while (arrived() == before) {
      std::this_thread::sleep_for(50us);
      require(Clock::now() < until, "a sensor message is not counted");
    }
  }

  void cycles(int count) {
    for (int i = 0; i < count; ++i) {
      require(loop_->cycle(), "the loop has ended");
      look();
    }
  }

  void look() const {
    const fci::RobotCommand& command = robot_->command;
    require(are_numbers(command.q_c) && are_numbers(command.dq_c) && are_numbers(command.O_T_EE_c) &&
                are_numbers(command.O_dP_EE_c) && are_numbers(command.elbow_c) && are_numbers(command.tau_J_d),
            "a command that is no number");
    if (!robot_->obeyed()) require(false, robot_->judgement().c_str());
  }

  zmq::context_t context_;
  server::BlackBox box_;
  realtime::Door door_{box_.records};
  server::Publisher publisher_{context_, "127.0.0.1", 0, door_, nullptr};
  server::SensorHub sensors_{context_, "127.0.0.1", 0, box_.journal, door_.robot_time, true};
  server::Recorder recorder_{box_, {.mode = server::RecordingsConfig::Mode::kOff, .folder = "/dev/null/none"}, "arm", nullptr};
  server::Transport transport_{context_, "127.0.0.1", 0, door_, publisher_, sensors_, recorder_, nullptr, server::WallStore({}),
                               {.clock = [] { return 0ms; }}};  // leases do not end
  std::atomic<bool> quit_{false};
  std::thread thread_;
  std::array<zmq::socket_t, 2> clients_{zmq::socket_t(context_, zmq::socket_type::dealer),
                                        zmq::socket_t(context_, zmq::socket_type::dealer)};
  zmq::socket_t publisher_socket_{context_, zmq::socket_type::push};

  std::unique_ptr<testing_tools::MockRobot> robot_;
  std::unique_ptr<realtime::Model> model_;
  std::unique_ptr<realtime::Loop> loop_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static std::unique_ptr<Server> server;
  if (!server) {
    spdlog::set_level(spdlog::level::off);
    server = std::make_unique<Server>();
  }
  server->run({data, size});
  return 0;
}
