#pragma once

#include <vector>

#include "latin/common/types.hpp"
#include "latin/substructure/body.hpp"

namespace latin {

/// Dense flexibility of the interfaces of condensed bodies: what Newton's step needs of the global stage.
///
/// With A the global stage, N = 1 + mu - k A and E the map of a force per area of an interface to its sides
/// (+1 on side 1, -1 on side 2), (N)^-1 is a body on springs mu k instead of k, factorised here, and
/// E^T k^-1 N^-1 E is its matrix (unknowns, unknowns).
class Flexibility {
 public:
  /// Share of the search direction that holds the bodies: nothing beside their own stiffness, enough for a
  /// Cholesky factor of a floating one.
  static constexpr double mu = 1e-7;

  /// @param first_rows  first row of every body in the stacked blocks
  /// @param unknown     (rows) the unknown (point and component of an interface) that a row belongs to
  /// @param sign        (rows) +1 on side 1, -1 on side 2
  /// @throws NumericalError naming a body that is not definite
  Flexibility(const std::vector<Body>& bodies, const std::vector<Index>& first_rows,
              std::vector<Index> unknown, Vector sign, Index unknowns);

  [[nodiscard]] Index unknowns() const { return matrix_.rows(); }
  /// E^T k^-1 N^-1 E
  [[nodiscard]] const Matrix& matrix() const { return matrix_; }
  /// E^T k^-1 E
  [[nodiscard]] const Vector& direct() const { return direct_; }
  /// N^-1 v, (rows, c)
  [[nodiscard]] Matrix solve(ConstMatrixRef v) const;
  /// E y: (unknowns, c) -> (rows, c)
  [[nodiscard]] Matrix spread(ConstMatrixRef y) const;
  /// E^T k^-1 v: (rows, c) -> (unknowns, c)
  [[nodiscard]] Matrix jump(ConstMatrixRef v) const;

 private:
  struct Part {
    const Body* body;
    Index first_row;
    Matrix factor;  ///< L of (1 + mu) S + mu T^T W k T
  };
  std::vector<Part> parts_;
  std::vector<Index> unknown_;
  Vector sign_;
  Vector inverse_direction_;
  Vector direct_;
  Matrix matrix_;
};

}  // namespace latin
