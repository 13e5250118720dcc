#include "equilibration/equilibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

namespace latin::equilibration {
namespace {

/// Eigenvalues below this share of the largest belong to what is not determined.
constexpr double undetermined = 1e-10;

/// The least solution of a symmetric system that may be singular.
Matrix least(const Matrix& matrix, const Matrix& right) {
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(matrix);
  const double smallest =
      undetermined * std::max(solver.eigenvalues().cwiseAbs().maxCoeff(), 1e-300);
  const Vector inverse = solver.eigenvalues().unaryExpr(
      [&](double value) { return value > smallest ? 1.0 / value : 0.0; });
  return solver.eigenvectors() *
         (inverse.asDiagonal() * (solver.eigenvectors().transpose() * right));
}

}  // namespace

/// The changes of moments around a node, and what its cells lack.
struct Equilibration::NodeSystem {
  /// A facet whose moment at the node may change, the rows of its cells and its signs in them.
  struct Term {
    Index facet;
    Index place;
    Index rows[2] = {-1, -1};
    double signs[2] = {0.0, 0.0};
  };

  NodeSystem(Equilibration& whole, const std::map<Index, Matrix>& partly_held, Index cells)
      : of(whole), partly(partly_held), right(whole.dim_, cells) {}

  void add(Index row, Index cell, Index node) {
    for (Index number = 0; number < of.corners_; ++number) {
      const auto& on = of.reference_.on_facet(number);
      const auto found = std::ranges::find(on, node);
      if (found == on.end()) {
        continue;
      }
      const Index place = found - on.begin();
      const Index f = of.facet_of_[cell * of.corners_ + number];
      const double eta = of.sign(cell, number);
      right.col(row) -= eta * of.moments_.col(f).segment(of.dim_ * place, of.dim_);
      const bool some = partly.contains(f);
      if (!of.facets_[f].changes && !some) {
        continue;
      }
      coupled = coupled || some;
      auto known = std::ranges::find(terms, f, &Term::facet);
      if (known == terms.end()) {
        terms.push_back({f, place});
        known = terms.end() - 1;
      }
      const int side = known->rows[0] < 0 ? 0 : 1;
      known->rows[side] = row;
      known->signs[side] = eta;
    }
  }

  /// Directions are coupled only by a facet that is held in some of them.
  [[nodiscard]] Index block() const { return coupled ? of.dim_ : 1; }

  [[nodiscard]] Matrix projector(Index facet) const {
    const auto some = partly.find(facet);
    return some != partly.end() ? some->second : Matrix(Matrix::Identity(block(), block()));
  }

  /// What each cell's equation is multiplied with, (d, cells).
  [[nodiscard]] Matrix multipliers(const Vector& cheap) const {
    const Index size = right.cols();
    Matrix matrix = Matrix::Zero(size * block(), size * block());
    for (const Term& term : terms) {
      const Matrix own = cheap(term.facet) * projector(term.facet);
      for (int i = 0; i < 2; ++i) {
        for (int j = 0; j < 2; ++j) {
          if (term.rows[i] >= 0 && term.rows[j] >= 0) {
            matrix.block(term.rows[i] * block(), term.rows[j] * block(), block(), block()) +=
                term.signs[i] * term.signs[j] * own;
          }
        }
      }
    }
    return coupled ? Matrix(least(matrix, right.reshaped()).reshaped(of.dim_, size))
                   : Matrix(least(matrix, right.transpose()).transpose());
  }

  void change(const Vector& cheap) {
    const Matrix lambda = multipliers(cheap);
    for (const Term& term : terms) {
      Vector step = Vector::Zero(of.dim_);
      for (int side = 0; side < 2 && term.rows[side] >= 0; ++side) {
        step += cheap(term.facet) * term.signs[side] * lambda.col(term.rows[side]);
      }
      if (partly.contains(term.facet)) {
        step = projector(term.facet) * step;
      }
      of.moments_.col(term.facet).segment(of.dim_ * term.place, of.dim_) += step;
      for (int side = 0; side < 2 && term.rows[side] >= 0; ++side) {
        right.col(term.rows[side]) -= term.signs[side] * step;
      }
    }
  }

  Equilibration& of;
  const std::map<Index, Matrix>& partly;
  Matrix right;  ///< (d, cells) what is lacking
  std::vector<Term> terms;
  bool coupled = false;
};

/// How little a change of each facet's moments strains the cells beside it.
Vector Equilibration::softness_of_facets() const {
  Vector out(static_cast<Index>(facets_.size()));
  for (std::size_t f = 0; f < facets_.size(); ++f) {
    double cost = 0.0;
    for (std::size_t side = 0; side < 2 && facets_[f].cells[side] >= 0; ++side) {
      const Index cell = facets_[f].cells[side];
      const double volume = std::abs(edges(cell).determinant());
      const double area = volume * gradients(cell).col(facets_[f].numbers[side]).norm();
      cost += cells_.compliance[cells_.material[cell]].trace() * volume / (area * area);
    }
    out(static_cast<Index>(f)) = 1.0 / cost;
  }
  return out;
}

/// Moments that make up what the cells around each node lack, with the least change.
void Equilibration::balance(const Boundary& boundary, const std::vector<Index>& named) {
  std::map<Index, Matrix> partly;  // facets that are held in some directions
  for (std::size_t n = 0; n < named.size(); ++n) {
    const Matrix held = boundary.held.col(static_cast<Index>(n)).reshaped(dim_, dim_);
    if (!held.isIdentity() && !held.isZero()) {
      partly[named[n]] = held;
    }
  }
  const Vector cheap = softness_of_facets();
  std::vector<std::vector<std::pair<Index, Index>>> around(static_cast<std::size_t>(nodes_));
  const Index nodes = reference_.nodes();
  Matrix left(dim_, count_ * nodes);
  for (Index cell = 0; cell < count_; ++cell) {
    left.middleCols(cell * nodes, nodes) = lacking(cell);
    if (cells_.shift.size() > 0) {
      left.middleCols(cell * nodes, nodes) += cells_.shift.middleCols(cell * nodes, nodes);
    }
    for (Index i = 0; i < nodes; ++i) {
      around[node_of_[cell * nodes + i]].emplace_back(cell, i);
    }
  }
  const double largest = left.cwiseAbs().maxCoeff();
  double off = 0.0;
  for (const auto& cells : around) {
    NodeSystem system(*this, partly, static_cast<Index>(cells.size()));
    for (std::size_t row = 0; row < cells.size(); ++row) {
      const auto [cell, node] = cells[row];
      system.right.col(static_cast<Index>(row)) = left.col(cell * nodes + node);
      system.add(static_cast<Index>(row), cell, node);
    }
    system.change(cheap);
    off = std::max(off, system.right.cwiseAbs().maxCoeff());
  }
  defect_ = off > 0.0 ? off / largest : 0.0;
}

}  // namespace latin::equilibration
