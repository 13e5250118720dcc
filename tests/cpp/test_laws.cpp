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
