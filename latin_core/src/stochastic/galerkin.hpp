#pragma once

#include <vector>

#include "stochastic/basis.hpp"

namespace latin::stochastic {

/// An index of Eigen as one of the standard containers.
inline std::size_t at(Index i) { return static_cast<std::size_t>(i); }

/// T_i(j, k) = E[psi_i psi_j psi_k] of one germ for i <= `first` and j, k <= `second`: `first` + 1
/// matrices of size `second` + 1. Exact Gauss quadrature; what vanishes by degree or symmetry is
/// exactly 0.
[[nodiscard]] std::vector<Matrix> triple_products(const Germ& germ, Index first, Index second);

/// E[Psi_i Psi_j Psi_k] of the modes i of a property and the modes j, k of a basis: what the Galerkin matrices of
/// all points of a field have in common. What vanishes by degree or symmetry is not stored.
class TripleProducts {
 public:
  /// One of a pair of modes j <= k: its terms are [begin, end).
  struct Entry {
    int j;
    int k;
    std::size_t begin;
    std::size_t end;
  };
  /// A mode of the property, and the product.
  struct Term {
    int mode;
    double value;
  };

  /// @param used modes of the property that are to be taken
  /// @throws InputError if the property is in other variables, or `used` has another size
  TripleProducts(const ChaosBasis& basis, const MultiIndexSet& property,
                 const std::vector<bool>& used);

  [[nodiscard]] Index modes() const { return modes_; }
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  [[nodiscard]] const std::vector<Term>& terms() const { return terms_; }

  /// Galerkin matrix of a scalar with these coefficients. @throws InputError if they are not finite
  [[nodiscard]] SparseColumns matrix(ConstVectorRef coefficients) const;

 private:
  Index modes_;
  Index of_property_;
  std::vector<Entry> entries_;
  std::vector<Term> terms_;
};

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
