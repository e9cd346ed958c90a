#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <new>
#include <type_traits>
#include <utility>

namespace bridge {

// The newest elements of one producer, who never waits and overwrites the oldest, for any number of readers at their own
// pace (RingReader). It may lie in memory that outlives its process: elements hold no pointers, and begin as zeros.
template <class T>
class Ring {
  static_assert(std::is_trivially_destructible_v<T>);

 public:
  explicit Ring(std::size_t capacity)
      : Ring(std::shared_ptr<void>(std::memset(::operator new(size(capacity), kAlignment), 0, size(capacity)),
                                   [](void* memory) { ::operator delete(memory, kAlignment); }),
             capacity) {}
  // In memory of size(capacity) bytes of zeros, aligned to a page, that stays as long as the ring.
  Ring(std::shared_ptr<void> memory, std::size_t capacity) : Ring(std::move(memory), capacity, 0) {
    new (written_) std::atomic<std::uint64_t>(0);
  }
  // The ring that lies there already.
  static Ring found(std::shared_ptr<void> memory, std::size_t capacity) { return Ring(std::move(memory), capacity, 0); }

  static std::size_t size(std::size_t capacity) { return kHeader + capacity * sizeof(T); }
  std::size_t capacity() const noexcept { return capacity_; }

  // The producer's: the element to fill next, which push() makes visible.
  T& back() noexcept { return elements_[written_->load(std::memory_order_relaxed) % capacity_]; }
  void push() noexcept { written_->store(written_->load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  void push(const T& element) noexcept {
    back() = element;
    push();
  }

  // How many have been pushed.
  std::uint64_t written() const noexcept { return written_->load(std::memory_order_acquire); }

  // Copies the element that was pushed as number `index`, from 0; false when it has been overwritten.
  bool read(std::uint64_t index, T& out) const noexcept {
    if (written() - index >= capacity_) return false;
    out = elements_[index % capacity_];
    std::atomic_thread_fence(std::memory_order_acquire);
    return written_->load(std::memory_order_relaxed) - index < capacity_;  // else it may have changed on the way
  }

 private:
  static constexpr std::align_val_t kAlignment{64};
  static constexpr std::size_t kHeader = 64;

  Ring(std::shared_ptr<void> memory, std::size_t capacity, int)
      : capacity_(capacity),
        memory_(std::move(memory)),
        written_(static_cast<std::atomic<std::uint64_t>*>(memory_.get())),
        elements_(reinterpret_cast<T*>(static_cast<std::byte*>(memory_.get()) + kHeader)) {}

  std::size_t capacity_;
  std::shared_ptr<void> memory_;
  std::atomic<std::uint64_t>* written_;
  T* elements_;
};

// Reads a ring from some element on, one after the other.
template <class T>
class RingReader {
 public:
  // From what is pushed next.
  explicit RingReader(const Ring<T>& ring) : RingReader(ring, ring.written()) {}
  // From the element that was pushed as number `first`, or the oldest that is there.
  RingReader(const Ring<T>& ring, std::uint64_t first) : ring_(&ring) {
    const std::uint64_t written = ring.written();
    next_ = std::max(first, written - std::min<std::uint64_t>(written, ring.capacity() - 1));
  }

  // False when there is no other yet.
  bool next(T& out) noexcept {
    for (;;) {
      const std::uint64_t written = ring_->written();
      if (next_ == written) return false;
      if (ring_->read(next_, out)) {
        ++next_;
        return true;
      }
      // Far enough on not to be overtaken again at once.
      const std::uint64_t oldest = written - ring_->capacity() * 3 / 4;
      lost_ += oldest - next_;
      next_ = oldest;
    }
  }

  // How many there were before the next.
  std::uint64_t position() const noexcept { return next_; }

  // Elements that were overwritten before they were read.
  std::uint64_t lost() const noexcept { return lost_; }

 private:
  const Ring<T>* ring_;
  std::uint64_t next_ = 0, lost_ = 0;
};

}  // namespace bridge
