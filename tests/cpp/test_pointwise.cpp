#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "latin/interface/pointwise.hpp"
#include "law_sample.hpp"

namespace latin::interface {
namespace {

/// Contact, as a user would write it.
struct Stop {
  static constexpr const char* name = "stop";
  static constexpr std::array parameters{Parameter{"gap"}, Parameter{"compliance", 0.0}};
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      PointForce force) {
    std::ranges::fill(force, 0.0);
    force[0] = std::min(0.0, (jump[0] + p[0]) / (flexibility[0] + p[1]));
  }
};

/// Counts its steps, and fails when it is told to.
struct Counter {
  static constexpr const char* name = "counter";
  static constexpr std::array<Parameter, 1> parameters{Parameter{"fail"}};
  static constexpr std::size_t memory = 1;
  static void resolve(PointValues jump, PointValues /*flexibility*/, const std::array<double, 1>& p,
                      std::array<double, 1>& state, PointForce force) {
    if (p[0] == 1.0) {
      throw std::runtime_error("no more");
    }
    state[0] += 1.0;
    force[0] = p[0] == 2.0 ? std::nan("") : state[0];
    force[1] = jump[1];
  }
};

static_assert(PointwiseLaw<Stop>);
static_assert(PointwiseLaw<Counter>);
struct Nothing {};
static_assert(!PointwiseLaw<Nothing>);

}  // namespace

TEST(PointwiseLaw, EqualsTheBatchedLaw) {
  const auto own = make_law(*law_factory<Stop>());
  const auto contact = make_law("contact");
  for (const auto& law : {own.get(), contact.get()}) {
    law->set("gap", ParameterField((Matrix(2, 1) << 0.05, -0.1).finished()));
    law->set("compliance", ParameterField(0.7));
    law->set("jump", ParameterField((Matrix(4, 1) << 0.2, 0.0, -0.3, 0.1).finished()));
  }
  const Asked asked;
  EXPECT_EQ(asked.resolve(*own), asked.resolve(*contact));
  EXPECT_FALSE(own->history());
  EXPECT_THROW(own->set("compliance", ParameterField(-1.0)), InputError);
  EXPECT_EQ(own->blank()->name(), "stop");
}

TEST(PointwiseLaw, RemembersWithinAHistory) {
  const PointwiseLawAdapter<Counter> law;
  EXPECT_TRUE(law.history());
  Matrix force(4, 6);
  law.resolve({2, Matrix::Ones(4, 6), Vector::Ones(4), 3}, force);
  EXPECT_EQ(force.row(0), (Matrix(1, 6) << 1, 2, 3, 1, 2, 3).finished());
  EXPECT_EQ(force.row(2), force.row(0));
}

TEST(PointwiseLaw, OneColumnAfterTheOtherIsTheHistory) {
  PointwiseLawAdapter<Counter> law;
  law.set("fail", ParameterField((Matrix(1, 6) << 0, 0, 0, 0, 0, 3).finished()));
  EXPECT_EQ(law.memory(), 1);
  const Matrix jump = Matrix::Random(4, 6);
  Matrix force(4, 6);
  law.resolve({2, jump, Vector::Ones(4), 3}, force);
  Matrix memory;
  for (Index column = 0; column < 6; ++column) {
    if (column % 3 == 0) {
      memory = Matrix::Zero(1, 2);
    }
    Matrix one(4, 1);
    EXPECT_TRUE(law.resolve_column({2, jump.col(column), Vector::Ones(4), 3}, column, memory, one));
    EXPECT_EQ(one.col(0), force.col(column));
  }
  EXPECT_EQ(law.at_columns(4, 2)->get("fail").values(), (Matrix(1, 2) << 0, 3).finished());
}

TEST(PointwiseLaw, NamesWhereItFails) {
  PointwiseLawAdapter<Counter> law;
  Matrix force(4, 1);
  for (const double how : {1.0, 2.0}) {
    law.set("fail", ParameterField((Matrix(2, 1) << 0.0, how).finished()));
    try {
      law.resolve({2, Matrix::Ones(4, 1), Vector::Ones(4), 1, "seal"}, force);
      FAIL();
    } catch (const NumericalError& error) {
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
  const LawFactory other{"laws 0", nullptr};
  EXPECT_THROW(make_law(other), InputError);
}

}  // namespace latin::interface
