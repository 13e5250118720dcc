#include "latin/common/threads.hpp"

#ifdef __linux__
#include <sched.h>
#endif

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <exception>
#include <thread>

// of whichever BLAS and OpenMP are there; null where they are not
extern "C" {
int openblas_get_num_threads() __attribute__((weak));
void openblas_set_num_threads(int) __attribute__((weak));
int omp_get_max_threads() __attribute__((weak));
void omp_set_num_threads(int) __attribute__((weak));
}

namespace latin {
namespace {

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

}  // namespace

int threads_of_algebra() {
  if (openblas_get_num_threads != nullptr) {
    return std::max(openblas_get_num_threads(), 1);
  }
  return omp_get_max_threads != nullptr ? std::max(omp_get_max_threads(), 1) : 1;
}

OneThread::OneThread() {
  if (openblas_get_num_threads != nullptr && openblas_set_num_threads != nullptr) {
    before_ = openblas_get_num_threads();
    if (before_ > 1) {
      openblas_set_num_threads(1);
    }
  }
}

OneThread::~OneThread() {
  if (before_ > 1) {
    openblas_set_num_threads(before_);
  }
}

void side_by_side(const std::vector<std::size_t>& order,
                  const std::function<void(std::size_t)>& work, int threads) {
  const auto count = std::min(order.size(), static_cast<std::size_t>(threads));
  if (count < 2) {
    std::vector<std::size_t> sorted = order;  // the first that fails has the smallest number
    std::ranges::sort(sorted);
    std::ranges::for_each(sorted, work);
    return;
  }
  const OneThread one;
  std::atomic<std::size_t> next{0};
  std::vector<std::exception_ptr> failures(*std::ranges::max_element(order) + 1);
  const auto take = [&] {
    for (std::size_t at = next++; at < order.size(); at = next++) {
      try {
        work(order[at]);
      } catch (...) {
        failures[order[at]] = std::current_exception();
      }
    }
  };
  {
    std::vector<std::jthread> others;
    for (std::size_t each = 1; each < count; ++each) {
      others.emplace_back(take);
    }
    take();
  }
  for (const std::exception_ptr& failure : failures) {
    if (failure) {
      std::rethrow_exception(failure);
    }
  }
}

int bound_threads(const Communicator& communicator) {
  auto cores = own_cores();
  auto threads = static_cast<int>(std::ranges::count(cores, 1));
  if (!communicator.alone()) {
    MPI_Comm machine = MPI_COMM_NULL;
    MPI_Comm_split_type(communicator.mpi(), MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine);
    int ranks = 1;
    MPI_Comm_size(machine, &ranks);
    int sum = threads;
    MPI_Allreduce(MPI_IN_PLACE, &sum, 1, MPI_INT, MPI_SUM, machine);
    MPI_Allreduce(MPI_IN_PLACE, cores.data(), static_cast<int>(cores.size()), MPI_UNSIGNED_CHAR,
                  MPI_MAX, machine);
    MPI_Comm_free(&machine);
    const auto all = static_cast<int>(std::ranges::count(cores, 1));
    if (sum > all) {  // not bound to cores of their own
      threads = all / ranks;
    }
  }
  threads = std::max(threads, 1);
  if (openblas_get_num_threads != nullptr && openblas_set_num_threads != nullptr) {
    openblas_set_num_threads(std::min(openblas_get_num_threads(), threads));
  }
  if (omp_get_max_threads != nullptr && omp_set_num_threads != nullptr) {
    omp_set_num_threads(std::min(omp_get_max_threads(), threads));
  }
  return threads;
}

}  // namespace latin
