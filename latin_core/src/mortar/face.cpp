#include "mortar/face.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::mortar {

namespace {

using Eigen::Vector3d;
using Powers = std::array<double, highest_product + 1>;

/// Maps whose other coefficients are below this part of the linear ones are linear.
constexpr double straight = 1e-12;
/// Facets that leave their plane, or edges that leave their line, by less than this part of their size do not.
constexpr double level_enough = 1e-11;

/// Integer powers 0 ... degree.
void powers_of(double x, int degree, Powers& out) {
  out[0] = 1.0;
  for (int k = 1; k <= degree; ++k) {
    out[k] = x * out[k - 1];
  }
}

/// Corners of the reference facet in the order of the rim.
Polygon rim(FacetShape shape) {
  switch (shape) {
    case FacetShape::interval:
      return {{0.0, 0.0}, {1.0, 0.0}};
    case FacetShape::triangle:
      return {{0.0, 0.0}, {1.0, 0.0}, {0.0, 1.0}};
    default:
      return {{0.0, 0.0}, {1.0, 0.0}, {1.0, 1.0}, {0.0, 1.0}};
  }
}

/// The reference facet cut along a lattice.
std::vector<Polygon> lattice(FacetShape shape, int parts) {
  std::vector<Polygon> out;
  const double step = 1.0 / parts;
  const int rows = shape == FacetShape::interval ? 1 : parts;
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < parts; ++i) {
      const Point2 corner(i * step, j * step);
      Polygon up = rim(shape);
      for (Point2& p : up) {
        p = corner + step * p;
      }
      if (shape != FacetShape::triangle) {
        out.push_back(std::move(up));
        continue;
      }
      if (i + j < parts) {
        out.push_back(std::move(up));
      }
      if (i + j < parts - 1) {
        out.push_back(
            {corner + Point2(step, 0.0), corner + Point2(step, step), corner + Point2(0.0, step)});
      }
    }
  }
  return out;
}

void check(const Functions& functions, const Monomials& monomials, const std::string& name) {
  if (functions.coefficients.empty()) {
    throw InputError("face: no coefficients of the " + name);
  }
  const Index rows = functions.coefficients.front().rows();
  for (const Matrix& c : functions.coefficients) {
    if (c.cols() != monomials.size() || c.rows() != rows) {
      throw InputError("face: coefficients of the " + name + " (" + std::to_string(c.rows()) +
                       ", " + std::to_string(c.cols()) + "); (" + std::to_string(rows) + ", " +
                       std::to_string(monomials.size()) + ") are wanted for degree " +
                       std::to_string(functions.degree));
    }
  }
}

}  // namespace

FacetShape facet_shape(const std::string& name) {
  if (name == "interval") {
    return FacetShape::interval;
  }
  if (name == "triangle") {
    return FacetShape::triangle;
  }
  if (name == "quadrilateral") {
    return FacetShape::quadrilateral;
  }
  throw InputError("facets of shape '" + name + "': they are interval, triangle or quadrilateral");
}

Monomials::Monomials(FacetShape shape, int degree, int highest) : shape_(shape), degree_(degree) {
  if (degree < 0 || degree > highest) {
    throw InputError("monomials of degree " + std::to_string(degree) + ": 0 to " +
                     std::to_string(highest) + " are possible");
  }
  for (int a = 0; a <= degree; ++a) {
    for (int b = 0; b <= most(a); ++b) {
      powers_.push_back({a, b});
    }
  }
}

void Monomials::values(const Point2& s, double* out) const {
  Powers q;  // NOLINT: filled up to the degree
  powers_of(s.y(), shape_ == FacetShape::interval ? 0 : degree_, q);
  double p = 1.0;
  for (int a = 0; a <= degree_; ++a) {
    for (int b = 0; b <= most(a); ++b) {
      *out++ = p * q[b];
    }
    p *= s.x();
  }
}

Face::Face(FacetShape shape, int parts, const Matrix& nodes, std::vector<Index> variants,
           std::vector<double> orientation, const Functions& map, Functions shapes)
    : shape_(shape),
      parts_(parts),
      variants_(std::move(variants)),
      orientation_(std::move(orientation)),
      map_monomials_(shape, map.degree),
      shapes_(std::move(shapes)),
      shape_monomials_(shape, shapes_.degree) {
  check(map, map_monomials_, "map");
  check(shapes_, shape_monomials_, "shape functions");
  const Index count = map.coefficients.front().rows();
  const Index d = shape == FacetShape::interval ? 2 : 3;
  if (nodes.cols() != d || nodes.rows() != count * facets() ||
      static_cast<Index>(orientation_.size()) != facets() || parts < 1) {
    throw InputError("face of " + std::to_string(facets()) + " facets: nodes (" +
                     std::to_string(nodes.rows()) + ", " + std::to_string(nodes.cols()) + "), (" +
                     std::to_string(count * facets()) + ", " + std::to_string(d) +
                     ") are wanted, one orientation for each facet, and at least one part");
  }
  const auto known =
      static_cast<Index>(std::min(map.coefficients.size(), shapes_.coefficients.size()));
  maps_.setZero(4, map_monomials_.size() * facets());
  for (Index f = 0; f < facets(); ++f) {
    const Index variant = variants_[f];
    if (variant < 0 || variant >= known) {
      throw InputError("face: facet " + std::to_string(f) + " has the number " +
                       std::to_string(variant) + " within its cell, of " + std::to_string(known));
    }
    auto x = maps_.middleCols(f * map_monomials_.size(), map_monomials_.size());
    x.topRows(d) = nodes.middleRows(count * f, count).transpose() * map.coefficients[variant];
    double linear = 0.0;
    double rest = 0.0;
    for (Index k = 0; k < map_monomials_.size(); ++k) {
      const int order = map_monomials_.order(k);
      double& largest = order == 1 ? linear : rest;
      largest = order == 0 ? largest : std::max(largest, x.col(k).cwiseAbs().maxCoeff());
    }
    affine_.push_back(rest <= straight * linear ? 1 : 0);
  }
  for (Index f = 0; f < facets(); ++f) {
    level_.push_back(affine(f) || (curved() && straight_edged(f)) ? 1 : 0);
  }
  cut();
}

bool Face::straight_edged(Index facet) const {
  const Polygon corners = rim(shape_);
  const std::size_t edges = flat() ? 1 : corners.size();
  const int between = 2 * parts_;
  std::vector<Vector3d> x;
  for (const Point2& s : corners) {
    x.push_back(point(facet, s));
  }
  double size = 0.0;
  double beside = 0.0;
  for (std::size_t k = 0; k < edges; ++k) {
    const std::size_t next = (k + 1) % corners.size();
    const Vector3d edge = (x[next] - x[k]).normalized();
    size = std::max(size, (x[next] - x[k]).norm());
    for (int i = 1; i < between; ++i) {
      const double t = static_cast<double>(i) / between;
      const Vector3d off = point(facet, corners[k] + t * (corners[next] - corners[k])) - x[k];
      beside = std::max(beside, (off - off.dot(edge) * edge).norm());
    }
  }
  if (!flat()) {
    const Vector3d normal = (x[1] - x[0]).cross(x.back() - x[0]).normalized();
    for (int i = 0; i <= between; ++i) {
      for (int j = 0; j <= (shape_ == FacetShape::triangle ? between - i : between); ++j) {
        const Point2 s(static_cast<double>(i) / between, static_cast<double>(j) / between);
        beside = std::max(beside, std::abs(normal.dot(point(facet, s) - x[0])));
      }
    }
  }
  return beside <= level_enough * size;
}

void Face::cut() {
  const std::vector<Polygon> polygons = lattice(shape_, parts_);
  pieces_.reserve(polygons.size() * variants_.size());
  for (Index f = 0; f < facets(); ++f) {
    for (const Polygon& reference : polygons) {
      Piece piece{f, {}, reference, Vector3d::Zero()};
      Point2 middle = Point2::Zero();
      for (const Point2& s : reference) {
        piece.corners.push_back(at(f, s).x);
        middle += s / static_cast<double>(reference.size());
      }
      piece.normal = area_vector(f, at(f, middle)).normalized();
      pieces_.push_back(std::move(piece));
    }
  }
}

}  // namespace latin::mortar
