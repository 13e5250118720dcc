#pragma once

#include <functional>
#include <limits>
#include <vector>

#include "iteration/anderson.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"

namespace latin::iteration {

/// The two stages, as a step sees them: anything that has both can be iterated on.
struct FixedPoint {
  /// Traces of the data, to which `step` has just been added. What a coarse problem adds to the data beyond it
  /// is added to the step as well.
  std::function<void(Matrix& step, Matrix& data, Matrix& traces)> global;
  /// Residual of data and traces.
  std::function<void(const Matrix& data, const Matrix& traces, Matrix& residual)> local;
  Preconditioner precondition;  ///< empty: none
};

/// Relaxation of an averaged step, which converges for every monotone law.
inline constexpr double averaged_share = 0.8;

/// The steps of the iteration: of one run, of several parameter sets side by side, of a single column.
class Stepper {
 public:
  /// @param history     learns from every step; it must outlive this object
  /// @param relaxation  mu in (0, 1]: s <- s + mu r (and of Anderson's remainder)
  /// @param longest     accelerated steps so much longer than the residual are not taken, and the history is
  ///                    dropped: nothing answers yet (a body flies through a gap), it says nothing
  Stepper(FixedPoint stages, Anderson& history, double relaxation,
          double longest = std::numeric_limits<double>::infinity());

  /// Start from the affine combination of snapshots (rows, c) with the smallest residual: the same ones for all
  /// sets, one combination each. It costs local stages only, because the global image of a state does not
  /// depend on the laws. The residual is left as that of the first snapshot. Collective.
  void start_from(const std::vector<const State*>& snapshots, Iterate at);

  enum class Kind {
    plain,       ///< the relaxed residual
    averaged,    ///< the same with at most `averaged_share` of it, and without preconditioner
    accelerated  ///< Anderson's, by the last fit of the history
  };
  /// Go one step, through both stages, and hand the difference to the history. Collective.
  void step(Kind kind, Iterate at);
  /// What the first step after start_from() has changed of the residual, relative to the step that was chosen; 0: there
  /// was none. Both stages together do not expand, where laws are monotone: far above 2 the traces of the start were
  /// not those of its data.
  [[nodiscard]] double first_change() const { return first_change_; }

 private:
  void choose(Kind kind, const Matrix& residual);

  FixedPoint stages_;
  Anderson& history_;
  double relaxation_;
  double longest_;
  bool started_ = false;
  double first_change_ = 0.0;
  // kept from one step to the next: no block is allocated in the iteration
  Matrix step_;
  Matrix residual_change_;
  Matrix traces_change_;
};

}  // namespace latin::iteration
