#pragma once

#include <utility>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::equilibration {

/// Points (d, m) of the unit simplex and their weights (m,), whose sum is 1 / d!.
struct Rule {
  Matrix points;
  Vector weights;
};
/// Conical product of Gauss rules with `points` points each: exact for polynomials of degree 2 points - d.
[[nodiscard]] Rule simplex_rule(int dim, int points);

/// Lagrange functions of degree 1 or 2: those of the vertices, then of the edges (0, 1), (0, 2), ..., (1, 2), ...
/// @param barycentric (d + 1, m)
/// @return (functions, m)
[[nodiscard]] Matrix lagrange(int degree, ConstMatrixRef barycentric);

/// Symmetric stresses, polynomials of degree q on each of the d + 1 simplices into which a unit simplex is cut by its
/// centroid (Alfeld), that are continuous in tractions: those in balance with tractions and a constant body force, and
/// those in balance with nothing. With the tractions' moments as data they exist for all that balance (C. Johnson and
/// B. Mercier for q = 1; on the Alfeld split no unknowns at vertices are needed).
///
/// Piola's transform s = B s' B' / |B| keeps symmetry, divergence and tractions: so this is made once.
class ReferenceCell {
 public:
  /// @param dim 2 or 3
  /// @param degree 1 or 2, of displacements, tractions and stresses
  ReferenceCell(int dim, int degree);
  /// The same, made when first asked for.
  static const ReferenceCell& of(int dim, int degree);

  [[nodiscard]] int dim() const { return dim_; }
  [[nodiscard]] int degree() const { return degree_; }
  /// Of a symmetric tensor: 11, 22, 12 or 11, 22, 33, 23, 13, 12.
  [[nodiscard]] Index components() const { return dim_ * (dim_ + 1) / 2; }
  [[nodiscard]] std::pair<int, int> component(Index k) const;
  [[nodiscard]] Index nodes() const;
  [[nodiscard]] Index facet_nodes() const { return static_cast<Index>(facet_.front().size()); }
  /// Nodes of a cell that are on the facet opposite to vertex k.
  [[nodiscard]] const std::vector<Index>& on_facet(Index k) const { return facet_[k]; }
  /// Coefficients (components * pieces * terms) of the self-stresses, then of those in balance with each number of data:
  /// moments of tractions with the functions of each facet (facet, node, component), then the divergence.
  [[nodiscard]] const Matrix& basis() const { return basis_; }
  [[nodiscard]] Index self_stresses() const { return self_stresses_; }
  [[nodiscard]] Index data() const { return basis_.cols() - self_stresses_; }
  /// Products of the basis for each pair a <= b of components: (columns^2, pairs).
  [[nodiscard]] const Matrix& products() const { return products_; }
  /// Values (terms, m) of the functions of a piece at points (d, m), which are orthonormal on it.
  [[nodiscard]] Matrix values(Index piece, ConstMatrixRef points) const;
  [[nodiscard]] Index terms() const { return orthonormal_.cols(); }

 private:
  struct Piece {
    Matrix inverse;  ///< of the map from the unit simplex
    Vector origin;
    double size;  ///< determinant
  };
  [[nodiscard]] Matrix slopes(Index piece, ConstMatrixRef point) const;
  struct Equations;
  void solve();

  int dim_;
  int degree_;
  std::vector<std::vector<int>> exponents_;
  Matrix orthonormal_;  ///< (terms, terms) coefficients of monomials
  Matrix vertices_;     ///< (d, d + 1)
  std::vector<Piece> pieces_;
  std::vector<std::vector<Index>> facet_;
  Matrix basis_;
  Matrix products_;
  Index self_stresses_ = 0;
};

}  // namespace latin::equilibration
