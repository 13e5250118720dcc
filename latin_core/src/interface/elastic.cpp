#include "interface/elastic.hpp"

#include <limits>

namespace latin::interface {

std::vector<Law::ParameterInfo> ElasticLaw::parameters() const {
  return {{"normal", Shape::per_point, 0.0},
          {"tangential", Shape::per_point, 0.0},
          {"jump", Shape::per_row, -std::numeric_limits<double>::infinity()}};
}

void ElasticLaw::resolve(const LocalProblem& problem, MatrixRef force) const {
  const Matrix& normal = get("normal").values();
  const Matrix& tangential = get("tangential").values();
  const Matrix& imposed = get("jump").values();
  const Index points = force.rows() / problem.components;
  Vector conductance(force.rows());
  for (Index column = 0; column < force.cols(); ++column) {
    const auto at = [column](const Matrix& field) { return field.cols() == 1 ? 0 : column; };
    if (column == 0 || normal.cols() > 1 || tangential.cols() > 1) {
      for (Index component = 0; component < problem.components; ++component) {
        const Matrix& field = component == 0 ? normal : tangential;
        auto own = conductance(Eigen::seqN(component, points, problem.components));
        if (field.rows() == 1) {
          own.setConstant(field(0, at(field)));
        } else {
          own = field.col(at(field));
        }
      }
      // kappa / (1 + c kappa), written so that neither end of the range overflows
      conductance =
          (conductance.array().inverse() + problem.flexibility.array()).inverse().matrix();
    }
    if (imposed.rows() == 1) {
      const double jump = imposed(0, at(imposed));
      force.col(column) = conductance.array() * (problem.jump.col(column).array() - jump);
    } else {
      force.col(column) =
          conductance.cwiseProduct(problem.jump.col(column) - imposed.col(at(imposed)));
    }
  }
}

bool ElasticLaw::slopes(const LocalProblem& problem, Index column, ConstMatrixRef /*memory*/,
                        MatrixRef slopes) const {
  const ParameterField& normal = get("normal");
  const ParameterField& tangential = get("tangential");
  slopes.setZero();
  for (Index row = 0; row < slopes.rows(); ++row) {
    const Index point = row / problem.components;
    const Index component = row % problem.components;
    const double stiffness = component == 0 ? normal(point, column) : tangential(point, column);
    slopes(row, component) = 1.0 / (1.0 / stiffness + problem.flexibility(row));
  }
  return true;
}

}  // namespace latin::interface
