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
/// With y = j / sqrt(c) that is
///
///     G(y) = y + sqrt(c) R(sqrt(c) y) - j0 / sqrt(c) = 0,      G(y) . (y - z) >= |y - z|^2 at the root z
///
/// if R is monotone. So every value of G cuts off a half-space, and the first one leaves a ball for the root.
/// Newton's method is tried from the last point; where it leaves the ellipsoid that encloses what is left, or
/// does not halve |G|, the next point is the ellipsoid's centre. The ellipsoid shrinks whatever R is; see Bland,
/// Goldfarb and Todd, Operations Research 29 (1981) 1039-1091. Where the components of a law do not depend on
/// each other, each is a problem of its own, and the centre of its interval is bisection.
/// @param free_jump j0 (q, n)  @param flexibility c (q, n) > 0
Roots find_roots(const ForceFunction& law, const PointRows& free_jump,
                 const PointRows& flexibility);

}  // namespace latin::interface
