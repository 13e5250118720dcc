#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <functional>

namespace latin {

/// A callback throws it to end the run with what is done so far; on several ranks, that of any of them does.
class Interrupted : public std::exception {
 public:
  [[nodiscard]] const char* what() const noexcept override { return "interrupted"; }
};

/// As long as one lives, its thread, and those that share its work in in_lanes(), can be ended where they ask for it.
/// They may be nested; the innermost counts. On one rank only: others would wait.
class Interruptible {
 public:
  /// @param wanted asked on the thread that made this, a few times a second: whether it is to end; it may throw
  explicit Interruptible(std::function<bool()> wanted);
  ~Interruptible();
  Interruptible(const Interruptible&) = delete;
  Interruptible& operator=(const Interruptible&) = delete;
  Interruptible(Interruptible&&) = delete;
  Interruptible& operator=(Interruptible&&) = delete;

  /// That of this thread; null: it cannot be ended.
  static Interruptible* of_thread();
  /// Take part in the work of another thread; null: no more.
  static void take_part(Interruptible* other);
  /// Whether it is to end; only its own thread asks anew.
  bool ends();
  /// Throw what `wanted` has thrown, if it has.
  void pass_on() const;

 private:
  using Clock = std::chrono::steady_clock;
  std::function<bool()> wanted_;
  Interruptible* outer_;
  Clock::time_point asked_ = Clock::now();
  std::atomic<bool> ended_{false};
  std::exception_ptr failure_;
};

/// Between pieces of work that takes long. @throws Interrupted if it is to end
void stop_if_wanted();

}  // namespace latin
