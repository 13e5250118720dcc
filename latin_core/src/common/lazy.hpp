#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <utility>

namespace latin {

/// A value that is made once, when a thread first asks for it.
///
/// It must not be moved while a thread asks for it. Threads that ask meanwhile wait until the value is made, so
/// making it must not wait for anything that they may hold (for example Python's interpreter lock).
template <class T>
class Lazy {
 public:
  /// The value, or null if it has not been made yet.
  [[nodiscard]] const T* made() const { return state_->ready.load(std::memory_order_acquire); }

  /// The value; `make()` returns it. What make() throws is passed on, and the next call tries again.
  template <class Make>
  const T& get(Make&& make) const {
    if (const T* ready = made()) {
      return *ready;
    }
    const std::scoped_lock lock(state_->mutex);
    if (state_->value == nullptr) {
      state_->value = std::make_unique<const T>(std::forward<Make>(make)());
      state_->ready.store(state_->value.get(), std::memory_order_release);
    }
    return *state_->value;
  }

 private:
  struct State {
    std::mutex mutex;
    std::unique_ptr<const T> value;
    std::atomic<const T*> ready{nullptr};
  };
  std::unique_ptr<State> state_ = std::make_unique<State>();
};

/// A number that several threads add to. It must not be moved meanwhile.
class Counter {
 public:
  Counter() = default;
  Counter(Counter&& other) noexcept : count_(other.count_.load(std::memory_order_relaxed)) {}
  Counter(const Counter&) = delete;
  Counter& operator=(const Counter&) = delete;
  Counter& operator=(Counter&&) = delete;
  ~Counter() = default;

  /// @return the sum
  long long add(long long more) { return count_.fetch_add(more, std::memory_order_relaxed) + more; }

 private:
  std::atomic<long long> count_{0};
};

}  // namespace latin
