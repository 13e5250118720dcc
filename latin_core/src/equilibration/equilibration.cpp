#include "equilibration/equilibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>
#include <utility>

#include "common/threads.hpp"
#include "latin/common/error.hpp"

namespace latin::equilibration {
namespace {

Cells checked(Cells cells) {
  const Index d = cells.vertices.rows();
  const auto corners = static_cast<Index>(cells.corners.size());
  const auto count = static_cast<Index>(cells.material.size());
  const Index components = d * (d + 1) / 2;
  if ((d != 2 && d != 3) || corners != count * (d + 1) || cells.stress.rows() != components ||
      cells.stress.cols() != corners || cells.force.rows() != d || cells.force.cols() != count) {
    throw InputError("equilibrated stresses: " + std::to_string(corners) + " corners, " +
                     std::to_string(cells.stress.cols()) + " stresses and " +
                     std::to_string(cells.force.cols()) + " forces of " + std::to_string(count) +
                     " cells do not fit");
  }
  for (Index cell = 0; cell < count; ++cell) {
    const auto* first = cells.corners.data() + cell * (d + 1);
    if (first[0] < 0 || first[d] >= cells.vertices.cols() ||
        std::adjacent_find(first, first + d + 1, std::greater_equal<>()) != first + d + 1 ||
        cells.material[cell] < 0 ||
        cells.material[cell] >= static_cast<Index>(cells.compliance.size())) {
      throw InputError("equilibrated stresses: cell " + std::to_string(cell) +
                       " has vertices that are not ascending, or no material");
    }
  }
  return cells;
}

/// Physical components by those that Piola's transform takes, times the determinant of the edges.
Matrix turn_of(const ReferenceCell& reference, const Matrix& edge) {
  const Index n = reference.components();
  Matrix turn(n, n);
  for (Index a = 0; a < n; ++a) {
    const auto [i, j] = reference.component(a);
    for (Index b = 0; b < n; ++b) {
      const auto [k, l] = reference.component(b);
      turn(a, b) = edge(i, k) * edge(j, l) + (k != l ? edge(i, l) * edge(j, k) : 0.0);
    }
  }
  return turn;
}

}  // namespace

Equilibration::Equilibration(Cells cells, const Boundary& boundary)
    : cells_(checked(std::move(cells))),
      reference_(ReferenceCell::of(
          static_cast<int>(cells_.vertices.rows()),
          boundary.moments.rows() == cells_.vertices.rows() * cells_.vertices.rows() ? 1 : 2)),
      dim_(cells_.vertices.rows()),
      corners_(dim_ + 1),
      count_(static_cast<Index>(cells_.material.size())),
      of_facet_(dim_ * reference_.facet_nodes()) {
  const Index named = boundary.moments.cols();
  if (boundary.moments.rows() != of_facet_ || boundary.held.rows() != dim_ * dim_ ||
      boundary.held.cols() != named ||
      static_cast<Index>(boundary.corners.size()) != dim_ * named) {
    throw InputError("equilibrated stresses: moments and supports of the boundary do not fit");
  }
  const Index rows = reference_.components() * corners_ * reference_.terms();
  const auto fits = [](const Matrix& given, Index height, Index width) {
    return given.size() == 0 || (given.rows() == height && given.cols() == width);
  };
  if (!fits(cells_.rest, rows, count_) || !fits(cells_.shift, dim_, count_ * reference_.nodes())) {
    throw InputError("equilibrated stresses: rests and shifts of the cells do not fit");
  }
  const SerialAlgebra serial;  // cells and nodes are small
  find_facets();
  find_nodes();
  const std::vector<Index> facets = named_facets(boundary);
  start(boundary, facets);
  balance(boundary, facets);
  find_stars();
  energies_ = Vector::Zero(count_);
  slopes_ = Matrix::Zero(corners_ * of_facet_, count_);
  condensed_.assign(static_cast<std::size_t>(count_), 0);
}

Matrix Equilibration::edges(Index cell) const {
  const auto* at = cells_.corners.data() + cell * corners_;
  Matrix out(dim_, dim_);
  for (Index k = 0; k < dim_; ++k) {
    out.col(k) = cells_.vertices.col(at[k + 1]) - cells_.vertices.col(at[0]);
  }
  return out;
}

/// Of the barycentric coordinates, (d, d + 1).
Matrix Equilibration::gradients(Index cell) const {
  Matrix out(dim_, corners_);
  out.rightCols(dim_) = edges(cell).inverse().transpose();
  out.col(0) = -out.rightCols(dim_).rowwise().sum();
  return out;
}

void Equilibration::find_facets() {
  std::vector<std::pair<std::array<Index, 3>, Index>> keys;
  keys.reserve(cells_.corners.size());
  for (Index cell = 0; cell < count_; ++cell) {
    for (Index number = 0; number < corners_; ++number) {
      std::array<Index, 3> key{-1, -1, -1};
      Index next = 0;
      for (Index k = 0; k < corners_; ++k) {
        if (k != number) {
          key[next++] = cells_.corners[cell * corners_ + k];
        }
      }
      keys.emplace_back(key, cell * corners_ + number);
    }
  }
  std::ranges::sort(keys);
  facet_of_.resize(keys.size());
  for (std::size_t k = 0; k < keys.size(); ++k) {
    const bool again = k > 0 && keys[k].first == keys[k - 1].first;
    if (!again) {
      facets_.emplace_back();
    }
    Facet& facet = facets_.back();
    const std::size_t side = again ? 1 : 0;
    if (facet.cells[side] >= 0) {
      throw InputError("equilibrated stresses: a facet belongs to three cells");
    }
    facet.cells[side] = keys[k].second / corners_;
    facet.numbers[side] = keys[k].second % corners_;
    facet.changes = again;
    facet_of_[keys[k].second] = static_cast<Index>(facets_.size()) - 1;
  }
}

void Equilibration::find_nodes() {
  const Index nodes = reference_.nodes();
  node_of_.resize(static_cast<std::size_t>(count_ * nodes));
  std::vector<std::pair<std::array<Index, 2>, Index>> keys;
  keys.reserve(node_of_.size());
  for (Index cell = 0; cell < count_; ++cell) {
    const auto* at = cells_.corners.data() + cell * corners_;
    Index next = cell * nodes;
    for (Index i = 0; i < corners_; ++i) {
      keys.push_back({{at[i], -1}, next++});
    }
    for (Index i = 0; nodes > corners_ && i < corners_; ++i) {
      for (Index j = i + 1; j < corners_; ++j) {
        keys.push_back({{at[i], at[j]}, next++});
      }
    }
  }
  std::ranges::sort(keys);
  for (std::size_t k = 0; k < keys.size(); ++k) {
    nodes_ += k == 0 || keys[k].first != keys[k - 1].first ? 1 : 0;
    node_of_[keys[k].second] = nodes_ - 1;
  }
}

/// Numbers of the facets of a boundary.
std::vector<Index> Equilibration::named_facets(const Boundary& boundary) const {
  std::vector<Index> out;
  for (Index n = 0; n < boundary.moments.cols(); ++n) {
    const auto* first = boundary.corners.data() + n * dim_;
    const auto at =
        std::ranges::lower_bound(facets_, std::vector<Index>(first, first + dim_), {},
                                 [this](const Facet& facet) { return corners_of(facet); });
    if (at == facets_.end() || corners_of(*at) != std::vector<Index>(first, first + dim_) ||
        at->cells[1] >= 0) {
      throw InputError("equilibrated stresses: facet " + std::to_string(n) +
                       " that is named is not on the boundary");
    }
    out.push_back(static_cast<Index>(at - facets_.begin()));
  }
  return out;
}

/// Vertices, ascending.
std::vector<Index> Equilibration::corners_of(const Facet& facet) const {
  std::vector<Index> out;
  for (Index k = 0; k < corners_; ++k) {
    if (k != facet.numbers[0]) {
      out.push_back(cells_.corners[facet.cells[0] * corners_ + k]);
    }
  }
  return out;
}

/// Tractions: given ones, and else the mean of both sides.
void Equilibration::start(const Boundary& boundary, const std::vector<Index>& named) {
  const auto facets = static_cast<Index>(facets_.size());
  moments_ = Matrix::Zero(of_facet_, facets);
  places_.resize(of_facet_, facets);
  double length = 0.0;
  for (Index cell = 0; cell < count_; ++cell) {
    length += std::pow(std::abs(edges(cell).determinant()), 1.0 / static_cast<double>(dim_)) /
              static_cast<double>(count_);
  }
  for (Index f = 0; f < facets; ++f) {
    const Facet& facet = facets_[f];
    if (facet.changes) {
      moments_.col(f) = 0.5 * (own_moments(facet.cells[0], facet.numbers[0]).reshaped() -
                               own_moments(facet.cells[1], facet.numbers[1]).reshaped());
    }
    Matrix corners(dim_, dim_);
    Index next = 0;
    for (const Index vertex : corners_of(facet)) {
      corners.col(next++) = cells_.vertices.col(vertex) / length;
    }
    places_.col(f).head(dim_ * dim_) = corners.reshaped();
    for (Index i = 0; reference_.degree() > 1 && i < dim_; ++i) {
      for (Index j = i + 1; j < dim_; ++j) {
        places_.col(f).segment(dim_ * next++, dim_) = 0.5 * (corners.col(i) + corners.col(j));
      }
    }
  }
  for (std::size_t n = 0; n < named.size(); ++n) {
    const Index f = named[n];
    const Eigen::Map<const Matrix> held(boundary.held.col(static_cast<Index>(n)).data(), dim_,
                                        dim_);
    const Matrix own = own_moments(facets_[f].cells[0], facets_[f].numbers[0]);
    const Matrix given =
        boundary.moments.col(static_cast<Index>(n)).reshaped(dim_, of_facet_ / dim_);
    moments_.col(f) = (held * own + given - held * given).reshaped();
    facets_[f].changes = held.isIdentity();
  }
}

/// Moments and divergence of the distance, on the reference cell.
Vector Equilibration::data(Index cell) const {
  Vector out(reference_.data());
  const Matrix edge = edges(cell);
  const Matrix inverse = edge.inverse();
  for (Index number = 0; number < corners_; ++number) {
    const Matrix own = own_moments(cell, number);
    const Matrix moments =
        sign(cell, number) *
        moments_.col(facet_of_[cell * corners_ + number]).reshaped(dim_, own.cols());
    out.segment(number * of_facet_, of_facet_) = (inverse * (moments - own)).reshaped();
  }
  const Matrix slopes = gradients(cell);
  Vector divergence = cells_.force.col(cell);
  for (Index v = 0; v < corners_; ++v) {
    for (Index a = 0; a < reference_.components(); ++a) {
      const auto [i, j] = reference_.component(a);
      const double value = cells_.stress(a, cell * corners_ + v);
      divergence(i) += value * slopes(j, v);
      if (i != j) {
        divergence(j) += value * slopes(i, v);
      }
    }
  }
  out.tail(dim_) = -std::abs(edge.determinant()) * (inverse * divergence);
  return out;
}

/// Energy of Piola's transform of a stress, by its components.
Matrix Equilibration::reference_compliance(Index cell) const {
  const Matrix edge = edges(cell);
  const Matrix turn = turn_of(reference_, edge);
  return turn.transpose() * cells_.compliance[cells_.material[cell]] * turn /
         std::abs(edge.determinant());
}

/// What the solution's stress has beyond linear, on the reference cell: coefficients.
Vector Equilibration::rest(Index cell) const {
  const Index each = corners_ * reference_.terms();
  if (cells_.rest.size() == 0) {
    return Vector::Zero(each * reference_.components());
  }
  const Matrix edge = edges(cell);
  const Matrix own = cells_.rest.col(cell).reshaped(each, reference_.components());
  const Matrix turn = turn_of(reference_, edge) / std::abs(edge.determinant());
  return (own * turn.inverse().transpose()).reshaped();
}

Matrix Equilibration::stress(Index cell, ConstMatrixRef points) const {
  const Index n = reference_.components();
  const Index each = corners_ * reference_.terms();
  const Index free = reference_.self_stresses();
  const Matrix compliance = reference_compliance(cell);
  const Vector given = reference_.basis().rightCols(reference_.data()) * data(cell);
  Vector coefficients = given;
  if (free > 0) {
    const Matrix own = reference_.basis().leftCols(free);
    Matrix strained(own.rows(), free);
    for (Index a = 0; a < n; ++a) {
      strained.middleRows(a * each, each).setZero();
      for (Index b = 0; b < n; ++b) {
        strained.middleRows(a * each, each) += compliance(a, b) * own.middleRows(b * each, each);
      }
    }
    coefficients -=
        own * (own.transpose() * strained).llt().solve(strained.transpose() * (given - rest(cell)));
  }
  const Matrix edge = edges(cell);
  Matrix bary(corners_, points.cols());
  bary.row(0) = 1.0 - points.colwise().sum().array();
  bary.bottomRows(dim_) = points;
  Matrix out = cells_.stress.middleCols(cell * corners_, corners_) * bary;
  for (Index m = 0; m < points.cols(); ++m) {
    Index piece = 0;
    bary.col(m).minCoeff(&piece);  // the piece without the vertex that is farthest
    const Matrix values = reference_.values(piece, points.col(m));
    Matrix tensor(dim_, dim_);
    for (Index a = 0; a < n; ++a) {
      const auto [i, j] = reference_.component(a);
      tensor(i, j) = tensor(j, i) =
          coefficients.segment(a * each + piece * reference_.terms(), reference_.terms())
              .dot(values.col(0));
    }
    const Matrix moved = edge * tensor * edge.transpose() / std::abs(edge.determinant());
    for (Index a = 0; a < n; ++a) {
      const auto [i, j] = reference_.component(a);
      out(a, m) += moved(i, j);
    }
  }
  return out;
}

}  // namespace latin::equilibration
