#include "latin/mortar/face.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::mortar {

namespace {

using Eigen::Vector3d;
using Powers = std::array<double, highest_degree + 1>;

/// Maps whose other coefficients are below this part of the linear ones are linear.
constexpr double straight = 1e-12;

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

struct Vertices {
  std::array<double, 4> values;
  std::array<double, 4> first;
  std::array<double, 4> second;
};

/// Functions of the corners of a unit polygon, with derivatives.
Vertices vertices(std::size_t corners, const Point2& s) {
  const double a = s.x();
  const double b = s.y();
  if (corners == 2) {
    return {{1.0 - a, a, 0.0, 0.0}, {-1.0, 1.0, 0.0, 0.0}, {}};
  }
  if (corners == 3) {
    return {{1.0 - a - b, a, b, 0.0}, {-1.0, 1.0, 0.0, 0.0}, {-1.0, 0.0, 1.0, 0.0}};
  }
  return {{(1.0 - a) * (1.0 - b), a * (1.0 - b), a * b, (1.0 - a) * b},
          {b - 1.0, 1.0 - b, b, -b},
          {a - 1.0, -a, a, 1.0 - a}};
}

double cross(const Point2& a, const Point2& b) { return a.x() * b.y() - a.y() * b.x(); }

struct Tangents {
  Point2 first = Point2::Zero();
  Point2 second = Point2::Zero();
};

Tangents tangents(const Polygon& corners, const Vertices& v) {
  Tangents out;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    out.first += v.first[k] * corners[k];
    out.second += v.second[k] * corners[k];
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

Monomials::Monomials(FacetShape shape, int degree) : degree_(degree) {
  if (degree < 0 || degree > highest_degree) {
    throw InputError("monomials of degree " + std::to_string(degree) + ": 0 to " +
                     std::to_string(highest_degree) + " are possible");
  }
  for (int a = 0; a <= degree; ++a) {
    const int most = shape == FacetShape::interval   ? 0
                     : shape == FacetShape::triangle ? degree - a
                                                     : degree;
    for (int b = 0; b <= most; ++b) {
      powers_.push_back({a, b});
    }
  }
}

void Monomials::values(const Point2& s, Values& out) const {
  Powers p;  // NOLINT: filled up to the degree
  Powers q;  // NOLINT
  powers_of(s.x(), degree_, p);
  powers_of(s.y(), degree_, q);
  out.resize(size());
  for (Index k = 0; k < size(); ++k) {
    out[k] = p[powers_[k].a] * q[powers_[k].b];
  }
}

void Monomials::gradients(const Point2& s, Values& first, Values& second) const {
  Powers p;  // NOLINT: filled up to the degree
  Powers q;  // NOLINT
  powers_of(s.x(), degree_, p);
  powers_of(s.y(), degree_, q);
  first.resize(size());
  second.resize(size());
  for (Index k = 0; k < size(); ++k) {
    const auto [a, b] = powers_[k];
    first[k] = a > 0 ? a * p[a - 1] * q[b] : 0.0;
    second[k] = b > 0 ? b * p[a] * q[b - 1] : 0.0;
  }
}

Point2 mapped(const Polygon& corners, const Point2& sigma) {
  const Vertices v = vertices(corners.size(), sigma);
  Point2 y = Point2::Zero();
  for (std::size_t k = 0; k < corners.size(); ++k) {
    y += v.values[k] * corners[k];
  }
  return y;
}

double stretch(const Polygon& corners, const Point2& sigma) {
  const Tangents t = tangents(corners, vertices(corners.size(), sigma));
  return corners.size() == 2 ? std::abs(t.first.x()) : std::abs(cross(t.first, t.second));
}

Point2 inverted(const Polygon& corners, const Point2& y) {
  if (corners.size() == 2) {
    return {(y.x() - corners[0].x()) / (corners[1].x() - corners[0].x()), 0.0};
  }
  const bool affine = corners.size() == 3;
  Point2 sigma = affine ? Point2(1.0 / 3.0, 1.0 / 3.0) : Point2(0.5, 0.5);
  for (int round = 0; round < (affine ? 2 : 20); ++round) {
    const Tangents t = tangents(corners, vertices(corners.size(), sigma));
    const Point2 r = y - mapped(corners, sigma);
    const double determinant = cross(t.first, t.second);
    const Point2 step(cross(r, t.second) / determinant, cross(t.first, r) / determinant);
    sigma = (sigma + step).cwiseMax(-0.5).cwiseMin(1.5);
    if (step.cwiseAbs().maxCoeff() < 1e-14) {
      break;
    }
  }
  return sigma;
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
  maps_.reserve(variants_.size());
  for (Index f = 0; f < facets(); ++f) {
    const Index variant = variants_[f];
    if (variant < 0 || variant >= known) {
      throw InputError("face: facet " + std::to_string(f) + " has the number " +
                       std::to_string(variant) + " within its cell, of " + std::to_string(known));
    }
    Eigen::Matrix3Xd x = Eigen::Matrix3Xd::Zero(3, map_monomials_.size());
    x.topRows(d) = nodes.middleRows(count * f, count).transpose() * map.coefficients[variant];
    double linear = 0.0;
    double rest = 0.0;
    for (Index k = 0; k < map_monomials_.size(); ++k) {
      const int order = map_monomials_.order(k);
      double& largest = order == 1 ? linear : rest;
      largest = order == 0 ? largest : std::max(largest, x.col(k).cwiseAbs().maxCoeff());
    }
    affine_.push_back(rest <= straight * linear ? 1 : 0);
    maps_.push_back(std::move(x));
  }
  cut();
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

Face::Place Face::at(Index facet, const Point2& s) const {
  Values values;
  Values first;
  Values second;
  map_monomials_.values(s, values);
  map_monomials_.gradients(s, first, second);
  const Eigen::Matrix3Xd& map = maps_[facet];
  Place place{Vector3d::Zero(), Vector3d::Zero(), Vector3d::Zero()};
  for (Index k = 0; k < map.cols(); ++k) {
    place.x += values[k] * map.col(k);
    place.first += first[k] * map.col(k);
    place.second += second[k] * map.col(k);
  }
  return place;
}

Vector3d Face::area_vector(Index facet, const Place& place) const {
  if (flat()) {
    return orientation_[facet] * Vector3d(-place.first.y(), place.first.x(), 0.0);
  }
  return orientation_[facet] * place.first.cross(place.second);
}

Vector3d Face::point(Index facet, const Point2& s) const {
  Values values;
  map_monomials_.values(s, values);
  const Eigen::Matrix3Xd& map = maps_[facet];
  Vector3d x = Vector3d::Zero();
  for (Index k = 0; k < map.cols(); ++k) {
    x += values[k] * map.col(k);
  }
  return x;
}

}  // namespace latin::mortar
