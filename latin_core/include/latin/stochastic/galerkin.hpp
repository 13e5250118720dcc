#pragma once

#include <vector>

#include "latin/stochastic/basis.hpp"

namespace latin::stochastic {

/// T_i(j, k) = E[psi_i psi_j psi_k] of one germ for i <= `first` and j, k <= `second`: `first` + 1
/// matrices of size `second` + 1. Exact Gauss quadrature; what vanishes by degree or symmetry is
/// exactly 0.
[[nodiscard]] std::vector<Matrix> triple_products(const Germ& germ, Index first, Index second);

/// Galerkin matrix of a random scalar a = sum_i a_i Psi_i:
///
///     A_jk = sum_i a_i E[Psi_i Psi_j Psi_k]  =  E[a Psi_j Psi_k]      (paper, equation 19)
///
/// with the full coupling if `property` holds every i that some pair j, k reaches (degree up to
/// 2p): then A is positive definite for every order as soon as a > 0.
/// @param basis germs and modes j, k
/// @param coefficients (property.size()), unit of a
/// @param property multi-indices of a, in the same germs
/// @return (size, size), symmetric, entries that vanish by degree or symmetry not stored
[[nodiscard]] SparseColumns galerkin_matrix(const ChaosBasis& basis, ConstVectorRef coefficients,
                                            const MultiIndexSet& property);

/// Groups of rows that a symmetric sparse matrix couples with each other, each ascending.
[[nodiscard]] std::vector<std::vector<Index>> coupled_blocks(const SparseColumns& matrix);

/// Smallest eigenvalue of a symmetric matrix, block by block. A Galerkin stiffness whose smallest
/// eigenvalue is not positive has no meaning, and an iteration on it may converge all the same.
[[nodiscard]] double smallest_eigenvalue(const SparseColumns& matrix);

/// Greatest coefficient of variation d for which the Galerkin matrix of 1 + d zeta, zeta the
/// standardised germ, is positive definite at this order (a total or tensor set): -1 / (smallest
/// node of the Gauss rule of order + 1 points). Normal germ: 1 / (greatest root of He_{order+1}).
/// Infinite at order 0.
[[nodiscard]] double critical_cov(const Germ& germ, Index order);

}  // namespace latin::stochastic
