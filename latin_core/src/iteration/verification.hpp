#pragma once

#include <memory>
#include <optional>

#include "iteration/anderson.hpp"
#include "iteration/error_estimate.hpp"
#include "iteration/linearisation.hpp"
#include "iteration/stages.hpp"

namespace latin::iteration {

/// How wrong an iterate is, by a few steps of Newton's method on the assembled structure from a copy of it.
///
/// An iteration only knows what it has seen move. Here the residual is divided by the stiffness of the whole
/// structure with the tangents of its laws (`Tangent`), in which no soft or light part can hide. The distance to
/// where these steps lead is the error, once they have become short beside it. On several ranks every one takes the
/// steps of the whole structure, and all decide by the same numbers: everything is collective.
class Verification {
 public:
  /// Forces of the laws and of the bodies may differ by so many tolerances.
  static constexpr double bearable_imbalance = 3.0;
  /// Errors of nonlinear laws below this are not told apart: short steps do not say how short the next one is.
  [[nodiscard]] static double resolution(double rtol);

  /// Whether the structure can be linearised: not for long histories of laws with memory. Collective.
  [[nodiscard]] static bool known(const substructure::Laws& laws);

  /// Whether every estimate is checked: not where the stiffness of bodies varies, but for what is solved at once.
  /// Collective.
  [[nodiscard]] static bool possible(const substructure::Laws& laws);

  /// Whether one step of it is exact for these laws, but for what the tangents of rigid ones leave. Collective.
  [[nodiscard]] static bool exact(const substructure::Laws& laws);

  /// Whether the columns are those of a chaos that can be solved for at once: with linear laws, on one rank.
  [[nodiscard]] static bool coupled(const substructure::Laws& laws);

  /// @param stages of the run; they must outlive this object
  /// @param known  of a near parameter set, to begin with and to be replaced; null: nothing is known
  explicit Verification(Stages& stages, std::shared_ptr<Linearisation> known = {});

  /// The step from an iterate to the answer of a chaos: see coupled().
  /// @param tolerance on the error that it leaves, relative
  /// @param step      the residual, which becomes the step on the data
  /// @return whether there is one
  [[nodiscard]] bool solve_coupled(const State& state, double tolerance, Matrix& step);

  struct Found {
    Matrix errors;            ///< (groups, bodies of this rank) of the iterate
    Matrix errors_better;     ///< of the better one, at most
    double imbalance;         ///< of the iterate, see Linearisation::imbalance()
    double imbalance_better;  ///< of the better one, beyond rounding
    bool rounding;            ///< only rounding keeps the better one from the tolerance, by far
  };
  /// @param residual of the iterate
  /// @param whole    what errors are relative to
  /// @param rtol     errors far below this need not be known
  /// @param at_most_once take no steps, unless only rounding is left to be told from an error
  /// @return nothing where the steps do not become short: the error is not known
  [[nodiscard]] std::optional<Found> check(const State& state, const Matrix& residual,
                                           const Whole& whole, double rtol,
                                           bool at_most_once = false);
  /// Whether the iterate of the last check is an equilibrium but for rounding. What its steps move none the less hangs
  /// on nothing: any place of that is an answer.
  [[nodiscard]] bool at_rounding() const { return at_rounding_; }
  /// What rounding leaves was measured of a state that is no answer: measure it again.
  void forget_rounding() { linear_->forget_rounding(); }
  /// Look for the answer itself, by steps of the same kind with the bodies held back (pseudo-transient
  /// continuation, C. T. Kelley and D. E. Keyes, SIAM J. Numer. Anal. 35 (1998) 508): what is left to try where an
  /// iteration got stuck.
  /// @param least residual norm at which to stop
  /// @param most  global stages
  /// @return whether the residual has fallen; better() is then where it is least
  bool search(const State& state, const Matrix& residual, double least, Index most);
  /// Where the last check or search has led to.
  [[nodiscard]] const State& better() const { return better_; }
  [[nodiscard]] const Matrix& better_residual() const { return residual_; }
  /// Its distance from the iterate: what the error is at least like, if nothing was found.
  [[nodiscard]] const Matrix& distance() const { return distance_; }

 private:
  [[nodiscard]] static bool tells(const substructure::Laws& laws);
  bool evaluate(State& state, Matrix& residual);
  /// Of the tables on all ranks, and whether something holds on all.
  [[nodiscard]] double largest(const Matrix& errors) const;
  [[nodiscard]] double agreed(double value) const;
  [[nodiscard]] bool everywhere(bool holds) const;
  [[nodiscard]] std::optional<Found> at_once(const State& state, const Matrix& residual,
                                             const Whole& whole, double rtol, double spread);
  [[nodiscard]] substructure::Sizes leak(const substructure::Sizes& errors, double spread) const;
  [[nodiscard]] bool stays_in_branch(const Matrix& step) const;
  struct Best {
    State state;
    Matrix residual;
    double norm;
  };
  bool held_step(double hold, double& norm);
  void search_once(double patience, double least, Index until, Best& best);
  [[nodiscard]] Matrix carried(Matrix errors) const;
  void plain_steps(Index count, double& norm);

  Stages& stages_;
  Gauge gauge_;
  std::shared_ptr<Linearisation> linear_;
  Anderson history_;
  State better_;
  Matrix residual_;
  Matrix distance_;
  Matrix moved_;
  double spread_of_coupled_ =
      0.0;           ///< bound of errors in energy, see Coupled::correct(); 0: not known
  Vector energies_;  ///< of the coupled solution so far
  int rounds_ = 0;   ///< of it
  bool at_rounding_ = false;
  bool rounding_decides_ =
      false;  ///< whether an iterate is an answer: nothing else keeps it from that
};

}  // namespace latin::iteration
