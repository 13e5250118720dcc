#include "iteration/anderson.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "common/threads.hpp"

namespace latin::iteration {
namespace {

/// Blocks are cut into pieces of this many numbers, which sums depend on: however many threads there are.
constexpr Index piece_size = 32768;
/// Differences shorter than this, relative to the residual that they are to explain, are rounding.
constexpr double shortest_difference = 1e-14;

}  // namespace

Fit least_squares(const Matrix& gram, const Vector& projection, double norm) {
  Fit fit{Vector::Zero(projection.size()), 1.0};
  if (projection.size() == 0 || norm == 0.0) {
    return fit;
  }
  // unit columns but those that are noise (snapshots alike to rounding), then drop directions that are noise
  const Vector lengths = gram.diagonal().cwiseMax(0.0).cwiseSqrt();
  const Vector scale =
      (lengths.array() > shortest_difference * norm).select(lengths.cwiseInverse(), 0.0);
  if (scale.isZero(0.0)) {
    return fit;
  }
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

Anderson::Anderson(Metric metric, Index columns, Index depth, Index sets)
    : metric_(std::move(metric)),
      rows_(metric_.weights().size()),
      columns_(columns),
      depth_(depth),
      sets_(sets),
      data_(rows_ * columns, depth),
      traces_(rows_ * columns, depth),
      residual_(rows_ * columns, sets * depth),
      gram_(static_cast<std::size_t>(sets), Matrix::Zero(depth, depth)),
      work_(rows_ * columns, sets),
      gamma_(0, sets),
      remainders_(Vector::Ones(sets)),
      norms_(Vector::Zero(sets)) {}

void Anderson::clear() {
  size_ = 0;
  next_ = 0;
  common_ = 0;
  fresh_.clear();
  gamma_.resize(0, sets_);
  predicted_data_ = predicted_traces_ = false;
}

/// Columns of a block (rows, c), one below the other. (Eigen's reshaped divides for every number of a block whose
/// columns may lie apart.)
void Anderson::stack(ConstMatrixRef block, Eigen::Ref<Vector> into) const {
  for (Index column = 0; column < columns_; ++column) {
    into.segment(column * rows_, rows_) = block.col(column);
  }
}

Index Anderson::take_slot(ConstMatrixRef residual) {
  if (common_ < size_ && sets_ > 1) {
    throw std::logic_error("a history of several sets takes one difference of their own, at last");
  }
  const Index slot = next_;
  for (Index set = 0; set < sets_; ++set) {
    stack(residual.middleCols(set * columns_, columns_), residual_.col(set * depth_ + slot));
  }
  next_ = (next_ + 1) % depth_;
  size_ = std::min(size_ + 1, depth_);
  if (std::ranges::find(fresh_, slot) == fresh_.end()) {
    fresh_.push_back(slot);
  }
  return slot;
}

void Anderson::push_common(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces) {
  if (depth_ == 0) {
    return;
  }
  const Index slot = take_slot(residual);
  common_ = size_;
  stack(data, data_.col(slot));
  stack(traces, traces_.col(slot));
}

void Anderson::push(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces) {
  if (sets_ == 1) {
    push_common(data, residual, traces);
  } else if (depth_ > 0) {
    take_slot(residual);
    own_data_.resize(rows_ * columns_, sets_);
    own_traces_.resize(rows_ * columns_, sets_);
    for (Index set = 0; set < sets_; ++set) {
      stack(data.middleCols(set * columns_, columns_), own_data_.col(set));
      stack(traces.middleCols(set * columns_, columns_), own_traces_.col(set));
    }
  }
}

const Matrix& Anderson::products_of(Index set, ConstMatrixRef residual) {
  const Index count = 1 + static_cast<Index>(fresh_.size());
  products_.setZero(size_, count);
  const Index size = rows_ * columns_;
  if (size_ == 0 || size == 0) {
    return products_;
  }
  // one row of sums after the other for every piece, which are added in their order
  of_pieces_.setZero(size_ * count, (size + piece_size - 1) / piece_size);
  weighted_.resize(size);
  in_pieces(size, piece_size, size_ * count, [&](Index first, Index length) {
    Eigen::Map<Matrix> sums(of_pieces_.col(first / piece_size).data(), size_, count);
    auto weighted = weighted_.segment(first, length);
    // column by column, so that all products pass over the history once
    for (Index at = first; at < first + length;) {
      const Index row = at % rows_;
      const Index rows = std::min(rows_ - row, first + length - at);
      const auto weights = metric_.weights().segment(row, rows);
      const auto stored = residual_.block(at, set * depth_, rows, size_);
      for (Index i = 0; i < count; ++i) {
        if (i == 0) {
          weighted.head(rows) = weights.cwiseProduct(residual.col(at / rows_).segment(row, rows));
        } else {
          weighted.head(rows) =
              weights.cwiseProduct(stored.col(fresh_[static_cast<std::size_t>(i - 1)]));
        }
        sums.col(i).noalias() += stored.transpose() * weighted.head(rows);
      }
      at += rows;
    }
  });
  for (const auto& of_piece : of_pieces_.colwise()) {
    products_ += of_piece.reshaped(size_, count);
  }
  return products_;
}

void Anderson::fit(ConstMatrixRef residual, std::span<double> shares) {
  // all that must be summed over ranks, in one message: the caller's, |r|^2, dR^T r, new rows of the Gram matrix
  std::vector<double> sums(shares.begin(), shares.end());
  for (Index set = 0; set < sets_; ++set) {
    const auto of_set = residual.middleCols(set * columns_, columns_);
    sums.push_back(metric_.share_of_square(of_set));
    const Matrix& products = products_of(set, of_set);
    sums.insert(sums.end(), products.data(), products.data() + products.size());
  }
  metric_.sum(sums);
  auto next = sums.cbegin() + static_cast<std::ptrdiff_t>(shares.size());
  std::copy(sums.cbegin(), next, shares.begin());

  gamma_.resize(size_, sets_);
  Vector projection(size_);
  for (Index set = 0; set < sets_; ++set) {
    norms_(set) = std::sqrt(*next++);
    for (double& value : projection) {
      value = *next++;
    }
    Matrix& gram = gram_[static_cast<std::size_t>(set)];
    for (const Index slot : fresh_) {
      for (Index other = 0; other < size_; ++other) {
        gram(slot, other) = *next++;
        gram(other, slot) = gram(slot, other);
      }
    }
    const Fit best = least_squares(gram.topLeftCorner(size_, size_), projection, norms_(set));
    gamma_.col(set) = best.gamma;
    remainders_(set) = best.remainder;
  }
  fresh_.clear();
  predicted_data_ = predicted_traces_ = false;
}

double Anderson::explained(Index set) const {
  return std::sqrt(std::max(0.0, 1.0 - remainders_(set) * remainders_(set)));
}

void Anderson::combine(const Matrix& common, const Matrix& own, Matrix& sum) const {
  sum.resize(rows_, sets_ * columns_);
  if (rows_ == 0) {
    return;  // a rank without interfaces: BLAS does not take empty blocks
  }
  Eigen::Map<Matrix> all(sum.data(), rows_ * columns_, sets_);
  if (sets_ == 1) {
    in_pieces(all.rows(), piece_size, gamma_.rows(), [&](Index first, Index length) {
      all.col(0).segment(first, length).noalias() =
          common.block(first, 0, length, gamma_.rows()) * gamma_.col(0);
    });
    return;
  }
  const Index shared = std::min(common_, gamma_.rows());
  all.noalias() = common.leftCols(shared) * gamma_.topRows(shared);
  if (shared < gamma_.rows()) {
    all += own * gamma_.row(shared).asDiagonal();
  }
}

const Matrix& Anderson::predicted_data() const {
  if (!predicted_data_) {
    predicted_data_ = true;
    combine(data_, own_data_, error_.data);
  }
  return error_.data;
}

const State& Anderson::predicted_error() const {
  static_cast<void>(predicted_data());
  if (!predicted_traces_) {
    predicted_traces_ = true;
    combine(traces_, own_traces_, error_.traces);
  }
  return error_;
}

void Anderson::step(ConstMatrixRef residual, double beta, const Preconditioner& precondition,
                    MatrixRef step) {
  const Index used = gamma_.rows();
  for (Index set = 0; set < sets_ && rows_ > 0; ++set) {
    in_pieces(work_.rows(), piece_size, used, [&](Index first, Index length) {
      work_.col(set).segment(first, length).noalias() =
          residual_.block(first, set * depth_, length, used) * gamma_.col(set);
    });
  }
  step = residual - Eigen::Map<const Matrix>(work_.data(), rows_, sets_ * columns_);
  if (precondition) {
    precondition(step);
  }
  step = beta * step - predicted_data();
}

Anderson::Difference Anderson::difference(Index slot) const {
  return {{data_.col(slot).data(), rows_, columns_},
          {traces_.col(slot).data(), rows_, columns_},
          std::sqrt(gram_.front()(slot, slot))};
}

}  // namespace latin::iteration
