#pragma once

#include <atomic>
#include <cstddef>
#include <memory>

namespace bridge {

// Bounded queue of one producer and one consumer; neither waits nor allocates after construction.
template <class T>
class Queue {
 public:
  // Room for `capacity` elements, a power of two.
  explicit Queue(std::size_t capacity)
      : mask_(capacity - 1), elements_(std::make_unique<T[]>(capacity)) {}

  // The element to fill next, or null when the queue is full; push() makes it visible. Filling in
  // place spares a copy of large records.
  T* back() noexcept {
    const std::size_t head = head_.load(std::memory_order_relaxed);
    if (head - tail_.load(std::memory_order_acquire) > mask_) return nullptr;
    return &elements_[head & mask_];
  }
  void push() noexcept { head_.store(head_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

  // How many more it takes; the producer's to ask.
  std::size_t room() const noexcept {
    return mask_ + 1 - (head_.load(std::memory_order_relaxed) - tail_.load(std::memory_order_acquire));
  }

  // False, and nothing done, when the queue is full.
  bool push(const T& element) noexcept {
    T* slot = back();
    if (slot == nullptr) return false;
    *slot = element;
    push();
    return true;
  }

  // The oldest element, or null when the queue is empty; pop() gives it up.
  const T* front() const noexcept {
    const std::size_t tail = tail_.load(std::memory_order_relaxed);
    if (tail == head_.load(std::memory_order_acquire)) return nullptr;
    return &elements_[tail & mask_];
  }
  void pop() noexcept { tail_.store(tail_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

 private:
  std::size_t mask_;
  std::unique_ptr<T[]> elements_;
  alignas(64) std::atomic<std::size_t> head_{0};
  alignas(64) std::atomic<std::size_t> tail_{0};
};

}  // namespace bridge
