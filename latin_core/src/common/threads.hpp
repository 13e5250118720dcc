#pragma once

#include <algorithm>
#include <cstddef>
#include <deque>
#include <functional>
#include <vector>

#include "latin/common/communicator.hpp"
#include "latin/common/types.hpp"

namespace latin {

/// Let the linear algebra of this rank use its share of the cores of its machine: its own, where ranks are
/// bound to different ones, else an equal part. A smaller number of threads (OMP_NUM_THREADS) is kept.
/// Collective. @return threads that a rank may use
int bound_threads(const Communicator& communicator);

/// Threads of the linear algebra, also while it has to work on one of them; 1 where that cannot be asked, and for who is at
/// work on a piece of side_by_side() or in_lanes().
[[nodiscard]] int threads_of_algebra();

/// As long as one lives, the linear algebra works on one thread, and what it rounds does not depend on how many there
/// are: side_by_side() and in_lanes() have the others. Any number may live at once, also on several threads.
class SerialAlgebra {
 public:
  SerialAlgebra();
  ~SerialAlgebra();
  SerialAlgebra(const SerialAlgebra&) = delete;
  SerialAlgebra& operator=(const SerialAlgebra&) = delete;
  SerialAlgebra(SerialAlgebra&&) = delete;
  SerialAlgebra& operator=(SerialAlgebra&&) = delete;
};

/// Call `work` of every number in `order`, which begin in this order, on as many threads as the linear algebra has
/// (OMP_NUM_THREADS, bound_threads()); that works on one thread meanwhile. All are called, also after one has failed.
/// @throws what the work of the smallest number that failed has thrown
void side_by_side(const std::vector<std::size_t>& order,
                  const std::function<void(std::size_t)>& work);

/// What every thread of in_lanes() has for itself.
template <class Own>
class PerLane {
 public:
  [[nodiscard]] Own& operator[](std::size_t lane) { return own_[lane]; }
  void grow(std::size_t lanes) {
    while (own_.size() < lanes) {
      own_.emplace_back();
    }
  }

 private:
  std::deque<Own> own_;
};

namespace detail {
using PieceCall = void (*)(void* work, std::size_t piece, std::size_t lane);
/// On how many threads pieces are worth to be done.
std::size_t lanes_of(std::size_t count, double numbers);
void in_lanes(std::size_t lanes, std::size_t count, PieceCall call, void* work);
}  // namespace detail

/// Call `work(piece, own)` of every piece below `count`, side by side on several threads where that pays, in no order.
/// Pieces must not depend on each other, and be cut without regard to the number of threads: then results do not depend
/// on it. Within a piece everything is on one thread. Small ones are all done by the caller.
/// @param numbers about how many are read, written or calculated with by all pieces together
/// @param own     working blocks: one thread at a time has one of them
/// @throws what the smallest piece that failed has thrown
template <class Own, class Work>
void in_lanes(std::size_t count, double numbers, PerLane<Own>& own, const Work& work) {
  const std::size_t lanes = detail::lanes_of(count, numbers);
  own.grow(lanes);
  auto call = [&](std::size_t piece, std::size_t lane) { work(piece, own[lane]); };
  using Call = decltype(call);
  detail::in_lanes(
      lanes, count,
      [](void* called, std::size_t piece, std::size_t lane) {
        (*static_cast<Call*>(called))(piece, lane);
      },
      &call);
}

/// The same with `work(piece)`.
template <class Work>
void in_lanes(std::size_t count, double numbers, const Work& work) {
  auto call = [&](std::size_t piece) { work(piece); };
  using Call = decltype(call);
  detail::in_lanes(
      detail::lanes_of(count, numbers), count,
      [](void* called, std::size_t piece, std::size_t /*lane*/) {
        (*static_cast<Call*>(called))(piece);
      },
      &call);
}

/// Call `work(first, count)` of pieces of `piece` rows of `size`, the last one smaller, side by side as in_lanes() does.
/// @param depth numbers of a row
template <class Work>
void in_pieces(Index size, Index piece, Index depth, const Work& work) {
  const auto pieces = static_cast<std::size_t>((size + piece - 1) / piece);
  in_lanes(pieces, static_cast<double>(size * depth), [&](std::size_t number) {
    const Index first = piece * static_cast<Index>(number);
    work(first, std::min(piece, size - first));
  });
}

}  // namespace latin
