#include "stochastic/transform.hpp"

#include <cstddef>
#include <string>

#include "algebra/eigenvectors.hpp"
#include "latin/common/error.hpp"
#include "stochastic/galerkin.hpp"

namespace latin::stochastic {
namespace {

ColumnTransform eigenvectors_of(const SparseColumns& matrix) {
  const Index size = matrix.rows();
  ColumnTransform transform;
  transform.forward = Matrix::Zero(size, size);
  transform.values.resize(size);
  std::vector<Index> place(static_cast<std::size_t>(size));
  Index column = 0;
  // by blocks: smaller, and the zeros between uncoupled modes stay exact
  for (const std::vector<Index>& block : coupled_blocks(matrix)) {
    const auto width = static_cast<Index>(block.size());
    for (Index a = 0; a < width; ++a) {
      place[static_cast<std::size_t>(block[static_cast<std::size_t>(a)])] = a;
    }
    Matrix dense = Matrix::Zero(width, width);
    for (Index b = 0; b < width; ++b) {
      for (SparseColumns::InnerIterator entry(matrix, block[static_cast<std::size_t>(b)]); entry;
           ++entry) {
        dense(place[static_cast<std::size_t>(entry.row())], b) = entry.value();
      }
    }
    if (!dense.allFinite() ||
        (dense - dense.transpose()).cwiseAbs().maxCoeff() > 1e-12 * dense.cwiseAbs().maxCoeff()) {
      throw InputError("a Galerkin matrix must be symmetric and finite");
    }
    const Vector values = algebra::eigenvectors_in_place(dense);
    if (values.size() != width) {
      throw NumericalError("the eigenvalues of a Galerkin matrix of size " + std::to_string(width) +
                           " did not converge");
    }
    transform.values.segment(column, width) = values;
    for (Index a = 0; a < width; ++a) {
      transform.forward.row(block[static_cast<std::size_t>(a)]).segment(column, width) =
          dense.row(a);
    }
    column += width;
  }
  return transform;
}

}  // namespace

ColumnTransform galerkin_transform(const SparseColumns& matrix) {
  ColumnTransform transform = eigenvectors_of(matrix);
  transform.backward = transform.forward.transpose();
  return transform;
}

std::vector<ColumnTransform> galerkin_transforms(const ChaosBasis& basis,
                                                 ConstMatrixRef coefficients,
                                                 const MultiIndexSet& property) {
  if (coefficients.cols() != property.size()) {
    throw InputError("coefficients of shape (" + std::to_string(coefficients.rows()) + ", " +
                     std::to_string(coefficients.cols()) + ") do not fit a property of " +
                     std::to_string(property.size()) + " modes");
  }
  std::vector<bool> used(static_cast<std::size_t>(property.size()));
  for (Index i = 0; i < property.size(); ++i) {
    used[static_cast<std::size_t>(i)] = (coefficients.col(i).array() != 0.0).any();
  }
  const TripleProducts products(basis, property, used);
  std::vector<ColumnTransform> transforms;
  transforms.reserve(static_cast<std::size_t>(coefficients.rows()));
  for (Index point = 0; point < coefficients.rows(); ++point) {
    transforms.push_back(eigenvectors_of(products.matrix(coefficients.row(point).transpose())));
  }
  return transforms;
}

ColumnTransform quadrature_transform(const ChaosBasis& basis, const Rule& rule) {
  if (rule.weights.size() != rule.points.rows()) {
    throw InputError("a rule of " + std::to_string(rule.points.rows()) +
                     " points needs as many weights; got " + std::to_string(rule.weights.size()));
  }
  const Matrix psi = basis.evaluate(rule.points);
  return {psi.transpose(), rule.weights.asDiagonal() * psi, Vector(), rule.points, rule.weights};
}

}  // namespace latin::stochastic
