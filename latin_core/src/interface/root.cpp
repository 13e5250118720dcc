#include "interface/root.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace latin::interface {
namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();
/// Residual, over the terms that it is the sum of, at which nothing is left but rounding.
constexpr double settled = 8.0 * epsilon;
/// The same, after the last step.
constexpr double good_enough = 1e-10;
constexpr int most_steps = 500;
/// Deepest cut of an ellipsoid that is accepted; a cut of depth 1 removes all of it.
constexpr double deepest = 0.9;
constexpr double smallest_radius = 1e-300;
/// A force at the free jump that moves this many times as far is no place to begin at.
constexpr double explosive = 1e8;

constexpr int most = 3;  // components
using Small = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, most, 1>;
using SmallMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most, most>;

/// Encloses the root of one component.
class Interval {
 public:
  Interval(const Small& y, const Small& residual) { cut(y, residual); }
  [[nodiscard]] Small centre() const { return Small::Constant(1, 0.5 * low_ + 0.5 * high_); }
  /// Half the width.
  [[nodiscard]] Small extent() const { return Small::Constant(1, 0.5 * high_ - 0.5 * low_); }
  [[nodiscard]] bool holds(const Small& y) const { return y(0) >= low_ && y(0) <= high_; }
  /// Keep what lies on the side of y that the residual points away from, at most its size far.
  void cut(const Small& y, const Small& residual) {
    const double far = y(0) - (1.0 + settled) * residual(0);
    low_ = std::fmax(low_, residual(0) < 0.0 ? y(0) : far);
    high_ = std::fmin(high_, residual(0) > 0.0 ? y(0) : far);
  }

 private:
  double low_ = -std::numeric_limits<double>::infinity();
  double high_ = std::numeric_limits<double>::infinity();
};

/// {centre + B u, |u| <= 1}, which encloses the root of several components.
class Ellipsoid {
 public:
  Ellipsoid(const Small& y, const Small& residual) : centre_(y - 0.5 * residual) {
    const double radius = std::max(0.5 * residual.norm(), smallest_radius);
    rounding_ = settled * radius;
    shape_ = radius * SmallMatrix::Identity(y.size(), y.size());
    inverse_ = SmallMatrix::Identity(y.size(), y.size()) / radius;
  }
  [[nodiscard]] const Small& centre() const { return centre_; }
  [[nodiscard]] Small extent() const { return shape_.rowwise().norm().array() + rounding_; }
  [[nodiscard]] bool holds(const Small& y) const {
    constexpr double on_the_edge = 1e-9;
    const double away = (inverse_ * (y - centre_)).norm();
    return away <= 1.0 + on_the_edge + rounding_ * inverse_.norm();
  }
  /// Keep the smallest ellipsoid around what is left of it where residual . (z - y) <= 0.
  void cut(const Small& y, Small normal) {
    if (normal.hasNaN()) {
      return;
    }
    if (!normal.allFinite()) {  // an infinite force has a direction, and nothing else
      normal = normal.unaryExpr(
          [](double each) { return std::isinf(each) ? std::copysign(1.0, each) : 0.0; });
    }
    normal /= std::max(normal.cwiseAbs().maxCoeff(), smallest_radius);
    const auto count = static_cast<double>(y.size());
    Small u = shape_.transpose() * normal;
    const double length = u.norm();
    if (!(length > 0.0)) {
      return;
    }
    u /= length;
    const double found = normal.dot(centre_ - y) / length;
    if (!(found > -1.0 / count)) {
      return;
    }
    const double depth = std::min(found, deepest);
    // semi-axes: along u, and across it
    const double axis = (1.0 - depth) * count / (count + 1.0);
    const double across = count * std::sqrt((1.0 - depth * depth) / (count * count - 1.0));
    centre_ -= (1.0 + count * depth) / (count + 1.0) * (shape_ * u);
    const SmallMatrix pair = u * u.transpose();
    shape_ = (across * shape_ + (axis - across) * (shape_ * pair)).eval();
    inverse_ = (inverse_ / across + (1.0 / axis - 1.0 / across) * (pair * inverse_)).eval();
  }

 private:
  Small centre_;
  double rounding_ = 0.0;
  SmallMatrix shape_;
  SmallMatrix inverse_;
};

/// Newton's step; NaN where there is none.
Small newton_step(const SmallMatrix& tangent, const Small& residual, const Small& root) {
  const SmallMatrix matrix = SmallMatrix::Identity(root.size(), root.size()) +
                             root.asDiagonal() * tangent * root.asDiagonal();
  if (matrix.allFinite() && residual.allFinite()) {
    const Eigen::PartialPivLU<SmallMatrix> factors(matrix);
    if (factors.determinant() != 0.0) {
      return factors.solve(-residual);
    }
  }
  return Small::Constant(root.size(), std::numeric_limits<double>::quiet_NaN());
}

/// An iterate of all rows.
struct Trial {
  PointRows y;
  PointRows force;
};

/// One search: the rows in blocks of components that depend on each other.
class Search {
 public:
  Search(const ForceFunction& law, const PointRows& free, const PointRows& root)
      : law_(law), free_(free), root_(root) {}

  [[nodiscard]] PointRows force_at(const PointRows& y, ForceFunction::Far allowed) const {
    return law_.force(root_.cwiseProduct(y), allowed);
  }
  [[nodiscard]] PointRows residual(const Trial& at) const {
    return at.y + root_.cwiseProduct(at.force) - free_;
  }
  /// Leaves the root in `at`. @param count components of a block: 1 or all
  /// @return where none was found, by row; nothing if blocks of one component turn out to depend on each other
  template <class Region>
  std::optional<std::vector<bool>> run(Trial& at, Index count) const {
    const Index blocks = at.y.size() / count;
    PointRows left = residual(at);
    const auto part = [count](const PointRows& field, Index block) -> Small {
      return Eigen::Map<const Small>(field.data() + block * count, count);
    };
    std::vector<State<Region>> states;
    states.reserve(static_cast<std::size_t>(blocks));
    for (Index block = 0; block < blocks; ++block) {
      const Small own = part(left, block);
      states.push_back({Region(part(at.y, block), own), own.norm()});
    }
    for (int step = 0; step < most_steps; ++step) {
      const PointRows terms =
          at.y.cwiseAbs() + root_.cwiseProduct(at.force).cwiseAbs() + free_.cwiseAbs();
      bool all = true;
      for (Index block = 0; block < blocks; ++block) {
        State<Region>& state = states[static_cast<std::size_t>(block)];
        state.size = part(terms, block).norm();
        // far away both may be infinite
        const bool settles = std::isfinite(state.norm) && state.norm <= settled * state.size;
        state.done = state.done || settles;
        all = all && state.done;
      }
      if (all) {
        break;
      }
      const PointRows slopes = tangent(at);
      if (count == 1 && couples(slopes)) {
        return std::nullopt;
      }
      for (Index block = 0; block < blocks; ++block) {
        State<Region>& state = states[static_cast<std::size_t>(block)];
        const Small y = part(at.y, block);
        const Small next = advance(
            state, y, part(free_, block),
            newton_step(slope_of(slopes, block, count), part(left, block), part(root_, block)));
        Eigen::Map<Small>(at.y.data() + block * count, count) = next;
      }
      at.force = force_at(at.y, ForceFunction::Far::infinite);
      left = residual(at);
      for (Index block = 0; block < blocks; ++block) {
        State<Region>& state = states[static_cast<std::size_t>(block)];
        const Small own = part(left, block);
        const double before = state.norm;
        state.norm = own.norm();
        if (!state.done) {
          state.region.cut(part(at.y, block), own);
        }
        state.fast = !state.newton || state.norm <= 0.5 * before;
      }
    }
    std::vector<bool> bad(static_cast<std::size_t>(at.y.rows()), false);
    for (Index block = 0; block < blocks; ++block) {
      const State<Region>& state = states[static_cast<std::size_t>(block)];
      const bool close = std::isfinite(state.norm) && state.norm <= good_enough * state.size;
      if (!state.done && !close) {
        bad[static_cast<std::size_t>(block * count / at.y.cols())] = true;
      }
    }
    return bad;
  }

 private:
  template <class Region>
  struct State {
    Region region;
    double norm;  ///< of the residual
    double size = 0.0;
    bool done = false;
    bool fast = true;     ///< Newton's steps gain enough
    bool newton = false;  ///< the last step was one
  };

  /// The next iterate of a block; it stays where it is when it is done.
  template <class Region>
  static Small advance(State<Region>& state, const Small& y, const Small& free, const Small& step) {
    // the force is taken from whichever of y and free - y is the smaller
    const Small least = settled * y.cwiseAbs().cwiseMax(free.cwiseAbs());
    const bool arrived = (step.cwiseAbs().array() <= least.array()).all();
    const bool enclosed = !(state.region.extent().array() > least.array()).any();
    state.done = state.done || arrived || enclosed;
    const Small tried = y + step;
    state.newton = state.fast && state.region.holds(tried);
    if (state.done) {
      return y;
    }
    return state.newton ? tried : Small(state.region.centre());
  }

  /// Whether a component of a force depends on another one of the jump.
  [[nodiscard]] bool couples(const PointRows& slopes) const {
    const Index n = free_.cols();
    for (Index row = 0; row < slopes.rows(); ++row) {
      for (Index place = 0; place < n * n; ++place) {
        if (place % (n + 1) != 0 && slopes(row, place) != 0.0) {
          return true;
        }
      }
    }
    return false;
  }

  [[nodiscard]] SmallMatrix slope_of(const PointRows& slopes, Index block, Index count) const {
    const Index n = free_.cols();
    if (count == 1) {
      return SmallMatrix::Constant(1, 1, slopes(block / n, (block % n) * (n + 1)));
    }
    SmallMatrix slope(n, n);
    for (Index a = 0; a < n; ++a) {
      for (Index b = 0; b < n; ++b) {
        slope(a, b) = slopes(block, a * n + b);
      }
    }
    return slope;
  }

  /// dR_a / dj_b (q, n n), b fastest.
  [[nodiscard]] PointRows tangent(const Trial& at) const {
    if (law_.tangent) {
      return law_.tangent(root_.cwiseProduct(at.y));
    }
    constexpr double least = 1e-3;
    constexpr double smallest_size = 1e-12;
    const Index n = at.y.cols();
    // of stiffening laws the root is far below the free jump
    PointRows size = at.y.cwiseAbs().cwiseMax(smallest_size * free_.cwiseAbs());
    const double largest = size.maxCoeff();
    size = size.cwiseMax(least * largest);
    if (largest == 0.0) {
      size = root_.cwiseProduct(at.force).cwiseAbs();  // no jump: what the force would make of it
    }
    PointRows slopes(at.y.rows(), n * n);
    for (Index b = 0; b < n; ++b) {
      PointRows moved = at.y;
      moved.col(b) += std::sqrt(epsilon) * size.col(b);
      const Vector step = root_.col(b).cwiseProduct(moved.col(b) - at.y.col(b));
      const PointRows there = force_at(moved, ForceFunction::Far::anything);
      for (Index a = 0; a < n; ++a) {
        slopes.col(a * n + b) = (there.col(a) - at.force.col(a)).cwiseQuotient(step);
      }
    }
    return slopes;
  }

  const ForceFunction& law_;
  const PointRows& free_;
  const PointRows& root_;
};

}  // namespace

Roots find_roots(const ForceFunction& law, const PointRows& free_jump,
                 const PointRows& flexibility) {
  const PointRows root = flexibility.cwiseSqrt();
  const PointRows free = free_jump.cwiseQuotient(root);
  const Search search(law, free, root);
  Trial start{free, search.force_at(free, ForceFunction::Far::infinite)};
  // where the force at the free jump overflows, or is so large that it would take too many cuts, begin at jump 0
  bool far = false;
  for (Index row = 0; row < free.rows(); ++row) {
    const double pull = root.row(row).cwiseProduct(start.force.row(row)).norm();
    if (!(pull <= explosive * free.row(row).norm())) {
      start.y.row(row).setZero();
      far = true;
    }
  }
  if (far) {
    start.force = search.force_at(start.y, ForceFunction::Far::nothing);
  }
  Trial at = start;
  std::optional<std::vector<bool>> found = search.run<Interval>(at, 1);
  if (!found) {
    at = start;
    found = search.run<Ellipsoid>(at, free.cols());
  }
  std::vector<bool> bad = std::move(found).value_or(std::vector<bool>());
  // of the two ways to the force, the one that does not cancel
  const PointRows moved = (free - at.y).cwiseQuotient(root);
  const auto by_jump = (free - at.y).array().abs() >= at.y.array().abs();
  return {by_jump.select(moved, at.force), std::move(bad), root.cwiseProduct(search.residual(at))};
}

}  // namespace latin::interface
