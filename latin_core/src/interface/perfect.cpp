#include "latin/interface/perfect.hpp"

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

}  // namespace latin::interface
