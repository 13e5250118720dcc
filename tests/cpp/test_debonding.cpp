#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/debonding.hpp"
#include "law_sample.hpp"

namespace latin::interface {
namespace {

/// The damage of the debonding law at an opening.
double damage(double lambda, double first, double last) {
  return std::clamp(last * (lambda - first) / (lambda * (last - first)), 0.0, 1.0);
}

}  // namespace

TEST(DebondingLaw, HoldsItsEquationsOverRandomHistories) {
  const double normal = 50.0;
  const double strength = 2.0;
  const double opening = 0.5;
  const double first = strength / normal;
  const auto law = make_law("debonding");
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

TEST(DebondingLaw, TakesItsEnergyInEveryMode) {
  const double energy = 0.4;
  const auto law = make_law("debonding");
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

TEST(DebondingLaw, AsksForAUniqueAnswer) {
  const auto law = make_law("debonding");
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
  } catch (const InputError& error) {
    const std::string message = error.what();
    EXPECT_NE(message.find("interface 'glue line', law 'debonding', point 0"), std::string::npos);
    EXPECT_NE(message.find("search direction"), std::string::npos);
  }
  law->set("opening", ParameterField(0.03));
  EXPECT_THROW(law->resolve({1, jump, Vector::Constant(1, 1e-6)}, force), InputError);
  law->set("strength", ParameterField(0.0));
  EXPECT_THROW(law->resolve({1, jump, Vector::Constant(1, 1e-6)}, force), InputError);
}

TEST(DebondingLaw, KnowsItsSlopes) {
  const auto law = make_law("debonding");
  law->set("normal", ParameterField(50.0));
  law->set("tangential", ParameterField(20.0));
  law->set("strength", ParameterField(2.0));
  law->set("opening", ParameterField(0.5));
  const Vector c = (Vector(3) << 0.1, 0.07, 0.07).finished();
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  int branches[3] = {0, 0, 0};
  for (int trial = 0; trial < 300; ++trial) {
    const double size = 0.1 + 0.01 * (trial % 100);
    const Matrix memory = Matrix::Constant(1, 1, trial % 3 == 0 ? 0.2 * (any(random) + 1.0) : 0.0);
    const Vector jump =
        (Vector(3) << size * any(random), size * any(random), size * any(random)).finished();
    Matrix slopes(3, 3);
    ASSERT_TRUE(law->slopes({3, jump, c}, 0, memory, slopes));
    const double h = 1e-7;
    const auto force = [&](const Vector& at, Matrix& left) {
      Matrix answer(3, 1);
      left = memory;
      EXPECT_TRUE(law->resolve_column({3, at, c}, 0, left, answer));
      return Vector(answer.col(0));
    };
    Matrix left;
    Matrix before;
    force(jump, before);
    ++branches[before(0, 0) >= 0.5 ? 2 : before(0, 0) > memory(0, 0) ? 1 : 0];
    for (int b = 0; b < 3; ++b) {
      const Vector step = h * Vector::Unit(3, b);
      const Vector difference = (force(jump + step, left) - force(jump - step, left)) / (2.0 * h);
      EXPECT_LT((difference - slopes.col(b)).norm(), 1e-5 * (1.0 + difference.norm())) << trial;
    }
  }
  EXPECT_GT(*std::min_element(branches, branches + 3), 10);
  // at its largest opening a point unloads: the tangent is the secant
  const Vector pulled = (Vector(1) << 0.3).finished();
  const Vector soft = (Vector(1) << 0.1).finished();
  Matrix memory = Matrix::Zero(1, 1);
  Matrix answer(1, 1);
  ASSERT_TRUE(law->resolve_column({1, pulled, soft}, 0, memory, answer));
  Matrix slope(1, 1);
  ASSERT_TRUE(law->slopes({1, pulled, soft}, 0, memory, slope));
  EXPECT_NEAR(slope(0, 0), answer(0, 0) / pulled(0), 1e-12 * slope(0, 0));
}

}  // namespace latin::interface
