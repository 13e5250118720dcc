#include "latin/substructure/contact_tangent.hpp"

#include <algorithm>
#include <utility>

#include "latin/algebra/general_factor.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// Jumps fewer than this fraction of the active unknowns are worth a dense matrix, as long as there are no more than
/// this.
constexpr double few = 0.5;
constexpr double most_jumps = 4000.0;
constexpr double most_bytes = 1e9;
/// Tangents that differ by less are the same: they may come from differences.
constexpr double same = 1e-6;
/// Columns of G at once.
constexpr Index block = 64;
/// Operations of a factorisation, over the third power of its size.
constexpr double of_factorisation = 2.0 / 3.0;

}  // namespace

bool ContactTangent::pays(const Tangent& tangent, const std::vector<Index>& varying) {
  const auto active = static_cast<double>(tangent.joined().active());
  const auto jumps = static_cast<double>(varying.size());
  return jumps <= std::min(most_jumps, few * active) && 8.0 * jumps * active <= most_bytes;
}

ContactTangent::ContactTangent(Tangent& tangent, std::vector<Index> varying)
    : tangent_(tangent), varying_(std::move(varying)) {
  const auto count = static_cast<Index>(varying_.size());
  reference_.resize(count);
  jumps_.resize(count, tangent_.joined().active());
  std::vector<Eigen::Triplet<double, int>> entries;
  for (Index i = 0; i < count; ++i) {
    const Index unknown = varying_[static_cast<std::size_t>(i)];
    reference_(i) = 1.0 / tangent_.flexibility()(unknown);
    for (SparseRows::InnerIterator it(tangent_.jumps(), unknown); it; ++it) {
      entries.emplace_back(static_cast<int>(i), static_cast<int>(it.col()), it.value());
    }
  }
  jumps_.setFromTriplets(entries.begin(), entries.end());
}

double ContactTangent::work() const {
  const auto size = static_cast<double>(jumps_.rows());
  return of_factorisation * size * size * size;
}

void ContactTangent::factorise(const Matrix& stiffness, const Vector& springs) {
  take_others(stiffness);
  const Index count = jumps_.rows();
  change_.resize(count, stiffness.cols());
  Matrix whole = Matrix::Identity(count, count);
  for (Index i = 0; i < count; ++i) {
    const Index unknown = varying_[static_cast<std::size_t>(i)];
    const Index component = tangent_.component(unknown);
    change_.row(i) = stiffness.row(unknown);
    change_(i, component) += springs(unknown) - reference_(i);
    change_.row(i) *= tangent_.areas()(unknown);
    // column j of G times row i of D, where both are of one point
    for (Index j = 0; j < change_.cols(); ++j) {
      if (change_(i, j) != 0.0) {
        whole.col(i - component + j) += change_(i, j) * flexibility_.col(i);
      }
    }
  }
  factor_.compute(whole);
  if (!algebra::has_pivots(factor_)) {
    throw NumericalError("the structure is not stable with the tangents of its laws");
  }
}

/// The tangents that do not change, unless they are those that are known.
void ContactTangent::take_others(const Matrix& stiffness) {
  Matrix others = stiffness;
  for (std::size_t i = 0; i < varying_.size(); ++i) {
    const Index unknown = varying_[i];
    others.row(unknown).setZero();
    others(unknown, tangent_.component(unknown)) = reference_(static_cast<Index>(i));
  }
  if (others.size() == others_.size() &&
      ((others - others_).array().abs() <= same * others_.array().abs()).all()) {
    return;
  }
  others_.resize(0, 0);
  tangent_.factorise_stiffness(others, Tangent::least_hold);
  const Index count = jumps_.rows();
  answers_.resize(jumps_.cols(), count);
  flexibility_.resize(count, count);
  for (Index first = 0; first < count; first += block) {
    const Index size = std::min(block, count - first);
    const Matrix forces = Matrix(jumps_.middleRows(first, size)).transpose();
    answers_.middleCols(first, size) = tangent_.solve(forces);
    flexibility_.middleCols(first, size) = jumps_ * answers_.middleCols(first, size);
  }
  others_ = std::move(others);
}

Vector ContactTangent::solve(const Vector& load) {
  const Vector jump = factor_.solve(Vector(answers_.transpose() * load));
  Vector force = Vector::Zero(jump.size());
  for (Index i = 0; i < jump.size(); ++i) {
    const Index first = i - tangent_.component(varying_[static_cast<std::size_t>(i)]);
    for (Index j = 0; j < change_.cols(); ++j) {
      if (change_(i, j) != 0.0) {
        force(i) += change_(i, j) * jump(first + j);
      }
    }
  }
  return tangent_.solve(load - jumps_.transpose() * force);
}

}  // namespace latin::substructure
