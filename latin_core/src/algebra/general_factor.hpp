#pragma once

#include <Eigen/LU>
#include <memory>

#include "latin/common/types.hpp"

namespace latin::algebra {

/// Whether dense LU factors have pivots to divide by: none is zero or no number, as in a GeneralFactor.
[[nodiscard]] inline bool has_pivots(const Eigen::PartialPivLU<Matrix>& factor) {
  const auto pivots = factor.matrixLU().diagonal().array();
  return pivots.isFinite().all() && (pivots != 0.0).all();
}

/// A = L U of a sparse matrix without symmetry: UMFPACK, which is fast on the dense blocks of condensed bodies, or
/// Eigen's SparseLU in a build without it.
class GeneralFactor {
 public:
  /// @param matrix (n, n)
  /// @throws NumericalError it is singular
  explicit GeneralFactor(const SparseColumns& matrix);
  ~GeneralFactor();
  GeneralFactor(const GeneralFactor&) = delete;
  GeneralFactor& operator=(const GeneralFactor&) = delete;
  GeneralFactor(GeneralFactor&&) noexcept;
  GeneralFactor& operator=(GeneralFactor&&) noexcept;

  /// @param load (n, any)
  [[nodiscard]] Matrix solve(const Matrix& load) const;

 private:
  struct Lu;
  std::unique_ptr<Lu> lu_;
};

}  // namespace latin::algebra
