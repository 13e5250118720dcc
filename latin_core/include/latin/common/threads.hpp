#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "latin/common/communicator.hpp"

namespace latin {

/// Let the linear algebra of this rank use its share of the cores of its machine: its own, where ranks are
/// bound to different ones, else an equal part. A smaller number of threads (OMP_NUM_THREADS) is kept.
/// Collective. @return threads that a rank may use
int bound_threads(const Communicator& communicator);

/// Threads of the linear algebra; 1 where that cannot be asked.
[[nodiscard]] int threads_of_algebra();

/// One thread of the linear algebra, as long as this lives.
class OneThread {
 public:
  OneThread();
  ~OneThread();
  OneThread(const OneThread&) = delete;
  OneThread& operator=(const OneThread&) = delete;
  OneThread(OneThread&&) = delete;
  OneThread& operator=(OneThread&&) = delete;

 private:
  int before_ = 0;
};

/// Call `work` of every number in `order`, which begin in this order, on some threads, as many as the linear algebra has
/// (OMP_NUM_THREADS, bound_threads()) if nothing else is said; that works on one thread meanwhile. All are called, also
/// after one has failed.
/// @throws what the work of the smallest number that failed has thrown
void side_by_side(const std::vector<std::size_t>& order,
                  const std::function<void(std::size_t)>& work, int threads = threads_of_algebra());

}  // namespace latin
