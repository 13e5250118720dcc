#include "substructure/flexibility.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <mutex>

#include "algebra/triangle.hpp"
#include "common/threads.hpp"
#include "latin/common/error.hpp"
#include "latin/common/interrupt.hpp"
#include "substructure/joined.hpp"

namespace latin::substructure {
namespace {

/// Modes of a body that are looked for: the rigid ones of two parts.
constexpr Index most_modes = 12;
/// Modes softer than this fraction of the springs k are kept apart.
constexpr double soft = 1e-4;
/// Least stiffness of a mode, in the same terms: rounding of a rigid one.
constexpr double floating = 1e-13;
/// Steps of the subspace iteration: what is soft is 1 / mu times larger after each.
constexpr int subspace_steps = 3;

}  // namespace

Flexibility::Flexibility(const Structure& structure)
    : structure_(structure), joined_(std::make_shared<const Joined>(Joined::numbered(structure))) {
  structure.communicator().answer_together("the flexibility of a body cannot be factorised", [&] {
    number();  // which takes the most memory
    add_bodies();
  });
  gather();
  find_own();
  matrix_.diagonal() += direct_;
  matrix_ /= 1.0 + mu;
  modal_jumps_ = Matrix::Zero(unknowns(), modal_traces_.cols());
  for (Index row = 0; row < modal_traces_.rows(); ++row) {
    modal_jumps_.row(unknown_[static_cast<std::size_t>(row)]) +=
        sign_(row) * modal_traces_.row(row);
  }
}

/// What is asked for of the rows and unknowns of all ranks.
void Flexibility::number() {
  const Index rows = joined_->rows();
  const Index unknowns = joined_->unknowns();
  unknown_.resize(static_cast<std::size_t>(rows));
  sign_.resize(rows);
  inverse_direction_ = joined_->directions().cwiseInverse();
  weights_ = joined_->weights();
  direct_ = Vector::Zero(unknowns);
  areas_.resize(unknowns);
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    components_.insert(components_.end(), static_cast<std::size_t>(interface.size),
                       interface.components);
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      for (Index row = 0; row < interface.size; ++row) {
        unknown_[static_cast<std::size_t>(interface.rows[s] + row)] = interface.first_unknown + row;
        sign_(interface.rows[s] + row) = s == 0 ? 1.0 : -1.0;
      }
    }
  }
  for (Index row = 0; row < rows; ++row) {
    const Index unknown = unknown_[static_cast<std::size_t>(row)];
    direct_(unknown) += inverse_direction_(row);
    areas_(unknown) = weights_(row);
  }
  matrix_ = Matrix::Zero(unknowns, unknowns);
  modal_traces_.resize(rows, 0);
}

void Flexibility::add_bodies() {
  constexpr double operations_per_number = 16.0;
  double operations = 0.0;
  for (std::size_t b = 0; b < structure_.bodies().size(); ++b) {
    const Body& body = structure_.bodies()[b];
    if (body.active() > 0) {
      parts_.push_back({&body, joined_->first_row() + structure_.body_rows()[b], {}, {}, {}});
      operations += std::pow(static_cast<double>(body.active()), 3);
    }
  }
  std::ranges::stable_sort(parts_, std::greater<>(),
                           [](const Part& part) { return part.body->active(); });
  const double numbers = operations / operations_per_number;
  in_lanes(parts_.size(), numbers,
           [&](std::size_t piece) { add_body(*parts_[piece].body, parts_[piece].first_row); });
  for (Part& part : parts_) {
    const SparseRows& trace = part.body->active_traces();
    const Vector robin = part.body->weights().cwiseProduct(part.body->directions());
    find_modes(part, trace.transpose() * SparseRows(robin.asDiagonal() * trace));
  }
  std::mutex adding;
  in_lanes(parts_.size(), numbers, [&](std::size_t piece) {
    stop_if_wanted();
    add_matrix(parts_[piece], adding);
  });
}

/// The factor of a part.
void Flexibility::add_body(const Body& body, Index first_row) {
  const SparseRows& trace = body.active_traces();
  const Vector robin = body.weights().cwiseProduct(body.directions());
  // S + T^T W k T is given; held by mu k alone: (1 + mu) of it, less T^T W k T
  Matrix stiffness;
  if (body.condensed()) {
    const Matrix lower = body.condensed_factor().triangularView<Eigen::Lower>();
    stiffness = Matrix::Zero(lower.rows(), lower.cols());
    stiffness.selfadjointView<Eigen::Lower>().rankUpdate(lower, 1.0 + mu);
  } else {
    stiffness = (1.0 + mu) * body.schur();
  }
  stiffness -= Matrix(trace.transpose() * SparseRows(robin.asDiagonal() * trace));
  const Eigen::LLT<Matrix> cholesky(stiffness);  // of the lower triangle
  if (cholesky.info() != Eigen::Success) {
    throw NumericalError("body '" + body.name() + "': its flexibility cannot be factorised");
  }
  std::ranges::find(parts_, first_row, &Part::first_row)->factor = cholesky.matrixL();
}

/// The matrix and the modes of all ranks.
void Flexibility::gather() {
  const Communicator& communicator = structure_.communicator();
  if (communicator.alone()) {
    return;
  }
  communicator.sum({matrix_.data(), static_cast<std::size_t>(matrix_.size())});
  const auto stiffness =
      communicator.gather(std::vector<double>(modal_stiffness_.begin(), modal_stiffness_.end()));
  const auto traces = communicator.gather(
      std::vector<double>(modal_traces_.data(), modal_traces_.data() + modal_traces_.size()));
  std::vector<double> every_stiffness;
  std::vector<double> every_trace;
  for (std::size_t rank = 0; rank < traces.size(); ++rank) {
    every_stiffness.insert(every_stiffness.end(), stiffness[rank].begin(), stiffness[rank].end());
    every_trace.insert(every_trace.end(), traces[rank].begin(), traces[rank].end());
  }
  const auto modes = static_cast<Index>(every_stiffness.size());
  modal_stiffness_ = Eigen::Map<const Vector>(every_stiffness.data(), modes);
  modal_traces_ = Eigen::Map<const Matrix>(every_trace.data(), modal_traces_.rows(), modes);
}

void Flexibility::find_own() {
  own_ = joined_->of_points(matrix_.diagonal());
  own_ = (own_.array() > 0.0).select(own_, direct_);  // faces whose displacements are given
}

void Flexibility::find_modes(Part& part, const SparseRows& springs) {
  const Index size = part.factor.rows();
  const Matrix& factor = part.factor;
  const Index count = std::min(size, most_modes);
  Matrix block(size, count);
  for (Index column = 0; column < count; ++column) {
    for (Index row = 0; row < size; ++row) {
      // any fixed numbers without a pattern
      block(row, column) = std::sin(static_cast<double>((row + 1) * (2 * column + 1)) * 1.234567);
    }
  }
  for (int step = 0; step < subspace_steps; ++step) {
    block = springs * block;
    factor.triangularView<Eigen::Lower>().solveInPlace(block);
    factor.triangularView<Eigen::Lower>().transpose().solveInPlace(block);
    const Eigen::HouseholderQR<Matrix> qr(block);
    block = qr.householderQ() * Matrix::Identity(size, count);
  }
  // stiffnesses of the subspace against its springs: the softest modes are the largest of the inverse
  const Matrix stretched = part.factor.transpose().triangularView<Eigen::Upper>() * block;
  const Matrix held = springs * block;
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix> eigen(block.transpose() * held,
                                                               stretched.transpose() * stretched);
  const Index modes = (eigen.eigenvalues().array() > 1.0 / soft).count();
  const Vector inverse = eigen.eigenvalues().tail(modes);
  // eigenvectors have unit stiffness; unit springs instead
  const Vector scale = inverse.cwiseSqrt().cwiseInverse();
  part.modes = block * (eigen.eigenvectors().rightCols(modes) * scale.asDiagonal());
  part.springs = springs * part.modes;

  const Index before = modal_traces_.cols();
  modal_traces_.conservativeResize(Eigen::NoChange, before + modes);
  modal_traces_.rightCols(modes).setZero();
  modal_traces_.block(part.first_row, before, part.body->rows(), modes) =
      part.body->active_traces() * part.modes;
  modal_stiffness_.conservativeResize(before + modes);
  // without the springs mu k: beside soft supports they would carry a share of the load
  modal_stiffness_.tail(modes) =
      ((inverse.cwiseInverse().array() - mu) / ((1.0 + mu) * (1.0 + mu))).max(floating);
}

void Flexibility::add_matrix(const Part& part, std::mutex& adding) {
  // Y = L^-1 T^T E without the modes, so that the flexibility is Y^T Y W
  const SparseRows& trace = part.body->active_traces();
  std::vector<Index> position(static_cast<std::size_t>(unknowns()), -1);
  std::vector<Index> touched;
  for (Index row = 0; row < trace.rows(); ++row) {
    const Index unknown = unknown_[static_cast<std::size_t>(part.first_row + row)];
    if (position[static_cast<std::size_t>(unknown)] < 0) {
      position[static_cast<std::size_t>(unknown)] = static_cast<Index>(touched.size());
      touched.push_back(unknown);
    }
  }
  Matrix y = Matrix::Zero(part.factor.rows(), static_cast<Index>(touched.size()));
  Vector area(y.cols());
  for (Index row = 0; row < trace.rows(); ++row) {
    const Index unknown = unknown_[static_cast<std::size_t>(part.first_row + row)];
    const Index column = position[static_cast<std::size_t>(unknown)];
    area(column) = part.body->weights()(row);
    for (SparseRows::InnerIterator it(trace, row); it; ++it) {
      y(it.col(), column) += sign_(part.first_row + row) * it.value();
    }
  }
  y -= part.springs * (part.modes.transpose() * y);
  part.factor.triangularView<Eigen::Lower>().solveInPlace(y);
  Matrix product = Matrix::Zero(y.cols(), y.cols());
  product.selfadjointView<Eigen::Lower>().rankUpdate(y.transpose());
  // two bodies at most have a share in an entry: their order does not matter
  const std::scoped_lock lock(adding);
  for (Index column = 0; column < product.cols(); ++column) {
    const Index to = touched[static_cast<std::size_t>(column)];
    for (Index row = 0; row < product.rows(); ++row) {
      const double value = row < column ? product(column, row) : product(row, column);
      matrix_(touched[static_cast<std::size_t>(row)], to) += value * area(column);
    }
  }
}

Vector Flexibility::product(ConstVectorRef y) const {
  return algebra::product_with_triangle(matrix_, areas_, y);
}

Matrix Flexibility::solve(ConstMatrixRef v) const {
  // (1 + mu - k A)^-1 = (1 + k T K^-1 T^T W) / (1 + mu)
  Matrix result = v;
  double numbers = 0.0;
  for (const Part& part : parts_) {
    numbers += static_cast<double>(part.factor.size());
  }
  in_lanes(parts_.size(), numbers, [&](std::size_t piece) {  // none of them fails
    const Part& part = parts_[piece];
    const SparseRows& trace = part.body->active_traces();
    auto of_body = result.middleRows(part.first_row, part.body->rows());
    Matrix unknowns = trace.transpose() * (part.body->weights().asDiagonal() * of_body);
    unknowns -= part.springs * (part.modes.transpose() * unknowns);
    algebra::solve_with_triangle(part.factor, unknowns);
    unknowns -= part.modes * (part.springs.transpose() * unknowns);
    of_body += part.body->directions().asDiagonal() * (trace * unknowns);
  });
  if (!structure_.communicator().alone()) {
    result = joined_->of_rows(joined_->own_rows(result));
  }
  return result / (1.0 + mu);
}

Matrix Flexibility::modal_loads(ConstMatrixRef v) const {
  return modal_traces_.transpose() * (weights_.asDiagonal() * v);
}

Matrix Flexibility::modal_data(ConstMatrixRef amplitudes) const {
  return inverse_direction_.cwiseInverse().asDiagonal() * (modal_traces_ * amplitudes) / (1.0 + mu);
}

Matrix Flexibility::spread(ConstMatrixRef y) const {
  Matrix result(sign_.size(), y.cols());
  for (Index row = 0; row < result.rows(); ++row) {
    result.row(row) = sign_(row) * y.row(unknown_[static_cast<std::size_t>(row)]);
  }
  return result;
}

Vector Flexibility::force(ConstVectorRef v) const { return jump(v).cwiseQuotient(direct_); }

Matrix Flexibility::jump(ConstMatrixRef v) const {
  Matrix result = Matrix::Zero(unknowns(), v.cols());
  for (Index row = 0; row < v.rows(); ++row) {
    result.row(unknown_[static_cast<std::size_t>(row)]) +=
        sign_(row) * inverse_direction_(row) * v.row(row);
  }
  return result;
}

}  // namespace latin::substructure
