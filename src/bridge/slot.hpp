#pragma once

#include <atomic>
#include <memory>

namespace bridge {

// One object on its way through the door, newest wins. Any thread may put and take; neither waits.
template <class T>
class Slot {
 public:
  ~Slot() { delete held_.load(); }

  // Leaves `object`; returns what lay there unread, for its owner to destroy.
  std::unique_ptr<T> put(std::unique_ptr<T> object) noexcept {
    return std::unique_ptr<T>(held_.exchange(object.release(), std::memory_order_acq_rel));
  }

  // Takes what lies there; null when empty. The taker owns it.
  T* take() noexcept {
    if (held_.load(std::memory_order_relaxed) == nullptr) return nullptr;
    return held_.exchange(nullptr, std::memory_order_acq_rel);
  }

  bool empty() const noexcept { return held_.load(std::memory_order_relaxed) == nullptr; }

 private:
  std::atomic<T*> held_{nullptr};
};

}  // namespace bridge
