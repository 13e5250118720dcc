#include "latin/interface/coulomb.hpp"

#include <algorithm>
#include <limits>

namespace latin {

std::vector<Law::ParameterInfo> CoulombLaw::parameters() const {
  constexpr double unbounded = -std::numeric_limits<double>::infinity();
  return {{"gap", Shape::per_point, unbounded},
          {"compliance", Shape::per_point, 0.0},
          {"friction", Shape::per_point, 0.0},
          {"threshold", Shape::per_point, 0.0},
          {"jump", Shape::per_row, unbounded}};
}

void CoulombLaw::resolve(const LocalProblem& problem, MatrixRef force) const {
  const ParameterField& gap = get("gap");
  const ParameterField& compliance = get("compliance");
  const ParameterField& friction = get("friction");
  const ParameterField& threshold = get("threshold");
  const ParameterField& jump = get("jump");
  const Index components = problem.components;
  const Index tangents = components - 1;
  Vector before(tangents);
  for (Index point = 0; point * components < force.rows(); ++point) {
    const Index normal = point * components;
    for (Index column = 0; column < force.cols(); ++column) {
      if (column % problem.steps == 0) {
        before.setZero();
      }
      const double open = problem.jump(normal, column) - jump(normal, column) + gap(point, column);
      const double closing = problem.flexibility(normal) + compliance(point, column);
      const double pressure = std::max(0.0, -open / closing);
      force(normal, column) = -pressure;
      // stick trial, then back onto the bound; c is the same for all tangents of a point
      auto shear = force.col(column).segment(normal + 1, tangents);
      const auto free = problem.jump.col(column).segment(normal + 1, tangents);
      const double c = problem.flexibility(normal + 1);
      for (Index t = 0; t < tangents; ++t) {
        shear(t) = (free(t) - jump(normal + 1 + t, column) - before(t)) / c;
      }
      const double bound =
          pressure > 0.0 ? friction(point, column) * pressure + threshold(point, column) : 0.0;
      const double size = shear.norm();
      if (size > bound) {
        shear *= bound / size;
      }
      for (Index t = 0; t < tangents; ++t) {
        before(t) = free(t) - jump(normal + 1 + t, column) - c * shear(t);
      }
    }
  }
}

}  // namespace latin
