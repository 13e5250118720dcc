#include "substructure/macro.hpp"

#include <algorithm>
#include <iterator>
#include <map>
#include <utility>

namespace latin::substructure {

/// First moment of each interface, in the order of the ranks that have their first sides.
std::vector<Index> Macro::number(const std::vector<MacroInterface>& interfaces,
                                 const Communicator& communicator) {
  std::vector<std::string> names;
  std::vector<double> sizes;
  for (const MacroInterface& interface : interfaces) {
    if (interface.rows.front() >= 0) {
      names.push_back(interface.name);
      sizes.push_back(static_cast<double>(interface.basis.cols()));
    }
  }
  const auto all_names = communicator.gather(names);
  const auto all_sizes = communicator.gather(sizes);
  std::map<std::string, Index> first;
  for (std::size_t rank = 0; rank < all_names.size(); ++rank) {
    for (std::size_t i = 0; i < all_names[rank].size(); ++i) {
      first.emplace(all_names[rank][i], size_);
      size_ += static_cast<Index>(all_sizes[rank][i]);
    }
  }
  std::vector<Index> of_interface;
  std::ranges::transform(interfaces, std::back_inserter(of_interface),
                         [&](const MacroInterface& each) { return first.at(each.name); });
  return of_interface;
}

Macro::Macro(const std::vector<Body>& bodies, const std::vector<Index>& first_rows,
             const std::vector<MacroInterface>& interfaces, const Communicator& communicator) {
  struct Block {
    Index row;  ///< first row in the body
    const Matrix* basis;
    Index first;  ///< first coarse unknown
  };
  const std::vector<Index> first_moment = number(interfaces, communicator);
  std::vector<std::vector<Block>> blocks(bodies.size());
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    for (const Index row : interfaces[i].rows) {
      if (row < 0) {
        continue;
      }
      const auto after = std::upper_bound(first_rows.begin(), first_rows.end(), row);
      // a body without rows begins where the next one does
      const auto b = static_cast<std::size_t>(after - first_rows.begin()) - 1;
      blocks[b].push_back({row - first_rows[b], &interfaces[i].basis, first_moment[i]});
    }
  }

  BodyWork work;
  std::vector<double> entries;  ///< row, column, value of the lower triangle
  const auto add_body = [&](std::size_t b) {
    if (blocks[b].empty()) {
      return;
    }
    const Body& body = bodies[b];
    Part part{first_rows[b], {}, {}, {}, {}};
    for (const Block& block : blocks[b]) {
      for (Index m = 0; m < block.basis->cols(); ++m) {
        part.moments.push_back(block.first + m);
      }
    }
    const auto moments = static_cast<Index>(part.moments.size());
    Matrix z = Matrix::Zero(body.rows(), moments);
    Index column = 0;
    for (const Block& block : blocks[b]) {
      z.block(block.row, column, block.basis->rows(), block.basis->cols()) = *block.basis;
      column += block.basis->cols();
    }
    part.basis = body.weights().asDiagonal() * z;
    part.data = body.directions().asDiagonal() * z;
    part.traces.resize(body.rows(), moments);
    body.apply(part.data, part.traces, work);
    // Z^T W (k - k A k) Z: the body, and the springs k in series with it
    const Matrix stiffness =
        part.data.transpose() * (body.weights().asDiagonal() * Matrix(z - part.traces));
    for (Index i = 0; i < moments; ++i) {
      for (Index j = 0; j < moments; ++j) {
        const Index row = part.moments[static_cast<std::size_t>(i)];
        const Index col = part.moments[static_cast<std::size_t>(j)];
        if (row >= col) {
          entries.insert(entries.end(), {static_cast<double>(row), static_cast<double>(col),
                                         0.5 * (stiffness(i, j) + stiffness(j, i))});
        }
      }
    }
    parts_.push_back(std::move(part));
  };
  communicator.together([&] {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      add_body(b);
    }
  });
  const auto of_ranks = communicator.gather(entries);
  communicator.together([&] { factorise(of_ranks); });
}

void Macro::factorise(const std::vector<std::vector<double>>& entries) {
  std::vector<Eigen::Triplet<double>> all;
  for (const std::vector<double>& of_rank : entries) {
    for (std::size_t i = 0; i + 2 < of_rank.size(); i += 3) {
      all.emplace_back(static_cast<int>(of_rank[i]), static_cast<int>(of_rank[i + 1]),
                       of_rank[i + 2]);
    }
  }
  SparseRows lower(size_, size_);
  lower.setFromTriplets(all.begin(), all.end());
  factor_ = algebra::factorise(lower, 0, algebra::FactorBackend::automatic, "coarse problem");
}

Matrix Macro::imbalance(ConstMatrixRef forces) const {
  Matrix imbalance = Matrix::Zero(size_, forces.cols());
  for (const Part& part : parts_) {
    imbalance(part.moments, every) -=
        part.basis.transpose() * forces.middleRows(part.first_row, part.basis.rows());
  }
  return imbalance;
}

Matrix Macro::correct(const Matrix& imbalance, MatrixRef data, MatrixRef traces) const {
  const Matrix amplitudes = factor_->solve(imbalance);
  Matrix added = Matrix::Zero(data.rows(), data.cols());
  for (const Part& part : parts_) {
    const Matrix own = amplitudes(part.moments, every);
    const Index rows = part.basis.rows();
    added.middleRows(part.first_row, rows).noalias() = part.data * own;
    traces.middleRows(part.first_row, rows).noalias() += part.traces * own;
  }
  data += added;
  return added;
}

}  // namespace latin::substructure
