#include <gtest/gtest.h>

#include <cmath>
#include <memory>

#include "substructure/seen_forces.hpp"
#include "substructure/structure.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::SparseRows;
using latin::Vector;

constexpr Index points = 4;

/// Displacements of a line of two nodes at points between them, one component.
SparseRows line() {
  SparseRows trace(points, 2);
  for (Index point = 0; point < points; ++point) {
    const double at = (static_cast<double>(point) + 0.5) / static_cast<double>(points);
    trace.insert(point, 0) = 1.0 - at;
    trace.insert(point, 1) = at;
  }
  trace.makeCompressed();
  return trace;
}

/// Two bodies of two nodes each on springs, joined at four points.
latin::substructure::Structure joined(const std::string& law) {
  SparseRows stiffness(2, 2);
  stiffness.setIdentity();
  const auto shared = latin::owning_view(stiffness);
  std::vector<latin::substructure::BodyDescription> bodies;
  latin::substructure::InterfaceDescription joint{
      "joint", law, Vector::LinSpaced(points, 0.5, 1.5), Matrix::Identity(1, 1), {}};
  joint.frames = Matrix::Ones(points, 1);
  for (const std::string name : {"left", "right"}) {
    bodies.push_back({name, 2, {{name, shared, {}, Matrix::Zero(2, 1), {}}}, {}});
    joint.sides.push_back({name, line(), Vector::Constant(points, 1.3), 1.0});
  }
  return {std::move(bodies), {std::move(joint)}, {}};
}

TEST(SeenForces, KeepsWhatTheDisplacementsSeeAndNoMore) {
  const auto structure = joined("perfect");
  const SparseRows trace = line();
  const Vector weights = structure.weights().head(points);
  Vector force(points);
  force << 3.0, -1.0, 4.0, 1.5;
  const Matrix traces = Matrix::Constant(2 * points, 1, 0.2);
  Matrix data = structure.directions().asDiagonal() * traces;
  data.topRows(points) += force;
  data.bottomRows(points) -= force;
  structure.seen_forces().keep(data, traces);
  const Vector kept = (data - structure.directions().asDiagonal() * traces).topRows(points);
  const Vector other = (data - structure.directions().asDiagonal() * traces).bottomRows(points);
  EXPECT_LT((kept + other).norm(), 1e-13);
  EXPECT_LT((trace.transpose() * weights.cwiseProduct(kept - force)).norm(), 1e-12);
  // on a line between the nodes: second differences vanish
  EXPECT_NEAR(kept(0) - 2.0 * kept(1) + kept(2), 0.0, 1e-12);
  EXPECT_NEAR(kept(1) - 2.0 * kept(2) + kept(3), 0.0, 1e-12);
  // and it is the answer for itself
  const Matrix before = data;
  structure.seen_forces().keep(data, traces);
  EXPECT_LT((data - before).norm(), 1e-12);
}

TEST(SeenForces, ForcesThatNothingSeesAreNone) {
  const auto structure = joined("preload");
  const Vector weights = structure.weights().head(points);
  // orthogonal to constants and to lines
  Matrix seen(points, 2);
  seen = Matrix(line());
  const Matrix gram = seen.transpose() * weights.asDiagonal() * seen;
  Vector force = Vector::Unit(points, 0);
  force -= seen * gram.ldlt().solve(seen.transpose() * weights.cwiseProduct(force));
  Matrix data(2 * points, 1);
  data << force, -force;
  structure.seen_forces().keep(data, Matrix::Zero(2 * points, 1));
  EXPECT_LT(data.norm(), 1e-12);
}

TEST(SeenForces, LawsThatDetermineTheirForcesAreLeftAlone) {
  const auto structure = joined("elastic");
  Matrix data(2 * points, 1);
  data << 1.0, -2.0, 3.0, 5.0, -1.0, 2.0, -3.0, -5.0;
  const Matrix before = data;
  structure.seen_forces().keep(data, Matrix::Zero(2 * points, 1));
  EXPECT_EQ(data, before);
}

}  // namespace
