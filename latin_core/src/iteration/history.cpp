#include "latin/iteration/history.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace latin::iteration {
namespace {

/// An iterate whose residual has fallen to this share is the next to look back on.
constexpr double well_below = 0.2;
/// Distances of iterates that are better than this are rounding, rather than what was wrong with them.
constexpr double noise = 1e-10;

}  // namespace

std::array<double, 2> stage_shares(const substructure::Structure& structure, const State& state,
                                   ConstMatrixRef residual) {
  std::array<double, 2> shares{};
  const Vector& k = structure.directions();
  const Vector& area = structure.weights();
  for (Index column = 0; column < residual.cols(); ++column) {
    for (Index row = 0; row < residual.rows(); ++row) {
      // r = 2 k (w^ - w) = 2 (f^ - f)
      const double half = 0.5 * residual(row, column);
      const double w = state.traces(row, column);
      const double f = state.data(row, column) - k(row) * w;
      const double w_hat = w + half / k(row);
      const double f_hat = f + half;
      shares[0] += area(row) * 2.0 * half * half / k(row);
      shares[1] +=
          area(row) * ((f * f + f_hat * f_hat) / k(row) + k(row) * (w * w + w_hat * w_hat));
    }
  }
  return shares;
}

double stage_distance(const std::array<double, 2>& shares) {
  return shares[1] > 0.0 ? std::sqrt(shares[0] / shares[1]) : 0.0;
}

Fit least_squares(const Matrix& gram, const Vector& projection, double norm) {
  Fit fit{Vector::Zero(projection.size()), 1.0};
  if (projection.size() == 0 || norm == 0.0) {
    return fit;
  }
  // unit columns, then drop directions that are noise
  Vector scale = gram.diagonal().cwiseMax(std::numeric_limits<double>::min()).cwiseSqrt();
  scale = scale.cwiseInverse();
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(scale.asDiagonal() * gram * scale.asDiagonal());
  const Vector& values = eigen.eigenvalues();
  const double smallest = 1e-13 * values.tail(1)(0);
  Vector coordinates = eigen.eigenvectors().transpose() * (scale.asDiagonal() * projection);
  double explained = 0.0;
  for (Index i = 0; i < coordinates.size(); ++i) {
    if (values(i) > smallest) {
      explained += coordinates(i) * coordinates(i) / values(i);
      coordinates(i) /= values(i);
    } else {
      coordinates(i) = 0.0;
    }
  }
  fit.gamma = scale.asDiagonal() * (eigen.eigenvectors() * coordinates);
  fit.remainder = std::sqrt(std::max(0.0, 1.0 - explained / (norm * norm)));
  return fit;
}

History::History(const substructure::Laws& laws, Index columns, Index depth)
    : laws_(laws),
      structure_(&laws.structure()),
      rows_(structure_->rows()),
      columns_(columns),
      depth_(depth),
      data_(rows_ * columns, depth),
      residual_(rows_ * columns, depth),
      traces_(rows_ * columns, depth),
      gram_(Matrix::Zero(depth, depth)),
      metric_(structure_->weights().cwiseQuotient(structure_->directions())),
      work_(rows_ * columns) {}

void History::clear() {
  size_ = 0;
  next_ = 0;
  fresh_.clear();
  gamma_.resize(0);
  predicted_ = false;
}

Eigen::Map<const Matrix> History::block(const Matrix& store, Index slot) const {
  return {store.col(slot).data(), rows_, columns_};
}

Eigen::Map<Matrix> History::shaped(Vector& vector) const {
  return {vector.data(), rows_, columns_};
}

double History::share_of_square(ConstMatrixRef residual) const {
  double sum = 0.0;
  for (Index column = 0; column < columns_; ++column) {
    sum += residual.col(column).cwiseAbs2().dot(metric_);
  }
  return sum;
}

void History::push(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces) {
  if (depth_ == 0) {
    return;
  }
  const Index slot = next_;
  data_.col(slot) = data.reshaped();
  residual_.col(slot) = residual.reshaped();
  traces_.col(slot) = traces.reshaped();
  next_ = (next_ + 1) % depth_;
  size_ = std::min(size_ + 1, depth_);
  if (std::ranges::find(fresh_, slot) == fresh_.end()) {
    fresh_.push_back(slot);
  }
}

void History::fit(ConstMatrixRef residual, std::span<double> shares) {
  // all that must be summed over ranks, in one message: the caller's, |r|^2, dR^T r, new rows of the Gram matrix
  std::vector<double> sums(shares.begin(), shares.end());
  sums.push_back(share_of_square(residual));
  // piece by piece, so that all products pass over the history once
  Matrix products = Matrix::Zero(size_, 1 + static_cast<Index>(fresh_.size()));
  Vector weighted(rows_);
  for (Index column = 0; column < columns_ && products.rows() > 0 && rows_ > 0; ++column) {
    const auto stored = residual_.block(column * rows_, 0, rows_, size_);
    for (Index i = 0; i < products.cols(); ++i) {
      if (i == 0) {
        weighted = metric_.cwiseProduct(residual.col(column));
      } else {
        weighted = metric_.cwiseProduct(stored.col(fresh_[static_cast<std::size_t>(i - 1)]));
      }
      products.col(i).noalias() += stored.transpose() * weighted;
    }
  }
  sums.insert(sums.end(), products.data(), products.data() + products.size());
  structure_->communicator().sum(sums);
  auto next = sums.cbegin() + static_cast<std::ptrdiff_t>(shares.size());
  std::copy(sums.cbegin(), next, shares.begin());
  residual_norm_ = std::sqrt(*next++);
  Vector projection(size_);
  for (double& value : projection) {
    value = *next++;
  }
  for (const Index slot : fresh_) {
    for (Index other = 0; other < size_; ++other) {
      gram_(slot, other) = *next++;
      gram_(other, slot) = gram_(slot, other);
    }
  }
  fresh_.clear();

  Fit best = least_squares(gram_.topLeftCorner(size_, size_), projection, residual_norm_);
  gamma_ = std::move(best.gamma);
  predicted_ = false;
  remainder_ = best.remainder;
}

const State& History::predicted_error() const {
  if (predicted_) {
    return error_;
  }
  predicted_ = true;
  const auto combine = [this](const Matrix& store, Matrix& sum) {
    sum.resize(rows_, columns_);
    Eigen::Map<Vector>(sum.data(), sum.size()).noalias() = store.leftCols(gamma_.size()) * gamma_;
  };
  combine(data_, error_.data);
  combine(traces_, error_.traces);
  return error_;
}

double History::error(const substructure::Size& whole, double rounding) const {
  if (residual_norm_ == 0.0) {
    return 0.0;
  }
  const double explained = std::sqrt(std::max(0.0, 1.0 - remainder_ * remainder_));
  if (residual_norm_ <= rounding || explained < least_explained) {
    const double worst = amplification(whole, rounding);
    if (std::isfinite(worst) || explained < least_explained) {
      return residual_norm_ * worst;
    }
  }
  const State& error = predicted_error();
  // what the history cannot explain is taken to be amplified as much as what it can
  return substructure::difference_size(*structure_, error.data, error.traces).relative_to(whole) /
         explained;
}

double History::amplification(const substructure::Size& whole, double rounding) const {
  double worst = size_ > 0 ? 0.0 : std::numeric_limits<double>::infinity();
  for (Index slot = 0; slot < size_; ++slot) {
    const double norm = std::sqrt(gram_(slot, slot));
    if (norm > rounding) {
      const substructure::Size size =
          substructure::difference_size(*structure_, block(data_, slot), block(traces_, slot));
      worst = std::max(worst, size.relative_to(whole) / norm);
    }
  }
  return worst > 0.0 ? worst : std::numeric_limits<double>::infinity();
}

void History::step(ConstMatrixRef residual, double beta, MatrixRef step) {
  const Index used = gamma_.size();
  work_.noalias() = residual_.leftCols(used) * gamma_;
  step = residual - shaped(work_);
  if (laws_.preconditions()) {
    laws_.precondition(step);
  }
  step = beta * step - predicted_error().data;
}

Hindsight::Hindsight(const substructure::Structure& structure, Index columns)
    : structure_(&structure) {
  for (Kept& each : kept_) {
    each.state.data.resize(structure.rows(), columns);
    each.state.traces.resize(structure.rows(), columns);
  }
}

std::array<double, 2 * Hindsight::most> Hindsight::shares(const State& state) const {
  std::array<double, 2 * most> shares{};
  for (std::size_t i = 0; i < size_; ++i) {
    const State& then = kept_[i].state;
    const substructure::Size share = substructure::share_of_distance(
        *structure_, state.data, state.traces, then.data, then.traces);
    shares[2 * i] = share.strain;
    shares[2 * i + 1] = share.trace;
  }
  return shares;
}

double Hindsight::raised(double estimate, double residual, const substructure::Size& whole,
                         std::span<const double> sums) const {
  double said = 0.0;
  for (std::size_t i = 0; i < size_; ++i) {
    const substructure::Size distance =
        substructure::Size{sums[2 * i], sums[2 * i + 1], 0.0}.positive();
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

}  // namespace latin::iteration
