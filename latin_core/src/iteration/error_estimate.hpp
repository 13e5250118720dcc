#pragma once

#include <array>
#include <cstddef>
#include <functional>

#include "common/numbers.hpp"
#include "iteration/anderson.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "substructure/size.hpp"

namespace latin::iteration {

/// A history that explains less of the residual than this says nothing about the error.
inline constexpr double least_explained = 0.05;
/// The two stages of a converged run agree. Where a law has just changed its branch the history predicts
/// nothing, so no estimate is believed that lies further than this below the distance of the stages.
inline constexpr double least_of_indicator = 0.3;
/// A residual below this share of the data is rounding.
inline constexpr double rounding_share = 2e-13;
/// An estimate of rounding below so many tolerances is no reason to refuse an answer.
inline constexpr double bearable_rounding = 3.0;

/// This rank's shares of the squared distance of the two stages and of their squared size, in k and 1/k.
/// @param weights, directions W and k of the rows
[[nodiscard]] std::array<double, 2> stage_shares(const Vector& weights, const Vector& directions,
                                                 const State& state, ConstMatrixRef residual);
/// The paper's indicator (Ladeveze 1999), from the sums of the shares: distance over size.
[[nodiscard]] double stage_distance(const std::array<double, 2>& shares);

/// How large solutions are, in a measure that does not depend on the search direction.
struct Gauge {
  /// Sizes of a difference of two solutions.
  std::function<substructure::Sizes(ConstMatrixRef data, ConstMatrixRef traces)> of_difference;
  /// Sizes of the difference of two states.
  std::function<substructure::Sizes(const State&, const State&)> of_distance;
};

/// The size of an iterate, for errors relative to it.
struct Whole {
  substructure::Sizes sizes;
  substructure::Yardstick yardstick;

  /// Relative errors (groups, bodies) of which these are the sizes.
  [[nodiscard]] Matrix relative(const substructure::Sizes& error) const {
    return yardstick.relative(error, sizes);
  }
  /// The same with what is next to rounding of the displacements of other bodies.
  [[nodiscard]] Matrix relative_with_noise(const substructure::Sizes& error) const {
    return larger(relative(error), yardstick.relative(error, sizes, substructure::Noise::counted));
  }
};

/// The largest of a table of errors, 0 of none. NaN where one of them is.
[[nodiscard]] double largest(const Matrix& errors);

/// The errors (groups, bodies) of an iterate as its history predicts them, relative to the size of the iterate.
/// What the history cannot explain is taken to be amplified as much as what it can.
[[nodiscard]] Matrix predicted_errors(const Gauge& gauge, ConstMatrixRef data,
                                      ConstMatrixRef traces, double explained, const Whole& whole);

/// What earlier iterates turned out to be wrong by, and what follows for the present one.
///
/// An estimate sees an error only as far as the last steps have moved it: parts that hardly move (a search
/// direction far off) hide. In hindsight they do not: the distance from an earlier iterate to the present,
/// much better one is the error that the earlier one had. It is carried to the present iterate by the
/// geometric mean of the falls of its estimate and of its residual since then, of which the first
/// falls too fast where an error hides and the second depends on the search direction.
class Hindsight {
 public:
  static constexpr std::size_t most = 2;  ///< iterates kept

  /// @param rows, columns of the states
  Hindsight(Index rows, Index columns);

  /// The estimates of the present iterate of that residual and size, raised to what the iterates kept say.
  /// @param estimates  (groups, bodies)
  /// @param estimate   the largest of them on all ranks
  [[nodiscard]] Matrix raised(const Gauge& gauge, const State& state, const Matrix& estimates,
                              double estimate, double residual, const Whole& whole) const;
  /// Keep an iterate, if its residual is well below that of the last one kept.
  void keep(const State& state, double estimate, double residual);

 private:
  struct Kept {
    State state;
    double estimate = 0.0;
    double residual = 0.0;
  };

  std::array<Kept, most> kept_;  ///< the newest first
  std::size_t size_ = 0;
};

/// What was measured of an iterate, summed over the ranks.
struct Measured {
  double residual = 0.0;   ///< |r| in sqrt(W/k)
  double data = 0.0;       ///< |s| in sqrt(W/k)
  double indicator = 0.0;  ///< the paper's error indicator
  double strain = 0.0;     ///< u^T K u of all bodies
  Whole whole;             ///< of the solution on this rank

  [[nodiscard]] double rounding() const { return rounding_share * data; }
};

/// The estimated relative error of the iterates of a run, in a measure that does not depend on k.
class ErrorEstimate {
 public:
  /// Largest of a number over all ranks.
  using Maximum = std::function<double(double)>;

  /// @param rows, columns of the states
  /// @param own_needed steps of its own that a run needs before its history is believed
  /// @param maximum empty: there is one rank
  ErrorEstimate(Gauge gauge, Index rows, Index columns, Index own_needed, Maximum maximum = {});

  /// A step was taken.
  void count_step() { ++own_; }
  /// The iterate jumped: its history begins again.
  void restart() { own_ = 0; }
  /// Whether the history has enough steps of this run.
  [[nodiscard]] bool ready() const { return own_ >= own_needed_; }
  /// The largest error on all ranks. Collective.
  [[nodiscard]] double largest(const Matrix& errors) const;

  /// Errors (groups, bodies) by the history, and by what it said of earlier iterates; infinity if it says nothing.
  /// Collective.
  [[nodiscard]] Matrix by_history(const Anderson& history, const State& state,
                                  const Measured& measured);
  /// By a step that Newton's method proposes: it is the error as far as the linearisation holds, of which the
  /// fraction `left` of the residual says how far that is.
  [[nodiscard]] Matrix by_step(const State& step, double left, const Measured& measured) const;

 private:
  [[nodiscard]] Matrix of_fit(const Anderson& history, const Measured& measured) const;
  [[nodiscard]] Matrix amplifications(const Anderson& history, const Measured& measured) const;

  Gauge gauge_;
  Hindsight hindsight_;
  Index own_needed_;
  Maximum maximum_;
  Index own_ = 0;
};

}  // namespace latin::iteration
