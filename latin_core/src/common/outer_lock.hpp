#pragma once

namespace latin {

/// A lock of the program around this library: whoever works with PETSc or MPI elsewhere in the process holds
/// it, such as the lock of Python's interpreter. Without one it does nothing. A thread may hold it several
/// times.
class OuterLock {
 public:
  struct Functions {
    int (*enter)() = nullptr;
    void (*leave)(int entered) = nullptr;
  };
  /// Say what the lock is. Once, before any thread uses the library.
  static void set(Functions functions);

  /// @param wanted false: nothing is locked
  explicit OuterLock(bool wanted = true);
  OuterLock(const OuterLock&) = delete;
  OuterLock& operator=(const OuterLock&) = delete;
  OuterLock(OuterLock&&) = delete;
  OuterLock& operator=(OuterLock&&) = delete;
  ~OuterLock();

 private:
  void (*leave_)(int) = nullptr;
  int entered_ = 0;
};

}  // namespace latin
