#include "latin/iteration/error_estimate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace latin::iteration {
namespace {

using substructure::Size;

constexpr double unknown = std::numeric_limits<double>::infinity();
/// An iterate whose residual has fallen to this share is the next to look back on.
constexpr double well_below = 0.2;
/// Distances of iterates that are better than this are rounding, rather than what was wrong with them.
constexpr double noise = 1e-10;

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
  return shares[1] > 0.0 ? std::sqrt(shares[0] / shares[1]) : 0.0;
}

double predicted_error(const Gauge& gauge, ConstMatrixRef data, ConstMatrixRef traces,
                       double explained, const Size& whole) {
  return gauge.of_difference(data, traces).relative_to(whole) / explained;
}

Hindsight::Hindsight(Index rows, Index columns) {
  for (Kept& each : kept_) {
    each.state.data.resize(rows, columns);
    each.state.traces.resize(rows, columns);
  }
}

Hindsight::Shares Hindsight::shares(const Gauge& gauge, const State& state) const {
  Shares shares{};
  for (std::size_t i = 0; i < size_; ++i) {
    const Size share = gauge.share_of_distance(state, kept_[i].state);
    shares[2 * i] = share.strain;
    shares[2 * i + 1] = share.trace;
  }
  return shares;
}

double Hindsight::raised(double estimate, double residual, const Size& whole,
                         std::span<const double> sums) const {
  double said = 0.0;
  for (std::size_t i = 0; i < size_; ++i) {
    const Size distance = Size{sums[2 * i], sums[2 * i + 1], 0.0}.positive();
    const double fall =
        std::sqrt(estimate / kept_[i].estimate) * std::sqrt(residual / kept_[i].residual);
    said = std::max(said, distance.relative_to(whole) * std::min(fall, 1.0));
  }
  return estimate < noise ? estimate : std::max(estimate, said);
}

void Hindsight::keep(const State& state, double estimate, double residual) {
  if (!std::isfinite(estimate) || estimate < noise ||
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

ErrorEstimate::ErrorEstimate(Gauge gauge, Index rows, Index columns, Index own_needed)
    : gauge_(std::move(gauge)), hindsight_(rows, columns), own_needed_(own_needed) {}

double ErrorEstimate::by_history(const Anderson& history, const State& state,
                                 const Measured& measured) {
  const double own = std::max(of_fit(history, measured), least_of_indicator * measured.indicator);
  const double raised =
      hindsight_.raised(own, measured.residual, measured.whole, measured.distances);
  hindsight_.keep(state, own, measured.residual);
  return raised;
}

double ErrorEstimate::by_step(const State& step, double left, const Measured& measured) const {
  const Size error = gauge_.of_difference(step.data, step.traces);
  return std::max(error.relative_to(measured.whole) / (1.0 - left),
                  least_of_indicator * measured.indicator);
}

double ErrorEstimate::of_fit(const Anderson& history, const Measured& measured) const {
  if (history.residual_norm() == 0.0) {
    return 0.0;
  }
  const double explained = history.explained();
  if (history.residual_norm() <= measured.rounding() || explained < least_explained) {
    // no combination of differences is fitted to noise: it is amplified as the worst of them was
    const double worst = amplification(history, measured);
    if (std::isfinite(worst) || explained < least_explained) {
      return history.residual_norm() * worst;
    }
  }
  const State& error = history.predicted_error();
  return predicted_error(gauge_, error.data, error.traces, explained, measured.whole);
}

/// Largest |dS| / |dR| in the history, |dS| relative to the solution.
double ErrorEstimate::amplification(const Anderson& history, const Measured& measured) const {
  double worst = 0.0;
  for (Index slot = 0; slot < history.size(); ++slot) {
    const Anderson::Difference each = history.difference(slot);
    if (each.norm > measured.rounding()) {
      const Size size = gauge_.of_difference(each.data, each.traces);
      worst = std::max(worst, size.relative_to(measured.whole) / each.norm);
    }
  }
  return worst > 0.0 ? worst : unknown;
}

}  // namespace latin::iteration
