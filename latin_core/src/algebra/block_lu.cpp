#include "latin/algebra/block_lu.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "latin/common/error.hpp"

namespace latin::algebra {

BlockLu::Coupling BlockLu::coupling(const Matrix& block) {
  Coupling found;
  for (Index row = 0; row < block.rows(); ++row) {
    if (!block.row(row).isZero(0.0)) {
      found.rows.push_back(row);
    }
  }
  for (Index column = 0; column < block.cols(); ++column) {
    if (!block.col(column).isZero(0.0)) {
      found.columns.push_back(column);
    }
  }
  found.values = block(found.rows, found.columns);
  return found;
}

BlockLu::BlockLu(const SparseColumns& matrix, const std::vector<Index>& first) {
  const std::size_t count = first.size() - 1;
  std::vector<std::size_t> block_of(static_cast<std::size_t>(matrix.rows()));
  for (std::size_t b = 0; b < count; ++b) {
    std::fill(block_of.begin() + first[b], block_of.begin() + first[b + 1], b);
  }
  const auto size = [&](std::size_t b) { return first[b + 1] - first[b]; };
  std::map<std::pair<std::size_t, std::size_t>, Matrix> left;
  std::vector<std::set<std::size_t>> neighbours(count);
  const auto block = [&](std::size_t i, std::size_t j) -> Matrix& {
    Matrix& found = left[{i, j}];
    if (found.size() == 0) {
      found = Matrix::Zero(size(i), size(j));
    }
    if (i != j) {
      neighbours[i].insert(j);
      neighbours[j].insert(i);
    }
    return found;
  };
  for (Index column = 0; column < matrix.outerSize(); ++column) {
    const std::size_t j = block_of[static_cast<std::size_t>(column)];
    for (SparseColumns::InnerIterator it(matrix, column); it; ++it) {
      const std::size_t i = block_of[static_cast<std::size_t>(it.row())];
      block(i, j)(it.row() - first[i], column - first[j]) += it.value();
    }
  }
  std::set<std::size_t> rest;
  for (std::size_t b = 0; b < count; ++b) {
    if (size(b) > 0) {
      rest.insert(b);
    }
  }
  while (!rest.empty()) {
    const std::size_t b = *std::ranges::min_element(
        rest, {}, [&](std::size_t each) { return neighbours[each].size(); });
    rest.erase(b);
    Eliminated own{first[b], Eigen::PartialPivLU<Matrix>(block(b, b)), {}, {}};
    if (!own.lu.matrixLU().allFinite() ||
        own.lu.matrixLU().diagonal().cwiseAbs().minCoeff() == 0.0) {
      throw NumericalError("a block of a matrix is singular");
    }
    const std::set<std::size_t> around = neighbours[b];
    for (const std::size_t i : around) {
      own.down.emplace_back(first[i], coupling(block(i, b)));
      own.across.emplace_back(first[i], coupling(block(b, i)));
    }
    std::size_t at = 0;
    for (const std::size_t j : around) {
      const Coupling& across = own.across[at++].second;
      Matrix right = Matrix::Zero(size(b), across.values.cols());
      right(across.rows, every) = across.values;
      const Matrix solved = own.lu.solve(right);
      std::size_t from = 0;
      for (const std::size_t i : around) {
        const Coupling& down = own.down[from++].second;
        block(i, j)(down.rows, across.columns) -= down.values * solved(down.columns, every);
      }
    }
    for (const std::size_t i : around) {
      neighbours[i].erase(b);
      left.erase({i, b});
      left.erase({b, i});
    }
    left.erase({b, b});
    blocks_.push_back(std::move(own));
  }
}

Matrix BlockLu::solve(const Matrix& load) const {
  Matrix answer = load;
  const auto rows_of = [](const Eliminated& block) {
    return Eigen::seqN(block.first, block.lu.rows());
  };
  const auto from = [](Index first, const std::vector<Index>& each) {
    std::vector<Index> rows = each;
    for (Index& row : rows) {
      row += first;
    }
    return rows;
  };
  for (const Eliminated& block : blocks_) {
    const Matrix solved = block.lu.solve(answer(rows_of(block), every));
    for (const auto& [first, down] : block.down) {
      answer(from(first, down.rows), every) -= down.values * solved(down.columns, every);
    }
  }
  for (auto it = blocks_.rbegin(); it != blocks_.rend(); ++it) {
    Matrix right = answer(rows_of(*it), every);
    for (const auto& [first, across] : it->across) {
      right(across.rows, every) -= across.values * answer(from(first, across.columns), every);
    }
    answer(rows_of(*it), every) = it->lu.solve(right);
  }
  return answer;
}

}  // namespace latin::algebra
