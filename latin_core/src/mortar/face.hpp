#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "latin/common/types.hpp"
#include "mortar/polygon.hpp"

namespace latin::mortar {

/// Reference facets: [0, 1], the triangle of the unit vectors, the unit square.
enum class FacetShape { interval, triangle, quadrilateral };

/// @throws InputError for another name
[[nodiscard]] FacetShape facet_shape(const std::string& name);

/// Largest degree of polynomials on facets.
constexpr int highest_degree = 9;
/// Largest degree of a product of two of them.
constexpr int highest_product = 2 * highest_degree;

/// Monomials s_0^a s_1^b of a reference facet: a + b <= degree on triangles, a, b <= degree otherwise;
/// the power of s_1 varies faster.
class Monomials {
 public:
  Monomials() = default;
  /// @throws InputError for a degree that is not 0 to `highest`
  Monomials(FacetShape shape, int degree, int highest = highest_degree);

  struct Power {
    int a;
    int b;
  };

  [[nodiscard]] Index size() const { return static_cast<Index>(powers_.size()); }
  [[nodiscard]] int degree() const { return degree_; }
  [[nodiscard]] Power power(Index k) const { return powers_[k]; }
  /// Sum of both powers of a monomial.
  [[nodiscard]] int order(Index k) const { return powers_[k].a + powers_[k].b; }
  /// Number of the monomial with such powers; it must be one of them.
  [[nodiscard]] Index number(int a, int b) const {
    return shape_ == FacetShape::interval   ? a
           : shape_ == FacetShape::triangle ? a * (2 * degree_ + 3 - a) / 2 + b
                                            : a * (degree_ + 1) + b;
  }
  /// Largest power of s_1 beside a power of s_0.
  [[nodiscard]] int most(int a) const {
    return shape_ == FacetShape::interval   ? 0
           : shape_ == FacetShape::triangle ? degree_ - a
                                            : degree_;
  }
  /// Values at a point, `size()` of them.
  void values(const Point2& s, double* out) const;
  /// The polynomial with such coefficients, one column for each monomial, by Horner's scheme.
  template <class Columns, class Vector>
  void evaluate(const Columns& columns, const Point2& s, Vector& value) const {
    Index k = columns.cols();
    value.setZero();
    for (int a = degree_; a >= 0; --a) {
      Vector inner = columns.col(--k);
      for (int b = most(a); b > 0; --b) {
        inner = inner * s.y() + columns.col(--k);
      }
      value = value * s.x() + inner;
    }
  }
  /// The same with its derivatives with respect to s_0 and s_1.
  template <class Columns, class Vector>
  void evaluate(const Columns& columns, const Point2& s, Vector& value, Vector& first,
                Vector& second) const {
    Index k = columns.cols();
    value.setZero();
    first.setZero();
    second.setZero();
    for (int a = degree_; a >= 0; --a) {
      Vector inner = columns.col(--k);
      Vector slope = Vector::Zero();
      for (int b = most(a); b > 0; --b) {
        slope = slope * s.y() + inner;
        inner = inner * s.y() + columns.col(--k);
      }
      first = first * s.x() + value;
      value = value * s.x() + inner;
      second = second * s.x() + slope;
    }
  }

 private:
  FacetShape shape_ = FacetShape::interval;
  int degree_ = 0;
  std::vector<Power> powers_;
};

/// Functions on the facets as polynomials: the nodal bases of any elements.
///
/// A cell's facets see its basis differently; hence one set of coefficients for each number that a facet may
/// have within its cell.
struct Functions {
  int degree;                        ///< of the monomials
  std::vector<Matrix> coefficients;  ///< by number within the cell, (functions, monomials)
};

/// Facets of one face of a part: images of one reference facet, flat or curved, in two or three dimensions.
class Face {
 public:
  /// @param shape of all facets
  /// @param parts pieces along an edge that are flat enough to be cut as polygons: the degree of the map
  /// @param nodes (facets * nodes per facet, 2 or 3), facet by facet
  /// @param variants (facets) numbers of the facets within their cells
  /// @param orientation (facets) 1, or -1 where the normal of the map points into the part
  /// @param map shape functions of the nodes
  /// @param shapes shape functions of the displacement
  /// @throws InputError if the shapes of the arrays do not agree
  Face(FacetShape shape, int parts, const Matrix& nodes, std::vector<Index> variants,
       std::vector<double> orientation, const Functions& map, Functions shapes);

  struct Place {
    Eigen::Vector3d x;
    Eigen::Vector3d first;   ///< dx / ds_0
    Eigen::Vector3d second;  ///< dx / ds_1; 0 on intervals
  };
  /// A polygon that stands for a piece of a facet.
  struct Piece {
    Index facet;
    std::vector<Eigen::Vector3d> corners;  ///< in the order of the rim
    Polygon reference;                     ///< the same on the reference facet
    Eigen::Vector3d normal;                ///< out of the part, of the map in the middle
  };

  [[nodiscard]] FacetShape shape() const { return shape_; }
  [[nodiscard]] bool flat() const { return shape_ == FacetShape::interval; }  ///< a scene in 2D
  [[nodiscard]] int parts() const { return parts_; }
  [[nodiscard]] bool curved() const { return parts_ > 1; }
  [[nodiscard]] Index facets() const { return static_cast<Index>(variants_.size()); }
  [[nodiscard]] Index functions() const { return shapes_.coefficients.front().rows(); }
  [[nodiscard]] const std::vector<Piece>& pieces() const { return pieces_; }

  /// Coefficients of the coordinates, (4, monomials of the map); the last row is 0.
  [[nodiscard]] auto map(Index facet) const {
    return maps_.middleCols(facet * map_monomials_.size(), map_monomials_.size());
  }
  [[nodiscard]] const Monomials& map_monomials() const { return map_monomials_; }
  [[nodiscard]] Place at(Index facet, const Point2& s) const {
    Eigen::Vector4d x;
    Eigen::Vector4d first;
    Eigen::Vector4d second;
    map_monomials_.evaluate(map(facet), s, x, first, second);
    return {x.head<3>(), first.head<3>(), second.head<3>()};
  }
  [[nodiscard]] Eigen::Vector3d point(Index facet, const Point2& s) const {
    Eigen::Vector4d x;
    map_monomials_.evaluate(map(facet), s, x);
    return x.head<3>();
  }
  /// Whether its map is linear.
  [[nodiscard]] bool affine(Index facet) const { return affine_[facet] != 0; }
  /// Whether it is plane: its map is linear, or is one of the plane to itself between straight edges.
  [[nodiscard]] bool level(Index facet) const { return level_[facet] != 0; }
  /// Area (length in 2D) per area of the reference facet, times the unit normal out of the part.
  [[nodiscard]] Eigen::Vector3d area_vector(Index facet, const Place& place) const {
    if (flat()) {
      return orientation_[facet] * Eigen::Vector3d(-place.first.y(), place.first.x(), 0.0);
    }
    return orientation_[facet] * place.first.cross(place.second);
  }
  /// Shape functions of the displacement: coefficients (functions, monomials) of such monomials.
  [[nodiscard]] const Matrix& coefficients(Index facet) const {
    return shapes_.coefficients[variants_[facet]];
  }
  [[nodiscard]] const Monomials& shape_monomials() const { return shape_monomials_; }

 private:
  void cut();
  [[nodiscard]] bool straight_edged(Index facet) const;

  FacetShape shape_;
  int parts_;
  std::vector<Index> variants_;
  std::vector<double> orientation_;
  Monomials map_monomials_;
  Eigen::Matrix4Xd maps_;  ///< facet by facet; four rows, which are added two at a time
  std::vector<char> affine_;
  std::vector<char> level_;
  Functions shapes_;
  Monomials shape_monomials_;
  std::vector<Piece> pieces_;
};

}  // namespace latin::mortar
