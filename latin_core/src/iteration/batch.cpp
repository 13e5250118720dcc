#include "latin/iteration/batch.hpp"

#include <algorithm>
#include <limits>

#include "latin/iteration/history.hpp"
#include "latin/substructure/global_stage.hpp"
#include "latin/substructure/local_stage.hpp"

namespace latin::iteration {
namespace {

/// The same block for every set. (Eigen's replicate divides for every number.)
Matrix repeated(const Matrix& block, Index sets) {
  Matrix all(block.rows(), block.cols() * sets);
  for (Index set = 0; set < sets; ++set) {
    all.middleCols(set * block.cols(), block.cols()) = block;
  }
  return all;
}

/// Residuals in the metric W/k, one column a set, and their differences between snapshots.
class Residuals {
 public:
  Residuals(const substructure::Structure& structure, Index columns, Index sets, Index differences)
      : scale_(structure.weights()
                   .cwiseQuotient(structure.directions())
                   .cwiseSqrt()
                   .replicate(columns, 1)
                   .reshaped()),
        sets_(sets),
        count_(differences),
        differences_(scale_.size(), sets * differences),
        grams_(static_cast<std::size_t>(sets)) {}

  [[nodiscard]] const Vector& scale() const { return scale_; }
  /// (n, sets), scaled
  [[nodiscard]] Matrix scaled(const Matrix& residual) const {
    return scale_.asDiagonal() * Eigen::Map<const Matrix>(residual.data(), scale_.size(), sets_);
  }
  /// Keep difference i of all sets.
  void keep(Index i, const Matrix& difference) {
    for (Index set = 0; set < sets_; ++set) {
      differences_.col(set * count_ + i) = difference.col(set);
    }
  }
  /// The first `count` differences of a set.
  [[nodiscard]] auto of(Index set, Index count) const {
    return differences_.middleCols(set * count_, count);
  }
  void make_gram(Index set, Index count) {
    Matrix& gram = grams_[static_cast<std::size_t>(set)];
    gram = Matrix::Zero(count_, count_);
    gram.topLeftCorner(count, count)
        .selfadjointView<Eigen::Lower>()
        .rankUpdate(of(set, count).transpose());
    gram.triangularView<Eigen::StrictlyUpper>() = gram.transpose();
  }
  /// Take difference `i` up into the Gram matrix of a set.
  void extend_gram(Index set, Index i) {
    Matrix& gram = grams_[static_cast<std::size_t>(set)];
    gram.row(i).head(i + 1).noalias() =
        (of(set, i + 1).transpose() * differences_.col(set * count_ + i)).transpose();
    gram.col(i).head(i) = gram.row(i).head(i).transpose();
  }
  [[nodiscard]] Fit fit(Index set, Index count, ConstVectorRef residual) const {
    return least_squares(grams_[static_cast<std::size_t>(set)].topLeftCorner(count, count),
                         of(set, count).transpose() * residual, residual.norm());
  }

 private:
  Vector scale_;  ///< sqrt(W/k)
  Index sets_;
  Index count_;
  Matrix differences_;  ///< (n, sets * count), those of a set side by side
  std::vector<Matrix> grams_;
};

/// As `Summary::error` of a run whose history is this fit; infinity if it explains too little.
double estimate(const substructure::Structure& structure, const Fit& fit, const Advanced& answer,
                const Matrix& away, const Matrix& traces_away, const substructure::Size& whole) {
  const double explained = std::sqrt(std::max(0.0, 1.0 - fit.remainder * fit.remainder));
  if (explained < least_explained) {
    return std::numeric_limits<double>::infinity();
  }
  const substructure::Size wrong = substructure::difference_size(structure, away, traces_away);
  return std::max(wrong.relative_to(whole) / explained, least_of_indicator * answer.indicator);
}

}  // namespace

std::vector<Advanced> advance_together(const substructure::Laws& laws, const Options& options,
                                       const Matrix& amplitudes, Index sets,
                                       const std::vector<const State*>& snapshots) {
  const substructure::Structure& structure = laws.structure();
  const Index rows = structure.rows();
  const Index columns = amplitudes.cols();
  const Index size = rows * columns;
  const auto others = static_cast<Index>(snapshots.size()) - 1;
  Residuals residuals(structure, columns, sets, others + 1);

  substructure::GlobalStage global(laws);
  substructure::LocalStage local(laws, sets * columns);

  // residuals of the snapshots under the laws of every set
  Matrix data = repeated(snapshots.front()->data, sets);
  Matrix traces = repeated(snapshots.front()->traces, sets);
  Matrix residual(rows, sets * columns);
  local.apply(data, traces, residual);
  const Matrix first = residuals.scaled(residual);
  Matrix data_differences(size, others + 1);
  Matrix trace_differences(size, others + 1);
  for (Index i = 0; i < others; ++i) {
    const State& snapshot = *snapshots[static_cast<std::size_t>(i + 1)];
    data_differences.col(i) = (snapshot.data - snapshots.front()->data).reshaped();
    trace_differences.col(i) = (snapshot.traces - snapshots.front()->traces).reshaped();
    local.apply(repeated(snapshot.data, sets), repeated(snapshot.traces, sets), residual);
    residuals.keep(i, residuals.scaled(residual) - first);
  }

  // the combination with the smallest residual; its global image is that of the snapshots
  Matrix combined(others, sets);
  for (Index set = 0; set < sets; ++set) {
    residuals.make_gram(set, others);
    combined.col(set) = residuals.fit(set, others, first.col(set)).gamma;
  }
  Eigen::Map<Matrix> data_of(data.data(), size, sets);
  Eigen::Map<Matrix> traces_of(traces.data(), size, sets);
  data_of.noalias() -= data_differences.leftCols(others) * combined;
  traces_of.noalias() -= trace_differences.leftCols(others) * combined;
  local.apply(data, traces, residual);
  const Matrix start = residuals.scaled(residual);

  // one accelerated step from there
  Matrix step = start;
  for (Index set = 0; set < sets; ++set) {
    combined.col(set) = residuals.fit(set, others, start.col(set)).gamma;
    step.col(set).noalias() -= residuals.of(set, others) * combined.col(set);
  }
  step = residuals.scale().cwiseInverse().asDiagonal() * step;
  laws.precondition(Eigen::Map<Matrix>(step.data(), rows, sets * columns));
  step *= options.relaxation;
  step.noalias() -= data_differences.leftCols(others) * combined;
  data_of += step;
  Matrix moved(rows, sets * columns);
  global.apply(data, repeated(amplitudes, sets), moved);
  if (structure.macro_size() > 0) {
    step += global.balance(local, data, moved).reshaped(size, sets);
  }
  local.apply(data, moved, residual);
  const Matrix left = residuals.scaled(residual);
  residuals.keep(others, left - start);

  std::vector<Advanced> answers(static_cast<std::size_t>(sets));
  const Eigen::Map<const Matrix> moved_of(moved.data(), size, sets);
  for (Index set = 0; set < sets; ++set) {
    Advanced& answer = answers[static_cast<std::size_t>(set)];
    answer.state = {data.middleCols(set * columns, columns),
                    moved.middleCols(set * columns, columns)};
    answer.indicator = stage_distance(
        stage_shares(structure, answer.state, residual.middleCols(set * columns, columns)));
    answer.residual = left.col(set).norm();
    const substructure::Size whole =
        global.size(answer.state.data, answer.state.traces, amplitudes);
    answer.energy = whole.strain;
    const double rounding =
        rounding_share * data_of.col(set).cwiseProduct(residuals.scale()).norm();
    answer.error = std::numeric_limits<double>::infinity();
    if (answer.residual > rounding) {
      residuals.extend_gram(set, others);
      const Fit fit = residuals.fit(set, others + 1, left.col(set));
      data_differences.col(others) = step.col(set);
      trace_differences.col(others) = moved_of.col(set) - traces_of.col(set);
      const Vector away = data_differences * fit.gamma;
      const Vector traces_away = trace_differences * fit.gamma;
      answer.error = estimate(structure, fit, answer, away.reshaped(rows, columns),
                              traces_away.reshaped(rows, columns), whole);
    }
  }
  return answers;
}

}  // namespace latin::iteration
