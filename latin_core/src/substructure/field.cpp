#include "substructure/field.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "algebra/sparse_product.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

using stochastic::ModeRows;

/// What conjugate gradients leave of changes, which are repeated exactly at the end; as single precision leaves of them.
constexpr double of_changes = 1e-6;
/// Of what the last solution lacked: the next one of an iteration starts from what is left here.
constexpr double of_lacking = 3e-3;
constexpr int most_steps = 2000;

/// Inner products of the columns of every step, (steps); columns (k, s), s fastest.
Vector products(const Matrix& a, const Matrix& b, Index modes) {
  const Vector each = a.cwiseProduct(b).colwise().sum();
  const Index steps = each.size() / modes;
  return each.reshaped(steps, modes).rowwise().sum();
}

/// The numbers of steps in all columns.
Vector spread(const Vector& of_steps, Index modes) { return of_steps.replicate(modes, 1); }

}  // namespace

FieldBody::FieldBody(const Body& body, Matrix extra, const Couplings& couplings)
    : body_(&body), extra_(std::move(extra)) {
  for (const Stretch& stretch : body.stretches()) {
    const auto found = couplings.find(stretch.member);
    if (found == couplings.end()) {
      continue;
    }
    const stochastic::Coupling& coupling = *found->second;
    if (coupling.points() != stretch.points ||
        (!couplings_.empty() && coupling.modes() != modes())) {
      throw InputError("substructure '" + stretch.member + "': a field on " +
                       std::to_string(coupling.points()) + " points and " +
                       std::to_string(coupling.modes()) + " modes, it has " +
                       std::to_string(stretch.points) + " points");
    }
    stretches_.push_back(&stretch);
    couplings_.push_back(found->second);
  }
}

Matrix FieldBody::coupled(std::size_t part, const Matrix& stretch) const {
  const Index steps = stretch.cols() / modes();
  Matrix result(stretch.rows(), stretch.cols());
  ModeRows given(stretch.rows(), modes());
  ModeRows found(stretch.rows(), modes());
  for (Index step = 0; step < steps; ++step) {
    const auto columns = Eigen::seqN(step, modes(), steps);
    given = stretch(every, columns);
    couplings_[part]->apply(given, stretches_[part]->components(), found);
    result(every, columns) = found;
  }
  return result;
}

void FieldBody::add_change(const Matrix& unknowns, Matrix& forces) const {
  for (std::size_t part = 0; part < stretches_.size(); ++part) {
    const Stretch& stretch = *stretches_[part];
    Matrix moved(stretch.of_unknowns.rows(), unknowns.cols());
    algebra::multiply_sparse(stretch.of_unknowns, unknowns, moved);
    const Matrix stressed = coupled(part, moved);
    Matrix back(stretch.back.rows(), unknowns.cols());
    algebra::multiply_sparse(stretch.back, stressed, back);
    forces += back;
  }
}

void FieldBody::iterate(Matrix& left, Work& work, double accuracy) const {
  const Index columns = left.cols();
  Matrix& found = work.unknowns;
  double of_first = std::isinf(work.accuracy) ? 0.0 : of_lacking * of_lacking;
  if (found.rows() != body_->size() || found.cols() != columns) {
    if (std::isinf(accuracy)) {  // the means alone
      found = body_->factor_->solve(left);
      work.of_means = left;
      return;
    }
    found = Matrix::Zero(body_->size(), columns);
    work.of_means = Matrix::Zero(body_->size(), columns);
    of_first = 0.0;  // nothing is known: it may be the only solution
  } else {
    Matrix forces = work.of_means;
    add_change(found, forces);
    left -= forces;
  }
  const algebra::Factor& means = *body_->factor_;
  Matrix direction = means.solve(left);
  Matrix of_means = left;
  Vector size = products(left, direction, modes());
  const Vector enough = of_first * size;
  const double square = accuracy * accuracy;
  constexpr double step_of_least_size = 1e-12;
  for (int step = 0; step < most_steps; ++step) {
    if (!size.allFinite()) {  // that of data which are none: the iteration says so
      found.setConstant(std::numeric_limits<double>::quiet_NaN());
      return;
    }
    Vector wanted = square * products(found, work.of_means, modes());
    wanted = wanted.cwiseMax(step_of_least_size * wanted.maxCoeff()).cwiseMax(enough);
    if ((size.array() <= wanted.array()).all() || !(size.maxCoeff() > 0.0)) {
      return;
    }
    Matrix forces = of_means;
    add_change(direction, forces);
    const Vector energy = products(direction, forces, modes());
    Vector length = Vector::Zero(size.size());
    for (Index s = 0; s < size.size(); ++s) {
      if (size(s) > 0.0) {
        if (!(energy(s) > 0.0)) {
          throw NumericalError("body '" + body_->name() +
                               "': the stiffness with its random field is not positive definite");
        }
        length(s) = size(s) / energy(s);
      }
    }
    const Vector lengths = spread(length, modes());
    found.noalias() += direction * lengths.asDiagonal();
    work.of_means.noalias() += of_means * lengths.asDiagonal();
    left.noalias() -= forces * lengths.asDiagonal();
    const Matrix preconditioned = means.solve(left);
    const Vector now = products(left, preconditioned, modes());
    Vector ratio = Vector::Zero(size.size());
    for (Index s = 0; s < size.size(); ++s) {
      ratio(s) = size(s) > 0.0 ? now(s) / size(s) : 0.0;
    }
    const Vector ratios = spread(ratio, modes());
    direction = preconditioned + direction * ratios.asDiagonal();
    of_means = left + of_means * ratios.asDiagonal();
    size = now;
  }
  throw NumericalError("body '" + body_->name() + "': " + std::to_string(most_steps) +
                       " steps of conjugate gradients did not solve its random field: its "
                       "stiffness is nearly indefinite");
}

Matrix FieldBody::forces_of(ConstMatrixRef data, ConstMatrixRef amplitudes) const {
  Matrix forces = Matrix::Zero(body_->size(), amplitudes.cols());
  if (body_->rows() > 0) {
    forces += body_->traces_.transpose() * (body_->weights_.asDiagonal() * data);
  }
  if (amplitudes.rows() > 0) {
    forces += body_->load_ * amplitudes;
    if (extra_.size() > 0) {
      forces += extra_ * amplitudes;
    }
    for (std::size_t part = 0; part < stretches_.size(); ++part) {
      const Stretch& stretch = *stretches_[part];
      const Matrix imposed = (stretch.initial - stretch.offset) * amplitudes;
      if (!imposed.isZero(0.0)) {
        forces += stretch.back * coupled(part, imposed);
      }
    }
  }
  return forces;
}

bool FieldBody::solved(ConstMatrixRef data, ConstMatrixRef amplitudes) const {
  const auto same = [](const Matrix& known, const ConstMatrixRef& given) {
    return known.rows() == given.rows() && known.cols() == given.cols() && known == given;
  };
  return work_.unknowns.size() > 0 && same(work_.data, data) && same(work_.amplitudes, amplitudes);
}

void FieldBody::solve(ConstMatrixRef data, ConstMatrixRef amplitudes, double accuracy) const {
  if (work_.accuracy <= accuracy && solved(data, amplitudes)) {
    return;
  }
  work_.data.resize(0, 0);  // nothing is solved if this fails
  work_.forces = forces_of(data, amplitudes);
  Matrix left = work_.forces;
  iterate(left, work_, accuracy);
  work_.data = data;
  work_.amplitudes = amplitudes;
  work_.accuracy = accuracy;
}

void FieldBody::apply(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces,
                      double accuracy) const {
  const std::scoped_lock lock(mutex_);
  solve(data, amplitudes, accuracy);
  if (body_->rows() > 0) {
    algebra::multiply_sparse(body_->traces_, work_.unknowns, traces);
    if (amplitudes.rows() > 0) {
      traces.noalias() += body_->offset_traces_ * amplitudes;
    }
  }
}

void FieldBody::change(ConstMatrixRef data, MatrixRef traces) const {
  if (body_->rows() == 0) {
    return;
  }
  Matrix forces = body_->traces_.transpose() * (body_->weights_.asDiagonal() * data);
  Work work;
  iterate(forces, work, of_changes);
  algebra::multiply_sparse(body_->traces_, work.unknowns, traces);
}

Matrix FieldBody::left() const {
  const std::scoped_lock lock(mutex_);
  Matrix of_all = work_.of_means;
  add_change(work_.unknowns, of_all);
  return work_.forces - of_all;
}

void FieldBody::advance(const Matrix& step) const {
  const std::scoped_lock lock(mutex_);
  work_.unknowns += step;
  work_.of_means += body_->lower_.selfadjointView<Eigen::Lower>() * step;
  work_.accuracy = std::numeric_limits<double>::infinity();
}

/// Of u = q + u0 that with the means, K q from the operator without the springs of its sides, and what the field adds.
Vector FieldBody::energies(ConstMatrixRef data, ConstMatrixRef amplitudes, double accuracy) const {
  const std::scoped_lock lock(mutex_);
  solve(data, amplitudes, accuracy);
  const Matrix& q = work_.unknowns;
  Vector energies = q.cwiseProduct(work_.of_means).colwise().sum();
  if (body_->rows() > 0) {
    const Matrix moved = body_->traces_ * q;
    const Vector robin = body_->weights_.cwiseProduct(body_->direction_);
    energies -= (moved.cwiseAbs2().transpose() * robin);
  }
  if (amplitudes.rows() > 0 && body_->work_.size() > 0) {
    const Vector robin = body_->weights_.cwiseProduct(body_->direction_);
    const Matrix whole =
        body_->load_ + body_->traces_.transpose() * (robin.asDiagonal() * body_->offset_traces_);
    const Matrix of_offset = (body_->work_ - whole) * amplitudes;  // twice
    const Matrix of_both = body_->offset_energy_ * amplitudes;
    energies += (q.cwiseProduct(of_offset).colwise().sum() +
                 amplitudes.cwiseProduct(of_both).colwise().sum())
                    .transpose();
  }
  for (std::size_t part = 0; part < stretches_.size(); ++part) {
    const Stretch& stretch = *stretches_[part];
    Matrix moved = stretch.of_unknowns * q;
    if (amplitudes.rows() > 0) {
      moved += stretch.offset * amplitudes;
    }
    energies += moved.cwiseProduct(coupled(part, moved)).colwise().sum().transpose();
  }
  return energies;
}

std::vector<Matrix> FieldBody::displacements(ConstMatrixRef data, ConstMatrixRef amplitudes) const {
  const std::scoped_lock lock(mutex_);
  if (std::isinf(work_.accuracy) || !solved(data, amplitudes)) {
    work_.accuracy = std::numeric_limits<double>::infinity();  // it is no step of an iteration
    solve(data, amplitudes, exact);
  }
  std::vector<Matrix> fields;
  for (std::size_t e = 0; e < body_->prolongations_.size(); ++e) {
    fields.emplace_back(body_->prolongations_[e] * work_.unknowns);
    if (body_->offsets_[e].size() > 0) {
      fields.back() += body_->offsets_[e] * amplitudes;
    }
  }
  return fields;
}

std::shared_ptr<const Body> FieldColumns::sample(const Body& mean, Index number) const {
  std::vector<Vector> own;
  own.reserve(factors.size());
  for (const Matrix& each : factors) {
    own.emplace_back(each.col(number));
  }
  return mean.with_factors(own);
}

std::vector<Matrix> FieldColumns::displacements(const Body& mean, ConstMatrixRef data,
                                                ConstMatrixRef amplitudes) const {
  if (chaos != nullptr) {
    return chaos->displacements(data, amplitudes);
  }
  if (body != nullptr) {
    return body->displacements(data, amplitudes, response);
  }
  const Index count = data.cols() / blocks();
  std::vector<Matrix> fields;
  for (Index k = 0; k < blocks(); ++k) {
    const std::shared_ptr<const Body> one = sample(mean, k);
    const std::vector<Matrix> found =
        one->displacements(data.middleCols(k * count, count),
                           amplitudes.middleCols(k * count, count), one->response_to_extra(extra));
    for (std::size_t e = 0; e < found.size(); ++e) {
      if (k == 0) {
        fields.emplace_back(found[e].rows(), data.cols());
      }
      fields[e].middleCols(k * count, count) = found[e];
    }
  }
  return fields;
}

}  // namespace latin::substructure
