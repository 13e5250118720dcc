#pragma once

#include <Eigen/Core>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::mortar {

/// A point of a plane, or of a line (its second coordinate is 0).
using Point2 = Eigen::Vector2d;
/// Corners in the order of the rim; in 2D scenes an interval: its two ends.
using Polygon = std::vector<Point2>;

/// Part of a convex polygon that lies in another one, by Sutherland and Hodgman (Comm. ACM 17, 1974).
/// @param subject corners either way round
/// @param window corners counter-clockwise
/// @param[out] common empty if nothing is left
/// @param scratch room, of any content
void clip(const Polygon& subject, const Polygon& window, Polygon& common, Polygon& scratch);

/// Common part of two intervals on a line; empty if they only touch.
void clip_intervals(const Polygon& subject, const Polygon& window, Polygon& common);

/// Third component of the product of two vectors of a plane.
inline double cross(const Point2& a, const Point2& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Signed area (counter-clockwise > 0) of a polygon, signed length of an interval.
[[nodiscard]] double area_of(const Polygon& polygon);

}  // namespace latin::mortar
