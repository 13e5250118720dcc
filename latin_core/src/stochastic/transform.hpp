#pragma once

#include <vector>

#include "stochastic/basis.hpp"

namespace latin::stochastic {

/// Change of columns between chaos modes and the columns in which a law is deterministic: a block
/// of modes (rows, c) becomes modes * forward (rows, q), the law is applied with the values of its
/// random parameter in each of the q columns, and the answer returns as answer * backward
/// (rows, c).
struct ColumnTransform {
  Matrix forward;   ///< (c, q)
  Matrix backward;  ///< (q, c); empty: the transpose of `forward`, which is orthogonal
  Vector values;    ///< (q) values of the random parameter; empty if it is evaluated at `points`
  Matrix points;    ///< (q, L) germ points; empty for a Galerkin transform
  Vector weights;   ///< (q) their probabilities; empty for a Galerkin transform
};

/// Exact Galerkin: A = V diag(values) V^T, forward = V, backward = V^T. A linear law with the
/// parameter `values` then solves the coupled systems of size P + 1 of the paper's section 4.3
/// exactly.
/// @param matrix (c, c) symmetric, of galerkin_matrix() or germ_matrix()
[[nodiscard]] ColumnTransform galerkin_transform(const SparseColumns& matrix);

/// The same of a field, point by point, from what the matrices of all points have in common.
/// @param coefficients (points, property.size())
/// @return of every point; `backward` is empty, it is the transpose
/// @throws InputError as galerkin_matrix()
[[nodiscard]] std::vector<ColumnTransform> galerkin_transforms(const ChaosBasis& basis,
                                                               ConstMatrixRef coefficients,
                                                               const MultiIndexSet& property);

/// Pseudo-spectral: forward evaluates the modes at the points, backward projects,
/// forward = Psi^T, backward = diag(weights) Psi. Inverse of each other on the modes if the rule is
/// exact for products of two of them.
/// @param rule points (q, L), weights (q)
[[nodiscard]] ColumnTransform quadrature_transform(const ChaosBasis& basis, const Rule& rule);

}  // namespace latin::stochastic
