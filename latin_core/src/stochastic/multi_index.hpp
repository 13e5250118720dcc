#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::stochastic {

/// (rows, L) table of degrees, one multi-index per row.
using IndexTable = Eigen::Matrix<int, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Which multi-indices i = (i_1, ..., i_L) belong to a set of order p, with weights w_l > 0:
///   total        sum_l w_l i_l <= p
///   tensor       max_l w_l i_l <= p
///   hyperbolic   (sum_l (w_l i_l)^q)^(1/q) <= p,  0 < q <= 1
enum class IndexShape { total, tensor, hyperbolic };

/// Shape by name. @throws InputError with the known names
[[nodiscard]] IndexShape index_shape(const std::string& name);

/// What a set is made of.
struct IndexRequest {
  IndexShape shape;
  Index dimension;              ///< L >= 0
  Index order;                  ///< p >= 0
  double q;                     ///< of the hyperbolic shape
  std::vector<double> weights;  ///< (L), or empty: all 1. A larger weight means lower degrees
  Index interaction;            ///< greatest number of variables in one index; 0: no limit
  std::vector<Index> caps;      ///< (L) greatest degree of each variable, or empty: no limit
  double bytes_per_index;       ///< memory that the caller needs per index, besides its own storage
  double memory_limit;          ///< bytes; 0: no limit
};

/// Finite set of multi-indices in graded order: by total degree, then lexicographically with the
/// first variable leading, e.g. (0,0) (1,0) (0,1) (2,0) (1,1) (0,2). Index 0 is the mean.
class MultiIndexSet {
 public:
  /// @throws InputError on an inadmissible request, or if the set would need more than
  /// memory_limit;
  ///         the size is found before anything is allocated
  explicit MultiIndexSet(const IndexRequest& request);

  /// A set given by its rows, in any order. @throws InputError on a negative degree, a repeated
  /// row, or if the zero row is missing
  explicit MultiIndexSet(IndexTable rows);

  [[nodiscard]] Index size() const { return table_.rows(); }
  [[nodiscard]] Index dimension() const { return table_.cols(); }
  [[nodiscard]] const IndexTable& table() const { return table_; }
  [[nodiscard]] std::span<const int> operator[](Index row) const {
    return {table_.data() + row * table_.cols(), static_cast<std::size_t>(table_.cols())};
  }
  /// Greatest degree of a variable.
  [[nodiscard]] int degree(Index variable) const { return table_.col(variable).maxCoeff(); }
  /// Row of an index, if it is in the set.
  [[nodiscard]] std::optional<Index> find(std::span<const int> index) const;

  /// Number of indices of a request without making them: exact, unless it passes `stop`, where the
  /// count of weighted, capped or hyperbolic sets ends.
  [[nodiscard]] static double count(const IndexRequest& request, double stop);

 private:
  IndexTable table_;
};

}  // namespace latin::stochastic
