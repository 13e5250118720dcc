#include "latin/stochastic/transform.hpp"

#include <Eigen/Eigenvalues>

#include "latin/common/error.hpp"
#include "latin/stochastic/galerkin.hpp"

namespace latin::stochastic {

ColumnTransform galerkin_transform(const SparseColumns& matrix) {
  const Index size = matrix.rows();
  ColumnTransform transform;
  transform.forward = Matrix::Zero(size, size);
  transform.values.resize(size);
  Index column = 0;
  // by blocks: smaller, and the zeros between uncoupled modes stay exact
  for (const std::vector<Index>& block : coupled_blocks(matrix)) {
    const auto width = static_cast<Index>(block.size());
    Matrix dense(width, width);
    for (Index a = 0; a < width; ++a) {
      for (Index b = 0; b < width; ++b) {
        dense(a, b) =
            matrix.coeff(block[static_cast<std::size_t>(a)], block[static_cast<std::size_t>(b)]);
      }
    }
    if (!dense.allFinite() ||
        (dense - dense.transpose()).cwiseAbs().maxCoeff() > 1e-12 * dense.cwiseAbs().maxCoeff()) {
      throw InputError("a Galerkin matrix must be symmetric and finite");
    }
    const Eigen::SelfAdjointEigenSolver<Matrix> solver(dense);
    if (solver.info() != Eigen::Success) {
      throw NumericalError("the eigenvalues of a Galerkin matrix of size " + std::to_string(width) +
                           " did not converge");
    }
    transform.values.segment(column, width) = solver.eigenvalues();
    for (Index a = 0; a < width; ++a) {
      transform.forward.row(block[static_cast<std::size_t>(a)]).segment(column, width) =
          solver.eigenvectors().row(a);
    }
    column += width;
  }
  transform.backward = transform.forward.transpose();
  return transform;
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
