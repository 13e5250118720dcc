#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "latin/common/error.hpp"
#include "latin/interface/interface.hpp"
#include "latin/interface/law.hpp"
#include "latin/interface/pointwise.hpp"

using latin::Matrix;
using latin::Vector;
using latin::interface::ParameterField;

namespace {

/// Two points, two components (normal, tangent), two columns.
struct Asked {
  Matrix jump = (Matrix(4, 2) << 0.3, -1.0, 0.2, 0.5, -0.4, 2.0, 0.1, 0.0).finished();
  Vector flexibility = (Vector(4) << 0.5, 0.5, 2.0, 2.0).finished();

  [[nodiscard]] Matrix resolve(const latin::interface::Law& law) const {
    Matrix force(4, 2);
    law.resolve({2, jump, flexibility}, force);
    return force;
  }
};

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

TEST(Laws, ElasticSatisfiesItsEquationOnTheResolvent) {
  const auto law = latin::interface::make_law("elastic");
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
  const auto elastic = latin::interface::make_law("elastic");
  const auto perfect = latin::interface::make_law("perfect");
  const Asked asked;
  for (const double stiffness : {1e16, 1e300, infinity}) {
    elastic->set("normal", ParameterField(stiffness));
    elastic->set("tangential", ParameterField(stiffness));
    EXPECT_LT((asked.resolve(*elastic) - asked.resolve(*perfect)).norm(), 1e-14);
  }
}

TEST(Laws, ElasticVanishesWithoutStiffness) {
  const auto law = latin::interface::make_law("elastic");
  EXPECT_EQ(Asked{}.resolve(*law).norm(), 0.0);
}

TEST(Laws, ForceIgnoresTheJump) {
  const auto law = latin::interface::make_law("force");
  law->set("force", ParameterField((Matrix(4, 1) << 1.0, 2.0, 3.0, 4.0).finished()));
  const Matrix force = Asked{}.resolve(*law);
  EXPECT_EQ(force.col(0), force.col(1));
  EXPECT_EQ(force(2, 1), 3.0);
}

TEST(Laws, RefuseWhatTheyCannotTake) {
  EXPECT_THROW(latin::interface::make_law("glue"), latin::InputError);
  const auto law = latin::interface::make_law("elastic");
  EXPECT_THROW(law->set("stifness", ParameterField(1.0)), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(-1.0)), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(std::nan(""))), latin::InputError);
  EXPECT_THROW(law->set("normal", ParameterField(Matrix(0, 1))), latin::InputError);
}

TEST(Laws, ContactIsComplementary) {
  const auto law = latin::interface::make_law("contact");
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
  const auto law = latin::interface::make_law("coulomb");
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
  const auto law = latin::interface::make_law("coulomb");
  const auto contact = latin::interface::make_law("contact");
  const Asked asked;
  EXPECT_EQ((asked.resolve(*law) - asked.resolve(*contact)).norm(), 0.0);  // mu = 0
  law->set("friction", ParameterField(1e12));
  const Matrix stuck = asked.resolve(*law);
  EXPECT_NEAR(stuck(3, 0), asked.jump(3, 0) / 2.0, 1e-12);
  EXPECT_EQ(stuck(1, 0), 0.0);  // open: nothing to rub on
}

namespace {

/// The damage of the debonding law at an opening.
double damage(double lambda, double first, double last) {
  return std::clamp(last * (lambda - first) / (lambda * (last - first)), 0.0, 1.0);
}

}  // namespace

TEST(Laws, DebondingHoldsItsEquationsOverRandomHistories) {
  const double normal = 50.0;
  const double strength = 2.0;
  const double opening = 0.5;
  const double first = strength / normal;
  const auto law = latin::interface::make_law("debonding");
  EXPECT_TRUE(law->history());
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  for (const double tangential : {0.0, 20.0, 90.0}) {
    const double ratio = tangential / normal;
    law->set("normal", ParameterField(normal));
    law->set("tangential", ParameterField(tangential));
    law->set("strength", ParameterField(strength));
    law->set("opening", ParameterField(opening));
    // up to 0.6 of the largest admissible flexibility
    Vector c(3);
    c << 0.6, 0.4, 0.4;
    c *= (opening - first) / strength;
    c.tail(2) /= std::max(1.0, ratio);
    const int steps = 8;
    const int histories = 200;
    Matrix jump(3, steps * histories);
    for (int column = 0; column < jump.cols(); ++column) {
      const double size = 0.1 + 0.1 * (column % steps);
      for (int row = 0; row < 3; ++row) {
        jump(row, column) = size * any(random);
      }
    }
    Matrix force(3, jump.cols());
    law->resolve({3, jump, c, steps}, force);
    double largest = 0.0;
    int broken = 0;
    int softening = 0;
    for (int column = 0; column < jump.cols(); ++column) {
      if (column % steps == 0) {
        largest = 0.0;
      }
      const Vector j = jump.col(column) - c.cwiseProduct(force.col(column));
      const double pull = std::max(j(0), 0.0);
      const double lambda = std::sqrt(pull * pull + ratio * (j(1) * j(1) + j(2) * j(2)));
      softening += lambda > largest && lambda > first && lambda < opening ? 1 : 0;
      largest = std::max(largest, lambda);
      const double d = largest > 0.0 ? damage(largest, first, opening) : 0.0;
      broken += d == 1.0 ? 1 : 0;
      const double expected = j(0) > 0.0 ? (1.0 - d) * normal * j(0) : normal * j(0);
      EXPECT_NEAR(force(0, column), expected, 1e-12 * strength);
      EXPECT_NEAR(force(1, column), (1.0 - d) * tangential * j(1), 1e-12 * strength);
      EXPECT_NEAR(force(2, column), (1.0 - d) * tangential * j(2), 1e-12 * strength);
    }
    EXPECT_GT(broken, 100);
    EXPECT_GT(softening, 100);
  }
}

TEST(Laws, DebondingTakesItsEnergyInEveryMode) {
  const double energy = 0.4;
  const auto law = latin::interface::make_law("debonding");
  law->set("normal", ParameterField(50.0));
  law->set("tangential", ParameterField(30.0));
  law->set("strength", ParameterField(2.0));
  law->set("energy", ParameterField(energy));
  const int steps = 4001;
  const double c = 1e-3;
  for (const double angle : {0.0, 0.7, std::acos(0.0)}) {
    Matrix jump(2, steps);
    for (int step = 0; step < steps; ++step) {
      const double size = 0.6 * step / (steps - 1);
      jump.col(step) << size * std::cos(angle), size * std::sin(angle);
    }
    Matrix force(2, steps);
    law->resolve({2, jump, Vector::Constant(2, c), steps}, force);
    const Matrix j = jump - c * force;
    double work = 0.0;
    for (int step = 1; step < steps; ++step) {
      work += 0.5 * (force.col(step) + force.col(step - 1)).dot(j.col(step) - j.col(step - 1));
    }
    EXPECT_EQ(force.col(steps - 1).norm(), 0.0);
    // the trapezoidal rule is exact but for the two kinks: an error of one step each, squared
    EXPECT_NEAR(work, energy, 1e-4 * energy);
  }
}

TEST(Laws, DebondingAsksForAUniqueAnswer) {
  const auto law = latin::interface::make_law("debonding");
  law->set("normal", ParameterField(50.0));
  law->set("strength", ParameterField(2.0));
  law->set("opening", ParameterField(0.5));
  Matrix force(1, 1);
  const Matrix jump = Matrix::Ones(1, 1);
  const double limit = (0.5 - 2.0 / 50.0) / 2.0;
  law->resolve({1, jump, Vector::Constant(1, 0.999 * limit)}, force);
  try {
    law->resolve({1, jump, Vector::Constant(1, 1.001 * limit), 1, "glue line"}, force);
    FAIL();
  } catch (const latin::InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("interface 'glue line', law 'debonding', point 0"), std::string::npos);
    EXPECT_NE(message.find("search direction"), std::string::npos);
  }
  law->set("opening", ParameterField(0.03));
  EXPECT_THROW(law->resolve({1, jump, Vector::Constant(1, 1e-6)}, force), latin::InputError);
  law->set("strength", ParameterField(0.0));
  EXPECT_THROW(law->resolve({1, jump, Vector::Constant(1, 1e-6)}, force), latin::InputError);
}

TEST(Laws, PreloadIsAForceThenALength) {
  const auto law = latin::interface::make_law("preload");
  law->set("force", ParameterField(5.0));
  law->set("locked", ParameterField((Matrix(1, 8) << 0, 0, 1, 1, 1, 0, 1, 1).finished()));
  const Vector c = (Vector(2) << 0.25, 2.0).finished();
  const Matrix free = Matrix::Random(2, 8);
  Matrix force(2, 8);
  law->resolve({2, free, c, 4}, force);
  const Matrix jump = free - c.asDiagonal() * force;
  for (const int step : {0, 1, 5}) {
    EXPECT_EQ(force(0, step), 5.0);
  }
  EXPECT_NEAR(jump(0, 2), jump(0, 1), 1e-15);
  EXPECT_NEAR(jump(0, 3), jump(0, 1), 1e-15);
  EXPECT_NEAR(jump(0, 4), 0.0, 1e-15);  // a history that begins locked keeps its length
  EXPECT_NEAR(jump(0, 6), jump(0, 5), 1e-15);
  EXPECT_LT(jump.row(1).norm(), 1e-15);  // tied
}

namespace {

/// Contact, as a user would write it.
struct Stop {
  static constexpr const char* name = "stop";
  static constexpr std::array parameters{latin::interface::Parameter{"gap"},
                                         latin::interface::Parameter{"compliance", 0.0}};
  static void resolve(latin::interface::PointValues jump, latin::interface::PointValues flexibility,
                      const std::array<double, 2>& p, latin::interface::PointForce force) {
    std::ranges::fill(force, 0.0);
    force[0] = std::min(0.0, (jump[0] + p[0]) / (flexibility[0] + p[1]));
  }
};

/// Counts its steps, and fails when it is told to.
struct Counter {
  static constexpr const char* name = "counter";
  static constexpr std::array<latin::interface::Parameter, 1> parameters{
      latin::interface::Parameter{"fail"}};
  static constexpr std::size_t memory = 1;
  static void resolve(latin::interface::PointValues jump,
                      latin::interface::PointValues /*flexibility*/, const std::array<double, 1>& p,
                      std::array<double, 1>& state, latin::interface::PointForce force) {
    if (p[0] == 1.0) {
      throw std::runtime_error("no more");
    }
    state[0] += 1.0;
    force[0] = p[0] == 2.0 ? std::nan("") : state[0];
    force[1] = jump[1];
  }
};

static_assert(latin::interface::PointwiseLaw<Stop>);
static_assert(latin::interface::PointwiseLaw<Counter>);
struct Nothing {};
static_assert(!latin::interface::PointwiseLaw<Nothing>);

}  // namespace

TEST(PointwiseLaw, EqualsTheBatchedLaw) {
  const auto own = latin::interface::make_law(*latin::interface::law_factory<Stop>());
  const auto contact = latin::interface::make_law("contact");
  for (const auto& law : {own.get(), contact.get()}) {
    law->set("gap", ParameterField((Matrix(2, 1) << 0.05, -0.1).finished()));
    law->set("compliance", ParameterField(0.7));
    law->set("jump", ParameterField((Matrix(4, 1) << 0.2, 0.0, -0.3, 0.1).finished()));
  }
  const Asked asked;
  EXPECT_EQ(asked.resolve(*own), asked.resolve(*contact));
  EXPECT_FALSE(own->history());
  EXPECT_THROW(own->set("compliance", ParameterField(-1.0)), latin::InputError);
  EXPECT_EQ(own->blank()->name(), "stop");
}

TEST(PointwiseLaw, RemembersWithinAHistory) {
  const latin::interface::PointwiseLawAdapter<Counter> law;
  EXPECT_TRUE(law.history());
  Matrix force(4, 6);
  law.resolve({2, Matrix::Ones(4, 6), Vector::Ones(4), 3}, force);
  EXPECT_EQ(force.row(0), (Matrix(1, 6) << 1, 2, 3, 1, 2, 3).finished());
  EXPECT_EQ(force.row(2), force.row(0));
}

TEST(PointwiseLaw, NamesWhereItFails) {
  latin::interface::PointwiseLawAdapter<Counter> law;
  Matrix force(4, 1);
  for (const double how : {1.0, 2.0}) {
    law.set("fail", ParameterField((Matrix(2, 1) << 0.0, how).finished()));
    try {
      law.resolve({2, Matrix::Ones(4, 1), Vector::Ones(4), 1, "seal"}, force);
      FAIL();
    } catch (const latin::NumericalError& error) {
      const std::string message = error.what();
      EXPECT_NE(message.find("interface 'seal', law 'counter', point 1"), std::string::npos);
      EXPECT_NE(message.find(how == 1.0 ? "no more" : "not finite"), std::string::npos);
    }
  }
  // what a diverging iteration asks is not the law's fault
  const Matrix lost = Matrix::Constant(4, 1, infinity);
  law.resolve({2, lost, Vector::Ones(4), 1, "seal"}, force);
}

TEST(PointwiseLaw, OfAnotherCompilationIsRefused) {
  const latin::interface::LawFactory other{"laws 0", nullptr};
  EXPECT_THROW(latin::interface::make_law(other), latin::InputError);
}

TEST(Interface, LocalFrameRotatesRowsAndDropsComponents) {
  latin::SparseRows trace(4, 2);  // two points in 2D, two unknowns
  trace.insert(0, 0) = 1.0;
  trace.insert(1, 1) = 1.0;
  trace.insert(2, 0) = 0.5;
  trace.insert(3, 1) = 0.5;
  trace.makeCompressed();
  const Matrix frames = (Matrix(2, 2) << 0.6, 0.8, -0.8, 0.6).finished();  // one row a point
  const Matrix local = latin::interface::to_local_frame(trace, frames, "joint");
  EXPECT_LT((local - (Matrix(2, 2) << 0.6, 0.8, -0.4, 0.3).finished()).norm(), 1e-15);
  EXPECT_THROW(latin::interface::to_local_frame(trace, Matrix::Ones(3, 2), "joint"),
               latin::InputError);
}
