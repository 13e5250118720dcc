#pragma once

#include <span>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::mortar {

/// Dense blocks (count, height, width), row-major, and the rows and columns of a matrix to which they belong.
struct Blocks {
  Index height;
  Index width;
  std::span<const double> values;
  std::span<const Index> rows;     ///< (count, height)
  std::span<const Index> columns;  ///< (count, width)
};

/// Compressed rows, columns ascending.
struct CompressedRows {
  std::vector<Index> starts;
  std::vector<Index> columns;
  std::vector<double> values;
};

/// The sum of blocks. Entries below 1e-15 of the largest one are integrals that are zero, and left out.
/// @throws InputError if sizes or numbers do not fit
[[nodiscard]] CompressedRows sum_of(const Blocks& blocks, Index rows, Index columns);

}  // namespace latin::mortar
