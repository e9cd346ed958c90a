#include "server/log.hpp"

#include <signal.h>
#include <spdlog/details/log_msg_buffer.h>
#include <spdlog/sinks/base_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <chrono>
#include <condition_variable>
#include <deque>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

namespace server {
namespace {

constexpr std::size_t kMostLines = 1000;                       // that wait
constexpr auto kFlushTime = std::chrono::milliseconds(500);

class PatientSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  explicit PatientSink(spdlog::sink_ptr out) : lines_(std::make_shared<Lines>()) {
    lines_->out = std::move(out);
    // Signals are for the other threads.
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    std::thread([lines = lines_] { write(*lines); }).detach();  // it may never come back from where it writes
    pthread_sigmask(SIG_SETMASK, &before, nullptr);
  }
  ~PatientSink() override {
    flush_();
    const std::lock_guard lock(lines_->mutex);
    lines_->quit = true;
    lines_->changed.notify_all();
  }

 private:
  struct Lines {
    spdlog::sink_ptr out;
    std::mutex mutex;
    std::condition_variable changed;
    std::deque<spdlog::details::log_msg_buffer> waiting;
    std::uint64_t dropped = 0;
    bool writing = false, quit = false;
  };

  void sink_it_(const spdlog::details::log_msg& message) override {
    const std::lock_guard lock(lines_->mutex);
    if (lines_->waiting.size() >= kMostLines) {
      ++lines_->dropped;
      return;
    }
    lines_->waiting.emplace_back(message);
    lines_->changed.notify_all();
  }
  void flush_() override {
    std::unique_lock lock(lines_->mutex);
    lines_->changed.wait_for(lock, kFlushTime, [this] { return lines_->waiting.empty() && !lines_->writing; });
  }
  void set_formatter_(std::unique_ptr<spdlog::formatter> formatter) override { lines_->out->set_formatter(std::move(formatter)); }
  void set_pattern_(const std::string& pattern) override { lines_->out->set_pattern(pattern); }

  static void write(Lines& lines) {
    std::unique_lock lock(lines.mutex);
    for (;;) {
      lines.changed.wait(lock, [&] { return lines.quit || !lines.waiting.empty(); });
      if (lines.waiting.empty()) return;
      const auto line = std::move(lines.waiting.front());
      lines.waiting.pop_front();
      const std::uint64_t dropped = lines.waiting.empty() ? std::exchange(lines.dropped, 0) : 0;
      lines.writing = true;
      lock.unlock();
      lines.out->log(line);
      if (dropped > 0) {
        lines.out->log({line.logger_name, spdlog::level::warn,
                        fmt::format("{} lines of the log were dropped here: what shows it did not take them", dropped)});
      }
      lines.out->flush();
      lock.lock();
      lines.writing = false;
      lines.changed.notify_all();
    }
  }

  const std::shared_ptr<Lines> lines_;
};

}  // namespace

spdlog::sink_ptr make_patient_sink(spdlog::sink_ptr out) { return std::make_shared<PatientSink>(std::move(out)); }

void start_log() {
  auto sink = make_patient_sink(std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
  spdlog::set_default_logger(std::make_shared<spdlog::logger>("franka-interface", std::move(sink)));
  spdlog::set_pattern("[%H:%M:%S.%e] %^%l%$ %v");
}

}  // namespace server
