#pragma once

#include <functional>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::interface {

/// Fields (q, n): row by row the components at a point and column.
using PointRows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// A law f = R(j) that is given by a function of the jump, for many points and columns at once.
struct ForceFunction {
  enum class Far {
    infinite,  ///< the jump is a trial: a force may be infinite
    anything,  ///< for a difference: it may be NaN
    nothing    ///< it has to be finite
  };
  /// R(j) (q, n) of jumps (q, n); throws where it is not what it may be.
  std::function<PointRows(const PointRows& jump, Far allowed)> force;
  /// dR_a / dj_b of jumps (q, n) as (q, n n), b fastest; empty: by differences.
  std::function<PointRows(const PointRows& jump)> tangent;
};

/// What find_roots() leaves.
struct Roots {
  PointRows force;        ///< (q, n)
  std::vector<bool> bad;  ///< (q) where no jump was found that the force holds
  PointRows off;          ///< (q, n) by how much the jump misses there, length
};

/// The forces f = R(j) with j = j0 - c f of a continuous, monotone law: what Law::resolve() is asked.
///
/// Newton's method for y + sqrt(c) R(sqrt(c) y) = j0 / sqrt(c), kept inside of regions that enclose the root (by
/// monotonicity every residual cuts off a half space, and what is left is bounded): intervals where the components do
/// not depend on each other, else ellipsoids.
/// @param free_jump j0 (q, n)  @param flexibility c (q, n) > 0
Roots find_roots(const ForceFunction& law, const PointRows& free_jump,
                 const PointRows& flexibility);

}  // namespace latin::interface
