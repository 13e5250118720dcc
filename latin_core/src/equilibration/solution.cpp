#include "equilibration/equilibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace latin::equilibration {

/// Moments (d, facet nodes) of the tractions of the solution, out of the cell.
Matrix Equilibration::own_moments(Index cell, Index facet) const {
  // int phi_j lambda_v over a facet of area 1
  static const auto weights = [](int dim, int degree) {
    const Rule rule = simplex_rule(dim - 1, degree + 1);
    Matrix bary(dim, rule.points.cols());
    bary.row(0) = 1.0 - rule.points.colwise().sum().array();
    bary.bottomRows(dim - 1) = rule.points;
    return Matrix(bary * (rule.weights / rule.weights.sum()).asDiagonal() *
                  lagrange(degree, bary).transpose());
  };
  static const std::array<std::array<Matrix, 2>, 2> all{
      {{weights(2, 1), weights(2, 2)}, {weights(3, 1), weights(3, 2)}}};
  const Matrix& shares = all[dim_ - 2][reference_.degree() - 1];
  const Matrix slopes = gradients(cell);
  const double volume = std::abs(edges(cell).determinant()) / (dim_ == 2 ? 2.0 : 6.0);
  const Vector normal =
      -static_cast<double>(dim_) * volume * slopes.col(facet);  // as long as the facet is large
  Matrix tractions = Matrix::Zero(dim_, dim_);
  Index next = 0;
  for (Index v = 0; v < corners_; ++v) {
    if (v == facet) {
      continue;
    }
    for (Index a = 0; a < reference_.components(); ++a) {
      const auto [i, j] = reference_.component(a);
      const double value = cells_.stress(a, cell * corners_ + v);
      tractions(i, next) += value * normal(j);
      if (i != j) {
        tractions(j, next) += value * normal(i);
      }
    }
    ++next;
  }
  return tractions * shares;
}

/// What tractions are to make up (d, nodes): the moments of the solution's stress without the body forces.
Matrix Equilibration::lacking(Index cell) const {
  static const auto rule_of = [](int dim) {
    const Rule rule = simplex_rule(dim, 3);
    Matrix bary(dim + 1, rule.points.cols());
    bary.row(0) = 1.0 - rule.points.colwise().sum().array();
    bary.bottomRows(dim) = rule.points;
    return std::pair{bary, Vector(rule.weights)};
  };
  static const std::array<std::pair<Matrix, Vector>, 2> rules{rule_of(2), rule_of(3)};
  const auto& [bary, weights] = rules[dim_ - 2];
  const Matrix slopes = gradients(cell);
  const double size = std::abs(edges(cell).determinant());
  const Matrix stress =
      cells_.stress.middleCols(cell * corners_, corners_) * bary * weights.asDiagonal() * size;
  const Matrix shapes = lagrange(reference_.degree(), bary);
  Matrix out = -cells_.force.col(cell) * (shapes * weights * size).transpose();
  // coefficients of the gradients of the barycentric coordinates in that of each function
  for (Index node = 0; node < reference_.nodes(); ++node) {
    Matrix of_lambda = Matrix::Zero(corners_, bary.cols());
    if (reference_.degree() == 1) {
      of_lambda.row(node).setOnes();
    } else if (node < corners_) {
      of_lambda.row(node) = 4.0 * bary.row(node).array() - 1.0;
    } else {
      Index next = corners_;
      for (Index i = 0; i < corners_; ++i) {
        for (Index j = i + 1; j < corners_; ++j, ++next) {
          if (next == node) {
            of_lambda.row(i) = 4.0 * bary.row(j);
            of_lambda.row(j) = 4.0 * bary.row(i);
          }
        }
      }
    }
    const Matrix gradient = slopes * (of_lambda * stress.transpose());  // (d, components)
    for (Index a = 0; a < reference_.components(); ++a) {
      const auto [i, j] = reference_.component(a);
      out(i, node) += gradient(j, a);
      if (i != j) {
        out(j, node) += gradient(i, a);
      }
    }
  }
  return out;
}

}  // namespace latin::equilibration
