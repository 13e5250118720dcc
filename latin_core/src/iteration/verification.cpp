#include "iteration/verification.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/numbers.hpp"
#include "latin/common/error.hpp"
#include "substructure/coupled.hpp"

namespace latin::iteration {
namespace {

using substructure::Tangent;

/// Steps at most, and how many of them the next is combined with.
constexpr Index most_checks = 12;
constexpr Index depth = 8;
/// A step below this fraction of the way so far leaves the error known, if it is that much shorter than the last.
constexpr double shorter = 0.25;
constexpr double contraction = 0.5;
/// The same of linear laws, whose steps shorten as the last ones did.
constexpr double linear_contraction = 0.9;
/// A step that is no shorter than the last may be this fraction of what is left.
constexpr double most_left_over = 20.0;
/// What the residual falls to with a step that a law has not made useless by another branch.
constexpr double residual_fall = 0.7;
/// The same with the tangents of another parameter set, which may not know how soft a law is.
constexpr double borrowed_fall = 0.3;
/// Nor may the next step lead into another branch, if the residual has not fallen to this since the first.
constexpr double well_fallen = 0.1;
/// Errors below this fraction of the tolerance need not be known any better.
constexpr double negligible = 0.05;
/// A last step that leads into another branch may be this many times too short.
constexpr double of_other_branch = 4.0;
/// Steps of linear laws with springs for rigid connections may be this many times too short, however fast they shorten:
/// what is soft for the springs is a small share of each.
constexpr double of_springs = 2.0;
/// What a step of linear laws with springs for rigid connections may leave of an error.
constexpr double of_step_left = 0.3;
/// Steps with the tangents of another parameter set before those here are taken.
constexpr Index most_borrowed = 4;
/// Errors of linear laws are known well enough with tangents whose stiffnesses differ by this factor.
constexpr double bearable_spread = 9.0;
/// What conjugate gradients have not seen of the factor between two stiffnesses.
constexpr double safe_spread = 2.0;
/// What may be hidden counts above this share of what is seen.
constexpr double visible = 0.5;
/// Time steps of a history with memory, each of which has tangents of its own.
constexpr Index most_steps_of_history = 16;
/// Steps of a search, and plain steps where those do not help.
constexpr Index most_of_search = 200;
constexpr Index first_pause = 4;
/// A residual of a search may grow by this: it does where a part begins to move.
constexpr double bearable_growth = 1.2;
/// Springs that hold the bodies, relative to the search direction.
constexpr double largest_hold = 25.0;
constexpr double least_hold = Linearisation::least_hold;
/// After so many steps those that are within so many times rounding are short enough.
constexpr Index first_of_rounding = 3;
constexpr double within_rounding = 10.0;

/// Whether the structure of the means is worth its price: of a chaos with random stiffnesses, whose bodies have dense
/// blocks that cost more, it replaces up to hundreds of iterations on all columns.
bool affords_tangent(const substructure::Laws& laws) {
  return Tangent::possible(laws.structure()) ||
         (laws.scales_anywhere() && substructure::Coupled::possible(laws));
}

}  // namespace

bool Verification::tells(const substructure::Laws& laws) {
  return (!laws.scales_anywhere() || laws.stiffness_is_one()) &&
         (laws.steps() <= most_steps_of_history || !laws.remembers_anywhere());
}

bool Verification::known(const substructure::Laws& laws) {
  return affords_tangent(laws) && tells(laws);
}

bool Verification::possible(const substructure::Laws& laws) {
  // a sample with its own stiffness would be condensed for its check alone; tangents of a chaos are those of the means
  return known(laws) && (!laws.scales_anywhere() || coupled(laws));
}

bool Verification::exact(const substructure::Laws& laws) {
  return laws.modes() == 1 && laws.linear_everywhere();
}

bool Verification::coupled(const substructure::Laws& laws) {
  return substructure::Coupled::possible(laws) && affords_tangent(laws);
}

bool Verification::solve_coupled(const State& state, double tolerance, Matrix& step) {
  try {
    linear_->take(stages_.laws(), state);
    substructure::LocalStage local(stages_.laws(), state.data.cols());
    const double spread =
        linear_->correct_coupled(local, tolerance, rounds_++, energies_, step, moved_);
    // a later round sees less
    spread_of_coupled_ = spread > 0.0 ? larger(spread_of_coupled_, safe_spread * spread) : 0.0;
    return spread_of_coupled_ > 0.0;
  } catch (const NumericalError&) {
    return false;  // the iteration may know better
  }
}

double Verification::resolution(double rtol) { return std::min(0.05 * rtol, 2e-9); }

Verification::Verification(Stages& stages, std::shared_ptr<Linearisation> known)
    : stages_(stages),
      gauge_(gauge_of(stages.laws())),
      linear_(known ? std::move(known) : std::make_shared<Linearisation>()),
      history_(metric_of(stages.structure()), stages.amplitudes().cols(), depth) {}

/// Both stages. @return whether the laws have an answer there: too far off they may have none
bool Verification::evaluate(State& state, Matrix& residual) {
  return stages_.try_evaluate({state, residual}) && everywhere(residual.allFinite());
}

double Verification::largest(const Matrix& errors) const {
  return stages_.structure().communicator().largest(iteration::largest(errors));
}

double Verification::agreed(double value) const {
  return stages_.structure().communicator().agreed(value);
}

bool Verification::everywhere(bool holds) const {
  return stages_.structure().communicator().everywhere(holds);
}

/// Errors of steps with those that laws with memory carry over from the steps before.
Matrix Verification::carried(Matrix errors) const {
  const substructure::ColumnGroups groups = stages_.laws().groups();
  if (!stages_.laws().remembers_anywhere()) {
    return errors;
  }
  const Index block = groups.steps * groups.kinds();
  for (Index group = groups.kinds(); group < errors.rows(); ++group) {
    if (group % block >= groups.kinds()) {
      errors.row(group) += errors.row(group - groups.kinds());
    }
  }
  return errors;
}

/// What errors of the means may do to fluctuations where stiffnesses scatter by a factor.
substructure::Sizes Verification::leak(const substructure::Sizes& errors, double spread) const {
  substructure::Sizes leaked = errors;
  const Index kinds = stages_.laws().measured().kinds();
  for (Index group = 0; group < errors.strain.rows(); ++group) {
    const double share = group % kinds > 0 ? (spread - 1.0) * (spread - 1.0) : 0.0;
    const Index of = group - group % kinds;
    leaked.strain.row(group) = share * errors.strain.row(of);
    leaked.trace.row(group) = share * errors.trace.row(of);
  }
  return leaked;
}

/// Of linear laws one step says it all, without another global stage: exactly with their own tangents, and within the
/// factor between the stiffnesses with others.
std::optional<Verification::Found> Verification::at_once(const State& state, const Matrix& residual,
                                                         const Whole& whole, double rtol,
                                                         double spread) {
  const substructure::Laws& laws = stages_.laws();
  const bool of_coupled = spread_of_coupled_ > 0.0;
  if (!exact(laws) && !of_coupled) {
    return std::nullopt;
  }
  if (of_coupled) {
    spread = spread_of_coupled_;
  } else if (!linear_->made() || spread > bearable_spread) {
    try {
      linear_->take(laws, state);
    } catch (const NumericalError&) {
      return std::nullopt;  // the steps say so, too
    }
    spread = 1.0;
  }
  Matrix step = residual;
  linear_->correct(step, moved_);
  const substructure::Sizes difference = gauge_.of_difference(step, moved_);
  Matrix ahead = whole.relative(difference);
  if (!(spread * largest(ahead) <= rtol)) {
    return std::nullopt;
  }
  const bool leaks =
      of_coupled && largest(whole.relative(leak(difference, spread))) > visible * largest(ahead);
  if (leaks || (!of_coupled && linear_->softened())) {
    // springs in the place of rigid connections may be soft for what the points hardly see, and a mean that is wrong
    // makes a fluctuation
    Matrix left(residual.rows(), residual.cols());
    stages_.local(state.data + step, state.traces + moved_, left);
    Matrix moved_on;
    linear_->correct(left, moved_on);
    const Matrix next = whole.relative(gauge_.of_difference(left, moved_on));
    const double least = negligible * rtol / most_left_over;
    // tangents of another set leave as much as their stiffnesses differ
    const double left_over = std::max(of_step_left, 1.0 - 1.0 / spread);
    if (!leaks && !everywhere((next.array() <= (left_over * ahead.array()).max(least)).all())) {
      return std::nullopt;
    }
    ahead += next;
  }
  ahead = larger(ahead, whole.relative_with_noise(difference));
  if (!(spread * largest(ahead) <= rtol)) {
    rounding_decides_ = true;  // or an error in its shadow, which a step will mend
    return std::nullopt;
  }
  const double imbalance = linear_->imbalance(laws, state, residual);
  if (!(imbalance <= bearable_imbalance * rtol)) {
    return std::nullopt;
  }
  const Matrix least_error = linear_->rounding(laws, state, stages_.amplitudes(), whole);
  if (largest(least_error) > rtol) {
    rounding_decides_ = true;
    return std::nullopt;
  }
  const Matrix errors = larger((std::sqrt(spread) * ahead), least_error);
  return Found{errors, errors, imbalance, imbalance, false};
}

std::optional<Verification::Found> Verification::check(const State& state, const Matrix& residual,
                                                       const Whole& at_start, double rtol,
                                                       bool at_most_once) {
  // an iterate may be larger than the answer: errors are relative to where the steps lead
  Whole whole = at_start;
  better_ = state;
  residual_ = residual;
  history_.clear();
  distance_.resize(0, 0);
  Matrix step(residual.rows(), residual.cols());
  Matrix before;
  const double least = negligible * rtol;
  Matrix least_known =
      Matrix::Constant(whole.sizes.strain.rows(), whole.sizes.strain.cols(), least);
  double norm_before = std::numeric_limits<double>::infinity();
  State from;
  Matrix residual_before;
  double noise = 0.0;
  double first_norm = 0.0;
  bool rose = false;
  double spread = 1.0;
  const double bearable_left =
      stages_.laws().linear_everywhere() ? linear_contraction : contraction;
  bool borrowed = linear_->made() && !coupled(stages_.laws());
  if (borrowed) {
    spread = largest_of(linear_->contrasts(stages_.laws(), state), 1.0);
    borrowed = spread <= Linearisation::near_factor;
  }
  if (auto found = at_once(state, residual, at_start, rtol, spread)) {
    return found;
  }
  if (at_most_once && !rounding_decides_) {
    return std::nullopt;
  }
  at_rounding_ = false;
  for (Index count = 0; count <= most_checks; ++count) {
    borrowed = borrowed && count <= most_borrowed;
    const bool was_borrowed = borrowed;
    try {
      if (!borrowed && linear_->take(stages_.laws(), better_)) {
        history_.clear();
      }
    } catch (const NumericalError&) {
      return std::nullopt;  // not stable: its error is anything
    }
    // forces that the meshes do not determine may keep a residual
    const double norm = agreed(linear_->nodal(residual_).norm());
    if (count == 0) {
      first_norm = norm;
      noise = agreed(within_rounding * rounding_share * linear_->nodal(state.data).norm());
    }
    at_rounding_ = at_rounding_ || (count == 0 && norm <= noise);
    if (norm <= noise) {
      // what is left of light parts is no combination of what is rounding of heavy ones
      history_.clear();
    }
    history_.fit(residual_);
    history_.step(
        residual_, 1.0, [this](MatrixRef block) { linear_->correct(block, moved_); }, step);
    if (!everywhere(step.allFinite())) {
      return std::nullopt;
    }
    if (history_.size() > 0) {
      moved_ -= history_.predicted_error().traces;
    }
    if (count > 0) {
      whole = stages_.whole(better_);
    }
    const substructure::Sizes difference = gauge_.of_difference(step, moved_);
    Matrix ahead = whole.relative(difference);
    // an error next to rounding of others is mended by a step, or rounding itself
    const Matrix with_noise = whole.relative_with_noise(difference);
    const Matrix hidden = (with_noise.array() <= ahead.array()).select(0.0, with_noise);
    if (history_.size() > 0) {
      // a combination of steps may go nowhere although the residual is not small
      Matrix plain = residual_;
      Matrix moved_plainly;
      linear_->correct(plain, moved_plainly);
      ahead = larger(ahead, whole.relative(gauge_.of_difference(plain, moved_plainly)));
    }
    if (count > 0) {
      distance_ = whole.relative(gauge_.of_distance(better_, state));
      // how much of an error a step leaves, as far as the last two of them say
      const Matrix left = (before.array() > 0.0)
                              .select(ahead.cwiseQuotient(before), 0.0)
                              .cwiseMin(1.0 - 1.0 / most_left_over);
      Matrix rest = carried((ahead.array() / (1.0 - left.array())).matrix());
      if (count == first_of_rounding) {
        least_known = larger((within_rounding * linear_->rounding(stages_.laws(), better_,
                                                                  stages_.amplitudes(), whole)),
                             least);
      }
      if (count >= first_of_rounding) {
        // steps that do not become shorter, but are rounding, leave what they are
        rest = (ahead.array() <= least_known.array()).select(ahead, rest);
      }
      const auto enough =
          (rest.array() <= least_known.array()) ||
          (ahead.array() <= (count < first_of_rounding ? 0.0 : 1.0) * least_known.array()) ||
          ((ahead.array() <= shorter * distance_.array()) && (left.array() <= bearable_left));
      // tangents of another set say nothing where a law has changed its branch
      borrowed = borrowed && linear_->near(stages_.laws(), better_);
      // steps that lead to the answer are as good as those of the run, and better where it stagnates
      const bool go_on = count < (borrowed ? most_borrowed : most_checks) &&
                         !everywhere((rest.array() <= least_known.array().max(rtol)).all()) &&
                         largest(left) <= bearable_left;
      const bool hides = count < first_of_rounding && largest(hidden) > rtol;
      const bool fallen = norm <= std::max(well_fallen * first_norm, noise);
      // a step that made the residual larger led into another branch, and the last one may have come back to a stiff one
      rose = rose || norm > first_norm;
      const bool settled =
          !go_on && !hides && everywhere(enough.all()) && borrowed == was_borrowed &&
          norm <= std::max((borrowed ? borrowed_fall : residual_fall) * norm_before, noise) &&
          (!rose || fallen);
      const bool little = fallen && everywhere((rest.array() <= least_known.array()).all());
      const bool in_branch = settled && stays_in_branch(step);
      const auto imbalance_of_better = [this] {
        return linear_->imbalance(stages_.laws(), better_, residual_,
                                  within_rounding * rounding_share);
      };
      // short steps from one branch to another and back may be all that is seen of a soft part
      const bool crosses = settled && little && !in_branch;
      if (in_branch || (crosses && imbalance_of_better() <= bearable_imbalance * rtol)) {
        const bool springs = stages_.laws().linear_everywhere() && linear_->softened();
        const double longer = in_branch ? (springs ? of_springs : 1.0) : of_other_branch;
        rest *= longer;
        ahead *= longer;
        distance_ = whole.relative_with_noise(gauge_.of_distance(better_, state));
        // a little more than the tolerance may be as well a little less: it is a bound
        Matrix least_error =
            larger(linear_->rounding(stages_.laws(), better_, stages_.amplitudes(), whole), hidden);
        const bool rounding = largest(least_error) > bearable_rounding * rtol;
        if (!rounding) {
          least_error = least_error.cwiseMin(rtol);
        }
        Found found{larger((distance_ + ahead), least_error), larger(rest, least_error),
                    linear_->imbalance(stages_.laws(), state, residual), imbalance_of_better(),
                    rounding && everywhere((rest.array() <= least_error.array().max(rtol)).all())};
        if (count > 1) {
          // laws may change their branches on the way that is left: the error of the last but one is seen, not guessed
          const Matrix seen = larger(
              (whole.relative_with_noise(gauge_.of_distance(better_, from)) + ahead), least_error);
          if (largest(seen) <= rtol && linear_->imbalance(stages_.laws(), from, residual_before) <=
                                           bearable_imbalance * rtol) {
            found.errors_better = seen;
            std::swap(better_, from);
            std::swap(residual_, residual_before);
            found.imbalance_better = imbalance_of_better();
          }
        }
        return found;
      }
    }
    before = ahead;
    norm_before = norm;
    from = better_;
    residual_before = residual_;
    better_.data += step;
    if (!evaluate(better_, residual_)) {
      return std::nullopt;
    }
    history_.push(better_.data - from.data, residual_ - residual_before,
                  better_.traces - from.traces);
  }
  return std::nullopt;
}

/// Whether the laws have tangents that are alike at the end of a step from the better iterate, which was not taken.
bool Verification::stays_in_branch(const Matrix& step) const {
  return stages_.laws().linear_everywhere() ||
         linear_->near(stages_.laws(), {better_.data + step, better_.traces + moved_});
}

/// A step with bodies held by springs of that fraction of k. @return whether it is one to go on from
bool Verification::held_step(double hold, double& norm) {
  Matrix step = residual_;
  try {
    linear_->take(stages_.laws(), better_, hold);
    linear_->correct(step, moved_);
  } catch (const NumericalError&) {
    return false;
  }
  if (!everywhere(step.allFinite())) {
    return false;
  }
  State trial{better_.data + step, Matrix(better_.data.rows(), better_.data.cols())};
  Matrix residual(trial.data.rows(), trial.data.cols());
  if (!evaluate(trial, residual)) {
    return false;
  }
  const double now = history_.metric().norm(residual);
  if (!(now <= bearable_growth * norm)) {
    return false;
  }
  better_ = std::move(trial);
  residual_ = std::move(residual);
  norm = now;
  return true;
}

/// Averaged steps, which come nearer to the answer of every monotone law.
void Verification::plain_steps(Index count, double& norm) {
  for (Index i = 0; i < count; ++i) {
    better_.data += averaged_share * residual_;
    if (!evaluate(better_, residual_)) {
      norm = std::numeric_limits<double>::infinity();
      return;
    }
  }
  norm = history_.metric().norm(residual_);
}

bool Verification::search(const State& state, const Matrix& residual, double least, Index most) {
  const double first = history_.metric().norm(residual);
  Best best{state, residual, first};
  for (const double patience : {0.3, 0.5}) {
    if (best.norm > least) {
      better_ = state;
      residual_ = residual;
      search_once(patience, least, stages_.count() + most / 2, best);
    }
  }
  better_ = std::move(best.state);
  residual_ = std::move(best.residual);
  return best.norm < first;
}

/// @param until    number of global stages at which to stop
/// @param patience how much less the bodies are held after a step that did not make the residual fall
void Verification::search_once(double patience, double least, Index until, Best& best) {
  double norm = history_.metric().norm(residual_);
  double hold = 1.0;
  for (Index count = 0;
       count < most_of_search && stages_.count() < until && norm > least && std::isfinite(norm);
       ++count) {
    const double before = norm;
    if (held_step(hold, norm)) {
      const double fall = norm / before;
      hold *= fall < 0.5           ? 0.05
              : fall < 0.95        ? 0.3
              : fall <= 1.0 + 1e-3 ? patience
                                   : 3.0 * patience;
      hold = std::clamp(hold, least_hold, largest_hold);
    } else if (hold < largest_hold) {
      hold = std::min(5.0 * hold, largest_hold);
    } else {
      plain_steps(first_pause, norm);
      hold = 1.0;
    }
    if (norm < best.norm) {
      best = {better_, residual_, norm};
    }
  }
}

}  // namespace latin::iteration
