#pragma once

#include <memory>
#include <vector>

#include "algebra/handle.hpp"
#include "stochastic/coupling.hpp"

namespace latin::stochastic {

/// The operator of monolithic stochastic finite elements, applied and never formed:
///
///     (A u)_k = K u_k + sum B^T W sum_j A_kj (B u_j)
///
/// with K what is not random and one term for each random stiffness (paper, equations 14 to 19). Unknowns are
/// blocks (n, c) with the modes of an unknown next to each other.
class GalerkinOperator {
 public:
  /// A random stiffness per area between displacements.
  struct Term {
    SparseRows jump;  ///< B (points * components, n)
    Vector weights;   ///< W (points) areas
    std::shared_ptr<const Coupling> coupling;
  };

  /// @param fixed K (n, n), symmetric, force / length
  /// @param modes c
  /// @throws InputError on shapes that disagree
  GalerkinOperator(const SparseRows& fixed, std::vector<Term> terms, Index modes);

  /// Unknowns n of one mode.
  [[nodiscard]] Index size() const { return fixed_.rows(); }
  [[nodiscard]] Index modes() const { return modes_; }
  /// @param u (n, c)  @param v (n, c), overwritten
  void apply(ConstModeRowsRef u, ModeRowsRef v) const;

 private:
  SparseRows fixed_;
  std::vector<Term> terms_;
  std::vector<SparseRows> back_;  ///< B^T W of every term
  Index modes_;
};

/// A shell matrix of PETSc (n c, n c) that applies the operator and keeps it alive.
[[nodiscard]] algebra::MatHandle shell_matrix(std::shared_ptr<const GalerkinOperator> applied);

}  // namespace latin::stochastic
