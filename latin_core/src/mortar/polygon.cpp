#include "mortar/polygon.hpp"

#include <algorithm>

namespace latin::mortar {

void clip(const Polygon& subject, const Polygon& window, Polygon& common, Polygon& scratch) {
  common = subject;
  for (std::size_t edge = 0; edge < window.size() && !common.empty(); ++edge) {
    const Point2& start = window[edge];
    const Point2 along = window[(edge + 1) % window.size()] - start;
    scratch.swap(common);
    common.clear();
    double inside = cross(along, scratch.front() - start);
    for (std::size_t k = 0; k < scratch.size(); ++k) {
      const Point2& corner = scratch[k];
      const Point2& next = scratch[(k + 1) % scratch.size()];
      const double ahead = cross(along, next - start);
      if (inside >= 0.0) {
        common.push_back(corner);
      }
      if ((inside >= 0.0) != (ahead >= 0.0)) {
        common.emplace_back(corner + inside / (inside - ahead) * (next - corner));
      }
      inside = ahead;
    }
  }
}

void clip_intervals(const Polygon& subject, const Polygon& window, Polygon& common) {
  const double low =
      std::max(std::min(subject[0].x(), subject[1].x()), std::min(window[0].x(), window[1].x()));
  const double high =
      std::min(std::max(subject[0].x(), subject[1].x()), std::max(window[0].x(), window[1].x()));
  common.clear();
  if (high > low) {
    common.emplace_back(low, 0.0);
    common.emplace_back(high, 0.0);
  }
}

double area_of(const Polygon& polygon) {
  if (polygon.size() == 2) {
    return polygon[1].x() - polygon[0].x();
  }
  double twice = 0.0;
  for (std::size_t k = 2; k < polygon.size(); ++k) {
    twice += cross(polygon[k - 1] - polygon[0], polygon[k] - polygon[0]);
  }
  return 0.5 * twice;
}

}  // namespace latin::mortar
