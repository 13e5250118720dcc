#include "stochastic/germ.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <sstream>
#include <utility>
#include <vector>

#include "latin/common/error.hpp"

namespace latin::stochastic {

namespace {

Recurrence hermite(Index length, std::span<const double> /*none*/) {
  Recurrence r{Vector::Zero(length), Vector::Ones(length)};
  for (Index k = 1; k < length; ++k) {
    r.beta(k) = std::sqrt(static_cast<double>(k));
  }
  return r;
}

Recurrence legendre(Index length, std::span<const double> /*none*/) {
  Recurrence r{Vector::Zero(length), Vector::Ones(length)};
  for (Index i = 1; i < length; ++i) {
    const auto k = static_cast<double>(i);
    r.beta(i) = k / std::sqrt(4.0 * k * k - 1.0);
  }
  return r;
}

Recurrence laguerre(Index length, std::span<const double> parameters) {
  const double shape = parameters[0];
  Recurrence r{Vector::Zero(length), Vector::Ones(length)};
  for (Index i = 0; i < length; ++i) {
    const auto k = static_cast<double>(i);
    r.alpha(i) = 2.0 * k + shape;
    r.beta(i) = i == 0 ? 1.0 : std::sqrt(k * (k - 1.0 + shape));
  }
  return r;
}

Recurrence jacobi(Index length, std::span<const double> parameters) {
  // exponents of (1 - x) and (1 + x)
  const double right = parameters[1] - 1.0;
  const double left = parameters[0] - 1.0;
  const double sum = right + left;
  Recurrence r{Vector::Zero(length), Vector::Ones(length)};
  for (Index i = 0; i < length; ++i) {
    const auto k = static_cast<double>(i);
    const double t = 2.0 * k + sum;
    if (i == 0) {  // the general forms are 0 / 0 here if sum = 0 or -1
      r.alpha(0) = (left - right) / (sum + 2.0);
      continue;
    }
    r.alpha(i) = (left - right) * sum / (t * (t + 2.0));
    const double square =
        i == 1 ? 4.0 * (1.0 + right) * (1.0 + left) / (t * t * (t + 1.0))
               : 4.0 * k * (k + right) * (k + left) * (k + sum) / (t * t * (t + 1.0) * (t - 1.0));
    r.beta(i) = std::sqrt(square);
  }
  return r;
}

struct Family {
  const char* name;
  std::size_t parameters;
  Recurrence (*maker)(Index, std::span<const double>);
};

constexpr std::array<Family, 4> table{{{"hermite", 0, hermite},
                                       {"jacobi", 2, jacobi},
                                       {"laguerre", 1, laguerre},
                                       {"legendre", 0, legendre}}};

/// An eigenvalue of a Jacobi matrix, corrected, and the square of the first component of its eigenvector: node and
/// weight of the Gauss rule.
struct Pair {
  double node;
  double weight;
};

/// By a twisted factorisation (I. S. Dhillon and B. N. Parlett, Linear Algebra Appl. 387 (2004) 1): from both ends to
/// where the eigenvector is largest. The recurrence of the polynomials alone, upwards, loses an atom that lies apart.
Pair refined(const Recurrence& r, double x, Index n) {
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  const double size = r.alpha.head(n).norm() + r.beta.segment(1, n - 1).norm() + std::abs(x);
  // far below rounding, and its inverse is a number
  const double least = epsilon * epsilon * size + std::numeric_limits<double>::min();
  const auto pivot = [least](double value) { return std::abs(value) <= least ? least : value; };
  std::vector<double> up(static_cast<std::size_t>(n));    // of L D L^T
  std::vector<double> down(static_cast<std::size_t>(n));  // of U D U^T
  for (std::size_t k = 0; k < up.size(); ++k) {
    const auto at = static_cast<Index>(k);
    up[k] = pivot(r.alpha(at) - x - (k == 0 ? 0.0 : r.beta(at) * (r.beta(at) / up[k - 1])));
  }
  std::size_t twist = 0;
  double left = std::numeric_limits<double>::infinity();
  for (std::size_t k = down.size(); k-- > 0;) {
    const auto at = static_cast<Index>(k);
    const double next = at + 1 == n ? 0.0 : r.beta(at + 1) * (r.beta(at + 1) / down[k + 1]);
    down[k] = pivot(r.alpha(at) - x - next);
    const double here = up[k] - next;
    if (std::abs(here) < std::abs(left)) {
      left = here;
      twist = k;
    }
  }
  double first = 1.0;
  double square = 1.0;
  for (std::size_t k = twist; k-- > 0;) {
    first *= -r.beta(static_cast<Index>(k) + 1) / up[k];
    square += first * first;
  }
  double last = 1.0;
  for (std::size_t k = twist + 1; k < down.size(); ++k) {
    last *= -r.beta(static_cast<Index>(k)) / down[k];
    square += last * last;
  }
  return {std::isfinite(left) ? x + left / square : x, first * first / square};
}

}  // namespace

Rule gauss(const Recurrence& recurrence, Index count) {
  if (count < 1 || count > recurrence.length()) {
    throw InputError("a Gauss rule of " + std::to_string(count) +
                     " points needs that many recurrence coefficients; there are " +
                     std::to_string(recurrence.length()));
  }
  const Vector diagonal = recurrence.alpha.head(count);
  const Vector off = recurrence.beta.segment(1, count - 1);
  Rule rule{Matrix(count, 1), Vector(count)};
  Eigen::SelfAdjointEigenSolver<Matrix> solver;
  solver.computeFromTridiagonal(diagonal, off, Eigen::EigenvaluesOnly);
  if (solver.info() != Eigen::Success) {
    throw NumericalError("the eigenvalues of a Jacobi matrix of size " + std::to_string(count) +
                         " did not converge");
  }
  const Vector nodes = solver.eigenvalues();
  for (Index s = 0; s < count; ++s) {
    const Pair once = refined(recurrence, nodes(s), count);
    rule.points(s, 0) = once.node;
    rule.weights(s) = refined(recurrence, once.node, count).weight;
  }
  rule.weights /= rule.weights.sum();
  return rule;
}

Matrix evaluate(const Recurrence& recurrence, ConstVectorRef points, Index degree) {
  if (degree < 0 || degree >= recurrence.length()) {
    throw InputError("polynomials of degree " + std::to_string(degree) + " need degree >= 0 and " +
                     std::to_string(degree + 1) + " recurrence coefficients; there are " +
                     std::to_string(recurrence.length()));
  }
  Matrix psi(points.size(), degree + 1);
  psi.col(0).setOnes();
  for (Index k = 0; k < degree; ++k) {
    psi.col(k + 1) = (points.array() - recurrence.alpha(k)) * psi.col(k).array();
    if (k > 0) {
      psi.col(k + 1) -= recurrence.beta(k) * psi.col(k - 1);
    }
    psi.col(k + 1) /= recurrence.beta(k + 1);
  }
  return psi;
}

Recurrence lanczos(ConstVectorRef nodes, ConstVectorRef weights, Index length) {
  const Index atoms = nodes.size();
  if (length < 1 || length > atoms) {
    throw InputError("a measure with " + std::to_string(atoms) +
                     " atoms has orthogonal polynomials of "
                     "degree 0 to " +
                     std::to_string(atoms - 1) + "; asked for " + std::to_string(length) +
                     " of them");
  }
  // centred and scaled, so that the end of the process is seen whatever the unit of the nodes
  const double centre = weights.dot(nodes);
  const Vector shifted = nodes.array() - centre;
  const double scale = std::sqrt(weights.dot(shifted.cwiseAbs2()));
  const Vector x = scale > 0.0 ? Vector(shifted / scale) : shifted;
  Recurrence r{Vector::Zero(length), Vector::Ones(length)};
  Matrix basis(atoms, length);
  basis.col(0) = weights.cwiseSqrt();
  basis.col(0).normalize();
  for (Index k = 0; k < length; ++k) {
    Vector next = x.cwiseProduct(basis.col(k));
    const double alpha = basis.col(k).dot(next);
    r.alpha(k) = centre + (scale > 0.0 ? scale * alpha : 0.0);
    if (k + 1 == length) {
      break;
    }
    for (int pass = 0; pass < 2; ++pass) {
      const Vector overlap = basis.leftCols(k + 1).transpose() * next;
      next.noalias() -= basis.leftCols(k + 1) * overlap;
    }
    const double beta = next.norm();
    if (!(beta > 1e-10)) {
      throw NumericalError("a measure with " + std::to_string(atoms) +
                           " atoms carries numerically only polynomials of degree 0 to " +
                           std::to_string(k) + ": lower the degree");
    }
    r.beta(k + 1) = scale * beta;
    basis.col(k + 1) = next / beta;
  }
  return r;
}

Germ::Germ(std::string name, Maker maker, Index capacity, bool atomic)
    : name_(std::move(name)), maker_(std::move(maker)), capacity_(capacity), atomic_(atomic) {}

std::vector<std::string> Germ::families() {
  std::vector<std::string> names;
  names.reserve(table.size());
  for (const Family& entry : table) {
    names.emplace_back(entry.name);
  }
  return names;
}

Germ Germ::family(const std::string& name, std::span<const double> parameters) {
  const auto* entry =
      std::find_if(table.begin(), table.end(), [&](const Family& f) { return f.name == name; });
  if (entry == table.end()) {
    std::string known;
    for (const Family& f : table) {
      known += known.empty() ? f.name : std::string(", ") + f.name;
    }
    throw InputError("unknown polynomial family '" + name + "'; known: " + known);
  }
  std::ostringstream text;
  text << name;
  if (parameters.size() != entry->parameters) {
    throw InputError("polynomial family '" + name + "' has " + std::to_string(entry->parameters) +
                     " parameters; got " + std::to_string(parameters.size()));
  }
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    if (!(parameters[i] > 0.0) || !std::isfinite(parameters[i])) {
      throw InputError("polynomial family '" + name + "': parameter " + std::to_string(i) + " = " +
                       std::to_string(parameters[i]) + " must be positive and finite");
    }
    text << (i == 0 ? "(" : ", ") << parameters[i];
  }
  text << (parameters.empty() ? "" : ")");
  std::vector<double> copy(parameters.begin(), parameters.end());
  return {text.str(),
          [maker = entry->maker, copy = std::move(copy)](Index n) { return maker(n, copy); },
          unlimited, false};
}

Germ Germ::from_measure(ConstVectorRef nodes, ConstVectorRef weights) {
  if (nodes.size() != weights.size()) {
    throw InputError("a measure needs as many weights as nodes; got " +
                     std::to_string(weights.size()) + " and " + std::to_string(nodes.size()));
  }
  if (!nodes.allFinite() || !weights.allFinite() || (weights.array() < 0.0).any()) {
    throw InputError("a measure needs finite nodes and finite weights >= 0");
  }
  std::vector<Index> order(static_cast<std::size_t>(nodes.size()));
  std::iota(order.begin(), order.end(), Index{0});
  std::sort(order.begin(), order.end(), [&](Index a, Index b) { return nodes(a) < nodes(b); });
  std::vector<double> x;
  std::vector<double> w;
  for (const Index i : order) {
    if (weights(i) == 0.0) {
      continue;
    }
    if (!x.empty() && x.back() == nodes(i)) {
      w.back() += weights(i);
    } else {
      x.push_back(nodes(i));
      w.push_back(weights(i));
    }
  }
  if (x.empty()) {
    throw InputError("a measure needs at least one atom of positive weight");
  }
  struct Atoms {
    Vector nodes;
    Vector weights;
  };
  const auto size = static_cast<Index>(x.size());
  auto atoms = std::make_shared<Atoms>(
      Atoms{Eigen::Map<Vector>(x.data(), size), Eigen::Map<Vector>(w.data(), size)});
  atoms->weights /= atoms->weights.sum();
  return {"measure of " + std::to_string(size) + " atoms",
          [atoms](Index n) { return lanczos(atoms->nodes, atoms->weights, n); }, size, true};
}

Germ Germ::from_recurrence(Recurrence recurrence) {
  const Index length = recurrence.length();
  if (length < 1 || recurrence.beta.size() != length || !recurrence.alpha.allFinite() ||
      !recurrence.beta.allFinite() || (recurrence.beta.tail(length - 1).array() <= 0.0).any()) {
    throw InputError(
        "a recurrence needs alpha and beta of one length >= 1, finite, with beta_1, "
        "beta_2, ... > 0; got lengths " +
        std::to_string(length) + " and " + std::to_string(recurrence.beta.size()));
  }
  auto shared = std::make_shared<const Recurrence>(std::move(recurrence));
  return {"recurrence of length " + std::to_string(length),
          [shared](Index n) { return Recurrence{shared->alpha.head(n), shared->beta.head(n)}; },
          length, false};
}

Recurrence Germ::recurrence(Index length) const {
  if (length < 1 || length > capacity_) {
    throw InputError("germ '" + name_ + "': asked for " + std::to_string(length) +
                     " recurrence coefficients, i.e. degree " + std::to_string(length - 1) +
                     "; it has polynomials of degree 0 to " + std::to_string(capacity_ - 1));
  }
  return maker_(length);
}

Rule Germ::gauss(Index count) const { return stochastic::gauss(recurrence(count), count); }

Rule Germ::gauss_exact(Index degree) const {
  const Index count = degree / 2 + 1;
  return gauss(atomic_ ? std::min(count, capacity_) : count);
}

Matrix Germ::evaluate(ConstVectorRef points, Index degree) const {
  return stochastic::evaluate(recurrence(degree + 1), points, degree);
}

}  // namespace latin::stochastic
