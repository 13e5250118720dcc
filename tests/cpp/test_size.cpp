#include <gtest/gtest.h>

#include <Eigen/LU>

#include <algorithm>
#include <limits>

#include "chain.hpp"

namespace latin::substructure {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// Strain and trace of every body (columns) in every group.
Sizes sizes(const Matrix& strain, const Matrix& trace) {
  const Matrix none = Matrix::Zero(strain.rows(), strain.cols());
  return {strain, trace, none, none};
}

Sizes strains(const Matrix& strain) {
  return sizes(strain, Matrix::Zero(strain.rows(), strain.cols()));
}

Yardstick of(const ColumnGroups& groups, Index bodies, double reach = 0.0) {
  const auto count = static_cast<std::size_t>(bodies);
  return {groups,
          Vector::Ones(bodies),
          Vector::Ones(bodies),
          std::vector<bool>(count, false),
          std::vector<Index>(count, 0),
          Vector::Constant(1, reach)};
}

void expect(const Matrix& found, const Matrix& expected) {
  ASSERT_EQ(found.rows(), expected.rows());
  ASSERT_EQ(found.cols(), expected.cols());
  for (Index i = 0; i < found.size(); ++i) {
    EXPECT_NEAR(found(i), expected(i), 1e-12) << i;
  }
}

}  // namespace

TEST(ColumnGroups, StepsRunFastestThenModesThenSets) {
  const ColumnGroups single;
  EXPECT_EQ(single.kinds(), 1);
  EXPECT_EQ(single.count(3), 3);  // three sets, each by itself
  EXPECT_EQ(single.of(2), 2);
  const ColumnGroups history{3, 1};
  EXPECT_EQ(history.count(6), 6);
  EXPECT_EQ(history.of(4), 4);
  const ColumnGroups chaos{1, 4};
  EXPECT_EQ(chaos.kinds(), 2);
  EXPECT_EQ(chaos.count(4), 2);
  EXPECT_EQ(chaos.of(0), 0);
  for (const Index mode : {1, 2, 3}) {
    EXPECT_EQ(chaos.of(mode), 1);
  }
  const ColumnGroups both{2, 3};  // two steps of three modes, in two sets
  EXPECT_EQ(both.count(12), 8);
  const std::vector<Index> expected{0, 2, 1, 3, 1, 3, 4, 6, 5, 7, 5, 7};
  for (Index column = 0; column < 12; ++column) {
    EXPECT_EQ(both.of(column), expected[static_cast<std::size_t>(column)]) << column;
  }
  EXPECT_EQ(both.count(0), 0);  // a rank without columns
}

TEST(Yardstick, AnErrorIsTheLargerOfThoseInStrainAndInDisplacement) {
  const Yardstick yardstick = of({}, 1, 1.0);
  const Sizes whole = sizes(Matrix{{4.0}}, Matrix{{1.0}});
  expect(yardstick.relative(sizes(Matrix{{0.04}}, Matrix{{0.0}}), whole), Matrix{{0.1}});
  expect(yardstick.relative(sizes(Matrix{{0.0}}, Matrix{{0.04}}), whole), Matrix{{0.2}});
  expect(yardstick.relative(sizes(Matrix{{0.04}}, Matrix{{0.04}}), whole), Matrix{{0.2}});
  expect(yardstick.relative(sizes(Matrix{{0.16}}, Matrix{{0.01}}), whole), Matrix{{0.2}});
}

TEST(Yardstick, EveryBodyIsMeasuredByItself) {
  // the second carries 1e-8 of the energy of the first
  const Sizes whole = sizes(Matrix{{1.0, 1e-8}}, Matrix{{1.0, 1e-8}});
  const Sizes error = sizes(Matrix{{1e-6, 0.25e-8}}, Matrix{{0.0, 0.0}});
  expect(of({}, 2, 1.0).relative(error, whole), Matrix{{1e-3, 0.5}});
}

TEST(Yardstick, EveryStepIsMeasuredByItselfUnlessItIsQuiet) {
  // of four steps the third hardly moves, and the last not at all: both are measured with 1e-9 of the largest
  const Sizes whole = strains((Matrix(4, 1) << 1.0, 1e-8, 1e-20, 0.0).finished());
  const Sizes error = strains((Matrix(4, 1) << 1e-6, 1e-10, 1e-20, 4e-20).finished());
  expect(of({4, 1}, 1).relative(error, whole), (Matrix(4, 1) << 1e-3, 0.1, 0.1, 0.2).finished());
  // sets side by side are histories of their own: here the second is small as a whole
  const Sizes two = strains((Matrix(4, 1) << 1.0, 1.0, 1e-20, 1e-20).finished());
  const Sizes wrong = strains((Matrix(4, 1) << 1e-4, 1e-6, 1e-22, 1e-24).finished());
  expect(of({2, 1}, 1).relative(wrong, two), (Matrix(4, 1) << 1e-2, 1e-3, 1e-1, 1e-2).finished());
}

TEST(Yardstick, WhatDoublePrecisionLeavesOfALargeStepIsNoErrorOfAQuietOne) {
  const Sizes whole = strains((Matrix(2, 1) << 0.0, 1.0).finished());
  const Yardstick yardstick = of({2, 1}, 1);
  expect(yardstick.relative(strains((Matrix(2, 1) << 4.0e-30, 0.0).finished()), whole),
         Matrix::Zero(2, 1));
  expect(yardstick.relative(strains((Matrix(2, 1) << 4e-28, 0.0).finished()), whole),
         (Matrix(2, 1) << 2e-5, 0.0).finished());
}

TEST(Yardstick, AFluctuationIsMeasuredApartFromItsMean) {
  // mean and fluctuation of a covariance of 1e-4
  const Sizes whole = strains((Matrix(2, 1) << 1.0, 1e-8).finished());
  const Sizes error = strains((Matrix(2, 1) << 1e-10, 1e-10).finished());
  expect(of({1, 5}, 1).relative(error, whole), (Matrix(2, 1) << 1e-5, 0.1).finished());
  // below 5e-7 of the mean there is none: it is measured with the mean
  const Sizes certain = strains((Matrix(2, 1) << 1.0, 0.0).finished());
  expect(of({1, 5}, 1).relative(strains((Matrix(2, 1) << 0.0, 1e-14).finished()), certain),
         (Matrix(2, 1) << 0.0, 1e-7).finished());
  // but there may be one that the iterate has not found yet
  expect(of({1, 5}, 1).relative(strains((Matrix(2, 1) << 0.0, 1e-12).finished()), certain),
         (Matrix(2, 1) << 0.0, 1.0).finished());
  // a mean is not measured with its fluctuation, nor one step's with another's
  const Sizes steps = strains((Matrix(4, 1) << 1e-4, 1.0, 1.0, 1e-4).finished());
  expect(of({2, 5}, 1).relative(strains(Matrix::Constant(4, 1, 1e-6)), steps),
         (Matrix(4, 1) << 0.1, 1e-3, 1e-3, 0.1).finished());
}

TEST(Yardstick, ABodyThatDoesNotMoveIsMeasuredWithThoseThatDo) {
  const Sizes whole = sizes(Matrix{{1.0, 0.0}}, Matrix{{4.0, 0.0}});
  Yardstick yardstick{{},
                      (Vector(2) << 1.0, 0.25).finished(),
                      Vector::Ones(2),
                      {false, false},
                      {0, 0},
                      Vector::Zero(1)};
  // mean squares of displacement: 4 and 0
  EXPECT_DOUBLE_EQ(yardstick.share_of_reach(whole)(0), 4.0);
  yardstick.reach(0) = 4.0;
  expect(yardstick.relative(sizes(Matrix{{0.0, 0.0}}, Matrix{{0.0, 0.01}}), whole),
         Matrix{{0.0, 0.1}});
  // double precision knows no better than 1e-14 of the reach
  expect(yardstick.relative(sizes(Matrix{{0.0, 0.0}}, Matrix{{0.0, 0.9e-28}}), whole),
         Matrix{{0.0, 0.0}});
}

TEST(Yardstick, ABodyThatIsHeldAllAroundHasNoSizeOfItsOwn) {
  Sizes whole = sizes(Matrix{{1e-20}}, Matrix{{1e-20}});
  whole.pressed(0, 0) = 1.0;
  const Sizes error = sizes(Matrix{{1e-20}}, Matrix{{1e-20}});
  expect(of({}, 1).relative(error, whole), Matrix{{1e-6}});
}

TEST(Yardstick, RoundingDoesNotPassBetweenIslands) {
  const Sizes whole = sizes(Matrix{{1.0, 1e-30}}, Matrix{{1.0, 1e-30}});
  const Sizes error = sizes(Matrix{{0.0, 1e-34}}, Matrix{{0.0, 1e-34}});
  Yardstick yardstick{{},     Vector::Ones(2), Vector::Ones(2), {false, false},
                      {0, 1}, Vector::Zero(2)};
  yardstick.reach = yardstick.share_of_reach(whole);
  expect(yardstick.relative(error, whole), Matrix{{0.0, 1e-2}});
}

TEST(Yardstick, AScatterIsStrainWhateverTheMeanDoes) {
  // a scatter of 1e-5 in a body whose mean is all but a rigid motion between large forces
  Sizes whole =
      sizes((Matrix(2, 1) << 1e-10, 1e-20).finished(), (Matrix(2, 1) << 1.0, 1e-20).finished());
  whole.work = (Matrix(2, 1) << 1.0, 1e-20).finished();
  whole.pressed = (Matrix(2, 1) << 1.0, 1e-20).finished();
  const Sizes error = sizes((Matrix(2, 1) << 0.0, 1e-22).finished(), Matrix::Zero(2, 1));
  expect(of({1, 5}, 1, 1.0).relative(error, whole), (Matrix(2, 1) << 0.0, 0.1).finished());
}

TEST(Yardstick, RoundingOfOtherBodiesDoesNotStrainABody) {
  // a body that is hardly touched, beside one that moves by 1
  const Sizes whole = sizes(Matrix{{1.0, 1e-30}}, Matrix{{1.0, 1e-30}});
  const Sizes error = sizes(Matrix{{0.0, 4.0e-30}}, Matrix{{0.0, 4.0e-30}});
  expect(of({}, 2, 1.0).relative(error, whole), Matrix{{0.0, 0.0}});
}

TEST(Yardstick, TheStrainOfARigidMotionIsNoSize) {
  // forces that balance each other do work of 1, and rounding leaves 1e-14 of it as strain
  Sizes whole = sizes(Matrix{{1e-14}}, Matrix{{1.0}});
  whole.work(0, 0) = 1.0;
  const Sizes error = sizes(Matrix{{1e-14}}, Matrix{{0.01}});
  expect(of({}, 1, 1.0).relative(error, whole), Matrix{{0.1}});
  whole.strain(0, 0) = 1e-10;  // this is one
  expect(of({}, 1, 1.0).relative(sizes(Matrix{{1e-10}}, Matrix{{0.01}}), whole), Matrix{{1.0}});
}

TEST(Yardstick, TheStrainOfAPartThatIsCarriedIsMeasuredApartFromItsMotion) {
  // below what rounding of its motion might do to a strain that is a difference
  const Sizes whole = sizes(Matrix{{1e-18}}, Matrix{{1.0}});
  const Sizes error = sizes(Matrix{{2.5e-19}}, Matrix{{0.01}});
  Yardstick yardstick = of({}, 1, 1.0);
  expect(yardstick.relative(error, whole, Noise::counted), Matrix{{0.1}});
  yardstick.carried = {true};
  expect(yardstick.relative(error, whole, Noise::counted), Matrix{{0.5}});
}

TEST(Yardstick, FacesThatAreHeldAreMeasuredWithTheStrain) {
  const Sizes whole = sizes(Matrix{{1.0}}, Matrix{{1e-16}});
  expect(of({}, 1, 1.0).relative(sizes(Matrix{{0.0}}, Matrix{{1e-8}}), whole), Matrix{{0.1}});
}

TEST(Yardstick, WhereNothingMovesEveryErrorIsInfiniteAndWhatIsNanStaysNan) {
  const Sizes nothing = Sizes::zero(1, 1);
  expect(of({}, 1).relative(nothing, nothing), Matrix{{0.0}});
  EXPECT_EQ(of({}, 1).relative(sizes(Matrix{{0.0}}, Matrix{{1.0}}), nothing)(0, 0), infinity);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Sizes whole = sizes(Matrix{{1.0}}, Matrix{{1.0}});
  const Yardstick yardstick = of({}, 1, 1.0);
  EXPECT_TRUE(std::isnan(yardstick.relative(sizes(Matrix{{nan}}, Matrix{{0.5}}), whole)(0, 0)));
  EXPECT_TRUE(std::isnan(yardstick.relative(sizes(Matrix{{0.5}}, Matrix{{nan}}), whole)(0, 0)));
  EXPECT_TRUE(std::isnan(yardstick.relative(sizes(Matrix{{0.5}}, Matrix{{0.5}}),
                                            sizes(Matrix{{nan}}, Matrix{{nan}}))(0, 0)));
}

TEST(Yardstick, MetricsAreThoseOfTheFacesOfABody) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  // wall and joint, two joints, one joint; scale and area are 1
  EXPECT_EQ(yardstick(laws.structure(), {}).metric, (Vector(3) << 2.0, 2.0, 1.0).finished());
}

TEST(Sizes, DistanceAndDifferenceAgree) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  const Structure& structure = laws.structure();
  GlobalStage global(laws);
  const Matrix one = Matrix::Random(5, 2);
  const Matrix two = Matrix::Random(5, 2);
  Matrix w1(5, 2);
  Matrix w2(5, 2);
  global.apply(one, Matrix::Ones(1, 2), w1);
  global.apply(two, Matrix::Ones(1, 2), w2);
  const Sizes distance = sizes_of_distance(structure, {}, one, w1, two, w2);
  const Sizes difference = sizes_of_difference(structure, {}, one - two, w1 - w2);
  ASSERT_EQ(distance.strain.rows(), 2);
  ASSERT_EQ(distance.strain.cols(), 3);
  expect(distance.strain, difference.strain);
  expect(distance.trace, difference.trace);
  EXPECT_GT(difference.strain.leftCols(2).minCoeff(),
            0.0);  // the last bar, free at its end, is not strained
  // both columns are one where they are the fluctuations of a chaos
  const Sizes steps = sizes_of_difference(structure, {2, 1}, one - two, w1 - w2);
  expect(steps.trace, difference.trace);
  Matrix modes(5, 3);
  modes << Matrix::Zero(5, 1), one - two;
  Matrix moved(5, 3);
  moved << Matrix::Zero(5, 1), w1 - w2;
  const Sizes chaos = sizes_of_difference(structure, {1, 3}, modes, moved);
  expect(chaos.trace.row(0), Matrix::Zero(1, 3));
  expect(chaos.trace.row(1), difference.trace.colwise().sum());
}

TEST(Sizes, LoadPatternsAreMeasuredAtTheTimes) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  const Structure& structure = laws.structure();
  const Matrix data = Matrix::Random(5, 2);
  Matrix traces(5, 2);  // of the same bodies: others might have negative energies
  GlobalStage(laws).apply(data, Matrix::Zero(1, 2), traces);
  // as many times as sums of two patterns, and more: times themselves, or what follows from the sums
  for (const Index count : {3, 7}) {
    Matrix factors = 1e3 * Matrix::Random(2, count);
    factors.row(1) *= 1e-6;
    factors(1, 0) = 0.0;
    const PatternTimes in_time(factors);
    EXPECT_EQ(in_time.sums().cols(), 3);
    const Sizes patterns = sizes_of_difference(structure, {count, 1}, data, traces, &in_time);
    const Sizes times = sizes_of_difference(structure, {}, data * factors, traces * factors);
    // rounding of an energy is that of the motion, of which it is a product
    const double largest = std::max(times.strain.maxCoeff(), times.trace.maxCoeff());
    for (const auto& [found, wanted] :
         {std::pair{patterns.strain, times.strain}, {patterns.trace, times.trace}}) {
      ASSERT_EQ(found.rows(), count);
      EXPECT_LE((found - wanted).cwiseAbs().maxCoeff(), 1e-12 * largest);
    }
    // of sizes alone no more than a bound is known
    const Sizes bounds = in_time.bounds(sizes_of_difference(structure, {}, data, traces), 1);
    EXPECT_TRUE((bounds.trace.array() >= times.trace.array() * (1.0 - 1e-12)).all());
    EXPECT_NEAR(bounds.trace(0, 0), times.trace(0, 0), 1e-12 * times.trace(0, 0));
  }
}

TEST(Sizes, ADifferenceIsSeenInTheBodyWhereItIs) {
  const Laws laws = chain::Scene{.parts = 3}.build();
  const Structure& structure = laws.structure();
  Matrix data = Matrix::Zero(5, 1);
  data(1) = 1.0;  // the first bar's end at the first joint
  Matrix traces(5, 1);
  GlobalStage(laws).apply(data, Matrix::Zero(1, 1), traces);
  const Sizes sizes = sizes_of_difference(structure, {}, data, traces);
  // springs of 1.3 at both ends of a bar of stiffness 1: K u = s
  const Matrix stiffness{{2.3, -1.0}, {-1.0, 2.3}};
  const Vector u = stiffness.inverse() * Vector{{0.0, 1.0}};
  EXPECT_NEAR(sizes.strain(0, 0), (u(1) - u(0)) * (u(1) - u(0)), 1e-14);
  EXPECT_NEAR(sizes.trace(0, 0), u.squaredNorm(), 1e-14);
  expect(sizes.strain.rightCols(2), Matrix::Zero(1, 2));
  expect(sizes.trace.rightCols(2), Matrix::Zero(1, 2));
}

}  // namespace latin::substructure
