#include "mortar/blocks.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::mortar {

namespace {

/// Relative to the largest entry: rounding of an integral that is zero.
constexpr double nothing = 1e-15;

void check(std::span<const Index> numbers, Index below, const std::string& what) {
  for (const Index k : numbers) {
    if (k < 0 || k >= below) {
      throw InputError("blocks: " + what + " " + std::to_string(k) + " of " +
                       std::to_string(below));
    }
  }
}

}  // namespace

CompressedRows sum_of(const Blocks& blocks, Index rows, Index columns) {
  const Index size = blocks.height * blocks.width;
  const Index count = size > 0 ? static_cast<Index>(blocks.values.size()) / size : 0;
  if (static_cast<Index>(blocks.values.size()) != count * size ||
      static_cast<Index>(blocks.rows.size()) != count * blocks.height ||
      static_cast<Index>(blocks.columns.size()) != count * blocks.width) {
    throw InputError("blocks: " + std::to_string(blocks.values.size()) + " values, " +
                     std::to_string(blocks.rows.size()) + " rows and " +
                     std::to_string(blocks.columns.size()) + " columns do not fit");
  }
  check(blocks.rows, rows, "row");
  check(blocks.columns, columns, "column");

  // the lines of blocks that belong to each row
  std::vector<Index> first(static_cast<std::size_t>(rows + 1), 0);
  for (const Index row : blocks.rows) {
    ++first[row + 1];
  }
  for (Index row = 0; row < rows; ++row) {
    first[row + 1] += first[row];
  }
  std::vector<Index> lines(blocks.rows.size());
  std::vector<Index> next(first.begin(), first.end() - 1);
  for (std::size_t line = 0; line < blocks.rows.size(); ++line) {
    lines[next[blocks.rows[line]]++] = static_cast<Index>(line);
  }

  CompressedRows all;
  all.starts.assign(1, 0);
  std::vector<double> sum(static_cast<std::size_t>(columns), 0.0);
  std::vector<char> seen(static_cast<std::size_t>(columns), 0);
  std::vector<Index> touched;
  double largest = 0.0;
  for (Index row = 0; row < rows; ++row) {
    touched.clear();
    for (Index k = first[row]; k < first[row + 1]; ++k) {
      const Index line = lines[k];
      const double* values = blocks.values.data() + line * blocks.width;
      const Index* where = blocks.columns.data() + line / blocks.height * blocks.width;
      for (Index j = 0; j < blocks.width; ++j) {
        const Index column = where[j];
        if (seen[column] == 0) {
          seen[column] = 1;
          touched.push_back(column);
        }
        sum[column] += values[j];
      }
    }
    std::ranges::sort(touched);
    for (const Index column : touched) {
      all.columns.push_back(column);
      all.values.push_back(sum[column]);
      largest = std::max(largest, std::abs(sum[column]));
      sum[column] = 0.0;
      seen[column] = 0;
    }
    all.starts.push_back(static_cast<Index>(all.columns.size()));
  }

  std::size_t kept = 0;
  std::size_t k = 0;
  for (Index row = 0; row < rows; ++row) {
    for (; k < static_cast<std::size_t>(all.starts[row + 1]); ++k) {
      if (std::abs(all.values[k]) >= nothing * largest && all.values[k] != 0.0) {
        all.values[kept] = all.values[k];
        all.columns[kept++] = all.columns[k];
      }
    }
    all.starts[row + 1] = static_cast<Index>(kept);
  }
  all.values.resize(kept);
  all.columns.resize(kept);
  return all;
}

}  // namespace latin::mortar
