#include <gtest/gtest.h>

#include <Eigen/Sparse>
#include <algorithm>
#include <cstddef>
#include <string>
#include <vector>

#include "algebra/factor.hpp"
#include "chain.hpp"
#include "latin/common/error.hpp"

// The iteration must not allocate blocks: malloc is replaced to count the large requests. glibc only, and not where
// the address sanitizer has replaced it already.
#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__)
#include <malloc.h>

namespace {

constexpr latin::Index columns = 500;
/// More than a row of a block; what depends on the depth of the history alone is smaller.
constexpr std::size_t large = 3 * columns * sizeof(double) / 2;
int large_requests = 0;
int until_failure = 0;  ///< the request that is refused, counted from 1; 0: none is

}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);  // NOLINT(bugprone-reserved-identifier): glibc's own name
void* malloc(std::size_t size) {
  large_requests += size >= large ? 1 : 0;
  if (until_failure > 0 && --until_failure == 0) {
    return nullptr;
  }
  return __libc_malloc(size);
}
}

namespace {

/// Large requests in iterations 15 to 25, when all blocks are there.
int requests(const latin::substructure::Laws& laws, latin::Index acceleration,
             bool single = false) {
  latin::iteration::Options options = chain::options(acceleration, 1e-15);
  options.max_iterations = 25;
  options.newton = 0;
  options.single_precision = single;
  options.stop_on_indicator = true;  // the iteration alone, without checks and searches
  latin::Matrix amplitudes(1, columns);
  for (latin::Index column = 0; column < columns; ++column) {
    amplitudes(0, column) = 1.0 + 0.01 * static_cast<double>(column);
  }
  int before = 0;
  const auto count = [&before](const latin::iteration::Iteration& iteration) {
    if (iteration.number == 15) {
      before = large_requests;
    }
  };
  latin::iteration::State state;
  // modes of one solution: tables of errors have a row of mean and of fluctuation, not one per column
  const auto summary =
      latin::iteration::solve(laws.with_modes(columns), options, amplitudes, state, {}, count);
  EXPECT_EQ(summary.iterations, 25);
  return large_requests - before;
}

}  // namespace

/// Whatever request for memory is refused: the factor says so, and leaves nothing behind.
TEST(Factor, GivesBackWhatItHasWhereMemoryRunsOut) {
  constexpr int size = 600;
  std::vector<Eigen::Triplet<double>> entries;
  for (int row = 0; row < size; ++row) {
    for (int column = std::max(0, row - 60); column <= row; ++column) {
      entries.emplace_back(row, column, row == column ? 130.0 : 1.0);
    }
  }
  latin::SparseRows lower(size, size);
  lower.setFromTriplets(entries.begin(), entries.end());
  const auto factorise = [&lower] {
    return latin::algebra::factorise(lower, 40, latin::algebra::FactorBackend::automatic, "bar");
  };
  static_cast<void>(factorise());  // what the libraries keep for themselves is there
  const auto in_use = [] {
    const struct mallinfo2 facts = mallinfo2();
    return facts.uordblks + facts.hblkhd;
  };
  const std::size_t before = in_use();
  int refused = 0;
  for (int request = 1; request < 2000; ++request) {
    until_failure = request;
    try {
      static_cast<void>(factorise());
    } catch (const latin::NumericalError& error) {
      ++refused;
      until_failure = 0;
      ASSERT_NE(std::string(error.what()).find("not enough memory to factorise 'bar'"),
                std::string::npos)
          << error.what();
    }
    if (until_failure > 0) {
      break;  // there were no more requests
    }
  }
  until_failure = 0;
  EXPECT_GT(refused, 20);
  EXPECT_LT(in_use(), before + 20'000);  // a factor has 300 kB
}

class Allocation : public testing::TestWithParam<latin::Index> {};

TEST_P(Allocation, NoneInTheIteration) {
  chain::Scene scene;
  scene.parts = 40;
  EXPECT_EQ(requests(scene.build(), GetParam()), 0);
}

TEST_P(Allocation, NoneInSinglePrecision) {
  chain::Scene scene;
  scene.parts = 40;
  EXPECT_EQ(requests(scene.build(), GetParam(), true), 0);
}

TEST_P(Allocation, NoneWithColumnTransforms) {
  chain::Scene scene;
  scene.parts = 40;
  const latin::Matrix identity = latin::Matrix::Identity(columns, columns);
  const latin::stochastic::ColumnTransform transform{identity, identity, {}, {}, {}};
  EXPECT_EQ(requests(scene.build().with_columns("joint1", {{0, 1, {transform}, {}}}), GetParam()),
            0);
}

INSTANTIATE_TEST_SUITE_P(Depths, Allocation, testing::Values(0, 10));

#endif
