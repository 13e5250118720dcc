#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "interface/root.hpp"

namespace latin::interface {
namespace {

/// R applied to every row.
template <class Rule>
ForceFunction each_row(Rule rule) {
  ForceFunction law;
  law.force = [rule](const PointRows& jump, ForceFunction::Far /*allowed*/) {
    PointRows force(jump.rows(), jump.cols());
    for (Index row = 0; row < jump.rows(); ++row) {
      force.row(row) = rule(Vector(jump.row(row).transpose())).transpose();
    }
    return force;
  };
  return law;
}

double worst(const ForceFunction& law, const PointRows& jump, const PointRows& flexibility,
             const Roots& found) {
  const PointRows left = jump - flexibility.cwiseProduct(found.force);
  return (law.force(left, ForceFunction::Far::infinite) - found.force).cwiseAbs().maxCoeff();
}

}  // namespace

TEST(Roots, OfALinearLawAreInClosedForm) {
  const ForceFunction law = each_row([](const Vector& jump) -> Vector { return 3.0 * jump; });
  const PointRows jump = PointRows::Random(5, 2);
  const PointRows flexibility = PointRows::Random(5, 2).cwiseAbs().array() + 0.1;
  const Roots found = find_roots(law, jump, flexibility);
  const PointRows expected =
      3.0 * jump.cwiseQuotient(PointRows((1.0 + 3.0 * flexibility.array()).matrix()));
  EXPECT_LT((found.force - expected).cwiseAbs().maxCoeff(), 1e-14);
  EXPECT_EQ(std::ranges::count(found.bad, true), 0);
}

TEST(Roots, OfASteepLawThatOverflowsFarAway) {
  // R = sinh(200 j): infinite at the free jump
  const ForceFunction law =
      each_row([](const Vector& jump) -> Vector { return (200.0 * jump.array()).sinh(); });
  const PointRows jump = PointRows::Constant(3, 1, 10.0);
  const PointRows flexibility = (PointRows(3, 1) << 1e-3, 1.0, 1e3).finished();
  const Roots found = find_roots(law, jump, flexibility);
  EXPECT_EQ(std::ranges::count(found.bad, true), 0);
  // in the force, relative: the slope of the law is 200 f
  const PointRows left = jump - flexibility.cwiseProduct(found.force);
  for (Index row = 0; row < 3; ++row) {
    EXPECT_NEAR(std::asinh(found.force(row, 0)) / 200.0, left(row, 0), 1e-12 * jump(row, 0));
  }
}

TEST(Roots, OfACoupledLawWithAKink) {
  // the force of a rubber ring: nothing up to a length of 1, along the jump, stiffer in one direction
  const ForceFunction law = each_row([](const Vector& jump) -> Vector {
    const double length = jump.norm();
    return std::max(0.0, length - 1.0) * (length > 0.0 ? 5.0 / length : 0.0) * jump;
  });
  const PointRows jump = 4.0 * PointRows::Random(40, 3);
  const PointRows flexibility = PointRows::Constant(40, 3, 0.7);
  const Roots found = find_roots(law, jump, flexibility);
  EXPECT_EQ(std::ranges::count(found.bad, true), 0);
  EXPECT_LT(worst(law, jump, flexibility, found), 1e-12);
}

TEST(Roots, OfAStepLieOnItsVerticalPart) {
  // with j = 0.5 - f neither value of the step holds, with j = 9 - f the upper one does
  const ForceFunction law = each_row([](const Vector& jump) -> Vector {
    return jump.unaryExpr([](double each) { return each > 0.0 ? 1.0 : -1.0; });
  });
  const PointRows jump = (PointRows(2, 1) << 0.5, 9.0).finished();
  const Roots found = find_roots(law, jump, PointRows::Ones(2, 1));
  EXPECT_EQ(std::ranges::count(found.bad, true), 0);
  EXPECT_NEAR(found.force(0, 0), 0.5, 1e-12);
  EXPECT_NEAR(found.force(1, 0), 1.0, 1e-12);
}

TEST(Roots, SayWhereThereIsNone) {
  // a force that turns by a right angle at every step of the search, as no monotone law does
  Index calls = 0;
  ForceFunction law;
  law.force = [&calls](const PointRows& jump, ForceFunction::Far /*allowed*/) {
    const double sign = ++calls % 2 == 0 ? 1.0 : -1.0;
    PointRows force = jump;
    force.col(0) = 10.0 * sign * (jump.col(1).array() + 3.0);
    force.col(1) = -10.0 * sign * (jump.col(0).array() - 3.0);
    return force;
  };
  const Roots found = find_roots(law, PointRows::Ones(1, 2), PointRows::Ones(1, 2));
  EXPECT_TRUE(found.bad[0]);
  EXPECT_GT(found.off.norm(), 1e-3);
}

}  // namespace latin::interface
