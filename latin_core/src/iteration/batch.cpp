#include "iteration/batch.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>
#include <string>

#include "common/numbers.hpp"
#include "iteration/anderson.hpp"
#include "iteration/error_estimate.hpp"
#include "iteration/stages.hpp"
#include "iteration/step.hpp"
#include "iteration/verification.hpp"
#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

/// A step that leaves more than this of the one before says nothing.
constexpr double most_left = 0.5;
/// Steps below this are rounding.
constexpr double noise = 1e-12;
/// Steps of linear laws with tangents of their own, and the error they aim at, relative to the tolerance.
constexpr Index most_exact = 3;
constexpr double goal = 0.1;
constexpr double first_goal = 0.3;
/// Displacements that answers are looked for in, and of which so little is left beside others that they are none.
constexpr Index most_of_basis = 24;
constexpr double dependent = 1e-10;

/// The transforms of an interface are those of one set: the columns of several would not fit them.
void refuse_transforms(const substructure::Laws& laws) {
  const auto& interfaces = laws.structure().interfaces();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    if (laws.of(i).transformed()) {
      throw InputError(
          "interface '" + interfaces[i].name() +
          "': parameter sets are not solved side by side where columns are transformed");
    }
  }
}

/// Columns of a block that belong to one of several sets side by side.
Matrix of_set(const Matrix& block, Index set, Index columns) {
  return block.middleCols(set * columns, columns);
}

substructure::Sizes of_set(const substructure::Sizes& sizes, Index set, Index groups) {
  return {sizes.strain.middleRows(set * groups, groups),
          sizes.trace.middleRows(set * groups, groups), sizes.work.middleRows(set * groups, groups),
          sizes.pressed.middleRows(set * groups, groups)};
}

/// Sets side by side as they are, without their errors. Collective: the numbers of all ranks travel in one message.
/// @param sizes  of each set on this rank
/// @param wholes what errors of each set are relative to, found here
std::vector<Advanced> as_they_are(const substructure::Structure& structure, const Metric& metric,
                                  const substructure::Yardstick& yardstick, const State& state,
                                  const Matrix& residual,
                                  const std::vector<substructure::Sizes>& sizes,
                                  std::vector<Whole>& wholes) {
  const auto sets = static_cast<Index>(sizes.size());
  const Index columns = residual.cols() / sets;
  std::vector<Advanced> answers(sizes.size());
  Matrix sums;
  for (Index set = 0; set < sets; ++set) {
    const auto at = static_cast<std::size_t>(set);
    Advanced& answer = answers[at];
    const Matrix own = of_set(residual, set, columns);
    answer.state = {of_set(state.data, set, columns), of_set(state.traces, set, columns)};
    wholes.push_back({sizes[at], yardstick});
    const auto [distance, extent] =
        stage_shares(structure.weights(), structure.directions(), answer.state, own);
    const Vector reach = yardstick.share_of_reach(sizes[at]);
    sums.conservativeResize(4 + reach.size(), sets);
    sums.col(set) << distance, extent, metric.share_of_square(own), sizes[at].strain.sum(), reach;
  }
  structure.communicator().sum({sums.data(), static_cast<std::size_t>(sums.size())});
  for (Index set = 0; set < sets; ++set) {
    const auto at = static_cast<std::size_t>(set);
    answers[at].indicator = stage_distance({sums(0, set), sums(1, set)});
    answers[at].residual = std::sqrt(sums(2, set));
    answers[at].energy = sums(3, set);
    answers[at].error = std::numeric_limits<double>::infinity();
    wholes[at].yardstick.reach = sums.col(set).tail(sums.rows() - 4);
  }
  return answers;
}

/// Parameter sets side by side that are advanced with the tangents of a near one.
class Borrowing {
 public:
  Borrowing(const Linearisation& linear, const substructure::Laws& laws, const Options& options,
            const Matrix& amplitudes, Index sets, const std::vector<const State*>& snapshots,
            Matrix* basis)
      : linear_(linear),
        laws_(laws),
        basis_(basis),
        rtol_(options.rtol),
        exact_(Verification::exact(laws)),
        sets_(sets),
        columns_(amplitudes.cols()),
        amplitudes_(amplitudes.replicate(1, sets)),
        gauge_(gauge_of(laws)),
        yardstick_(substructure::yardstick(laws.structure(), laws.measured())),
        history_(metric_of(laws.structure()), columns_, static_cast<Index>(snapshots.size()), sets),
        stages_(laws, amplitudes_, false),
        residual_(laws.structure().rows(), sets * columns_),
        fall_(Vector::Constant(sets * columns_, first_goal * options.rtol)) {
    Stepper(stages_.fixed_point(), history_, options.relaxation)
        .start_from(snapshots, {state_, residual_});
    stages_.local(state_.data, state_.traces, residual_);
    stages_.agree();
  }

  std::vector<Advanced> answers() {
    if (exact_ && basis_ != nullptr) {
      return directly();
    }
    const substructure::Sizes first = correct();
    if (exact_) {
      std::vector<Advanced> at_once = of_linear_laws(first);
      if (all_good(at_once)) {
        return at_once;
      }
    }
    state_.data += step_;
    stages_.evaluate({state_, residual_});
    stages_.agree();
    const substructure::Sizes second = correct();
    return exact_ ? of_linear_laws(second) : of_two_steps(first, second);
  }

 private:
  /// Of linear laws a step with tangents of their own leads to the answer; the borrowed ones check it.
  std::vector<Advanced> directly() {
    std::vector<Advanced> answers;
    for (Index count = 0; count < most_exact && (count == 0 || !all_good(answers)); ++count) {
      step_ = residual_;
      const bool first = count == 0;
      const Matrix moved =
          linear_.correct_each(laws_, state_, first ? *basis_ : Matrix(), fall_, step_, moved_);
      if (moved.size() == 0) {
        correct();
      } else if (first && basis_->cols() < most_of_basis) {
        enlarge(moved.leftCols(std::min(moved.cols(), most_of_basis - basis_->cols())));
      }
      state_.data += step_;
      stages_.evaluate({state_, residual_});
      answers = of_linear_laws(correct());
    }
    return answers;
  }

  void enlarge(const Matrix& moved) {
    Matrix all(moved.rows(), basis_->cols() + moved.cols());
    if (basis_->cols() > 0) {
      all.leftCols(basis_->cols()) = *basis_;
    }
    all.rightCols(moved.cols()) = moved.colwise().normalized();
    Eigen::ColPivHouseholderQR<Matrix> factors(all);
    factors.setThreshold(dependent);
    *basis_ = factors.householderQ() * Matrix::Identity(all.rows(), factors.rank());
  }

  /// The next step, and what it would change.
  substructure::Sizes correct() {
    step_ = residual_;
    linear_.correct(step_, moved_);
    return gauge_.of_difference(step_, moved_);
  }

  [[nodiscard]] bool all_good(const std::vector<Advanced>& answers) const {
    return std::ranges::all_of(answers,
                               [this](const Advanced& answer) { return answer.error <= rtol_; }) &&
           linear_.imbalance(laws_, state_, residual_) <= Verification::bearable_imbalance * rtol_;
  }

  /// The sets as they are now, without their errors.
  std::vector<Advanced> as_they_are_now(std::vector<Whole>& wholes) {
    substructure::GlobalStage global(laws_);
    substructure::Sizes sizes;
    laws_.structure().communicator().together(
        [&] { sizes = global.sizes(state_.data, state_.traces, amplitudes_); });
    const Index groups = sizes.strain.rows() / sets_;
    std::vector<substructure::Sizes> of_sets;
    of_sets.reserve(static_cast<std::size_t>(sets_));
    for (Index set = 0; set < sets_; ++set) {
      of_sets.push_back(of_set(sizes, set, groups));
    }
    return as_they_are(laws_.structure(), history_.metric(), yardstick_, state_, residual_, of_sets,
                       wholes);
  }

  /// The largest of the errors on all ranks.
  [[nodiscard]] double largest_of_all(const Matrix& errors) const {
    return laws_.structure().communicator().largest(largest(errors));
  }

  /// What a step says of linear laws is right within the factor between the stiffnesses.
  std::vector<Advanced> of_linear_laws(const substructure::Sizes& ahead) {
    std::vector<Whole> wholes;
    std::vector<Advanced> answers = as_they_are_now(wholes);
    const std::vector<double> contrasts = linear_.contrasts(laws_, state_);
    const Index groups = ahead.strain.rows() / sets_;
    for (Index set = 0; set < sets_; ++set) {
      const auto at = static_cast<std::size_t>(set);
      const std::span own(contrasts.begin() + set * columns_, static_cast<std::size_t>(columns_));
      const double spread = largest_of(own, 1.0);
      const Matrix errors = wholes[at].relative(of_set(ahead, set, groups));
      // bounds are by energies of the whole, errors are of its bodies
      const double bound = spread * largest_of_all(errors);
      fall_.segment(set * columns_, columns_)
          .setConstant(bound > 0.0 ? std::min(goal * rtol_ / bound, 1.0) : 1.0);
      if (bound <= rtol_) {
        answers[at].errors = with_rounding(std::sqrt(spread) * errors);
        answers[at].error = largest_of_all(answers[at].errors);
      }
    }
    return answers;
  }

  /// Of other laws it takes two steps, of which the second is short, in one branch of the laws.
  std::vector<Advanced> of_two_steps(const substructure::Sizes& first,
                                     const substructure::Sizes& second) {
    std::vector<Whole> wholes;
    std::vector<Advanced> answers = as_they_are_now(wholes);
    // neither at the answer nor where the next step would lead may a law have another branch
    const std::vector<double> here = linear_.contrasts(laws_, state_);
    const std::vector<double> there =
        linear_.contrasts(laws_, {state_.data + step_, state_.traces + moved_});
    const Index groups = second.strain.rows() / sets_;
    for (Index set = 0; set < sets_; ++set) {
      const auto at = static_cast<std::size_t>(set);
      const Matrix before = wholes[at].relative(of_set(first, set, groups));
      const Matrix ahead = wholes[at].relative(of_set(second, set, groups));
      const Matrix left = (before.array() > 0.0).select(ahead.cwiseQuotient(before), 0.0);
      bool good = ((left.array() <= most_left) || (ahead.array() <= noise)).all();
      double spread = 1.0;
      for (Index column = set * columns_; column < (set + 1) * columns_; ++column) {
        const auto i = static_cast<std::size_t>(column);
        spread = largest_of({spread, here[i], there[i]});
      }
      good = good && spread <= Linearisation::near_factor;
      if (laws_.structure().communicator().everywhere(good)) {
        answers[at].errors = with_rounding(
            (ahead.array() * (1.0 / (1.0 - left.array().min(most_left))).max(std::sqrt(spread)))
                .matrix());
        answers[at].error = largest_of_all(answers[at].errors);
      }
    }
    return answers;
  }

  /// Errors with those of rounding, as far as these are known, but not above the tolerance.
  [[nodiscard]] Matrix with_rounding(Matrix errors) const {
    const Matrix& rounding = linear_.known_rounding();
    if (rounding.rows() == errors.rows() && rounding.cols() == errors.cols()) {
      errors = larger(errors, rounding.cwiseMin(rtol_));
    }
    return laws_.linear_everywhere() ? errors : larger(errors, Verification::resolution(rtol_));
  }

  const Linearisation& linear_;
  const substructure::Laws& laws_;
  Matrix* basis_;
  double rtol_;
  bool exact_;
  Index sets_;
  Index columns_;
  Matrix amplitudes_;
  Gauge gauge_;
  substructure::Yardstick yardstick_;
  Anderson history_;
  Stages stages_;
  State state_;
  Matrix residual_;
  Matrix step_;
  Matrix moved_;
  Vector fall_;  ///< of every column, what its error has to fall to
};

}  // namespace

std::vector<Advanced> advance_together(const substructure::Laws& laws, const Options& options,
                                       const Matrix& amplitudes, Index sets,
                                       const std::vector<const State*>& snapshots,
                                       const Linearisation* known, Matrix* basis) {
  refuse_transforms(laws);
  if (known != nullptr && known->made()) {
    return Borrowing(*known, laws, options, amplitudes, sets, snapshots, basis).answers();
  }
  const substructure::Structure& structure = laws.structure();
  const Index columns = amplitudes.cols();
  const Gauge gauge = gauge_of(laws);
  const Matrix all_amplitudes = amplitudes.replicate(1, sets);
  Anderson history(metric_of(structure), columns, static_cast<Index>(snapshots.size()), sets);
  Stages stages(laws, all_amplitudes, false);
  Stepper stepper(stages.fixed_point(), history, options.relaxation);
  State state;
  Matrix residual(structure.rows(), sets * columns);
  stepper.start_from(snapshots, {state, residual});
  stages.local(state.data, state.traces, residual);
  history.fit(residual);
  stepper.step(Stepper::Kind::accelerated, {state, residual});
  stages.agree();
  history.fit(residual);

  substructure::GlobalStage global(laws);
  const substructure::Yardstick yardstick = substructure::yardstick(structure, laws.measured());
  const State& wrong = history.predicted_error();
  std::vector<substructure::Sizes> sizes;
  sizes.reserve(static_cast<std::size_t>(sets));
  structure.communicator().together([&] {
    for (Index set = 0; set < sets; ++set) {
      sizes.push_back(global.sizes(of_set(state.data, set, columns),
                                   of_set(state.traces, set, columns), amplitudes));
    }
  });
  std::vector<Whole> wholes;
  std::vector<Advanced> answers =
      as_they_are(structure, history.metric(), yardstick, state, residual, sizes, wholes);
  for (Index set = 0; set < sets; ++set) {
    Advanced& answer = answers[static_cast<std::size_t>(set)];
    answer.residual = history.residual_norm(set);
    const double rounding = rounding_share * history.metric().norm(answer.state.data);
    if (answer.residual > rounding && history.explained(set) >= least_explained) {
      answer.errors = predicted_errors(gauge, of_set(wrong.data, set, columns),
                                       of_set(wrong.traces, set, columns), history.explained(set),
                                       wholes[static_cast<std::size_t>(set)]);
      if (!laws.linear_everywhere()) {
        answer.errors = larger(answer.errors, Verification::resolution(options.rtol));
      }
      answer.error = larger(structure.communicator().largest(largest(answer.errors)),
                            least_of_indicator * answer.indicator);
    }
  }
  return answers;
}

}  // namespace latin::iteration
