#pragma once

#include <memory>

#include "latin/common/types.hpp"

namespace latin::algebra {

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
