#include "iteration/step.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace latin::iteration {
namespace {

/// The same block for every set. (Eigen's replicate divides for every number.)
void repeat(const Matrix& block, Index sets, Matrix& all) {
  all.resize(block.rows(), block.cols() * sets);
  for (Index set = 0; set < sets; ++set) {
    all.middleCols(set * block.cols(), block.cols()) = block;
  }
}

}  // namespace

Stepper::Stepper(FixedPoint stages, Anderson& history, double relaxation, double longest)
    : stages_(std::move(stages)), history_(history), relaxation_(relaxation), longest_(longest) {}

void Stepper::start_from(const std::vector<const State*>& snapshots, Iterate at) {
  const State& first = *snapshots.front();
  const Index sets = history_.sets();
  repeat(first.data, sets, at.state.data);
  repeat(first.traces, sets, at.state.traces);
  stages_.local(at.state.data, at.state.traces, at.residual);
  State other;
  Matrix residual = Matrix::Zero(at.residual.rows(), at.residual.cols());
  for (std::size_t i = 1; i < snapshots.size(); ++i) {
    repeat(snapshots[i]->data, sets, other.data);
    repeat(snapshots[i]->traces, sets, other.traces);
    stages_.local(other.data, other.traces, residual);
    history_.push_common(snapshots[i]->data - first.data, residual - at.residual,
                         snapshots[i]->traces - first.traces);
  }
  history_.fit(at.residual);
  const State& away = history_.predicted_error();
  at.state.data -= away.data;
  at.state.traces -= away.traces;
  started_ = true;
}

void Stepper::step(Kind kind, Iterate at) {
  choose(kind, at.residual);
  const bool first = std::exchange(started_, false);
  const double chosen = first ? history_.metric().norm(step_) : 0.0;  // without the coarse problem
  residual_change_ = at.residual;
  traces_change_ = at.state.traces;
  at.state.data += step_;
  stages_.global(step_, at.state.data, at.state.traces);
  stages_.local(at.state.data, at.state.traces, at.residual);
  residual_change_ = at.residual - residual_change_;
  traces_change_ = at.state.traces - traces_change_;
  history_.push(step_, residual_change_, traces_change_);
  if (first && chosen > 0.0) {
    first_change_ = history_.metric().norm(residual_change_) / chosen;
  }
}

void Stepper::choose(Kind kind, const Matrix& residual) {
  step_.resize(residual.rows(), residual.cols());
  if (kind == Kind::accelerated) {
    history_.step(residual, relaxation_, stages_.precondition, step_);
    if (!std::isfinite(longest_) ||
        !(history_.metric().norm(step_) > longest_ * history_.residual_norm())) {
      return;
    }
    history_.clear();
  }
  if (kind == Kind::plain) {
    step_ = residual;
    if (stages_.precondition) {
      stages_.precondition(step_);
    }
    step_ *= relaxation_;
  } else {
    step_ = std::min(relaxation_, averaged_share) * residual;
  }
}

}  // namespace latin::iteration
