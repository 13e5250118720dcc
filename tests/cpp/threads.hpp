#pragma once

extern "C" {
int openblas_get_num_threads() __attribute__((weak));
void openblas_set_num_threads(int) __attribute__((weak));
}

/// As if OMP_NUM_THREADS had been so much. Without OpenBLAS everything is on one thread.
class Threads {
 public:
  explicit Threads(int count) {
    if (openblas_set_num_threads != nullptr) {
      before_ = openblas_get_num_threads();
      openblas_set_num_threads(count);
    }
  }
  ~Threads() {
    if (before_ > 0) {
      openblas_set_num_threads(before_);
    }
  }
  Threads(const Threads&) = delete;
  Threads& operator=(const Threads&) = delete;
  Threads(Threads&&) = delete;
  Threads& operator=(Threads&&) = delete;

 private:
  int before_ = 0;
};

/// While one lives, the system has no more threads to give.
class NoMoreThreads {
 public:
  NoMoreThreads() { wanted = true; }
  ~NoMoreThreads() { wanted = false; }
  NoMoreThreads(const NoMoreThreads&) = delete;
  NoMoreThreads& operator=(const NoMoreThreads&) = delete;
  NoMoreThreads(NoMoreThreads&&) = delete;
  NoMoreThreads& operator=(NoMoreThreads&&) = delete;

  /// Asked by pthread_create() of this program, see main.cpp.
  inline static bool wanted = false;
};
