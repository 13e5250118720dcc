#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include "algebra/elimination.hpp"
#include "algebra/factor.hpp"
#include "latin/common/error.hpp"
#include "threads.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::algebra::FactorBackend;

/// Lower triangle of a stiffness-like matrix: n^3 nodes of three coupled components, 27 neighbours each.
latin::SparseRows block_grid(int n) {
  std::vector<Eigen::Triplet<double>> entries;
  const auto node = [n](int x, int y, int z) { return (z * n + y) * n + x; };
  for (int at = 0; at < n * n * n; ++at) {
    const int x = at % n;
    const int y = at / n % n;
    const int z = at / (n * n);
    for (int k = 0; k < 27; ++k) {
      const int dx = k % 3 - 1;
      const int dy = k / 3 % 3 - 1;
      const int dz = k / 9 - 1;
      if (std::min({x + dx, y + dy, z + dz}) < 0 || std::max({x + dx, y + dy, z + dz}) >= n) {
        continue;
      }
      const int other = node(x + dx, y + dy, z + dz);
      for (int entry = 0; entry < 9; ++entry) {
        const int row = 3 * at + entry % 3;
        const int column = 3 * other + entry / 3;
        if (row >= column) {
          entries.emplace_back(row, column, row == column ? 90.0 : -1.0);
        }
      }
    }
  }
  latin::SparseRows matrix(3 * n * n * n, 3 * n * n * n);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

/// Stiffness of a bar of n nodes that nothing holds.
latin::SparseRows floating_bar(Index n, double stiffness) {
  latin::SparseRows lower(n, n);
  for (Index i = 0; i < n; ++i) {
    lower.coeffRef(i, i) = (i == 0 || i + 1 == n ? 1.0 : 2.0) * stiffness;
    if (i + 1 < n) {
      lower.coeffRef(i + 1, i) = -stiffness;
    }
  }
  lower.makeCompressed();
  return lower;
}

std::vector<FactorBackend> backends() {
  if (latin::algebra::available_backends().find("cholmod") == std::string::npos) {
    return {FactorBackend::mumps};
  }
  return {FactorBackend::cholmod, FactorBackend::mumps};
}

}  // namespace

// the larger grid is ordered by nested dissection, the smaller one by minimum degree
TEST(Factor, SolvesAndCondensesInEitherOrder) {
  for (const int n : {4, 17}) {
    const latin::SparseRows matrix = block_grid(n);
    const latin::Index trailing = 3 * n;
    const auto factor = latin::algebra::factorise(matrix, trailing,
                                                  latin::algebra::FactorBackend::automatic, "grid");
    const latin::Index size = matrix.rows();
    latin::Matrix x(size, 2);
    x << latin::Vector::LinSpaced(size, -1.0, 2.0), latin::Vector::Ones(size);
    const latin::Matrix b = matrix.selfadjointView<Eigen::Lower>() * x;
    EXPECT_LT((factor->solve(b) - x).norm(),
              1e-12 * x.norm());  // the condition number is below 100
    if (factor->condenses()) {
      latin::Matrix unit = latin::Matrix::Zero(size, trailing);
      unit.bottomRows(trailing).setIdentity();
      const latin::Matrix inverse = factor->solve(unit).bottomRows(trailing);
      const latin::Matrix half = factor->trailing_factor().triangularView<Eigen::Lower>();
      EXPECT_LT(
          (half * half.transpose() * inverse - latin::Matrix::Identity(trailing, trailing)).norm(),
          1e-12);
    }
  }
}

TEST(Factor, CondensesFacesThatAreNotCoupled) {
  const latin::SparseRows grid = block_grid(8);
  const latin::Index trailing = 150;
  const latin::Index interior = grid.rows() - trailing;
  std::vector<Eigen::Triplet<double>> entries;  // two grids, the last unknowns of both at the end
  for (int which = 0; which < 2; ++which) {
    const auto place = [&](latin::Index i) {
      const latin::Index first = i < interior ? which * interior : interior + which * trailing;
      return static_cast<int>(first + i);
    };
    for (latin::Index row = 0; row < grid.rows(); ++row) {
      for (latin::SparseRows::InnerIterator it(grid, row); it; ++it) {
        entries.emplace_back(place(row), place(it.col()), it.value());
      }
    }
  }
  latin::SparseRows both(2 * grid.rows(), 2 * grid.rows());
  both.setFromTriplets(entries.begin(), entries.end());
  const FactorBackend backend = FactorBackend::automatic;
  const auto one = latin::algebra::factorise(grid, trailing, backend, "grid");
  const auto two = latin::algebra::factorise(both, 2 * trailing, backend, "grids");
  if (!two->condenses()) {
    GTEST_SKIP() << "this backend does not condense";
  }
  latin::Matrix expected = latin::Matrix::Zero(2 * trailing, 2 * trailing);
  expected.topLeftCorner(trailing, trailing) =
      one->trailing_factor().triangularView<Eigen::Lower>();
  expected.bottomRightCorner(trailing, trailing) = expected.topLeftCorner(trailing, trailing);
  const latin::Matrix found = two->trailing_factor().triangularView<Eigen::Lower>();
  // the condition number is below 100
  EXPECT_LT((found - expected).norm(), 1e-13 * expected.norm());
}

TEST(Factor, RefusesAMotionThatNothingHolds) {
  // in some of these the last pivot is rounding above zero
  for (const FactorBackend backend : backends()) {
    for (const double stiffness : {1.0, 3.141592653589793, 0.1, 7.3e5, 1.0 / 3.0}) {
      for (const Index n : {3, 40, 41, 200}) {
        try {
          static_cast<void>(
              latin::algebra::factorise(floating_bar(n, stiffness), 0, backend, "bar"));
          ADD_FAILURE() << "a floating bar of " << n << " nodes was factorised";
        } catch (const latin::NumericalError& error) {
          EXPECT_NE(std::string(error.what()).find("'bar' is not positive definite"),
                    std::string::npos);
        }
      }
    }
  }
}

TEST(Factor, TakesWhatIsHeldSoftly) {
  latin::SparseRows bar = floating_bar(40, 1.0);
  bar.coeffRef(0, 0) += 1e-9;
  Matrix force = Matrix::Zero(40, 1);
  force(39, 0) = 1.0;
  for (const FactorBackend backend : backends()) {
    const auto factor = latin::algebra::factorise(bar, 0, backend, "bar");
    EXPECT_NEAR(factor->solve(force)(39, 0), 1e9, 1e4);
  }
}

TEST(Factor, SeveralThreadsMaySolve) {
  const latin::SparseRows matrix = block_grid(5);
  for (const FactorBackend backend : backends()) {
    const auto factor = latin::algebra::factorise(matrix, 0, backend, "grid");
    const Matrix x = Matrix::Random(matrix.rows(), 3);
    const Matrix b = matrix.selfadjointView<Eigen::Lower>() * x;
    std::vector<double> worst(4, 0.0);
    std::vector<std::thread> threads;
    for (double& own : worst) {
      threads.emplace_back([&] {
        for (int i = 0; i < 20; ++i) {
          own = std::max(own, (factor->solve(b) - x).norm());
        }
      });
    }
    for (std::thread& thread : threads) {
      thread.join();
    }
    EXPECT_LT(*std::max_element(worst.begin(), worst.end()), 1e-12 * x.norm());
  }
}

// two bars that hang on each other by springs that are far softer, or stiffer, than they are: against sums of long double
TEST(Factor, IsAsExactAsItsConditionLets) {
  using Longer = Eigen::Matrix<long double, Eigen::Dynamic, Eigen::Dynamic>;
  constexpr Index n = 30;
  for (const double spring : {1e-6, 1e-3, 1.0, 1e4, 1e8}) {
    for (const double ratio : {1.0, 1e8}) {
      if (spring < 1e-9 * ratio) {
        continue;  // beside that bar the springs are rounding
      }
      Matrix dense = Matrix::Zero(2 * n, 2 * n);
      const Matrix bar = Matrix(floating_bar(n, 1.0));
      const auto add = [&dense](Index i, Index j, double k) {
        dense(i, i) += k;
        dense(j, j) += k;
        dense(std::max(i, j), std::min(i, j)) -= k;
      };
      dense.topLeftCorner(n, n) = bar;
      dense.bottomRightCorner(n, n) = ratio * bar;
      add(0, n, spring);
      add(n - 1, n + 3, 0.3 * spring);
      dense(0, 0) += 1.0;
      const latin::SparseRows lower = dense.sparseView();
      const Longer whole = Matrix(dense.selfadjointView<Eigen::Lower>()).cast<long double>();
      const Matrix b = Matrix::Random(2 * n, 3);
      const Longer exact = Eigen::LLT<Longer>(whole).solve(b.cast<long double>());
      for (const FactorBackend backend : backends()) {
        const auto factor = latin::algebra::factorise(lower, 5, backend, "bars");
        const Matrix x = factor->solve(b);
        const Longer left = whole * x.cast<long double>() - b.cast<long double>();
        const Longer sums = whole.cwiseAbs() * x.cast<long double>().cwiseAbs();
        // of a Cholesky factor with few numbers in a row: each is a sum of rounded products
        EXPECT_LT(static_cast<double>(left.cwiseAbs().cwiseQuotient(sums).maxCoeff()), 1e-15 * n)
            << spring << " " << ratio << " " << factor->backend();
        // errors in energy are those of the forces, times the root of the condition of the scaled matrix
        const Longer wrong = x.cast<long double>() - exact;
        const auto energy = [&whole](const Longer& u) {
          return static_cast<double>((u.transpose() * whole * u).trace());
        };
        const bool known = factor->least_pivot() < 1.0;
        if (known) {
          EXPECT_LT(std::sqrt(energy(wrong) / energy(exact)), 1e-15 * n / factor->least_pivot())
              << spring << " " << ratio << " " << factor->backend();
        }
        if (known && factor->condenses()) {
          const Matrix l = factor->trailing_factor().triangularView<Eigen::Lower>();
          const Longer inverse = Eigen::LLT<Longer>(whole)
                                     .solve(Longer::Identity(2 * n, 2 * n))
                                     .bottomRightCorner(5, 5);
          const Longer unit = (l * l.transpose()).cast<long double>() * inverse;
          EXPECT_TRUE(unit.isIdentity(1e-15L * n / static_cast<long double>(factor->least_pivot())))
              << spring << " " << ratio;
        }
      }
    }
  }
}

// a grid large enough that subtrees are eliminated side by side and the supernodes above them in stripes
TEST(Factor, IsTheSameOnSeveralThreads) {
  const latin::SparseRows matrix = block_grid(17);
  const Index size = matrix.rows();
  const Index trailing = 3 * 17 * 17;
  Matrix x(size, 2);
  x << latin::Vector::LinSpaced(size, -1.0, 2.0), latin::Vector::Ones(size);
  const Matrix b = matrix.selfadjointView<Eigen::Lower>() * x;
  Matrix one;
  for (const int threads : {1, 2, 5}) {
    const Threads some(threads);
    const auto factor =
        latin::algebra::factorise(matrix, trailing, FactorBackend::automatic, "grid");
    if (threads == 1) {
      one = factor->solve(b);
    }
    EXPECT_LT((factor->solve(b) - one).norm(), 1e-14 * one.norm());
  }
  const Threads some(2);
  latin::SparseRows broken = matrix;
  broken.coeffRef(size / 2, size / 2) = -90.0;
  EXPECT_THROW(static_cast<void>(
                   latin::algebra::factorise(broken, trailing, FactorBackend::automatic, "grid")),
               latin::NumericalError);
}

// only the block of the eliminated unknowns has to be definite: a bar that nothing holds is condensed to its ends
TEST(Elimination, CondensesWhatIsLoose) {
  const Index n = 40;
  for (const FactorBackend backend : backends()) {
    // nodes 0 and 1 are the ends, what is between them follows
    latin::SparseRows bar(n, n);
    const auto place = [n](Index i) { return i == 0 ? n - 2 : i + 1 == n ? n - 1 : i - 1; };
    for (Index i = 0; i + 1 < n; ++i) {
      const Index a = place(i);
      const Index b = place(i + 1);
      bar.coeffRef(a, a) += 2.0;
      bar.coeffRef(b, b) += 2.0;
      bar.coeffRef(std::max(a, b), std::min(a, b)) -= 2.0;
    }
    bar.makeCompressed();
    latin::algebra::Elimination bars(bar, 2, backend, "bar");
    const double series = 2.0 / static_cast<double>(n - 1);
    const Matrix schur = bars.take_schur();
    EXPECT_NEAR(schur(0, 0), series, 1e-13);
    EXPECT_NEAR(schur(1, 0), -series, 1e-13);
    EXPECT_NEAR(schur(1, 1), series, 1e-13);
    // a force in the middle goes to both ends; these are held
    Matrix force = Matrix::Zero(n, 1);
    force(place(13), 0) = 1.0;
    Matrix partial;
    const Matrix reduced = bars.reduce(force, partial);
    const double share = 13.0 / static_cast<double>(n - 1);
    EXPECT_NEAR(reduced(0, 0), 1.0 - share, 1e-13);
    EXPECT_NEAR(reduced(1, 0), share, 1e-13);
    const Matrix moved = bars.expand(Matrix::Zero(2, 1), partial);
    EXPECT_NEAR(moved(place(13), 0), 13.0 * (1.0 - share) / 2.0, 1e-12);
    EXPECT_NEAR(bars.expand(Matrix::Ones(2, 1), Matrix::Zero(n, 1))(place(20), 0), 1.0, 1e-12);
    // what is between them, loose
    latin::SparseRows loose = bar;
    loose.coeffRef(0, 0) = -1.0;
    EXPECT_THROW(latin::algebra::Elimination(loose, 2, backend, "bar"), latin::NumericalError);
  }
}

TEST(Factor, TellsTheSmallestPivot) {
  // two unknowns that all but move together, beside one that is alone: 1 - c^2 is left of the last pivot
  const double c = 1.0 - 1e-6;
  std::vector<Eigen::Triplet<double>> entries{{0, 0, 4.0}, {1, 1, 1.0}, {2, 1, c}, {2, 2, 1.0}};
  latin::SparseRows matrix(3, 3);
  matrix.setFromTriplets(entries.begin(), entries.end());
  for (const FactorBackend backend : backends()) {
    const auto factor = latin::algebra::factorise(matrix, 0, backend, "pair");
    const double told = factor->least_pivot();
    EXPECT_TRUE(told == 1.0 || std::abs(told - (1.0 - c * c)) < 1e-12) << factor->backend();
    if (factor->backend().find("cholmod") != std::string::npos) {
      EXPECT_NE(told, 1.0);
    }
  }
}
