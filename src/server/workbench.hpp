#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>

namespace server {

// A thread for what takes long, one job after the other, so that whoever asks for it goes on. What came of a job is dealt with
// by the asker's thread.
class Workbench {
 public:
  static constexpr std::size_t kMostJobs = 32;

  struct Job {
    std::function<void()> work;                         // on the workbench's thread; may throw
    std::function<void(const std::exception_ptr&)> done;  // in take_finished(), with what `work` threw
  };

  Workbench();
  ~Workbench();  // waits for the job that runs; what was not begun is dropped

  // False, and nothing done, where kMostJobs wait.
  bool add(Job job);
  // Deals with those that are finished.
  void take_finished();
  // Readable when there is one: for poll().
  int fd() const { return fd_; }

  // Jobs begun and finished so far: equal while none runs. From any thread.
  std::uint64_t begun() const { return begun_.load(std::memory_order_acquire); }
  std::uint64_t finished() const { return finished_.load(std::memory_order_acquire); }

 private:
  struct Finished {
    Job job;
    std::exception_ptr thrown;
  };

  void run();

  const int fd_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Job> jobs_;
  std::deque<Finished> done_;
  bool quit_ = false;
  std::atomic<std::uint64_t> begun_{0}, finished_{0};
  std::thread thread_;
};

}  // namespace server
