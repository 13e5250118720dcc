#include "substructure/coupled.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "algebra/sparse_product.hpp"
#include "common/numbers.hpp"

namespace latin::substructure {
namespace {

using algebra::multiply_sparse;
using Row = Eigen::RowVectorXd;

/// Steps of conjugate gradients at most.
constexpr Index most_gradients = 100;
/// What a round leaves of rigid laws, as they are taken: more exact need nothing else be.
constexpr double of_rigid = 1e-5;
/// Energies of a fluctuation relative to its mean, and of a time step relative to the others, that count as none: the
/// square roots.
constexpr double little = 5e-7;
constexpr double still = 1e-9;

/// Inner products of the columns of every group, added: (groups).
template <class A, class B>
void add_products(const ColumnGroups& groups, const A& a, const B& b, Vector& sums) {
  for (Index column = 0; column < a.cols(); ++column) {
    sums(groups.of(column)) += a.col(column).dot(b.col(column));
  }
}

/// The same of the whole solution that a column belongs to: its mean with its fluctuation, (columns).
Row of_solutions(const ColumnGroups& groups, const Vector& sums, Index columns) {
  Row of_columns(columns);
  for (Index column = 0; column < columns; ++column) {
    const Index first = groups.of(column) / groups.kinds() * groups.kinds();
    of_columns(column) = sums.segment(first, groups.kinds()).sum();
  }
  return of_columns;
}

/// Errors in energy that are small enough, (groups): a group that is next to nothing is measured with the others.
Vector small_enough(const ColumnGroups& groups, Vector energies, double tolerance) {
  const double largest = energies.size() > 0 ? energies.maxCoeff() : 0.0;
  for (Index first = 0; first < energies.size(); first += groups.kinds()) {
    auto own = energies.segment(first, groups.kinds());
    own = own.cwiseMax(little * little * own.maxCoeff()).cwiseMax(still * still * largest);
  }
  return tolerance * tolerance * energies;
}

/// One over the least eigenvalue that conjugate gradients have seen of the preconditioned matrix, of all columns: from
/// the tridiagonal matrix of their coefficients (Y. Saad, Iterative Methods for Sparse Linear Systems, 6.7.3).
double largest_inverse(const std::vector<Row>& shares, const std::vector<Row>& falls) {
  double largest = 1.0;
  const Index columns = shares.empty() ? 0 : shares.front().size();
  for (Index column = 0; column < columns; ++column) {
    if (column > 0 && std::ranges::all_of(shares, [column](const Row& share) {
          return share(column) == share(column - 1);
        })) {
      continue;  // of the same solution
    }
    Index count = 0;
    while (count < static_cast<Index>(shares.size()) &&
           shares[static_cast<std::size_t>(count)](column) > 0.0) {
      ++count;
    }
    if (count == 0) {
      continue;
    }
    Vector diagonal(count);
    Vector beside(std::max<Index>(count - 1, 0));
    for (Index i = 0; i < count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      diagonal(i) = 1.0 / shares[at](column);
      if (i > 0) {
        diagonal(i) += falls[at - 1](column) / shares[at - 1](column);
      }
      if (i + 1 < count) {
        beside(i) = std::sqrt(falls[at](column)) / shares[at](column);
      }
    }
    Eigen::SelfAdjointEigenSolver<Matrix> eigen;
    eigen.computeFromTridiagonal(diagonal, beside, Eigen::EigenvaluesOnly);
    largest = larger(largest, 1.0 / eigen.eigenvalues()(0));
  }
  return largest;
}

/// a += b * factors of the columns.
void add_multiple(Matrix& a, const Matrix& b, const Row& factors) {
  for (Index column = 0; column < a.cols(); ++column) {
    a.col(column) += factors(column) * b.col(column);
  }
}

/// a = b + a * factors of the columns.
void multiply_and_add(Matrix& a, const Row& factors, const Matrix& b) {
  for (Index column = 0; column < a.cols(); ++column) {
    a.col(column) = b.col(column) + factors(column) * a.col(column);
  }
}

}  // namespace

Coupled::Coupled(Tangent& tangent, LocalStage& local)
    : tangent_(tangent),
      local_(local),
      structure_(local.laws().structure()),
      groups_(local.laws().groups()),
      nodal_(SparseRows(tangent.jumps().transpose()) * tangent.areas().asDiagonal()) {
  const Laws& laws = local.laws();
  for (std::size_t b = 0; b < structure_.bodies().size(); ++b) {
    const FieldColumns* field = laws.field(b);
    if (field != nullptr && structure_.bodies()[b].active() > 0) {
      inside_.push_back({b, field->chaos.get(), tangent.first_active()[b]});
    }
  }
}

bool Coupled::possible(const Laws& laws) {
  if (laws.modes() < 2 || !laws.structure().communicator().alone() || !laws.linear() ||
      laws.structure().interface_unknowns() == 0) {
    return false;
  }
  const auto& bodies = laws.structure().bodies();
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const FieldColumns* field = laws.field(b);
    if (field != nullptr &&
        (field->chaos == nullptr || (bodies[b].active() > 0 && !bodies[b].condensed()))) {
      return false;
    }
  }
  return true;
}

Coupled::Unknowns Coupled::zero(Index columns) const {
  Unknowns unknowns{Matrix::Zero(tangent_.joined().active(), columns), {}};
  for (const Inside& each : inside_) {
    unknowns.inside.emplace_back(Matrix::Zero(body(each).size(), columns));
  }
  return unknowns;
}

Vector Coupled::products(const Unknowns& a, const Unknowns& b) const {
  Vector sums = Vector::Zero(groups_.count(a.active.cols()));
  add_products(groups_, a.active, b.active, sums);
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    const Index interior = body(inside_[i]).size() - body(inside_[i]).active();
    add_products(groups_, a.inside[i].topRows(interior), b.inside[i].topRows(interior), sums);
  }
  return sums;
}

/// Forces of the laws per area for jumps, (unknowns, c), without those that they have without jumps; and of the means.
void Coupled::springs(const Matrix& jumps, Matrix& forces) {
  multiply_sparse(tangent_.springs(), jumps, of_means_);
  of_means_ = tangent_.areas().cwiseInverse().asDiagonal() * of_means_;
  local_.forces_of_jumps(jumps, forces, asked_);
  if (at_rest_.size() > 0) {
    forces -= at_rest_;
  }
  for (Index column = 0; column < forces.cols(); ++column) {
    for (const Index row : rigid_) {
      forces(row, column) = of_means_(row, column);
    }
  }
}

/// What the laws answer to no jump, and which of them are rigid.
void Coupled::ask_at_rest(Index columns) {
  const Index unknowns = structure_.interface_unknowns();
  at_rest_.resize(unknowns, columns);
  asked_.clear();
  local_.forces_of_jumps(Matrix::Zero(unknowns, columns), at_rest_);
  for (const ActiveInterface& interface : structure_.interfaces()) {
    bool asked = false;
    for (Index row = interface.first_unknown; row < interface.first_unknown + interface.size();
         ++row) {
      if (at_rest_.row(row).allFinite()) {
        asked = true;
      } else {
        rigid_.push_back(row);
        at_rest_.row(row).setZero();
      }
    }
    asked_.push_back(asked);
  }
  if (at_rest_.isZero(0.0)) {
    at_rest_.resize(0, 0);
  }
}

Coupled::Unknowns Coupled::precondition(const Unknowns& forces) {
  Unknowns moved;
  Matrix load = forces.active;
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    Matrix& partial = moved.inside.emplace_back();
    load(rows_of(inside_[i]), every) = body(inside_[i]).reduce(forces.inside[i], partial);
  }
  moved.active = tangent_.solve(load);
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    moved.inside[i] =
        body(inside_[i])
            .expand(Matrix(moved.active(rows_of(inside_[i]), every)), std::move(moved.inside[i]));
  }
  return moved;
}

/// S (A - 1) of the bodies with factors.
void Coupled::add_scaled(const Unknowns& moved, Unknowns& forces) const {
  const Laws& laws = local_.laws();
  const auto& bodies = tangent_.joined().bodies();
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const ScaledColumns* scaled = laws.scaled(b);
    const Matrix& stiffness = bodies[b].stiffness;
    if (scaled == nullptr || stiffness.rows() == 0) {
      continue;
    }
    const auto rows = Eigen::seqN(tangent_.first_active()[b], stiffness.rows());
    const Matrix own = scaled->into(Matrix(moved.active(rows, every)));
    const Vector change = scaled->each(own.cols()).array() - 1.0;
    Matrix stressed(own.rows(), own.cols());
    stressed.noalias() = stiffness.selfadjointView<Eigen::Lower>() * own;
    stressed = stressed * change.asDiagonal();
    forces.active(rows, every) += scaled->back(stressed);
  }
}

/// What the system has beside that of the means.
void Coupled::add_change(const Unknowns& moved, Unknowns& forces) {
  multiply_sparse(tangent_.jumps(), moved.active, jumps_);
  springs(jumps_, between_);
  between_ -= of_means_;
  Matrix added(moved.active.rows(), moved.active.cols());
  multiply_sparse(nodal_, between_, added);
  forces.active += added;
  for (const Inside& each : inside_) {
    const Index active = body(each).active();
    forces.inside[static_cast<std::size_t>(&each - inside_.data())].bottomRows(active) +=
        added(rows_of(each), every);
  }
  add_scaled(moved, forces);
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    Matrix& own = forces.inside[i];
    inside_[i].field->add_change(moved.inside[i], own);
    forces.active(rows_of(inside_[i]), every) = own.bottomRows(body(inside_[i]).active());
  }
}

double Coupled::correct(double tolerance, int round, Vector& energies, MatrixRef residual,
                        MatrixRef moved) {
  const Index columns = residual.cols();
  if (!tangent_.symmetric()) {
    return 0.0;
  }
  tangent_.expect(columns);
  ask_at_rest(columns);
  if (!rigid_.empty()) {
    tolerance = std::max(tolerance, std::pow(of_rigid, round + 1));
  }
  const Index unknowns = structure_.interface_unknowns();
  jumps_.resize(unknowns, columns);
  of_means_.resize(unknowns, columns);
  between_ = Matrix::Zero(unknowns, columns);

  const Joined& joined = tangent_.joined();
  const Matrix half = 0.5 * residual;
  const Matrix apart = tangent_.sides() * (joined.directions().cwiseInverse().asDiagonal() * half);
  springs(apart, between_);
  Unknowns left = zero(columns);
  left.active =
      nodal_ * between_ + tangent_.traces().transpose() * (joined.weights().asDiagonal() * half);
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    left.inside[i] = inside_[i].field->left();
    auto own = left.inside[i].bottomRows(body(inside_[i]).active());
    own += left.active(rows_of(inside_[i]), every);
    left.active(rows_of(inside_[i]), every) = own;
  }
  const Unknowns load = left;
  Unknowns answer = zero(columns);
  Unknowns of_direction = left;  // the system of the means on it
  Unknowns preconditioned = precondition(left);
  Unknowns direction = preconditioned;
  Vector size = products(left, preconditioned);
  if (energies.size() != size.size()) {
    energies = Vector::Zero(size.size());
  }
  const auto each = [this](const auto& function, auto&... unknowns_of) {
    function(unknowns_of.active...);
    for (std::size_t i = 0; i < inside_.size(); ++i) {
      function(unknowns_of.inside[i]...);
    }
  };
  std::vector<Row> shares;
  std::vector<Row> falls;
  Vector of_step = Vector::Zero(size.size());
  for (Index count = 0; count < most_gradients; ++count) {
    Unknowns forces = of_direction;
    add_change(direction, forces);
    const Row work = of_solutions(groups_, products(direction, forces), columns);
    const Row before = of_solutions(groups_, size, columns);
    if (!work.allFinite() || (work.array() < 0.0).any()) {
      return 0.0;  // not springs
    }
    const Row share = (work.array() > 0.0).select(before.cwiseQuotient(work), 0.0);
    shares.push_back(share);
    each([&share](Matrix& a, const Matrix& b) { add_multiple(a, b, share); }, answer, direction);
    const Row less = -share;
    each([&less](Matrix& a, const Matrix& b) { add_multiple(a, b, less); }, left, forces);
    preconditioned = precondition(left);
    size = products(left, preconditioned);
    of_step = products(answer, load) - products(answer, left);
    const Vector sum = larger(energies, of_step);
    if ((size.array() <= small_enough(groups_, sum, tolerance).array()).all()) {
      break;
    }
    const Row now = of_solutions(groups_, size, columns);
    falls.emplace_back((before.array() > 0.0).select(now.cwiseQuotient(before), 0.0));
    const Row& kept = falls.back();
    each([&kept](Matrix& a, const Matrix& b) { multiply_and_add(a, kept, b); }, direction,
         preconditioned);
    each([&kept](Matrix& a, const Matrix& b) { multiply_and_add(a, kept, b); }, of_direction, left);
  }
  if (!answer.active.allFinite()) {
    return 0.0;
  }
  energies = larger(energies, of_step);
  for (std::size_t i = 0; i < inside_.size(); ++i) {
    inside_[i].field->advance(answer.inside[i]);
  }
  multiply_sparse(tangent_.traces(), answer.active, moved);
  multiply_sparse(tangent_.jumps(), answer.active, jumps_);
  springs(apart - jumps_, between_);
  residual = half + (joined.directions() - tangent_.holding()).asDiagonal() * moved +
             tangent_.sides().transpose() * between_;
  return largest_inverse(shares, falls);
}

}  // namespace latin::substructure
