#include "latin/interface/elastic.hpp"

#include <cmath>
#include <limits>

namespace latin {

std::vector<Law::ParameterInfo> ElasticLaw::parameters() const {
  return {{"normal", Shape::per_point, 0.0},
          {"tangential", Shape::per_point, 0.0},
          {"jump", Shape::per_row, -std::numeric_limits<double>::infinity()}};
}

void ElasticLaw::resolve(const LocalProblem& problem, MatrixRef force) const {
  const ParameterField& normal = get("normal");
  const ParameterField& tangential = get("tangential");
  const ParameterField& jump = get("jump");
  for (Index column = 0; column < force.cols(); ++column) {
    for (Index row = 0; row < force.rows(); ++row) {
      const Index point = row / problem.components;
      const double kappa =
          row % problem.components == 0 ? normal(point, column) : tangential(point, column);
      // kappa / (1 + c kappa), written so that neither end of the range overflows
      const double conductance = kappa > 1.0 / problem.flexibility(row)
                                     ? 1.0 / (1.0 / kappa + problem.flexibility(row))
                                     : kappa / (1.0 + kappa * problem.flexibility(row));
      force(row, column) = conductance * (problem.jump(row, column) - jump(row, column));
    }
  }
}

}  // namespace latin
