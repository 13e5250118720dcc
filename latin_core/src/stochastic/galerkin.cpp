#include "stochastic/galerkin.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "latin/common/error.hpp"

namespace latin::stochastic {

namespace {

/// Rows of the set that agree on all variables outside of `support`: only these are coupled.
std::vector<std::vector<Index>> lines_along(const MultiIndexSet& set,
                                            const std::vector<Index>& support) {
  std::map<std::vector<int>, std::vector<Index>> groups;
  for (Index j = 0; j < set.size(); ++j) {
    const auto index = set[j];
    std::vector<int> rest(index.begin(), index.end());
    for (const Index l : support) {
      rest[at(l)] = 0;
    }
    groups[std::move(rest)].push_back(j);
  }
  std::vector<std::vector<Index>> lines;
  lines.reserve(groups.size());
  for (auto& [rest, rows] : groups) {
    lines.push_back(std::move(rows));
  }
  return lines;
}

}  // namespace

std::vector<Matrix> triple_products(const Germ& germ, Index first, Index second) {
  // psi_i = 0 beyond the atoms of a discrete measure: the tables stop there
  const Rule rule = germ.gauss_exact(first + 2 * second);
  const Recurrence recurrence =
      germ.recurrence(std::max(rule.weights.size(), std::max(first, second) + 1));
  const Matrix psi = evaluate(recurrence, rule.points.col(0), std::max(first, second));
  const double scale = std::max(recurrence.alpha.cwiseAbs().maxCoeff(), recurrence.beta.maxCoeff());
  const bool symmetric =
      (recurrence.alpha.array() - recurrence.alpha(0)).abs().maxCoeff() <= 1e-14 * scale;
  std::vector<Matrix> tables;
  for (Index i = 0; i <= first; ++i) {
    Matrix table = Matrix::Zero(second + 1, second + 1);
    const Vector weighted = rule.weights.cwiseProduct(psi.col(i));
    for (Index j = 0; j <= second; ++j) {
      for (Index k = j; k <= second; ++k) {
        if (i > j + k || k > i + j || (symmetric && (i + j + k) % 2 == 1)) {
          continue;
        }
        const double value =
            i == 0 ? (j == k ? 1.0 : 0.0)
                   : (weighted.array() * psi.col(j).array() * psi.col(k).array()).sum();
        table(j, k) = value;
        table(k, j) = value;
      }
    }
    tables.push_back(std::move(table));
  }
  return tables;
}

TripleProducts::TripleProducts(const ChaosBasis& basis, const MultiIndexSet& property,
                               const std::vector<bool>& used)
    : modes_(basis.size()), of_property_(property.size()) {
  if (property.dimension() != basis.dimension() ||
      static_cast<Index>(used.size()) != of_property_) {
    throw InputError("a property with " + std::to_string(used.size()) + " coefficients on " +
                     std::to_string(property.size()) + " modes in " +
                     std::to_string(property.dimension()) + " variables does not fit a basis in " +
                     std::to_string(basis.dimension()) + " variables");
  }
  const MultiIndexSet& set = basis.indices();

  // terms with the same active variables share the grouping of the basis
  std::map<std::vector<Index>, std::vector<Index>> by_support;
  std::vector<Index> highest(at(basis.dimension()), 0);
  for (Index i = 0; i < property.size(); ++i) {
    if (!used[at(i)]) {
      continue;
    }
    std::vector<Index> support;
    bool reached = true;
    for (Index l = 0; l < property.dimension(); ++l) {
      const int degree = property.table()(i, l);
      if (degree > 0) {
        support.push_back(l);
        reached = reached && degree <= 2 * set.degree(l);
      }
    }
    if (reached) {
      for (const Index l : support) {
        highest[at(l)] = std::max<Index>(highest[at(l)], property.table()(i, l));
      }
      by_support[support].push_back(i);
    }
  }
  std::vector<std::vector<Matrix>> tables(at(basis.dimension()));
  for (Index l = 0; l < basis.dimension(); ++l) {
    if (highest[at(l)] > 0) {
      tables[at(l)] = triple_products(basis.germs()[at(l)], highest[at(l)], set.degree(l));
    }
  }

  struct Found {
    Index place;  // k * modes + j
    Term term;
  };
  std::vector<Found> found;
  for (const auto& [support, terms] : by_support) {
    for (const std::vector<Index>& line : lines_along(set, support)) {
      for (std::size_t a = 0; a < line.size(); ++a) {
        for (std::size_t b = a; b < line.size(); ++b) {
          for (const Index i : terms) {
            double product = 1.0;
            for (const Index l : support) {
              product *= tables[at(l)][at(property.table()(i, l))](set.table()(line[a], l),
                                                                   set.table()(line[b], l));
              if (product == 0.0) {
                break;
              }
            }
            if (product != 0.0) {
              const Index j = std::min(line[a], line[b]);
              const Index k = std::max(line[a], line[b]);
              found.push_back({k * modes_ + j, {static_cast<int>(i), product}});
            }
          }
        }
      }
    }
  }
  std::ranges::stable_sort(found, {}, &Found::place);
  terms_.reserve(found.size());
  for (const Found& each : found) {
    const auto j = static_cast<int>(each.place % modes_);
    const auto k = static_cast<int>(each.place / modes_);
    if (entries_.empty() || entries_.back().j != j || entries_.back().k != k) {
      entries_.push_back({j, k, terms_.size(), terms_.size()});
    }
    terms_.push_back(each.term);
    ++entries_.back().end;
  }
}

SparseColumns TripleProducts::matrix(ConstVectorRef coefficients) const {
  if (coefficients.size() != of_property_ || !coefficients.allFinite()) {
    throw InputError(
        "the coefficients of a random property hold a NaN or an infinity, or are not " +
        std::to_string(of_property_));
  }
  std::vector<Eigen::Triplet<double, int>> entries;
  for (const Entry& entry : entries_) {
    double sum = 0.0;
    for (std::size_t t = entry.begin; t < entry.end; ++t) {
      sum += coefficients(terms_[t].mode) * terms_[t].value;
    }
    if (sum != 0.0) {
      entries.emplace_back(entry.j, entry.k, sum);
      if (entry.j != entry.k) {
        entries.emplace_back(entry.k, entry.j, sum);
      }
    }
  }
  SparseColumns matrix(modes_, modes_);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

SparseColumns galerkin_matrix(const ChaosBasis& basis, ConstVectorRef coefficients,
                              const MultiIndexSet& property) {
  std::vector<bool> used;
  for (const double each : coefficients) {
    used.push_back(each != 0.0);
  }
  return TripleProducts(basis, property, used).matrix(coefficients);
}

std::vector<std::vector<Index>> coupled_blocks(const SparseColumns& matrix) {
  if (matrix.rows() != matrix.cols()) {
    throw InputError("a Galerkin matrix is square; got (" + std::to_string(matrix.rows()) + ", " +
                     std::to_string(matrix.cols()) + ")");
  }
  std::vector<Index> parent(at(matrix.rows()));
  std::iota(parent.begin(), parent.end(), Index{0});
  const auto root = [&](Index i) {
    while (parent[at(i)] != i) {
      parent[at(i)] = parent[at(parent[at(i)])];
      i = parent[at(i)];
    }
    return i;
  };
  for (Index column = 0; column < matrix.outerSize(); ++column) {
    for (SparseColumns::InnerIterator entry(matrix, column); entry; ++entry) {
      const Index a = root(entry.row());
      const Index b = root(column);
      parent[at(std::max(a, b))] = std::min(a, b);
    }
  }
  std::map<Index, std::vector<Index>> groups;
  for (Index i = 0; i < matrix.rows(); ++i) {
    groups[root(i)].push_back(i);
  }
  std::vector<std::vector<Index>> blocks;
  blocks.reserve(groups.size());
  for (auto& [first, rows] : groups) {
    blocks.push_back(std::move(rows));
  }
  return blocks;
}

double smallest_eigenvalue(const SparseColumns& matrix) {
  if (matrix.rows() == 0) {
    throw InputError("a Galerkin matrix has at least one row");
  }
  double smallest = std::numeric_limits<double>::infinity();
  for (const std::vector<Index>& block : coupled_blocks(matrix)) {
    Matrix dense(block.size(), block.size());
    for (std::size_t a = 0; a < block.size(); ++a) {
      for (std::size_t b = 0; b < block.size(); ++b) {
        dense(static_cast<Index>(a), static_cast<Index>(b)) = matrix.coeff(block[a], block[b]);
      }
    }
    if (!dense.allFinite()) {
      throw InputError("a Galerkin matrix holds a NaN or an infinity");
    }
    const Eigen::SelfAdjointEigenSolver<Matrix> solver(dense, Eigen::EigenvaluesOnly);
    smallest = std::min(smallest, solver.eigenvalues()(0));
  }
  return smallest;
}

double critical_cov(const Germ& germ, Index order) {
  if (order < 0) {
    throw InputError("chaos order " + std::to_string(order) + ": an order is >= 0");
  }
  const Recurrence two = germ.recurrence(std::min<Index>(2, germ.capacity()));
  if (order == 0 || two.length() < 2) {
    return std::numeric_limits<double>::infinity();
  }
  const Rule rule = germ.gauss(order + 1);
  return two.beta(1) / (two.alpha(0) - rule.points(0, 0));
}

}  // namespace latin::stochastic
