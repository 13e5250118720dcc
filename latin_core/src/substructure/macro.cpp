#include "latin/substructure/macro.hpp"

#include <algorithm>

namespace latin::substructure {

Macro::Macro(const std::vector<Body>& bodies, const std::vector<Index>& first_rows,
             const std::vector<MacroInterface>& interfaces) {
  struct Block {
    Index row;  ///< first row in the body
    const Matrix* basis;
    Index first;  ///< first coarse unknown
  };
  std::vector<std::vector<Block>> blocks(bodies.size());
  for (const MacroInterface& interface : interfaces) {
    for (const Index row : interface.rows) {
      const auto after = std::upper_bound(first_rows.begin(), first_rows.end(), row);
      // a body without rows begins where the next one does
      const auto b = static_cast<std::size_t>(after - first_rows.begin()) - 1;
      blocks[b].push_back({row - first_rows[b], &interface.basis, size_});
    }
    size_ += interface.basis.cols();
  }

  BodyWork work;
  std::vector<Eigen::Triplet<double>> entries;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (blocks[b].empty()) {
      continue;
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
          entries.emplace_back(static_cast<int>(row), static_cast<int>(col),
                               0.5 * (stiffness(i, j) + stiffness(j, i)));
        }
      }
    }
    parts_.push_back(std::move(part));
  }
  SparseRows lower(size_, size_);
  lower.setFromTriplets(entries.begin(), entries.end());
  factor_ = algebra::factorise(lower, 0, algebra::FactorBackend::automatic, "coarse problem");
}

Matrix Macro::correct(ConstMatrixRef forces, MatrixRef data, MatrixRef traces) const {
  Matrix imbalance = Matrix::Zero(size_, forces.cols());
  for (const Part& part : parts_) {
    imbalance(part.moments, every) -=
        part.basis.transpose() * forces.middleRows(part.first_row, part.basis.rows());
  }
  const Matrix amplitudes = factor_->solve(imbalance);
  Matrix added = Matrix::Zero(forces.rows(), forces.cols());
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
