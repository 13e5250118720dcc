#include "common/threads.hpp"

#ifdef __linux__
#include <sched.h>
#endif

#include <unistd.h>
#include <csignal>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <exception>
#include <limits>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "latin/common/interrupt.hpp"

// of whichever BLAS and OpenMP are there; null where they are not
extern "C" {
int openblas_get_num_threads() __attribute__((weak));
void openblas_set_num_threads(int) __attribute__((weak));
int omp_get_max_threads() __attribute__((weak));
void omp_set_num_threads(int) __attribute__((weak));
}

namespace latin {
namespace {

/// Work on fewer numbers takes less time than waking a thread does.
constexpr double least_shared = 2e5;

constexpr std::chrono::milliseconds between_questions{200};

/// Of this thread, and whether it has made it.
// NOLINTBEGIN(cppcoreguidelines-avoid-non-const-global-variables)
thread_local Interruptible* innermost = nullptr;
thread_local bool owns = false;
// NOLINTEND(cppcoreguidelines-avoid-non-const-global-variables)

/// Bytes, one a core: 1 where this process may run.
std::array<unsigned char, 1024> own_cores() {
  std::array<unsigned char, 1024> cores{};
#ifdef __linux__
  cpu_set_t mask;
  CPU_ZERO(&mask);
  if (sched_getaffinity(0, sizeof(mask), &mask) == 0) {
    for (std::size_t core = 0; core < cores.size() && core < CPU_SETSIZE; ++core) {
      cores[core] = CPU_ISSET(core, &mask) ? 1 : 0;
    }
    return cores;
  }
#endif
  const std::size_t count = std::max(1U, std::thread::hardware_concurrency());
  std::fill_n(cores.begin(), std::min(count, cores.size()), 1);
  return cores;
}

/// Threads of the linear algebra, and how many wish it to have one.
struct Algebra {
  std::mutex mutex;
  int serial = 0;
  int threads = 1;  ///< as it was before the first of them

  static Algebra& of_process() {
    static Algebra algebra;
    return algebra;
  }
  /// 1 where that cannot be asked.
  static int asked() {
    if (openblas_get_num_threads != nullptr) {
      return std::max(openblas_get_num_threads(), 1);
    }
    return omp_get_max_threads != nullptr ? std::max(omp_get_max_threads(), 1) : 1;
  }
  static void set(int threads) {
    if (openblas_get_num_threads != nullptr && openblas_set_num_threads != nullptr) {
      openblas_set_num_threads(threads);
    }
  }
};

/// Whether this thread is at work on a piece.
thread_local bool within = false;  // NOLINT(cppcoreguidelines-avoid-non-const-global-variables)

/// Threads that wait for work. They live as long as the process: what they wait for must not be destroyed before.
class Team {
 public:
  /// The one of this process; a process that was forked has none of the threads of the other.
  static Team& of_process() {
    static std::mutex mutex;
    static Team* team = nullptr;
    static pid_t owner = 0;
    const std::scoped_lock lock(mutex);
    if (team == nullptr || owner != getpid()) {
      team = new Team;  // NOLINT(cppcoreguidelines-owning-memory): see above
      owner = getpid();
    }
    return *team;
  }

  /// @return whether they were free: else the caller does it alone
  bool run(std::size_t threads, std::size_t count, detail::PieceCall call, void* work) {
    const std::unique_lock free(free_, std::try_to_lock);
    if (!free) {
      return false;
    }
    const SerialAlgebra serial;
    while (others_ + 1 < threads) {
      try {
        std::thread([this, lane = others_ + 1] { serve(lane); }).detach();
      } catch (const std::system_error&) {
        break;  // no more threads to be had
      }
      ++others_;
    }
    {
      const std::scoped_lock lock(mutex_);
      call_ = call;
      work_ = work;
      count_ = count;
      next_ = 0;
      failure_ = nullptr;
      first_failed_ = count;
      wanted_ = threads;
      ends_with_ = Interruptible::of_thread();
      ++round_;
    }
    wake_.notify_all();
    take(0);
    std::unique_lock lock(mutex_);
    wanted_ = 0;  // who wakes up now is too late
    while (!finished_.wait_for(lock, between_questions, [this] { return at_work_ == 0; })) {
      if (ends_with_ != nullptr) {  // the others have to be told
        lock.unlock();
        static_cast<void>(ends_with_->ends());
        lock.lock();
      }
    }
    if (failure_) {
      std::rethrow_exception(std::exchange(failure_, nullptr));
    }
    return true;
  }

 private:
  void take(std::size_t lane) {
    within = true;
    for (std::size_t piece = next_++; piece < count_; piece = next_++) {
      try {
        call_(work_, piece, lane);
      } catch (...) {
        const std::scoped_lock lock(mutex_);
        if (piece < first_failed_) {
          first_failed_ = piece;
          failure_ = std::current_exception();
        }
      }
    }
    within = false;
  }

  [[noreturn]] void serve(std::size_t lane) {
    sigset_t all;  // signals are for the others
    sigfillset(&all);
    pthread_sigmask(SIG_BLOCK, &all, nullptr);
    std::uint64_t seen = 0;
    for (;;) {
      {
        std::unique_lock lock(mutex_);
        wake_.wait(lock, [&] { return round_ != seen && lane < wanted_; });
        seen = round_;
        ++at_work_;
        Interruptible::take_part(ends_with_);
      }
      take(lane);
      {
        const std::scoped_lock lock(mutex_);
        --at_work_;
      }
      finished_.notify_one();
    }
  }

  std::mutex free_;  ///< held by who has them
  std::size_t others_ = 0;
  std::mutex mutex_;
  std::condition_variable wake_;
  std::condition_variable finished_;
  std::uint64_t round_ = 0;
  Interruptible* ends_with_ = nullptr;
  std::size_t wanted_ = 0;  ///< lanes of this round; 0: it is over
  std::size_t at_work_ = 0;
  detail::PieceCall call_ = nullptr;
  void* work_ = nullptr;
  std::size_t count_ = 0;
  std::atomic<std::size_t> next_{0};
  std::exception_ptr failure_;
  std::size_t first_failed_ = 0;
};

}  // namespace

Interruptible::Interruptible(std::function<bool()> wanted)
    : wanted_(std::move(wanted)), outer_(innermost) {
  innermost = this;
  owns = true;
}

Interruptible::~Interruptible() {
  innermost = outer_;
  owns = outer_ != nullptr;
}

Interruptible* Interruptible::of_thread() { return innermost; }

void Interruptible::take_part(Interruptible* other) {
  innermost = other;
  owns = false;
}

bool Interruptible::ends() {
  const Clock::time_point now = Clock::now();
  if (!ended_ && owns && innermost == this && now - asked_ >= between_questions) {
    try {
      ended_ = wanted_();
    } catch (...) {
      failure_ = std::current_exception();
      ended_ = true;
    }
    asked_ = Clock::now();
  }
  return ended_;
}

void Interruptible::pass_on() const {
  if (failure_) {
    std::rethrow_exception(failure_);
  }
}

void stop_if_wanted() {
  if (innermost != nullptr && innermost->ends()) {
    throw Interrupted();
  }
}

int threads_of_algebra() {
  if (within) {
    return 1;
  }
  Algebra& algebra = Algebra::of_process();
  const std::scoped_lock lock(algebra.mutex);
  return algebra.serial > 0 ? algebra.threads : Algebra::asked();
}

SerialAlgebra::SerialAlgebra() {
  Algebra& algebra = Algebra::of_process();
  const std::scoped_lock lock(algebra.mutex);
  if (algebra.serial++ == 0) {
    algebra.threads = Algebra::asked();
    if (algebra.threads > 1) {
      Algebra::set(1);
    }
  }
}

SerialAlgebra::~SerialAlgebra() {
  Algebra& algebra = Algebra::of_process();
  const std::scoped_lock lock(algebra.mutex);
  if (--algebra.serial == 0 && algebra.threads > 1) {
    Algebra::set(algebra.threads);
  }
}

void side_by_side(const std::vector<std::size_t>& order,
                  const std::function<void(std::size_t)>& work) {
  // all are called, and the first failure is that of the smallest number
  std::vector<std::exception_ptr> failures(order.empty() ? 0
                                                         : *std::ranges::max_element(order) + 1);
  const auto attempt = [&](std::size_t piece) {
    try {
      work(order[piece]);
    } catch (...) {
      failures[order[piece]] = std::current_exception();
    }
  };
  in_lanes(order.size(), std::numeric_limits<double>::infinity(), attempt);
  for (const std::exception_ptr& failure : failures) {
    if (failure) {
      std::rethrow_exception(failure);
    }
  }
}

std::size_t detail::lanes_of(std::size_t count, double numbers) {
  const bool small = count < 2 || numbers < least_shared;
  return small ? 1 : std::min(count, static_cast<std::size_t>(threads_of_algebra()));
}

void detail::in_lanes(std::size_t lanes, std::size_t count, PieceCall call, void* work) {
  if (lanes > 1 && Team::of_process().run(lanes, count, call, work)) {
    return;
  }
  for (std::size_t piece = 0; piece < count; ++piece) {
    call(work, piece, 0);
  }
}

int bound_threads(const Communicator& communicator) {
  auto cores = own_cores();
  auto threads = static_cast<int>(std::ranges::count(cores, 1));
  if (!communicator.alone()) {
    MPI_Comm machine = MPI_COMM_NULL;
    check_mpi(
        MPI_Comm_split_type(communicator.mpi(), MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine),
        "MPI_Comm_split_type");
    int ranks = 1;
    check_mpi(MPI_Comm_size(machine, &ranks), "MPI_Comm_size");
    int sum = threads;
    check_mpi(MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_INT, MPI_SUM, machine), "MPI_Allreduce");
    check_mpi(MPI_Allreduce(MPI_IN_PLACE, cores.data(), static_cast<int>(cores.size()),
                            MPI_UNSIGNED_CHAR, MPI_MAX, machine),
              "MPI_Allreduce");
    check_mpi(MPI_Comm_free(&machine), "MPI_Comm_free");
    const auto all = static_cast<int>(std::ranges::count(cores, 1));
    if (sum > all) {  // not bound to cores of their own
      threads = all / ranks;
    }
  }
  threads = std::max(threads, 1);
  {
    Algebra& algebra = Algebra::of_process();
    const std::scoped_lock lock(algebra.mutex);
    if (algebra.serial > 0) {
      algebra.threads = std::min(algebra.threads, threads);
    } else if (openblas_get_num_threads != nullptr) {
      Algebra::set(std::min(Algebra::asked(), threads));
    }
  }
  if (omp_get_max_threads != nullptr && omp_set_num_threads != nullptr) {
    omp_set_num_threads(std::min(omp_get_max_threads(), threads));
  }
  return threads;
}

}  // namespace latin
