#include "interface/force.hpp"

#include <limits>

namespace latin::interface {

std::vector<Law::ParameterInfo> ForceLaw::parameters() const {
  return {{"force", Shape::per_row, -std::numeric_limits<double>::infinity()}};
}

void ForceLaw::resolve(const LocalProblem& /*problem*/, MatrixRef force) const {
  const ParameterField& given = get("force");
  for (Index column = 0; column < force.cols(); ++column) {
    for (Index row = 0; row < force.rows(); ++row) {
      force(row, column) = given(row, column);
    }
  }
}

bool ForceLaw::slopes(const LocalProblem& /*problem*/, Index /*column*/, ConstMatrixRef /*memory*/,
                      MatrixRef slopes) const {
  slopes.setZero();
  return true;
}

}  // namespace latin::interface
