#pragma once

#include "latin/common/communicator.hpp"

namespace latin {

/// Let the linear algebra of this rank use its share of the cores of its machine: its own, where ranks are
/// bound to different ones, else an equal part. A smaller number of threads (OMP_NUM_THREADS) is kept.
/// Collective. @return threads that a rank may use
int bound_threads(const Communicator& communicator);

}  // namespace latin
