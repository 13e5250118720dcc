#include <gtest/gtest.h>

#ifdef LATIN_HAVE_CHOLMOD

#include <cholmod.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

#include "algebra/supernodes.hpp"
#include "latin/common/types.hpp"
#include "threads.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::Vector;

/// Lower triangle of a matrix with a diagonal of 1 and rows whose other entries have a sum below 1/2, on a grid of
/// n x n nodes and some random pairs: its condition is below 3.
latin::SparseColumns dominant(int n, std::mt19937_64& random) {
  const int size = n * n;
  latin::SparseRows entries(size, size);
  std::uniform_real_distribution<double> value(-0.06, 0.06);
  const auto add = [&](int i, int j) {
    if (i != j) {
      entries.coeffRef(std::max(i, j), std::min(i, j)) = value(random);
    }
  };
  for (int at = 0; at < size; ++at) {
    entries.coeffRef(at, at) = 1.0;
    for (const int other : {at + 1, at + n, at + n + 1}) {
      if (other < size) {
        add(at, other);
      }
    }
  }
  std::uniform_int_distribution<int> any(0, size - 1);
  for (int pair = 0; pair < n; ++pair) {
    add(any(random), any(random));
  }
  return entries;
}

/// The analysis of a matrix by CHOLMOD, the matrix in the order that it chose, and factors by either.
class Analysis {
 public:
  explicit Analysis(const latin::SparseColumns& lower) : matrix_(lower) {
    cholmod_start(&common_);
    common_.print = 0;
    common_.error_handler = nullptr;
    common_.supernodal = CHOLMOD_SUPERNODAL;
    common_.final_ll = 1;
    cholmod_sparse seen = view();
    cholmod_factor* first = cholmod_analyze(&seen, &common_);
    Eigen::PermutationMatrix<Eigen::Dynamic> order(lower.rows());
    std::copy_n(static_cast<const int*>(first->Perm), lower.rows(), order.indices().data());
    cholmod_free_factor(&first, &common_);
    order_ = order.indices();
    latin::SparseColumns moved(lower.rows(), lower.cols());
    moved.selfadjointView<Eigen::Lower>() =
        lower.selfadjointView<Eigen::Lower>().twistedBy(order.transpose());
    matrix_ = latin::SparseRows(moved);  // sorts the rows of every column
    common_.nmethods = 1;
    common_.method[0].ordering = CHOLMOD_NATURAL;
    common_.postorder = 0;
  }
  ~Analysis() { cholmod_finish(&common_); }
  Analysis(const Analysis&) = delete;
  Analysis& operator=(const Analysis&) = delete;
  Analysis(Analysis&&) = delete;
  Analysis& operator=(Analysis&&) = delete;

  struct Found {
    Matrix factor;             ///< L, dense; empty if there is none
    std::int64_t failed = -1;  ///< column of the pivot that was not positive
  };

  Found by_cholmod() {
    cholmod_sparse seen = view();
    cholmod_factor* factor = cholmod_analyze(&seen, &common_);
    cholmod_factorize(&seen, factor, &common_);
    Found found;
    if (common_.status == CHOLMOD_NOT_POSDEF) {
      found.failed = static_cast<std::int64_t>(factor->minor);
    } else {
      found.factor = dense(*factor);
    }
    cholmod_free_factor(&factor, &common_);
    return found;
  }

  Found by_kernel() {
    cholmod_sparse seen = view();
    cholmod_factor* factor = cholmod_analyze(&seen, &common_);
    cholmod_change_factor(CHOLMOD_REAL, 1, 1, 1, 1, factor, &common_);
    Found found;
    try {
      latin::algebra::factorise_supernodes(
          {factor->n, factor->nsuper, static_cast<const int*>(factor->super),
           static_cast<const int*>(factor->pi), static_cast<const int*>(factor->px),
           static_cast<const int*>(factor->s), static_cast<double*>(factor->x)},
          {matrix_.outerIndexPtr(), matrix_.innerIndexPtr(), matrix_.valuePtr()}, factor->n);
      found.factor = dense(*factor);
    } catch (const latin::algebra::NotPositive& pivot) {
      found.failed = static_cast<std::int64_t>(pivot.column);
    }
    cholmod_free_factor(&factor, &common_);
    return found;
  }

  [[nodiscard]] const latin::SparseColumns& matrix() const { return matrix_; }
  /// The unknown at every place.
  [[nodiscard]] const Eigen::VectorXi& order() const { return order_; }

 private:
  cholmod_sparse view() {
    cholmod_sparse seen{};
    seen.nrow = seen.ncol = static_cast<std::size_t>(matrix_.rows());
    seen.nzmax = static_cast<std::size_t>(matrix_.nonZeros());
    seen.p = matrix_.outerIndexPtr();
    seen.i = matrix_.innerIndexPtr();
    seen.x = matrix_.valuePtr();
    seen.stype = -1;
    seen.itype = CHOLMOD_INT;
    seen.xtype = CHOLMOD_REAL;
    seen.dtype = CHOLMOD_DOUBLE;
    seen.packed = 1;
    seen.sorted = 1;
    return seen;
  }

  static Matrix dense(const cholmod_factor& factor) {
    const auto* const first_column = static_cast<const int*>(factor.super);
    const auto* const first_row = static_cast<const int*>(factor.pi);
    const auto* const first_value = static_cast<const int*>(factor.px);
    const auto* const rows = static_cast<const int*>(factor.s);
    const auto* const values = static_cast<const double*>(factor.x);
    Matrix lower = Matrix::Zero(static_cast<Index>(factor.n), static_cast<Index>(factor.n));
    for (std::size_t s = 0; s < factor.nsuper; ++s) {
      const int high = first_row[s + 1] - first_row[s];
      for (int column = 0; column < first_column[s + 1] - first_column[s]; ++column) {
        for (int i = column; i < high; ++i) {
          lower(rows[first_row[s] + i], first_column[s] + column) =
              values[first_value[s] + column * high + i];
        }
      }
    }
    return lower;
  }

  cholmod_common common_{};
  latin::SparseColumns matrix_;
  Eigen::VectorXi order_;
};

/// Largest difference of two factors, row by row relative to the root of the diagonal.
double apart(const Matrix& one, const Matrix& other, const latin::SparseColumns& matrix) {
  const Vector roots = Vector(matrix.diagonal()).cwiseSqrt();
  return (roots.cwiseInverse().asDiagonal() * (one - other)).cwiseAbs().maxCoeff();
}

}  // namespace

// a scaling does not change what a Cholesky factor loses: rows of a graded one are as exact as those of the plain one
TEST(Supernodes, AreThoseOfCholmod) {
  std::mt19937_64 random(3);
  for (const int n : {1, 2, 7, 24}) {
    for (const double decades : {0.0, 3.0, 12.0}) {
      const latin::SparseColumns plain = dominant(n, random);
      std::uniform_real_distribution<double> power(-0.5 * decades, 0.5 * decades);
      Vector scale(plain.rows());
      std::ranges::generate(scale, [&] { return std::pow(10.0, power(random)); });
      Analysis analysis(latin::SparseColumns(scale.asDiagonal() * plain * scale.asDiagonal()));
      const Analysis::Found library = analysis.by_cholmod();
      ASSERT_EQ(library.failed, -1);
      for (const int threads : {1, 3}) {
        const Threads some(threads);
        const Analysis::Found own = analysis.by_kernel();
        ASSERT_EQ(own.failed, -1);
        // sums of at most as many products as a row has numbers, magnified by the condition
        const double rounding =
            3.0 * std::numeric_limits<double>::epsilon() * static_cast<double>(plain.rows());
        EXPECT_LT(apart(own.factor, library.factor, analysis.matrix()), rounding)
            << n << " " << decades << " " << threads;
        const Matrix product = own.factor * own.factor.transpose();
        const Matrix lower(analysis.matrix());
        const Matrix whole = lower.selfadjointView<Eigen::Lower>();
        const Vector roots = whole.diagonal().cwiseSqrt().cwiseInverse();
        EXPECT_LT(
            (roots.asDiagonal() * (product - whole) * roots.asDiagonal()).cwiseAbs().maxCoeff(),
            rounding);
      }
    }
  }
}

TEST(Supernodes, FindThePivotThatCholmodFinds) {
  std::mt19937_64 random(4);
  for (const int n : {3, 24}) {
    for (int broken = 0; broken < n * n; broken += 1 + n * n / 7) {
      latin::SparseColumns matrix = dominant(n, random);
      matrix.coeffRef(broken, broken) = -0.5;
      Analysis analysis(matrix);
      const Analysis::Found library = analysis.by_cholmod();
      ASSERT_GE(library.failed, 0);
      EXPECT_EQ(analysis.order()(library.failed), broken);
      const Analysis::Found own = analysis.by_kernel();
      EXPECT_EQ(own.failed, library.failed);
    }
  }
}

#endif
