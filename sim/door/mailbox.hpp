#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <stdexcept>

namespace sim {

// What other threads want done by a loop between its cycles. The loop looks at one atomic number a cycle.
class Mailbox {
 public:
  // Has it done, and waits for that. What it throws is thrown here; std::runtime_error when the loop ends instead.
  void ask(const std::function<void()>& task) {
    Letter letter{&task, {}, false};
    std::unique_lock lock(mutex_);
    if (!closed_) {
      letters_.push_back(&letter);
      ++waiting_;
      answered_.wait(lock, [&] { return letter.done || closed_; });
    }
    if (letter.error) std::rethrow_exception(letter.error);
    if (!letter.done) throw std::runtime_error("the simulation ends");
  }

  // Of the loop: whether there was anything.
  bool serve() {
    if (waiting_.load(std::memory_order_relaxed) == 0) return false;
    const std::lock_guard lock(mutex_);
    for (; !letters_.empty(); letters_.pop_front()) {
      Letter& letter = *letters_.front();
      try {
        (*letter.task)();
      } catch (...) {
        letter.error = std::current_exception();
      }
      letter.done = true;
      --waiting_;
    }
    answered_.notify_all();
    return true;
  }
  // The loop ends.
  void close() {
    const std::lock_guard lock(mutex_);
    closed_ = true;
    answered_.notify_all();
  }

 private:
  struct Letter {
    const std::function<void()>* task;
    std::exception_ptr error;
    bool done;
  };

  std::mutex mutex_;
  std::condition_variable answered_;
  std::deque<Letter*> letters_;
  std::atomic<int> waiting_ = 0;
  bool closed_ = false;
};

}  // namespace sim
