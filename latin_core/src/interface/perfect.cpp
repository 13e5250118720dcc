#include "interface/perfect.hpp"

#include <limits>

namespace latin::interface {

std::vector<Law::ParameterInfo> PerfectLaw::parameters() const {
  return {{"jump", Shape::per_row, -std::numeric_limits<double>::infinity()}};
}

void PerfectLaw::resolve(const LocalProblem& problem, MatrixRef force) const {
  const ParameterField& jump = get("jump");
  for (Index column = 0; column < force.cols(); ++column) {
    for (Index row = 0; row < force.rows(); ++row) {
      force(row, column) =
          (problem.jump(row, column) - jump(row, column)) / problem.flexibility(row);
    }
  }
}

bool PerfectLaw::slopes(const LocalProblem& problem, Index /*column*/, ConstMatrixRef /*memory*/,
                        MatrixRef slopes) const {
  slopes.setZero();
  for (Index row = 0; row < slopes.rows(); ++row) {
    slopes(row, row % problem.components) = 1.0 / problem.flexibility(row);
  }
  return true;
}

}  // namespace latin::interface
