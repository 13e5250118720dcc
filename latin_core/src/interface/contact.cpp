#include "latin/interface/contact.hpp"

#include <algorithm>
#include <limits>

namespace latin {

std::vector<Law::ParameterInfo> ContactLaw::parameters() const {
  constexpr double unbounded = -std::numeric_limits<double>::infinity();
  return {{"gap", Shape::per_point, unbounded},
          {"compliance", Shape::per_point, 0.0},
          {"jump", Shape::per_row, unbounded}};
}

void ContactLaw::resolve(const LocalProblem& problem, MatrixRef force) const {
  const ParameterField& gap = get("gap");
  const ParameterField& compliance = get("compliance");
  const ParameterField& jump = get("jump");
  for (Index column = 0; column < force.cols(); ++column) {
    for (Index row = 0; row < force.rows(); ++row) {
      const Index point = row / problem.components;
      const double open = problem.jump(row, column) - jump(row, column) + gap(point, column);
      const double closing = problem.flexibility(row) + compliance(point, column);
      force(row, column) = row % problem.components == 0 ? std::min(0.0, open / closing) : 0.0;
    }
  }
}

}  // namespace latin
