#include "algebra/sparse_product.hpp"

#include <array>
#include <cstddef>
#include <vector>

#include "common/numbers.hpp"

// the compiler makes several versions, and the machine takes its own
#if defined(__x86_64__) && defined(__GNUC__) && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__)
#define LATIN_VERSIONS __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define LATIN_VERSIONS
#endif

namespace latin::algebra {
namespace {

constexpr std::size_t width = 8;

/// @param x the numbers of eight columns side by side
LATIN_VERSIONS void multiply_eight(const int* first, const int* columns, const double* values,
                                   std::ptrdiff_t rows, const double* x, double* out) {
  for (std::ptrdiff_t row = 0; row < rows; ++row) {
    std::array<double, width> sums{};
    for (std::ptrdiff_t k = first[row]; k < first[row + 1]; ++k) {
      const double value = values[k];
      const double* entry = x + static_cast<std::ptrdiff_t>(width) * columns[k];
      for (std::size_t i = 0; i < width; ++i) {
        sums[i] += value * entry[i];
      }
    }
    for (std::size_t i = 0; i < width; ++i) {
      out[static_cast<std::ptrdiff_t>(width) * row + static_cast<std::ptrdiff_t>(i)] = sums[i];
    }
  }
}

/// Rows of out = a x for `count` columns at once: sums that do not wait for each other.
template <int count>
void multiply_columns(const SparseRows& a, const ConstMatrixRef& x, MatrixRef& out, Index column) {
  const double* from = x.data() + column * x.outerStride();
  for (int row = 0; row < a.outerSize(); ++row) {
    std::array<double, count> sums{};
    for (SparseRows::InnerIterator it(a, row); it; ++it) {
      const double* entry = from + it.col();
      for (std::size_t i = 0; i < count; ++i) {
        sums[i] += it.value() * entry[static_cast<Index>(i) * x.outerStride()];
      }
    }
    for (std::size_t i = 0; i < count; ++i) {
      out(row, column + static_cast<Index>(i)) = sums[i];
    }
  }
}

}  // namespace

void multiply_sparse(const SparseRows& a, const ConstMatrixRef& x, MatrixRef out) {
  using Eight = Eigen::Matrix<double, Eigen::Dynamic, width, Eigen::RowMajor>;
  Index column = 0;
  if (x.cols() >= static_cast<Index>(width) && a.isCompressed()) {
    Eight packed(x.rows(), width);
    Eight sums(a.rows(), width);
    for (; column + static_cast<Index>(width) <= x.cols(); column += static_cast<Index>(width)) {
      packed = x.middleCols<width>(column);
      multiply_eight(a.outerIndexPtr(), a.innerIndexPtr(), a.valuePtr(), a.rows(), packed.data(),
                     sums.data());
      out.middleCols<width>(column) = sums;
    }
  }
  for (; column + 2 <= x.cols(); column += 2) {
    multiply_columns<2>(a, x, out, column);
  }
  for (; column < x.cols(); ++column) {
    multiply_columns<1>(a, x, out, column);
  }
}

SparseRows sparse_of(const Triplets& entries, Index rows, Index columns, const std::string& what) {
  count_of_entries(static_cast<Index>(entries.size()), what);
  SparseRows matrix(rows, columns);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

void append(const SparseRows& matrix, std::vector<double>& numbers) {
  numbers.insert(numbers.end(),
                 {static_cast<double>(matrix.rows()), static_cast<double>(matrix.cols()),
                  static_cast<double>(matrix.nonZeros())});
  const auto add = [&](const auto* first, Index count) {
    numbers.insert(numbers.end(), first, first + count);
  };
  add(matrix.outerIndexPtr(), matrix.rows() + 1);
  add(matrix.innerIndexPtr(), matrix.nonZeros());
  add(matrix.valuePtr(), matrix.nonZeros());
}

SparseRows take(const double*& next) {
  const auto count = [&] { return static_cast<Index>(*next++); };
  const Index rows = count();
  const Index columns = count();
  const Index entries = count();
  const auto indices = [&](Index many) {
    std::vector<int> found(static_cast<std::size_t>(many));
    std::transform(next, next + many, found.begin(), [](double n) { return static_cast<int>(n); });
    next += many;
    return found;
  };
  const std::vector<int> outer = indices(rows + 1);
  const std::vector<int> inner = indices(entries);
  SparseRows matrix =
      Eigen::Map<const SparseRows>(rows, columns, entries, outer.data(), inner.data(), next);
  next += entries;
  return matrix;
}

}  // namespace latin::algebra
