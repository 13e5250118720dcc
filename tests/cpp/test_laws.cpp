#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "latin/common/error.hpp"
#include "latin/interface/interface.hpp"
#include "latin/interface/law.hpp"

using latin::Matrix;
using latin::ParameterField;
using latin::Vector;

namespace {

/// Two points, two components (normal, tangent), two columns.
struct Asked {
  Matrix jump = (Matrix(4, 2) << 0.3, -1.0, 0.2, 0.5, -0.4, 2.0, 0.1, 0.0).finished();
  Vector flexibility = (Vector(4) << 0.5, 0.5, 2.0, 2.0).finished();

  [[nodiscard]] Matrix resolve(const latin::Law& law) const {
    Matrix force(4, 2);
    law.resolve({2, jump, flexibility}, force);
    return force;
  }
};

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

TEST(Laws, ElasticSatisfiesItsEquationOnTheResolvent) {
  const auto law = latin::make_law("elastic");
  law->set("normal", ParameterField((Matrix(2, 1) << 3.0, 0.0).finished()));
  law->set("tangential", ParameterField(7.0));
  law->set("jump", ParameterField((Matrix(4, 1) << -0.2, 0.0, 0.1, 0.0).finished()));
  const Asked asked;
  const Matrix force = asked.resolve(*law);
  const Vector kappa = (Vector(4) << 3.0, 7.0, 0.0, 7.0).finished();
  const Vector imposed = (Vector(4) << -0.2, 0.0, 0.1, 0.0).finished();
  for (int column = 0; column < 2; ++column) {
    for (int row = 0; row < 4; ++row) {
      const double jump = asked.jump(row, column) - asked.flexibility(row) * force(row, column);
      EXPECT_NEAR(force(row, column), kappa(row) * (jump - imposed(row)), 1e-14);
    }
  }
}

TEST(Laws, ElasticReachesThePerfectLawAtInfinity) {
  const auto elastic = latin::make_law("elastic");
  const auto perfect = latin::make_law("perfect");
  const Asked asked;
  for (const double stiffness : {1e16, 1e300, infinity}) {
    elastic->set("normal", ParameterField(stiffness));
    elastic->set("tangential", ParameterField(stiffness));
    EXPECT_LT((asked.resolve(*elastic) - asked.resolve(*perfect)).norm(), 1e-14);
  }
}

TEST(Laws, ElasticVanishesWithoutStiffness) {
  const auto law = latin::make_law("elastic");
  EXPECT_EQ(Asked{}.resolve(*law).norm(), 0.0);
}

TEST(Laws, ForceIgnoresTheJump) {
  const auto law = latin::make_law("force");
  law->set("force", ParameterField((Matrix(4, 1) << 1.0, 2.0, 3.0, 4.0).finished()));
  const Matrix force = Asked{}.resolve(*law);
  EXPECT_EQ(force.col(0), force.col(1));
  EXPECT_EQ(force(2, 1), 3.0);
}

TEST(Laws, RefuseWhatTheyCannotTake) {
  EXPECT_THROW(latin::make_law("glue"), latin::InputError);
  const auto law = latin::make_law("elastic");
  EXPECT_THROW(law->set("stifness", ParameterField(1.0)), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(-1.0)), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(std::nan(""))), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(Matrix(0, 1))), latin::InputError);
}

TEST(Laws, ContactIsComplementary) {
  const auto law = latin::make_law("contact");
  law->set("gap", ParameterField((Matrix(2, 1) << 0.05, -0.1).finished()));
  for (const double compliance : {0.0, 0.7}) {
    law->set("compliance", ParameterField(compliance));
    const Asked asked;
    const Matrix force = asked.resolve(*law);
    for (int column = 0; column < 2; ++column) {
      for (int point = 0; point < 2; ++point) {
        const int row = 2 * point;
        const double gap = point == 0 ? 0.05 : -0.1;
        const double open =
            asked.jump(row, column) - asked.flexibility(row) * force(row, column) + gap;
        const double slack = open - compliance * force(row, column);
        EXPECT_LE(force(row, column), 0.0);
        EXPECT_GE(slack, -1e-14);
        EXPECT_NEAR(force(row, column) * slack, 0.0, 1e-14);
        EXPECT_EQ(force(row + 1, column), 0.0);
      }
    }
  }
}

TEST(Laws, CoulombSticksSlipsAndRemembers) {
  const auto law = latin::make_law("coulomb");
  law->set("friction", ParameterField(0.3));
  // one point, pressed by -2 in every step, sheared by a cycle; c = 1
  const Matrix jump = (Matrix(2, 5) << -2, -2, -2, -2, -2, 0.5, 1.0, 2.0, 0.0, 1.4).finished();
  Matrix force(2, 5);
  law->resolve({2, jump, Vector::Ones(2), 5}, force);
  double before = 0.0;
  for (int step = 0; step < 5; ++step) {
    const double slipped = jump(1, step) - force(1, step);
    EXPECT_EQ(force(0, step), -2.0);
    EXPECT_LE(std::abs(force(1, step)), 0.6 + 1e-15);
    const double slip = slipped - before;
    // no slip below the bound; at the bound the slip has the direction of the force
    EXPECT_NEAR(slip * (0.6 - std::abs(force(1, step))), 0.0, 1e-14);
    EXPECT_GE(slip * force(1, step), -1e-14);
    before = slipped;
  }
  EXPECT_EQ(force(1, 0), 0.5);   // sticks
  EXPECT_EQ(force(1, 1), 0.6);   // slips
  EXPECT_EQ(force(1, 3), -0.6);  // slips back
  // without history every column is a first step
  law->resolve({2, jump, Vector::Ones(2)}, force);
  EXPECT_EQ(force(1, 3), 0.0);
}

TEST(Laws, CoulombLimits) {
  const auto law = latin::make_law("coulomb");
  const auto contact = latin::make_law("contact");
  const Asked asked;
  EXPECT_EQ((asked.resolve(*law) - asked.resolve(*contact)).norm(), 0.0);  // mu = 0
  law->set("friction", ParameterField(1e12));
  const Matrix stuck = asked.resolve(*law);
  EXPECT_NEAR(stuck(3, 0), asked.jump(3, 0) / 2.0, 1e-12);
  EXPECT_EQ(stuck(1, 0), 0.0);  // open: nothing to rub on
}

TEST(Interface, LocalFrameRotatesRowsAndDropsComponents) {
  latin::SparseRows trace(4, 2);  // two points in 2D, two unknowns
  trace.insert(0, 0) = 1.0;
  trace.insert(1, 1) = 1.0;
  trace.insert(2, 0) = 0.5;
  trace.insert(3, 1) = 0.5;
  trace.makeCompressed();
  const Matrix frames = (Matrix(2, 2) << 0.6, 0.8, -0.8, 0.6).finished();  // one row a point
  const Matrix local = latin::to_local_frame(trace, frames, "joint");
  EXPECT_LT((local - (Matrix(2, 2) << 0.6, 0.8, -0.4, 0.3).finished()).norm(), 1e-15);
  EXPECT_THROW(latin::to_local_frame(trace, Matrix::Ones(3, 2), "joint"), latin::InputError);
}
