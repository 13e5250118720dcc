#include "stochastic/coupling.hpp"

#include <algorithm>
#include <limits>
#include <numeric>
#include <string>

#include "latin/common/error.hpp"
#include "stochastic/galerkin.hpp"

namespace latin::stochastic {
Coupling::Coupling(const ChaosBasis& basis, ConstMatrixRef coefficients,
                   const MultiIndexSet& property) {
  if (coefficients.rows() < 1 || coefficients.cols() != property.size()) {
    throw InputError("coefficients of shape (" + std::to_string(coefficients.rows()) + ", " +
                     std::to_string(coefficients.cols()) + ") do not fit a property of " +
                     std::to_string(property.size()) + " modes");
  }
  std::vector<bool> used(at(property.size()));
  for (Index i = 0; i < property.size(); ++i) {
    used[at(i)] = (coefficients.col(i).array() != 0.0).any();
  }
  const TripleProducts products(basis, property, used);
  std::vector<Index> places;  // column * c + row
  const Index c = basis.size();
  for (const TripleProducts::Entry& entry : products.entries()) {
    places.push_back(entry.k * c + entry.j);
    if (entry.j != entry.k) {
      places.push_back(entry.j * c + entry.k);
    }
  }
  std::ranges::sort(places);
  starts_.assign(at(c) + 1, 0);
  for (const Index place : places) {
    first_.push_back(place % c);
    ++starts_[at(place / c) + 1];
  }
  std::partial_sum(starts_.begin(), starts_.end(), starts_.begin());
  values_.resize(static_cast<Index>(places.size()), coefficients.rows());
  const auto row_of = [&places](Index place) {
    return std::ranges::lower_bound(places, place) - places.begin();
  };
  Vector sum(coefficients.rows());
  for (const TripleProducts::Entry& entry : products.entries()) {
    sum.setZero();
    for (std::size_t t = entry.begin; t < entry.end; ++t) {
      const TripleProducts::Term& term = products.terms()[t];
      sum += term.value * coefficients.col(term.mode);
    }
    values_.row(row_of(entry.k * c + entry.j)) = sum.transpose();
    values_.row(row_of(entry.j * c + entry.k)) = sum.transpose();
  }
}

std::vector<Index> Coupling::second() const {
  std::vector<Index> columns;
  for (Index k = 0; k < modes(); ++k) {
    columns.insert(columns.end(), at(starts_[at(k) + 1] - starts_[at(k)]), k);
  }
  return columns;
}

Matrix Coupling::matrix(Index point) const {
  if (point < 0 || point >= points()) {
    throw InputError("point " + std::to_string(point) + " is none of " + std::to_string(points()));
  }
  Matrix dense = Matrix::Zero(modes(), modes());
  for (Index k = 0; k < modes(); ++k) {
    for (Index e = starts_[at(k)]; e < starts_[at(k) + 1]; ++e) {
      dense(first_[at(e)], k) = values_(e, point);
    }
  }
  return dense;
}

void Coupling::apply(ConstModeRowsRef u, Index components, ModeRowsRef v) const {
  const bool fits = components >= 1 && u.cols() == modes() && u.rows() % components == 0 &&
                    (points() == 1 || u.rows() == points() * components);
  if (!fits || v.rows() != u.rows() || v.cols() != u.cols()) {
    throw InputError("fields of shape (" + std::to_string(u.rows()) + ", " +
                     std::to_string(u.cols()) + ") do not fit " + std::to_string(points()) +
                     " points of " + std::to_string(components) + " components and " +
                     std::to_string(modes()) + " modes");
  }
  for (Index row = 0; row < u.rows(); ++row) {
    const double* const given = u.data() + row * u.outerStride();
    double* const found = v.data() + row * v.outerStride();
    const double* const values = values_.col(points() == 1 ? 0 : row / components).data();
    for (Index k = 0; k < modes(); ++k) {
      double sum = 0.0;
      for (Index e = starts_[at(k)]; e < starts_[at(k) + 1]; ++e) {
        sum += values[e] * given[first_[at(e)]];
      }
      found[k] = sum;
    }
  }
}

Vector Coupling::bounds() const {
  Vector bounds = Vector::Constant(points(), std::numeric_limits<double>::infinity());
  for (Index point = 0; point < points(); ++point) {
    for (Index k = 0; k < modes(); ++k) {
      double bound = 0.0;
      for (Index e = starts_[at(k)]; e < starts_[at(k) + 1]; ++e) {
        const double value = values_(e, point);
        bound += first_[at(e)] == k ? value : -std::abs(value);
      }
      bounds(point) = std::min(bounds(point), bound);
    }
  }
  return bounds;
}

double Coupling::smallest() const {
  const Vector bound = bounds();
  std::vector<Index> order(at(points()));
  std::iota(order.begin(), order.end(), Index{0});
  std::ranges::sort(order, {}, [&bound](Index point) { return bound(point); });
  double smallest = std::numeric_limits<double>::infinity();
  for (const Index point : order) {
    if (bound(point) >= smallest) {
      break;
    }
    smallest = std::min(smallest, smallest_eigenvalue(matrix(point).sparseView()));
  }
  return smallest;
}

}  // namespace latin::stochastic
