#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <span>

#include "latin/common/types.hpp"
#include "latin/iteration/anderson.hpp"
#include "latin/iteration/state.hpp"
#include "latin/substructure/size.hpp"

namespace latin::iteration {

/// A history that explains less of the residual than this says nothing about the error.
inline constexpr double least_explained = 0.05;
/// The two stages of a converged run agree. Where a law has just changed its branch the history predicts
/// nothing, so no estimate is believed that lies further than this below the distance of the stages.
inline constexpr double least_of_indicator = 0.3;
/// A residual below this share of the data is rounding.
inline constexpr double rounding_share = 2e-13;

/// This rank's shares of the squared distance of the two stages and of their squared size, in k and 1/k.
/// @param weights, directions W and k of the rows
[[nodiscard]] std::array<double, 2> stage_shares(const Vector& weights, const Vector& directions,
                                                 const State& state, ConstMatrixRef residual);
/// The paper's indicator (Ladeveze 1999), from the sums of the shares: distance over size.
[[nodiscard]] double stage_distance(const std::array<double, 2>& shares);

/// How large solutions are, in a measure that does not depend on the search direction.
struct Gauge {
  /// Size of a difference of two solutions. Collective.
  std::function<substructure::Size(ConstMatrixRef data, ConstMatrixRef traces)> of_difference;
  /// This rank's share of the size of the difference of two states.
  std::function<substructure::Size(const State&, const State&)> share_of_distance;
};

/// The error of an iterate as its history predicts it, relative to the size of the iterate. What the history
/// cannot explain is taken to be amplified as much as what it can. Collective.
[[nodiscard]] double predicted_error(const Gauge& gauge, ConstMatrixRef data, ConstMatrixRef traces,
                                     double explained, const substructure::Size& whole);

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
  using Shares = std::array<double, 2 * most>;

  /// @param rows, columns of the states
  Hindsight(Index rows, Index columns);

  /// This rank's shares of the sizes (strain, trace) of the distances to the iterates kept.
  [[nodiscard]] Shares shares(const Gauge& gauge, const State& state) const;
  /// The estimate of the present iterate of that residual and size, raised to what the iterates kept say.
  /// @param sums of the shares over all ranks
  [[nodiscard]] double raised(double estimate, double residual, const substructure::Size& whole,
                              std::span<const double> sums) const;
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
  double residual = 0.0;     ///< |r| in sqrt(W/k)
  double data = 0.0;         ///< |s| in sqrt(W/k)
  double indicator = 0.0;    ///< the paper's error indicator
  substructure::Size whole;  ///< of the solution
  Hindsight::Shares distances{};

  [[nodiscard]] double rounding() const { return rounding_share * data; }
};

/// The estimated relative error of the iterates of a run, in a measure that does not depend on k.
class ErrorEstimate {
 public:
  /// @param rows, columns of the states
  /// @param own_needed steps of its own that a run needs before its history is believed
  ErrorEstimate(Gauge gauge, Index rows, Index columns, Index own_needed);

  /// This rank's shares for `Measured::distances`.
  [[nodiscard]] Hindsight::Shares shares(const State& state) const {
    return hindsight_.shares(gauge_, state);
  }
  /// A step was taken.
  void count_step() { ++own_; }
  /// The iterate jumped: its history begins anew.
  void restart() { own_ = 0; }
  /// Whether the history has enough steps of this run.
  [[nodiscard]] bool ready() const { return own_ >= own_needed_; }

  /// By the history, and by what it said of earlier iterates; infinity if it says nothing. Collective.
  [[nodiscard]] double by_history(const Anderson& history, const State& state,
                                  const Measured& measured);
  /// By a step that Newton's method proposes: it is the error as far as the linearisation holds, of which the
  /// share `left` of the residual says how far that is. Collective.
  [[nodiscard]] double by_step(const State& step, double left, const Measured& measured) const;

 private:
  [[nodiscard]] double of_fit(const Anderson& history, const Measured& measured) const;
  [[nodiscard]] double amplification(const Anderson& history, const Measured& measured) const;

  Gauge gauge_;
  Hindsight hindsight_;
  Index own_needed_;
  Index own_ = 0;
};

}  // namespace latin::iteration
