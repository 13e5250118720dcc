#pragma once

#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/mortar/polygon.hpp"

namespace latin::mortar {

/// Reference facets: [0, 1], the triangle of the unit vectors, the unit square.
enum class FacetShape { interval, triangle, quadrilateral };

/// @throws InputError for another name
[[nodiscard]] FacetShape facet_shape(const std::string& name);

/// Largest degree of polynomials on facets.
constexpr int highest_degree = 9;
/// A value for each of a few functions; no memory is asked for.
using Values =
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, (highest_degree + 1) * (highest_degree + 1), 1>;

/// Monomials s_0^a s_1^b of a reference facet: a + b <= degree on triangles, a, b <= degree otherwise;
/// the power of s_1 varies faster.
class Monomials {
 public:
  Monomials() = default;
  Monomials(FacetShape shape, int degree);

  [[nodiscard]] Index size() const { return static_cast<Index>(powers_.size()); }
  /// Sum of both powers of a monomial.
  [[nodiscard]] int order(Index k) const { return powers_[k].a + powers_[k].b; }
  /// Values at a point.
  void values(const Point2& s, Values& out) const;
  /// Derivatives with respect to s_0 and s_1.
  void gradients(const Point2& s, Values& first, Values& second) const;

 private:
  struct Power {
    int a;
    int b;
  };
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

  [[nodiscard]] Place at(Index facet, const Point2& s) const;
  [[nodiscard]] Eigen::Vector3d point(Index facet, const Point2& s) const;
  /// Whether its map is linear.
  [[nodiscard]] bool affine(Index facet) const { return affine_[facet] != 0; }
  /// Area (length in 2D) per area of the reference facet, times the unit normal out of the part.
  [[nodiscard]] Eigen::Vector3d area_vector(Index facet, const Place& place) const;
  /// Shape functions of the displacement: coefficients (functions, monomials) of such monomials.
  [[nodiscard]] const Matrix& coefficients(Index facet) const {
    return shapes_.coefficients[variants_[facet]];
  }
  [[nodiscard]] const Monomials& shape_monomials() const { return shape_monomials_; }

 private:
  void cut();

  FacetShape shape_;
  int parts_;
  std::vector<Index> variants_;
  std::vector<double> orientation_;
  Monomials map_monomials_;
  std::vector<Eigen::Matrix3Xd> maps_;  ///< coefficients of the coordinates, by facet
  std::vector<char> affine_;
  Functions shapes_;
  Monomials shape_monomials_;
  std::vector<Piece> pieces_;
};

/// Coordinates of a point in the unit polygon of a flat one with 2 (interval), 3 or 4 corners.
[[nodiscard]] Point2 inverted(const Polygon& corners, const Point2& y);
/// The point of a polygon's map at such coordinates.
[[nodiscard]] Point2 mapped(const Polygon& corners, const Point2& sigma);
/// Area per area of the unit polygon there.
[[nodiscard]] double stretch(const Polygon& corners, const Point2& sigma);

}  // namespace latin::mortar
