#include "iteration/error_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/numbers.hpp"

namespace latin::iteration {
namespace {

constexpr double unknown = std::numeric_limits<double>::infinity();
/// An iterate whose residual has fallen to this share is the next to look back on.
constexpr double well_below = 0.2;
/// Distances of iterates that are better than this are rounding, rather than what was wrong with them.
constexpr double noise_of_steps = 1e-10;

/// Errors of which the largest is at least so large: where the error is that is not seen is not known.
Matrix at_least(Matrix errors, double least) {
  if (errors.size() > 0) {
    Index row = 0;
    Index column = 0;
    errors.maxCoeff<keep_nan>(&row, &column);
    errors(row, column) = larger(errors(row, column), least);
  }
  return errors;
}

}  // namespace

std::array<double, 2> stage_shares(const Vector& weights, const Vector& directions,
                                   const State& state, ConstMatrixRef residual) {
  std::array<double, 2> shares{};
  for (Index column = 0; column < residual.cols(); ++column) {
    for (Index row = 0; row < residual.rows(); ++row) {
      // r = 2 k (w^ - w) = 2 (f^ - f)
      const double k = directions(row);
      const double half = 0.5 * residual(row, column);
      const double w = state.traces(row, column);
      const double f = state.data(row, column) - k * w;
      const double w_hat = w + half / k;
      const double f_hat = f + half;
      shares[0] += weights(row) * 2.0 * half * half / k;
      shares[1] += weights(row) * ((f * f + f_hat * f_hat) / k + k * (w * w + w_hat * w_hat));
    }
  }
  return shares;
}

double stage_distance(const std::array<double, 2>& shares) {
  return shares[1] == 0.0 ? 0.0 : std::sqrt(shares[0] / shares[1]);
}

double largest(const Matrix& errors) {
  return errors.size() > 0 ? errors.maxCoeff<keep_nan>() : 0.0;
}

Matrix predicted_errors(const Gauge& gauge, ConstMatrixRef data, ConstMatrixRef traces,
                        double explained, const Whole& whole) {
  return whole.relative(gauge.of_difference(data, traces)) / explained;
}

Hindsight::Hindsight(Index rows, Index columns) {
  for (Kept& each : kept_) {
    each.state.data.resize(rows, columns);
    each.state.traces.resize(rows, columns);
  }
}

Matrix Hindsight::raised(const Gauge& gauge, const State& state, const Matrix& estimates,
                         double estimate, double residual, const Whole& whole) const {
  Matrix said = estimates;
  if (estimate < noise_of_steps) {
    return said;
  }
  for (std::size_t i = 0; i < size_; ++i) {
    const double fall =
        std::sqrt(estimate / kept_[i].estimate) * std::sqrt(residual / kept_[i].residual);
    said = larger(said,
                  std::min(fall, 1.0) * whole.relative(gauge.of_distance(state, kept_[i].state)));
  }
  return said;
}

void Hindsight::keep(const State& state, double estimate, double residual) {
  if (!std::isfinite(estimate) || estimate < noise_of_steps ||
      (size_ > 0 && residual > well_below * kept_[0].residual)) {
    return;
  }
  std::rotate(kept_.begin(), kept_.end() - 1, kept_.end());
  kept_[0].state.data = state.data;  // into its own block: nothing is allocated
  kept_[0].state.traces = state.traces;
  kept_[0].estimate = estimate;
  kept_[0].residual = residual;
  size_ = std::min(size_ + 1, most);
}

ErrorEstimate::ErrorEstimate(Gauge gauge, Index rows, Index columns, Index own_needed,
                             Maximum maximum)
    : gauge_(std::move(gauge)),
      hindsight_(rows, columns),
      own_needed_(own_needed),
      maximum_(std::move(maximum)) {}

double ErrorEstimate::largest(const Matrix& errors) const {
  const double here = iteration::largest(errors);
  return maximum_ ? maximum_(here) : here;
}

Matrix ErrorEstimate::by_history(const Anderson& history, const State& state,
                                 const Measured& measured) {
  const Matrix own = of_fit(history, measured);
  const double estimate = larger(largest(own), least_of_indicator * measured.indicator);
  Matrix raised =
      hindsight_.raised(gauge_, state, own, estimate, measured.residual, measured.whole);
  hindsight_.keep(state, estimate, measured.residual);
  return at_least(std::move(raised), least_of_indicator * measured.indicator);
}

Matrix ErrorEstimate::by_step(const State& step, double left, const Measured& measured) const {
  return at_least(
      measured.whole.relative(gauge_.of_difference(step.data, step.traces)) / (1.0 - left),
      least_of_indicator * measured.indicator);
}

Matrix ErrorEstimate::of_fit(const Anderson& history, const Measured& measured) const {
  const double explained = history.explained();
  if (history.residual_norm() <= measured.rounding() || explained < least_explained) {
    // no combination of differences is fitted to noise: it is amplified as the worst of them was
    const Matrix worst = amplifications(history, measured);
    if (history.residual_norm() == 0.0) {
      return Matrix::Zero(worst.rows(), worst.cols());
    }
    if (largest(worst) < unknown || explained < least_explained) {
      return history.residual_norm() * worst;
    }
  }
  const State& error = history.predicted_error();
  return predicted_errors(gauge_, error.data, error.traces, explained, measured.whole);
}

/// Largest |dS| / |dR| in the history, |dS| relative to the solution.
Matrix ErrorEstimate::amplifications(const Anderson& history, const Measured& measured) const {
  Matrix worst =
      Matrix::Zero(measured.whole.sizes.strain.rows(), measured.whole.sizes.strain.cols());
  bool found = false;
  for (Index slot = 0; slot < history.size(); ++slot) {
    const Anderson::Difference each = history.difference(slot);
    if (each.norm > measured.rounding()) {
      found = true;
      worst = larger(
          worst, measured.whole.relative(gauge_.of_difference(each.data, each.traces)) / each.norm);
    }
  }
  if (!found) {
    worst.setConstant(unknown);
  }
  return worst;
}

}  // namespace latin::iteration
