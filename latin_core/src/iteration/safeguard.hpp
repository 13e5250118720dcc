#pragma once

#include <limits>

#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"

namespace latin::iteration {

/// Keeps an accelerated run from getting lost.
///
/// An accelerated step may lead astray, or in circles, where a law changes its branch (contact opens,
/// friction slips). Then the best iterate is taken up again, the history dropped, and some plain steps lead
/// on, more each time. If they only lead back here, that iterate is a trap (friction is not monotone): the run
/// goes on from where it is.
class Safeguard {
 public:
  /// Take note of an iterate of that residual norm, or put the best one back in its place.
  /// @param iteration number of the iteration
  /// @param rounding  a residual up to this is at rest: it leads nowhere else
  /// @return whether the history must be dropped
  [[nodiscard]] bool guard(Index iteration, double norm, double rounding, Iterate at);
  /// Whether the next step is a plain one.
  [[nodiscard]] bool plain() const { return pause_ > 0; }
  /// A step was taken.
  void count_step() { pause_ = pause_ > 0 ? pause_ - 1 : 0; }
  /// Let the next steps be plain ones.
  void pause(Index steps) { pause_ = steps; }
  /// The run has jumped to another iterate: no earlier one is taken up again.
  void jumped(Index iteration, double norm, Iterate at);
  /// Residuals before this are not to be compared with what comes.
  void forget() { best_norm_ = std::numeric_limits<double>::infinity(); }

  /// Put the best iterate back in its place. @return whether there is one
  [[nodiscard]] bool restore(Iterate at) const;
  [[nodiscard]] double best_norm() const { return best_norm_; }
  /// Times the history was dropped.
  [[nodiscard]] Index restarts() const { return restarts_; }

 private:
  void remember(Index iteration, double norm, Iterate at);

  bool kept_ = false;  ///< whether there is a best iterate, which may have no rows on this rank
  State best_;         ///< iterate with the smallest residual
  Matrix best_residual_;
  double best_norm_ = std::numeric_limits<double>::infinity();
  Index best_at_ = 0;      ///< iteration of the best iterate
  bool trapped_ = false;   ///< no better iterate was found since the last return to the best one
  Index pause_ = 0;        ///< plain steps still to be taken
  Index plain_steps_ = 4;  ///< after the next restart
  Index restarts_ = 0;
};

}  // namespace latin::iteration
