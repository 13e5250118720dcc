#include "mortar/overlap.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>
#include <utility>

#include "common/threads.hpp"
#include "latin/common/error.hpp"
#include "mortar/box_tree.hpp"

namespace latin::mortar {

namespace {

using Eigen::Vector3d;

/// Slivers below this part of the area of a facet are rounding.
constexpr double no_area = 1e-15;
/// Quadrilaterals whose opposite edges differ by less than this part of their size are parallelograms.
constexpr double straight_sides = 1e-12;
/// Normals that differ by less are the same.
constexpr double coplanar = 1e-12;

/// Blocks of facets that threads share: more than cores, so that none of these waits long for the last one.
constexpr Index most_blocks = 64;
/// About how many numbers a facet takes, as in_lanes() counts: some intersections of some points and products each.
constexpr double numbers_of_facet = 5e3;

/// The plane of a piece: its middle, and axes within it.
struct Plane {
  Vector3d centre = Vector3d::Zero();
  Vector3d first;
  Vector3d second;  ///< 0 in 2D
  Vector3d normal;

  explicit Plane(const std::vector<Vector3d>& corners) {
    for (const Vector3d& x : corners) {
      centre += x / static_cast<double>(corners.size());
    }
    first = corners[1] - corners[0];
    if (corners.size() == 2) {
      first.normalize();
      second.setZero();
      normal = Vector3d(-first.y(), first.x(), 0.0);
      return;
    }
    normal.setZero();
    for (std::size_t k = 0; k < corners.size(); ++k) {
      normal += (corners[k] - centre).cross(corners[(k + 1) % corners.size()] - centre);
    }
    normal.normalize();
    first -= first.dot(normal) * normal;
    first.normalize();
    second = normal.cross(first);
  }

  [[nodiscard]] Point2 flatten(const Vector3d& x) const {
    const Vector3d r = x - centre;
    return {first.dot(r), second.dot(r)};
  }
  void flatten(const std::vector<Vector3d>& corners, Polygon& out) const {
    out.clear();
    for (const Vector3d& x : corners) {
      out.push_back(flatten(x));
    }
  }
};

Box box_of(const std::vector<Vector3d>& corners) {
  Box box;
  for (const Vector3d& x : corners) {
    box.extend(x);
  }
  return box;
}

/// A box around corners moved by so much along a direction, either way; a little wider than that.
Box swept(const std::vector<Vector3d>& corners, const Vector3d& along) {
  Box box;
  for (const Vector3d& x : corners) {
    box.extend(x + along);
    box.extend(x - along);
  }
  const double rounding = 1e-9 * box.diagonal().norm();
  box.min().array() -= rounding;
  box.max().array() += rounding;
  return box;
}

/// Whether the bounding boxes of two polygons have no point in common.
bool apart(const Polygon& a, const Polygon& b) {
  Eigen::AlignedBox2d first;
  Eigen::AlignedBox2d second;
  for (const Point2& p : a) {
    first.extend(p);
  }
  for (const Point2& p : b) {
    second.extend(p);
  }
  return !first.intersects(second);
}

/// How far apart two boxes are along the axis along which they are farthest apart.
double gap_between(const Box& a, const Box& b) {
  return (a.min() - b.max()).cwiseMax(b.min() - a.max()).maxCoeff();
}

Point2 within(FacetShape shape, const Point2& s) {
  Point2 out = s.cwiseMax(0.0).cwiseMin(1.0);
  const double excess = out.sum() - 1.0;
  if (shape == FacetShape::triangle && excess > 0.0) {
    const double along = std::clamp(0.5 * (1.0 + s.x() - s.y()), 0.0, 1.0);
    out = {along, 1.0 - along};
  }
  return out;
}

using Powers2 = Eigen::Matrix<double, 2, Eigen::Dynamic>;

/// Where the normal of a plane through a point of it meets a curved facet, by Newton's method.
/// @param map of the facet, in the coordinates of the plane
Point2 dropped(const Face& face, const Powers2& map, const Point2& y, Point2 s) {
  for (int round = 0; round < 30; ++round) {
    Point2 value;
    Point2 first;
    Point2 second;
    face.map_monomials().evaluate(map, s, value, first, second);
    if (face.flat()) {
      second.y() = 1.0;
    }
    const Point2 r = y - value;
    const double scale = 1.0 / cross(first, second);
    Point2 step(scale * cross(r, second), scale * cross(first, r));
    if (!step.allFinite()) {
      break;
    }
    const Point2 moved = (s + step).cwiseMax(-3.0).cwiseMin(4.0);
    step = moved - s;
    s = moved;
    if (step.cwiseAbs().maxCoeff() < 1e-8) {  // the next one would be its square
      break;
    }
  }
  return within(face.shape(), s);
}

/// The map of a facet in the coordinates of a plane.
void in_plane(const Face& face, Index facet, const Plane& plane, Powers2& out) {
  const auto map = face.map(facet);
  out.resize(2, map.cols());
  out.row(0).noalias() = plane.first.transpose() * map.topRows<3>();
  out.row(1).noalias() = plane.second.transpose() * map.topRows<3>();
  out.col(0) += plane.flatten(Vector3d::Zero());
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Lines of tables have an even length: they are added two numbers at a time.
Index even(Index count) { return count + count % 2; }

template <int R, int C>
void add_products(Index points, const double* a, Index wide_a, const double* b, Index wide_b,
                  double* to) {
  double sum[R][C] = {};  // NOLINT(modernize-avoid-c-arrays): stays in registers
  for (Index q = 0; q < points; ++q, a += wide_a, b += wide_b) {
    for (int i = 0; i < R; ++i) {
      for (int j = 0; j < C; ++j) {
        sum[i][j] += a[i] * b[j];
      }
    }
  }
  for (int i = 0; i < R; ++i) {
    for (int j = 0; j < C; ++j) {
      to[i * wide_b + j] += sum[i][j];
    }
  }
}

template <int R>
void add_products(Index points, const double* a, Index wide_a, const double* b, Index wide_b,
                  double* to) {
  Index j = 0;
  for (; j + 4 <= wide_b; j += 4) {
    add_products<R, 4>(points, a, wide_a, b + j, wide_b, to + j);
  }
  if (j < wide_b) {
    add_products<R, 2>(points, a, wide_a, b + j, wide_b, to + j);
  }
}

/// to (rows, wide_b) += a^T b for the tables a (points, wide_a), of which the first rows count, and
/// b (points, wide_b); wide_b is even.
void add_products(Index points, Index rows, const double* a, Index wide_a, const double* b,
                  Index wide_b, double* to) {
  for (; rows >= 4; rows -= 4, a += 4, to += 4 * wide_b) {
    add_products<4>(points, a, wide_a, b, wide_b, to);
  }
  switch (rows) {
    case 3:
      return add_products<3>(points, a, wide_a, b, wide_b, to);
    case 2:
      return add_products<2>(points, a, wide_a, b, wide_b, to);
    case 1:
      return add_products<1>(points, a, wide_a, b, wide_b, to);
    default:
      return;
  }
}

/// From a plane to coordinates on a reference facet, along a polygon: affine, or the inverse of a bilinear map.
class PlaneMap {
 public:
  struct Place {
    Point2 s;
    double stretch;  ///< area of the reference facet per area of the plane
  };

  PlaneMap(const Polygon& corners, const Polygon& reference)
      : corner_(corners[0]), reference_(reference[0]) {
    edges_.col(0) = corners[1] - corners[0];
    across_.col(0) = reference[1] - reference[0];
    if (corners.size() == 2) {
      edges_.col(1) = Point2(0.0, 1.0);
      across_.col(1) = Point2(0.0, 1.0);
    } else {
      edges_.col(1) = corners.back() - corners[0];
      across_.col(1) = reference.back() - reference[0];
    }
    inverse_ = edges_.inverse();
    area_ = std::abs(across_.determinant());
    if (corners.size() == 4) {
      twist_ = corners[2] - corners[0] - edges_.col(0) - edges_.col(1);
      const double size = edges_.cwiseAbs().rowwise().sum().maxCoeff();
      affine_ = twist_.cwiseAbs().maxCoeff() < straight_sides * size;
      nearly_ = twist_.cwiseAbs().maxCoeff() < 0.1 * size;
    }
    slope_ = across_ * inverse_;
    density_ = area_ / std::abs(edges_.determinant());
  }

  [[nodiscard]] bool affine() const { return affine_; }

  [[nodiscard]] Place at(const Point2& y) const {
    const Point2 r = y - corner_;
    if (affine_) {
      return {reference_ + slope_ * r, density_};
    }
    Point2 sigma = inverse_ * (r - 0.25 * twist_);
    Point2 first;
    Point2 second;
    for (int round = 0; round < 20; ++round) {
      first = edges_.col(0) + sigma.y() * twist_;
      second = edges_.col(1) + sigma.x() * twist_;
      const Point2 rest = r - edges_ * sigma - sigma.x() * sigma.y() * twist_;
      const double scale = 1.0 / cross(first, second);
      const Point2 step(scale * cross(rest, second), scale * cross(first, rest));
      sigma = (sigma + step).cwiseMax(-0.5).cwiseMin(1.5);
      if (step.cwiseAbs().maxCoeff() < 1e-8) {  // the next one would be its square
        break;
      }
    }
    first = edges_.col(0) + sigma.y() * twist_;
    second = edges_.col(1) + sigma.x() * twist_;
    return {reference_ + across_ * sigma, area_ / std::abs(cross(first, second))};
  }

  /// Nearly the same: where an iteration may begin.
  [[nodiscard]] Point2 near(const Point2& y) const {
    return nearly_ ? Point2(reference_ + slope_ * (y - corner_ - 0.25 * twist_)) : at(y).s;
  }

 private:
  bool affine_ = true;
  bool nearly_ = true;
  Point2 corner_;
  Point2 reference_;
  Eigen::Matrix2d edges_;
  Eigen::Matrix2d across_;
  Eigen::Matrix2d inverse_;
  Eigen::Matrix2d slope_;
  Point2 twist_ = Point2::Zero();
  double area_ = 1.0;
  double density_ = 1.0;
};

/// Pairs of facets in the order in which they are found.
struct Found {
  std::vector<Index> first, second;
  std::vector<double> area, other, other_normal, distance;
  double farthest = 0.0;

  /// Room for what follows if that is like what came.
  void reserve(double factor) {
    for (auto* v : {&area, &other, &other_normal, &distance}) {
      v->reserve(static_cast<std::size_t>(factor * static_cast<double>(v->size())));
    }
    for (auto* v : {&first, &second}) {
      v->reserve(static_cast<std::size_t>(factor * static_cast<double>(v->size())));
    }
  }
};

/// Integration over one pair of pieces after the other.
///
/// What is added up are integrals of products of monomials, times 1 and the components of the normal
/// ("fields"); coefficients make those of the functions of them, once for each facet and each pair.
class Integrator {
 public:
  Integrator(const Face& first, const Face& second, const Functions& multipliers, const Rule& rule,
             bool plane)
      : first_(first),
        second_(second),
        chi_(multipliers.coefficients.front()),
        monomials_(first.shape(), multipliers.degree),
        products_(
            first.shape(),
            multipliers.degree + std::max(multipliers.degree, first.shape_monomials().degree()),
            highest_product),
        rule_(rule),
        measure_(rule.weights.sum()),
        plane_(plane),
        wide_own_(even(products_.size())),
        wide_other_(even(second.shape_monomials().size())) {
    if (chi_.cols() != monomials_.size()) {
      throw InputError("coefficients of the multipliers: " + std::to_string(chi_.cols()) +
                       " columns, " + std::to_string(monomials_.size()) + " are wanted");
    }
    const auto numbers = [&](const Monomials& other) {
      std::vector<Index> out;
      for (Index j = 0; j < other.size(); ++j) {
        for (Index i = 0; i < monomials_.size(); ++i) {
          const Monomials::Power a = monomials_.power(i);
          const Monomials::Power b = other.power(j);
          out.push_back(products_.number(a.a + b.a, a.b + b.b));
        }
      }
      return out;
    };
    mass_at_ = numbers(monomials_);
    own_at_ = numbers(first.shape_monomials());
    own_sum_.resize(static_cast<std::size_t>(4 * wide_own_));
    place_sum_.resize(static_cast<std::size_t>(monomials_.size() * places));
    own_.resize(own_sum_.size());
    place_.resize(place_sum_.size());
    other_.resize(static_cast<std::size_t>(4 * monomials_.size() * wide_other_));
  }

  /// Begin with the next facet of side 1.
  void begin(Index facet) {
    flat1_ = first_.level(facet);
    uneven1_ = flat1_ && !first_.affine(facet);
    fields_ = flat1_ ? 1 : 4;
    std::ranges::fill(own_sum_, 0.0);
    std::ranges::fill(place_sum_, 0.0);
    count_ = 0;
  }

  /// Begin with the next piece of it, which has a plane.
  void begin(const Face::Piece& one, const Plane& plane) {
    if (uneven1_) {
      in_plane(first_, one.facet, plane, own_map_);
    }
  }

  /// Integrate over one intersection. @return the largest distance
  double over(const Polygon& common, const Face::Piece& one, const Face::Piece& two,
              const Plane& plane, const PlaneMap& map1, const Polygon& subject) {
    const Pair pair{one,
                    two,
                    plane,
                    map1,
                    PlaneMap(subject, two.reference),
                    second_.curved() && !(flat1_ && second_.affine(two.facet))};
    if (pair.drop) {
      in_plane(second_, two.facet, plane, other_map_);
    }
    const auto each = rule_.weights.size();
    const auto most = each * static_cast<Index>(common.size());
    weights_.resize(static_cast<std::size_t>(most * 4));
    weighed_.resize(static_cast<std::size_t>(most * 4 * monomials_.size()));
    powers_own_.resize(static_cast<std::size_t>(most * wide_own_));
    powers_other_.resize(static_cast<std::size_t>(most * wide_other_));
    places_.resize(static_cast<std::size_t>(most * places));
    points_ = 0;
    distance_ = 0.0;
    if (common.size() == 2) {
      const double length = area_of(common) / measure_;
      for (Index q = 0; q < each; ++q) {
        const Point2 y = common[0] + rule_.points(q, 0) * (common[1] - common[0]);
        look_at(pair, y, rule_.weights[q] * length);
      }
    }
    for (std::size_t k = 2; k < common.size(); ++k) {
      const Point2 a = common[k - 1] - common[0];
      const Point2 b = common[k] - common[0];
      const double area = 0.5 * std::abs(cross(a, b)) / measure_;
      if (area == 0.0) {
        continue;
      }
      for (Index q = 0; q < each; ++q) {
        const Point2 y = common[0] + rule_.points(q, 0) * a + rule_.points(q, 1) * b;
        look_at(pair, y, rule_.weights[q] * area);
      }
    }
    std::ranges::fill(own_, 0.0);
    std::ranges::fill(place_, 0.0);
    std::ranges::fill(other_, 0.0);
    const Index chi = monomials_.size();
    add_products(points_, fields_, weights_.data(), 4, powers_own_.data(), wide_own_, own_.data());
    add_products(points_, fields_ * chi, weighed_.data(), fields_ * chi, powers_other_.data(),
                 wide_other_, other_.data());
    add_products(points_, chi, weighed_.data(), fields_ * chi, places_.data(), places,
                 place_.data());
    return std::sqrt(distance_);
  }

  /// Count the last intersection.
  void count(Index facet2, double area, double distance) {
    add(own_sum_, own_);
    add(place_sum_, place_);
    Index k = 0;
    while (k < count_ && pairs_[k].facet != facet2) {
      ++k;
    }
    if (k == count_) {
      if (count_++ == static_cast<Index>(pairs_.size())) {
        pairs_.emplace_back();
      }
      pairs_[k].facet = facet2;
      pairs_[k].area = pairs_[k].distance = 0.0;
      pairs_[k].other.assign(other_.size(), 0.0);
    }
    pairs_[k].area += area;
    pairs_[k].distance = std::max(pairs_[k].distance, distance);
    add(pairs_[k].other, other_);
  }

  /// Write the sums of a facet of side 1, and its pairs.
  void write(Index facet, const Vector3d& normal, Overlap& out, Found& found) {
    const Index chi = monomials_.size();
    const Matrix mass = chi_ * moments(0, mass_at_, chi);
    put(out.mean, facet, mass.col(0));
    put(out.mass, facet, mass * chi_.transpose());
    const Eigen::Map<const RowMajor> place(place_sum_.data(), chi, places);
    put(out.place, facet, chi_ * place.leftCols<3>());
    put(out.offset, facet, chi_ * place.middleCols<3>(3));
    const Matrix& shapes = first_.coefficients(facet);
    const Matrix own = chi_ * moments(0, own_at_, shapes.cols()) * shapes.transpose();
    put(out.own, facet, own);
    Eigen::Map<RowMajor> normals(out.normal.data() + facet * chi_.rows() * 3, chi_.rows(), 3);
    if (flat1_) {  // the normal is the same everywhere
      put(out.gap, facet, chi_ * (place.middleCols<3>(3) * normal));
      normals = mass.col(0) * normal.transpose();
    } else {
      put(out.gap, facet, chi_ * place.col(6));
    }
    for (int c = 0; c < 3; ++c) {
      if (!flat1_) {
        normals.col(c) = chi_ * moments(c + 1, mass_at_, chi).col(0);
      }
      if (!plane_) {
        spread(out.own_normal.data() + facet * own.size() * 3, c,
               flat1_
                   ? RowMajor(normal[c] * own)
                   : RowMajor(chi_ * moments(c + 1, own_at_, shapes.cols()) * shapes.transpose()));
      }
    }
    for (Index k = 0; k < count_; ++k) {
      append(pairs_[k], normal, found);
      found.first.push_back(facet);
    }
  }

 private:
  /// Columns of the table of places: x_1, x_2 - x_1, (x_2 - x_1) . n_1, and one that is 0.
  static constexpr Index places = 8;

  struct Pair {
    const Face::Piece& one;
    const Face::Piece& two;
    const Plane& plane;
    const PlaneMap& map1;
    PlaneMap map2;
    bool drop;  ///< side 2 is curved: from a point of side 1 along the normal of the plane
  };
  /// What a facet of side 2 has in common with that of side 1.
  struct Other {
    Index facet = 0;
    double area = 0.0;
    double distance = 0.0;
    std::vector<double> other;
  };

  void look_at(const Pair& pair, const Point2& y, double weight) {
    const Index facet1 = pair.one.facet;
    PlaneMap::Place here = pair.map1.at(y);
    if (uneven1_) {
      here.s = dropped(first_, own_map_, y, here.s);
    }
    const Point2& s1 = here.s;
    Vector3d x;
    Vector3d normal = pair.one.normal;
    Point2 above = y;
    if (flat1_ && (uneven1_ || pair.map1.affine())) {
      x = pair.plane.centre + y.x() * pair.plane.first + y.y() * pair.plane.second;
    } else {
      const Face::Place place = first_.at(facet1, s1);
      const Vector3d area = first_.area_vector(facet1, place);
      const double size = area.norm();
      x = place.x;
      normal = area / size;
      weight *= size * here.stretch;
      above = pair.plane.flatten(x);
    }
    const Point2 s2 =
        pair.drop ? dropped(second_, other_map_, above, pair.map2.near(y)) : pair.map2.at(y).s;
    if (rule_.around) {
      weight *= 2.0 * std::numbers::pi * x.x();
    }
    const Vector3d offset = second_.point(pair.two.facet, s2) - x;
    distance_ = std::max(distance_, offset.squaredNorm());

    const Index chi = monomials_.size();
    double* own = powers_own_.data() + points_ * wide_own_;
    own[wide_own_ - 1] = 0.0;
    products_.values(s1, own);
    double* other = powers_other_.data() + points_ * wide_other_;
    other[wide_other_ - 1] = 0.0;
    second_.shape_monomials().values(s2, other);
    double* place = places_.data() + points_ * places;
    for (int c = 0; c < 3; ++c) {
      place[c] = x[c];
      place[3 + c] = offset[c];
    }
    place[6] = normal.dot(offset);
    place[7] = 0.0;
    const std::array<double, 4> factors = {weight, weight * normal.x(), weight * normal.y(),
                                           weight * normal.z()};
    std::ranges::copy(factors, weights_.data() + points_ * 4);
    double* weighed = weighed_.data() + points_ * fields_ * chi;
    for (Index f = 0; f < fields_; ++f) {
      for (Index i = 0; i < chi; ++i) {
        *weighed++ = factors[f] * own[mass_at_[i]];
      }
    }
    ++points_;
  }

  static void add(std::vector<double>& to, const std::vector<double>& more) {
    for (std::size_t k = 0; k < to.size(); ++k) {
      to[k] += more[k];
    }
  }

  /// Of a field: (chi, columns) of what is added up for the facet of side 1.
  [[nodiscard]] Matrix moments(int field, const std::vector<Index>& at, Index columns) const {
    Matrix out(monomials_.size(), columns);
    const double* from = own_sum_.data() + field * wide_own_;
    for (Index k = 0; k < out.size(); ++k) {
      out.data()[k] = from[at[k]];
    }
    return out;
  }

  template <class Block>
  static void put(std::vector<double>& to, Index number, const Block& block) {
    const Index size = block.rows() * block.cols();
    Eigen::Map<RowMajor>(to.data() + number * size, block.rows(), block.cols()) = block;
  }

  /// Component c of (chi, N, 3).
  static void spread(double* to, int c, const RowMajor& block) {
    for (Index k = 0; k < block.size(); ++k) {
      to[3 * k + c] = block.data()[k];
    }
  }

  void append(const Other& pair, const Vector3d& normal, Found& found) {
    const Matrix& shapes = second_.coefficients(pair.facet);
    const Index chi = monomials_.size();
    const Index rows = chi_.rows();
    const auto size = static_cast<std::size_t>(rows * shapes.rows());
    left_.resize(fields_ * rows, shapes.cols());
    for (Index f = 0; f < fields_; ++f) {
      const Eigen::Map<const RowMajor, 0, Eigen::OuterStride<>> sums(
          pair.other.data() + f * chi * wide_other_, chi, shapes.cols(),
          Eigen::OuterStride<>(wide_other_));
      left_.middleRows(f * rows, rows).noalias() = chi_.lazyProduct(sums);
    }
    right_.noalias() = left_.lazyProduct(shapes.transpose());
    found.second.push_back(pair.facet);
    found.area.push_back(pair.area);
    found.distance.push_back(pair.distance);
    found.other.insert(found.other.end(), right_.data(), right_.data() + size);
    if (plane_) {
      return;
    }
    const std::size_t begin = found.other_normal.size();
    found.other_normal.resize(begin + 3 * size);
    double* to = found.other_normal.data() + begin;
    for (std::size_t k = 0; k < size; ++k) {
      for (std::size_t c = 0; c < 3; ++c) {
        *to++ = flat1_ ? normal[static_cast<Index>(c)] * right_.data()[k]
                       : right_.data()[(c + 1) * size + k];
      }
    }
  }

  const Face& first_;
  const Face& second_;
  const Matrix& chi_;
  Monomials monomials_;
  Monomials products_;  ///< of chi and chi or the shape functions of side 1
  const Rule& rule_;
  double measure_;
  bool plane_;
  bool flat1_ = false;  ///< the facet of side 1 is
  bool uneven1_ =
      false;  ///< but its map is not affine: places are where it meets points of the plane
  Index fields_ = 1;
  Index wide_own_;
  Index wide_other_;
  std::vector<Index> mass_at_;  ///< (chi, chi), columns: their numbers among the products
  std::vector<Index> own_at_;   ///< (chi, N_1)
  Powers2 own_map_;             ///< map of the facet of side 1 in the plane, if it is uneven
  Powers2 other_map_;           ///< the same of side 2, if it is curved
  Index points_ = 0;
  double distance_ = 0.0;
  std::vector<double> weights_;  ///< (points, 4)
  std::vector<double> weighed_;  ///< (points, fields, chi)
  std::vector<double> powers_own_;
  std::vector<double> powers_other_;
  std::vector<double> places_;
  std::vector<double> own_, other_, place_;  ///< of the last intersection
  std::vector<double> own_sum_, place_sum_;  ///< of the facet of side 1
  std::vector<Other> pairs_;
  Index count_ = 0;  ///< of pairs of this facet
  RowMajor left_;
  RowMajor right_;
};

/// Whether all facets are flat and have one normal.
bool is_plane(const Face& face) {
  const Vector3d& normal = face.pieces().front().normal;
  return std::ranges::all_of(face.pieces(), [&](const Face::Piece& piece) {
    return face.level(piece.facet) && (piece.normal - normal).cwiseAbs().maxCoeff() < coplanar;
  });
}

template <class T>
void move_behind(std::vector<T>& all, std::vector<T>& more) {
  if (all.empty()) {
    all = std::move(more);
    return;
  }
  const std::size_t size = all.size();
  all.resize(size + more.size());
  std::ranges::copy(more, std::next(all.begin(), static_cast<std::ptrdiff_t>(size)));
  more = {};
}

void check(const Face& first, const Face& second, const Functions& multipliers, const Rule& rule,
           const Nearness& near) {
  if (first.flat() != second.flat()) {
    throw InputError("one face is in two dimensions, the other one in three");
  }
  if (multipliers.coefficients.size() != 1) {
    throw InputError("multipliers: one set of coefficients is wanted, got " +
                     std::to_string(multipliers.coefficients.size()));
  }
  const Index dimension = first.flat() ? 1 : 2;
  if (rule.points.cols() != dimension || rule.points.rows() != rule.weights.size() ||
      rule.weights.size() == 0) {
    throw InputError("rule: points (" + std::to_string(rule.points.rows()) + ", " +
                     std::to_string(rule.points.cols()) + ") and " +
                     std::to_string(rule.weights.size()) + " weights");
  }
  if (near.first.size() != first.facets() || near.second.size() != second.facets()) {
    throw InputError("largest distances: one for each facet is wanted");
  }
}

}  // namespace

Overlap integrate(const Face& first, const Face& second, const Functions& multipliers,
                  const Rule& rule, const Nearness& near) {
  check(first, second, multipliers, rule, near);
  std::vector<Box> boxes;
  boxes.reserve(second.pieces().size());
  for (const Face::Piece& piece : second.pieces()) {
    boxes.push_back(box_of(piece.corners));
  }
  const BoxTree tree(boxes);
  const double farthest_second = near.second.size() > 0 ? near.second.maxCoeff() : 0.0;
  const bool plane_face = first.facets() == 0 || is_plane(first);

  const Index chi = multipliers.coefficients.front().rows();
  Overlap out;
  const auto sized = [&](Index each) {
    return std::vector<double>(static_cast<std::size_t>(first.facets() * each), 0.0);
  };
  out.whole = sized(1);
  out.covered = sized(1);
  out.mean = sized(chi);
  out.mass = sized(chi * chi);
  out.own = sized(chi * first.functions());
  out.own_normal = sized(plane_face ? 0 : chi * first.functions() * 3);
  out.gap = sized(chi);
  out.place = sized(chi * 3);
  out.normal = sized(chi * 3);
  out.offset = sized(chi * 3);

  // facets in blocks, whose pairs are put behind each other
  const auto blocks = std::min(most_blocks, first.facets());
  std::vector<Found> parts(static_cast<std::size_t>(blocks));
  const double numbers = static_cast<double>(first.facets()) * numbers_of_facet;
  in_lanes(parts.size(), numbers, [&](std::size_t number) {
    Found& here = parts[number];
    const auto block = static_cast<Index>(number);
    Integrator integrator(first, second, multipliers, rule, plane_face);
    std::vector<Index> found;
    Polygon window;
    Polygon subject;
    Polygon common;
    Polygon scratch;
    const auto meet = [&](const Face::Piece& one) {
      const Plane plane(one.corners);
      plane.flatten(one.corners, window);
      const PlaneMap map1(window, one.reference);
      integrator.begin(one, plane);
      const double whole = std::abs(area_of(window));
      out.whole[one.facet] += whole;
      const Box own_box = box_of(one.corners);
      const double reach1 = near.first[one.facet];
      tree.touching(swept(one.corners, std::max(reach1, farthest_second) * plane.normal), found);
      for (const Index number : found) {
        const Face::Piece& two = second.pieces()[number];
        if (one.normal.dot(two.normal) >= near.opposed) {
          continue;
        }
        const double reach = std::max(reach1, near.second[two.facet]);
        if (gap_between(own_box, boxes[number]) > reach) {
          continue;
        }
        plane.flatten(two.corners, subject);
        if (apart(window, subject)) {
          continue;
        }
        if (first.flat()) {
          clip_intervals(subject, window, common);
        } else {
          clip(subject, window, common, scratch);
        }
        if (common.size() < (first.flat() ? 2U : 3U)) {
          continue;
        }
        const double area = std::abs(area_of(common));
        if (!(area > no_area * whole)) {
          continue;
        }
        const double distance = integrator.over(common, one, two, plane, map1, subject);
        if (distance > reach) {
          here.farthest = std::max(here.farthest, distance);
          continue;
        }
        out.covered[one.facet] += area;
        integrator.count(two.facet, area, distance);
      }
    };
    const auto each =
        static_cast<Index>(first.pieces().size()) / std::max<Index>(first.facets(), 1);
    const Index begin = first.facets() * block / blocks;
    const Index end = first.facets() * (block + 1) / blocks;
    const Index some = begin + std::max<Index>(64, (end - begin) / 8);
    for (Index facet = begin; facet < end; ++facet) {
      if (facet == some) {
        here.reserve(1.2 * static_cast<double>(end - begin) / static_cast<double>(some - begin));
      }
      integrator.begin(facet);
      for (Index k = facet * each; k < (facet + 1) * each; ++k) {
        meet(first.pieces()[k]);
      }
      integrator.write(facet, first.pieces()[facet * each].normal, out, here);
    }
  });
  for (Found& part : parts) {
    move_behind(out.first, part.first);
    move_behind(out.second, part.second);
    move_behind(out.area, part.area);
    move_behind(out.other, part.other);
    move_behind(out.other_normal, part.other_normal);
    move_behind(out.distance, part.distance);
    out.farthest = std::max(out.farthest, part.farthest);
  }
  return out;
}

}  // namespace latin::mortar
