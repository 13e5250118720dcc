#include "latin/mortar/overlap.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <exception>
#include <functional>
#include <iterator>
#include <mutex>
#include <numbers>
#include <thread>
#include <utility>

#include "latin/common/error.hpp"
#include "latin/mortar/box_tree.hpp"

namespace latin::mortar {

namespace {

using Eigen::Vector3d;

/// Slivers below this part of the area of a facet are rounding.
constexpr double nothing = 1e-15;
/// Quadrilaterals whose opposite edges differ by less than this part of their size are parallelograms.
constexpr double straight = 1e-12;
/// Normals that differ by less are the same.
constexpr double coplanar = 1e-12;

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
    if (step.cwiseAbs().maxCoeff() < 1e-8) {  // the next one would be its square
      break;
    }
  }
  return within(face.shape(), s);
}

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Integrals of products of monomials, which the coefficients of the functions make those of the functions.
struct Moments {
  Matrix mass, own, other, place, normal, offset, gap;
  std::array<Matrix, 3> own_normal, other_normal;
  double distance = 0.0;

  Moments(Index chi, Index shapes1, Index shapes2)
      : mass(chi, chi),
        own(chi, shapes1),
        other(chi, shapes2),
        place(chi, 3),
        normal(chi, 3),
        offset(chi, 3),
        gap(chi, 1) {
    own_normal.fill(own);
    other_normal.fill(other);
  }

  void clear() {
    for (Matrix* m : {&mass, &own, &other, &place, &normal, &offset, &gap}) {
      m->setZero();
    }
    for (int c = 0; c < 3; ++c) {
      own_normal[c].setZero();
      other_normal[c].setZero();
    }
    distance = 0.0;
  }

  /// What belongs to the facet of side 1.
  void add_own(const Moments& o) {
    mass += o.mass;
    own += o.own;
    place += o.place;
    normal += o.normal;
    offset += o.offset;
    gap += o.gap;
    for (int c = 0; c < 3; ++c) {
      own_normal[c] += o.own_normal[c];
    }
  }
};

/// to += a b^T for columns of numbers.
void add_product(Matrix& to, const Values& a, const Values& b, double factor) {
  double* at = to.data();
  const Index rows = a.size();
  for (Index j = 0; j < b.size(); ++j, at += rows) {
    const double weight = factor * b[j];
    for (Index i = 0; i < rows; ++i) {
      at[i] += weight * a[i];
    }
  }
}

void add_vector(Matrix& to, const Values& a, const Vector3d& b, double factor) {
  for (Index c = 0; c < 3; ++c) {
    to.col(c) += (factor * b[c]) * a;
  }
}

/// From a plane to coordinates on a reference facet, where that is affine.
struct PlaneMap {
  bool affine;
  Point2 origin = Point2::Zero();
  Eigen::Matrix2d slope = Eigen::Matrix2d::Zero();

  PlaneMap(const Polygon& corners, const Polygon& reference) : affine(true) {
    const Point2 a = corners[1] - corners[0];
    const Point2 ra = reference[1] - reference[0];
    if (corners.size() == 2) {
      slope.col(0) = ra / a.x();
    } else {
      const Point2 b = corners.back() - corners[0];
      const Point2 rb = reference.back() - reference[0];
      Eigen::Matrix2d from;
      Eigen::Matrix2d to;
      from << a, b;
      to << ra, rb;
      slope = to * from.inverse();
      if (corners.size() == 4) {
        const double twist = (corners[2] - corners[0] - a - b).cwiseAbs().maxCoeff();
        affine = twist < straight * (a.cwiseAbs() + b.cwiseAbs()).maxCoeff();
      }
    }
    origin = reference[0] - slope * corners[0];
  }
};

/// Integration over one pair of pieces after the other.
class Integrator {
 public:
  Integrator(const Face& first, const Face& second, const Functions& multipliers, const Rule& rule,
             bool plane)
      : first_(first),
        second_(second),
        chi_(multipliers.coefficients.front()),
        monomials_(first.shape(), multipliers.degree),
        rule_(rule),
        measure_(rule.weights.sum()),
        plane_(plane),
        pair_(monomials_.size(), first.shape_monomials().size(), second.shape_monomials().size()),
        sum_(pair_) {
    if (chi_.cols() != monomials_.size()) {
      throw InputError("coefficients of the multipliers: " + std::to_string(chi_.cols()) +
                       " columns, " + std::to_string(monomials_.size()) + " are wanted");
    }
  }

  /// Begin with the next facet of side 1.
  void clear() { sum_.clear(); }

  /// Integrate over one intersection. @return the largest distance
  double over(const Polygon& common, const Face::Piece& one, const Face::Piece& two,
              const Plane& plane, const Polygon& window, const Polygon& subject) {
    const Pair pair{one,
                    two,
                    plane,
                    window,
                    subject,
                    PlaneMap(window, one.reference),
                    PlaneMap(subject, two.reference),
                    first_.affine(one.facet),
                    second_.affine(two.facet)};
    pair_.clear();
    const auto each = rule_.weights.size();
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
      const double area = 0.5 * std::abs(a.x() * b.y() - a.y() * b.x()) / measure_;
      if (area == 0.0) {
        continue;
      }
      for (Index q = 0; q < each; ++q) {
        const Point2 y = common[0] + rule_.points(q, 0) * a + rule_.points(q, 1) * b;
        look_at(pair, y, rule_.weights[q] * area);
      }
    }
    if (pair.flat1) {  // the normal is the same everywhere
      for (int c = 0; c < 3; ++c) {
        const double n = one.normal[c];
        pair_.normal.col(c) = n * pair_.mass.col(0);
        if (!plane_) {
          pair_.own_normal[c] = n * pair_.own;
          pair_.other_normal[c] = n * pair_.other;
        }
      }
      pair_.gap.noalias() = pair_.offset * one.normal;
    }
    pair_.distance = std::sqrt(pair_.distance);
    return pair_.distance;
  }

  /// Count the last intersection: side 1 with its facet, side 2 by itself.
  void count(Index facet2, std::vector<double>& other, std::vector<double>& other_normal) {
    sum_.add_own(pair_);
    append(other, pair_.other, second_.coefficients(facet2));
    if (!plane_) {
      append(other_normal, pair_.other_normal, second_.coefficients(facet2));
    }
  }

  /// Write the sums of a facet of side 1.
  void write(Index facet, Overlap& out) {
    put(out.mean, facet, chi_ * sum_.mass.col(0));
    put(out.mass, facet, chi_ * sum_.mass * chi_.transpose());
    put(out.place, facet, chi_ * sum_.place);
    put(out.normal, facet, chi_ * sum_.normal);
    put(out.offset, facet, chi_ * sum_.offset);
    put(out.gap, facet, chi_ * sum_.gap);
    const Matrix& shapes = first_.coefficients(facet);
    put(out.own, facet, chi_ * sum_.own * shapes.transpose());
    if (!plane_) {
      const Index size = chi_.rows() * shapes.rows() * 3;
      spread(out.own_normal.data() + facet * size, sum_.own_normal, shapes);
    }
  }

 private:
  struct Pair {
    const Face::Piece& one;
    const Face::Piece& two;
    const Plane& plane;
    const Polygon& window;
    const Polygon& subject;
    PlaneMap map1;
    PlaneMap map2;
    bool flat1;
    bool flat2;
  };

  void look_at(const Pair& pair, const Point2& y, double weight) {
    const Index facet1 = pair.one.facet;
    const Index facet2 = pair.two.facet;
    Point2 s1;
    Vector3d x;
    Vector3d normal = pair.one.normal;
    if (pair.flat1 && pair.map1.affine) {
      s1 = pair.map1.origin + pair.map1.slope * y;
      x = pair.plane.centre + y.x() * pair.plane.first + y.y() * pair.plane.second;
    } else {
      const Point2 sigma = inverted(pair.window, y);
      s1 = mapped(pair.one.reference, sigma);
      const Face::Place place = first_.at(facet1, s1);
      const Vector3d area = first_.area_vector(facet1, place);
      const double size = area.norm();
      weight *= size * stretch(pair.one.reference, sigma) / stretch(pair.window, sigma);
      x = place.x;
      normal = area / size;
    }
    Point2 s2 = pair.map2.affine ? Point2(pair.map2.origin + pair.map2.slope * y)
                                 : mapped(pair.two.reference, inverted(pair.subject, y));
    if (second_.curved() && !(pair.flat1 && pair.flat2)) {
      s2 = dropped(second_, facet2, pair.plane, x, s2);
    }
    if (rule_.around) {
      weight *= 2.0 * std::numbers::pi * x.x();
    }
    const Vector3d offset = second_.point(facet2, s2) - x;
    monomials_.values(s1, chi_values_);
    first_.shape_monomials().values(s1, values1_);
    second_.shape_monomials().values(s2, values2_);
    add_product(pair_.mass, chi_values_, chi_values_, weight);
    add_product(pair_.own, chi_values_, values1_, weight);
    add_product(pair_.other, chi_values_, values2_, weight);
    add_vector(pair_.place, chi_values_, x, weight);
    add_vector(pair_.offset, chi_values_, offset, weight);
    pair_.distance = std::max(pair_.distance, offset.squaredNorm());
    if (pair.flat1) {
      return;
    }
    add_vector(pair_.normal, chi_values_, normal, weight);
    pair_.gap += (weight * normal.dot(offset)) * chi_values_;
    for (int c = 0; c < 3; ++c) {
      add_product(pair_.own_normal[c], chi_values_, values1_, weight * normal[c]);
      add_product(pair_.other_normal[c], chi_values_, values2_, weight * normal[c]);
    }
  }

  template <class Block>
  static void put(std::vector<double>& to, Index number, const Block& block) {
    const Index size = block.rows() * block.cols();
    Eigen::Map<RowMajor>(to.data() + number * size, block.rows(), block.cols()) = block;
  }

  void append(std::vector<double>& to, const Matrix& moments, const Matrix& shapes) {
    const std::size_t size = to.size();
    to.resize(size + static_cast<std::size_t>(chi_.rows() * shapes.rows()));
    left_.noalias() = chi_.lazyProduct(moments);
    Eigen::Map<RowMajor>(to.data() + size, chi_.rows(), shapes.rows()).noalias() =
        left_.lazyProduct(shapes.transpose());
  }

  void append(std::vector<double>& to, const std::array<Matrix, 3>& moments, const Matrix& shapes) {
    const std::size_t size = to.size();
    to.resize(size + static_cast<std::size_t>(chi_.rows() * shapes.rows() * 3));
    spread(to.data() + size, moments, shapes);
  }

  /// (chi, N, 3) from the moments of the three components.
  void spread(double* to, const std::array<Matrix, 3>& moments, const Matrix& shapes) {
    for (int c = 0; c < 3; ++c) {
      left_.noalias() = chi_.lazyProduct(moments[c]);
      RowMajor block = left_.lazyProduct(shapes.transpose());
      Eigen::Map<Vector, 0, Eigen::InnerStride<>>(to + c, block.size(), Eigen::InnerStride<>(3)) =
          Eigen::Map<const Vector>(block.data(), block.size());
    }
  }

  const Face& first_;
  const Face& second_;
  const Matrix& chi_;
  Monomials monomials_;
  const Rule& rule_;
  double measure_;
  bool plane_;
  Moments pair_;  ///< of the last intersection
  Moments sum_;   ///< of the intersections of a facet of side 1
  Matrix left_;
  Values chi_values_;
  Values values1_;
  Values values2_;
};

/// Whether all facets are flat and have one normal.
bool is_plane(const Face& face) {
  const Vector3d& normal = face.pieces().front().normal;
  return std::ranges::all_of(face.pieces(), [&](const Face::Piece& piece) {
    return face.affine(piece.facet) && (piece.normal - normal).cwiseAbs().maxCoeff() < coplanar;
  });
}

/// Pairs of facets in the order in which they are found.
struct Found {
  std::vector<Index> first, second;
  std::vector<double> area, other, other_normal, distance;
  double farthest = 0.0;
};

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

/// Do something with each of so many numbers, on some threads; the first error is thrown.
void on_threads(Index count, int threads, const std::function<void(Index)>& act) {
  std::atomic<Index> next = 0;
  std::mutex lock;
  std::exception_ptr error;
  const auto work = [&] {
    for (Index k = next++; k < count; k = next++) {
      try {
        act(k);
      } catch (...) {
        const std::scoped_lock held(lock);
        error = std::current_exception();
        return;
      }
    }
  };
  std::vector<std::thread> others;
  others.reserve(static_cast<std::size_t>(threads));
  for (int t = 1; t < threads; ++t) {
    others.emplace_back(work);
  }
  work();
  for (std::thread& other : others) {
    other.join();
  }
  if (error) {
    std::rethrow_exception(error);
  }
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
                  const Rule& rule, const Nearness& near, int threads) {
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

  // facets in blocks, whose pairs are put behind each other: the number of threads does not matter
  const Index blocks = threads > 1 ? std::min(Index{8} * threads, first.facets()) : 1;
  std::vector<Found> parts(static_cast<std::size_t>(blocks));
  on_threads(blocks, threads, [&](Index block) {
    Found& here = parts[block];
    Integrator integrator(first, second, multipliers, rule, plane_face);
    std::vector<Index> found;
    Polygon window;
    Polygon subject;
    Polygon common;
    Polygon scratch;
    const auto meet = [&](const Face::Piece& one) {
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
        if (!(area > nothing * whole)) {
          continue;
        }
        const double distance = integrator.over(common, one, two, plane, window, subject);
        if (distance > reach) {
          here.farthest = std::max(here.farthest, distance);
          continue;
        }
        out.covered[one.facet] += area;
        integrator.count(two.facet, here.other, here.other_normal);
        here.first.push_back(one.facet);
        here.second.push_back(two.facet);
        here.area.push_back(area);
        here.distance.push_back(distance);
      }
    };
    const auto each =
        static_cast<Index>(first.pieces().size()) / std::max<Index>(first.facets(), 1);
    const Index end = first.facets() * (block + 1) / blocks;
    for (Index facet = first.facets() * block / blocks; facet < end; ++facet) {
      integrator.clear();
      for (Index k = facet * each; k < (facet + 1) * each; ++k) {
        meet(first.pieces()[k]);
      }
      integrator.write(facet, out);
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
