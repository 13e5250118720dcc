#include "latin/mortar/overlap.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "latin/common/error.hpp"
#include "latin/mortar/box_tree.hpp"

namespace latin::mortar {

namespace {

using Eigen::Vector3d;

/// Slivers below this part of the area of a facet are rounding.
constexpr double nothing = 1e-15;

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

/// Where the normal of a plane through a point meets a curved facet, by Newton's method.
Point2 dropped(const Face& face, Index facet, const Plane& plane, const Vector3d& x, Point2 s) {
  for (int round = 0; round < 30; ++round) {
    const Face::Place place = face.at(facet, s);
    const Vector3d r = x - place.x;
    Eigen::Matrix2d jacobian;
    jacobian << plane.first.dot(place.first), plane.first.dot(place.second),
        plane.second.dot(place.first), plane.second.dot(place.second);
    if (face.flat()) {
      jacobian(1, 1) = 1.0;
    }
    Point2 step = jacobian.inverse() * Point2(plane.first.dot(r), plane.second.dot(r));
    if (!step.allFinite()) {
      break;
    }
    const Point2 moved = (s + step).cwiseMax(-3.0).cwiseMin(4.0);
    step = moved - s;
    s = moved;
    if (step.cwiseAbs().maxCoeff() < 1e-14) {
      break;
    }
  }
  return within(face.shape(), s);
}

/// The integrals of one pair of facets, until it is known whether the pair counts.
struct Sums {
  Matrix mass, own, other, own_normal, other_normal, place, normal, offset, gap, mean;
  double distance = 0.0;

  Sums(Index chi, Index shapes1, Index shapes2)
      : mass(chi, chi),
        own(chi, shapes1),
        other(chi, shapes2),
        own_normal(chi, 3 * shapes1),
        other_normal(chi, 3 * shapes2),
        place(chi, 3),
        normal(chi, 3),
        offset(chi, 3),
        gap(chi, 1),
        mean(chi, 1) {}
};

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

void add(std::vector<double>& to, Index number, const Matrix& block) {
  const Index size = block.size();
  Eigen::Map<RowMajor>(to.data() + number * size, block.rows(), block.cols()) += block;
}

void append(std::vector<double>& to, const Matrix& block) {
  const std::size_t size = to.size();
  to.resize(size + static_cast<std::size_t>(block.size()));
  Eigen::Map<RowMajor>(to.data() + size, block.rows(), block.cols()) = block;
}

/// Integration over one pair of pieces after the other.
///
/// What is known at the points of an intersection is gathered in columns; the integrals are products of these.
class Integrator {
 public:
  Integrator(const Face& first, const Face& second, const Functions& multipliers, const Rule& rule)
      : first_(first),
        second_(second),
        chi_(multipliers.coefficients.front()),
        monomials_(first.shape(), multipliers.degree),
        rule_(rule),
        measure_(rule.weights.sum()),
        sums_(chi_.rows(), first.functions(), second.functions()) {
    if (chi_.cols() != monomials_.size()) {
      throw InputError("coefficients of the multipliers: " + std::to_string(chi_.cols()) +
                       " columns, " + std::to_string(monomials_.size()) + " are wanted");
    }
  }

  /// Sums over one intersection.
  const Sums& over(const Polygon& common, const Face::Piece& one, const Face::Piece& two,
                   const Plane& plane, const Polygon& window, const Polygon& subject) {
    const auto each = rule_.weights.size();
    const auto parts = static_cast<Index>(std::max<std::size_t>(common.size(), 3) - 2);
    resize(parts * each);
    Index point = 0;
    if (common.size() == 2) {
      const double length = area_of(common) / measure_;
      for (Index q = 0; q < each; ++q) {
        const Point2 y = common[0] + rule_.points(q, 0) * (common[1] - common[0]);
        look_at(point++, y, rule_.weights[q] * length, one, two, plane, window, subject);
      }
    }
    for (std::size_t k = 2; k < common.size(); ++k) {
      const Point2 a = common[k - 1] - common[0];
      const Point2 b = common[k] - common[0];
      const double area = 0.5 * std::abs(a.x() * b.y() - a.y() * b.x()) / measure_;
      if (area == 0.0) {
        continue;
      }
      for (Index q = 0; q < each; ++q) {
        const Point2 y = common[0] + rule_.points(q, 0) * a + rule_.points(q, 1) * b;
        look_at(point++, y, rule_.weights[q] * area, one, two, plane, window, subject);
      }
    }
    add_up(point);
    return sums_;
  }

 private:
  void resize(Index points) {
    if (points <= weights_.size()) {
      return;
    }
    weights_.resize(points);
    multipliers_.resize(chi_.rows(), points);
    shapes1_.resize(first_.functions(), points);
    shapes2_.resize(second_.functions(), points);
    places_.resize(3, points);
    normals_.resize(3, points);
    offsets_.resize(3, points);
  }

  void look_at(Index point, const Point2& y, double weight, const Face::Piece& one,
               const Face::Piece& two, const Plane& plane, const Polygon& window,
               const Polygon& subject) {
    const Point2 sigma = inverted(window, y);
    const Point2 s1 = mapped(one.reference, sigma);
    const Face::Place place = first_.at(one.facet, s1);
    const Vector3d area = first_.area_vector(one.facet, place);
    const double size = area.norm();
    weights_[point] = weight * size * stretch(one.reference, sigma) / stretch(window, sigma);
    Point2 s2 = mapped(two.reference, inverted(subject, y));
    if (second_.curved()) {
      s2 = dropped(second_, two.facet, plane, place.x, s2);
    }
    if (rule_.around) {
      weights_[point] *= 2.0 * std::numbers::pi * place.x.x();
    }
    places_.col(point) = place.x;
    normals_.col(point) = area / size;
    offsets_.col(point) = second_.at(two.facet, s2).x - place.x;
    Values values;
    monomials_.values(s1, values);
    multipliers_.col(point).noalias() = chi_ * values;
    first_.shapes(one.facet, s1, values);
    shapes1_.col(point) = values;
    second_.shapes(two.facet, s2, values);
    shapes2_.col(point) = values;
  }

  void add_up(Index points) {
    const auto chi = multipliers_.leftCols(points);
    weighted_ = chi * weights_.head(points).asDiagonal();
    const auto shapes1 = shapes1_.leftCols(points);
    const auto shapes2 = shapes2_.leftCols(points);
    const auto normals = normals_.leftCols(points);
    const auto offsets = offsets_.leftCols(points);
    sums_.mass = weighted_.lazyProduct(chi.transpose());
    sums_.own = weighted_.lazyProduct(shapes1.transpose());
    sums_.other = weighted_.lazyProduct(shapes2.transpose());
    sums_.place = weighted_.lazyProduct(places_.leftCols(points).transpose());
    sums_.normal = weighted_.lazyProduct(normals.transpose());
    sums_.offset = weighted_.lazyProduct(offsets.transpose());
    sums_.gap = weighted_.lazyProduct(normals.cwiseProduct(offsets).colwise().sum().transpose());
    sums_.mean = weighted_.rowwise().sum();
    sums_.distance = points > 0 ? offsets.colwise().norm().maxCoeff() : 0.0;
    for (Index c = 0; c < 3; ++c) {
      // chi_i N_k n_c at (i, 3 k + c)
      along_ = weighted_ * normals.row(c).asDiagonal();
      for (Index k = 0; k < shapes1.rows(); ++k) {
        sums_.own_normal.col(3 * k + c) = along_.lazyProduct(shapes1.row(k).transpose());
      }
      for (Index k = 0; k < shapes2.rows(); ++k) {
        sums_.other_normal.col(3 * k + c) = along_.lazyProduct(shapes2.row(k).transpose());
      }
    }
  }

  const Face& first_;
  const Face& second_;
  const Matrix& chi_;
  Monomials monomials_;
  const Rule& rule_;
  double measure_;
  Sums sums_;
  Vector weights_;  // of the points; below: (what, points)
  Matrix multipliers_;
  Matrix weighted_;
  Matrix along_;
  Matrix shapes1_;
  Matrix shapes2_;
  Matrix places_;
  Matrix normals_;
  Matrix offsets_;
};

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
  const BoxTree tree(std::move(boxes));
  const double farthest_second = near.second.size() > 0 ? near.second.maxCoeff() : 0.0;

  Integrator integrator(first, second, multipliers, rule);
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
  out.own_normal = sized(chi * first.functions() * 3);
  out.gap = sized(chi);
  out.place = sized(chi * 3);
  out.normal = sized(chi * 3);
  out.offset = sized(chi * 3);

  std::vector<Index> found;
  Polygon window;
  Polygon subject;
  Polygon common;
  Polygon scratch;
  for (const Face::Piece& one : first.pieces()) {
    const Plane plane(one.corners);
    plane.flatten(one.corners, window);
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
      if (gap_between(own_box, box_of(two.corners)) > reach) {
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
      if (!(area > nothing * whole)) {
        continue;
      }
      const Sums& sums = integrator.over(common, one, two, plane, window, subject);
      if (sums.distance > reach) {
        out.farthest = std::max(out.farthest, sums.distance);
        continue;
      }
      out.covered[one.facet] += area;
      add(out.mean, one.facet, sums.mean);
      add(out.mass, one.facet, sums.mass);
      add(out.own, one.facet, sums.own);
      add(out.own_normal, one.facet, sums.own_normal);
      add(out.gap, one.facet, sums.gap);
      add(out.place, one.facet, sums.place);
      add(out.normal, one.facet, sums.normal);
      add(out.offset, one.facet, sums.offset);
      out.first.push_back(one.facet);
      out.second.push_back(two.facet);
      out.area.push_back(area);
      append(out.other, sums.other);
      append(out.other_normal, sums.other_normal);
      out.distance.push_back(sums.distance);
    }
  }
  return out;
}

}  // namespace latin::mortar
