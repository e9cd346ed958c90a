#include "server/workbench.hpp"

#include <sys/eventfd.h>
#include <unistd.h>

#include <utility>

#include "server/system_call.hpp"

namespace server {
namespace {

int make_eventfd() {
  const int fd = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (fd < 0) failed("eventfd");
  return fd;
}

}  // namespace

Workbench::Workbench() : fd_(make_eventfd()), thread_([this] { run(); }) {}

Workbench::~Workbench() {
  {
    const std::lock_guard lock(mutex_);
    quit_ = true;
  }
  changed_.notify_all();
  thread_.join();
  close(fd_);
}

bool Workbench::add(Job job) {
  {
    const std::lock_guard lock(mutex_);
    if (jobs_.size() >= kMostJobs) return false;
    jobs_.push_back(std::move(job));
  }
  changed_.notify_all();
  return true;
}

void Workbench::take_finished() {
  std::uint64_t count;
  if (::read(fd_, &count, sizeof count) < 0) return;  // none
  std::deque<Finished> finished;
  {
    const std::lock_guard lock(mutex_);
    finished.swap(done_);
  }
  for (const Finished& each : finished) each.job.done(each.thrown);
}

void Workbench::run() {
  std::unique_lock lock(mutex_);
  for (;;) {
    changed_.wait(lock, [this] { return quit_ || !jobs_.empty(); });
    if (quit_) return;
    Job job = std::move(jobs_.front());
    jobs_.pop_front();
    lock.unlock();
    begun_.fetch_add(1, std::memory_order_release);
    std::exception_ptr thrown;
    try {
      job.work();
    } catch (...) {
      thrown = std::current_exception();
    }
    finished_.fetch_add(1, std::memory_order_release);
    lock.lock();
    done_.push_back({std::move(job), thrown});
    const std::uint64_t one = 1;
    [[maybe_unused]] const ssize_t written = write(fd_, &one, sizeof one);
  }
}

}  // namespace server
