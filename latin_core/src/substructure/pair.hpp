#pragma once

#include <array>
#include <string>
#include <vector>

#include "substructure/body.hpp"

namespace latin::substructure {

/// One side of an interface: what its body is to the other one. A rank may tell it to another.
struct PairSide {
  Vector direction;  ///< k of the rows
  SparseRows trace;  ///< (rows, unknowns that the side touches)
  Matrix held;       ///< the body on these unknowns, with the springs k of its other sides
  std::string body;  ///< its name

  PairSide() = default;
  /// @param row_in_body first row of the side among those of the body
  PairSide(const Body& body, Index row_in_body, const Vector& weights);

  /// As numbers, and back. @param name of the body
  [[nodiscard]] std::vector<double> packed() const;
  static PairSide unpacked(const std::vector<double>& numbers, std::string name);
};

/// Matrix search directions of a linear interface: its residual is solved for with both of its bodies.
///
/// The best search direction of one side would be the Steklov operator of the structure beyond the other side,
/// to which a diagonal k is a poor approximation. So both sides and the law of one interface are solved here
/// together, with the data of all other interfaces held (their springs k close the bodies there): with the Schur complements S of the bodies on the unknowns that the sides touch,
///
///     (S_i (1 + mu) - T^T W k T) q_i = T^T W (+-f + r_i / 2),   f = kappa (rho + w_2 - w_1),   w_i = T q_i
///
/// and the step on the data is +-f + r_i / 2 + k w_i. The directions k stay diagonal in both stages and in
/// every measure of error: this is a step of the iteration, not another iteration.
class Pair {
 public:
  /// @param stiffness kappa of the law (rows) force / length^3; infinite: perfect
  Pair(std::array<PairSide, 2> sides, const Vector& weights, const Vector& stiffness);

  /// Replace the residuals of both sides (rows, c) by the steps that make them vanish.
  void apply(MatrixRef first, MatrixRef second) const;
  /// kappa that it was made with.
  [[nodiscard]] const Vector& stiffness() const { return of_law_; }

 private:
  std::array<PairSide, 2> sides_;
  Vector weights_;
  Vector of_law_;
  Vector stiffness_;  ///< of the law, softened where that is perfect
  Matrix lower_;      ///< L of both bodies and the law
};

}  // namespace latin::substructure
