#include "substructure/tangent.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "algebra/inverse.hpp"
#include "algebra/sparse_product.hpp"
#include "common/numbers.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// A rigid connection is this many times as stiff as the search directions of its sides together, and as a node of
/// the stiffer side: more is rounding of forces, less lets the stiffer side deform as it likes.
constexpr double rigid_in_series = 1e5;
constexpr double rigid_beside_nodes = 1e2;
/// Shape functions, and areas of nodes relative to that of a point, below this are rounding.
constexpr double least_area = 1e-3;
/// And no stiffer than this leaves digits for.
constexpr double stiffest_rigid = 1.0 - 1e-12;
/// Springs that are stiffer keep their own stiffness but for this fraction, and rigid connections are that much
/// stiffer than they, as long as it is below so many times that of a node: bodies that move as if they were rigid may
/// hang on such springs alone.
constexpr double off_springs = 1e-3;
constexpr double springs_beside_nodes = 1e7;
/// Slopes closer than this are the same: they may come from differences.
constexpr double same_slope = 1e-6;
/// Where more of the matrix is filled than this, it is dense.
constexpr double filled = 0.3;
/// Springs below this, relative to the search direction, are rounding of the body's stiffness.
constexpr double of_rounding = 1e-14;
/// Sums that springs glued into a body round in, until it is condensed.
constexpr double glued_sums = 10.0;
/// Steps of conjugate gradients at most.
constexpr Index most_search_gradients = 60;
/// Steps that there will be at least, usually.
constexpr Index some_gradients = 8;
/// Operations of the check that nobody notices, and those beside the factorisations of the bodies.
constexpr double negligible = 2e8;
constexpr double affordable = 0.1;
/// The same of a search, without which there is no answer: of what is condensed once, for steps that may cost less.
constexpr double bearable_alone = 2e11;
constexpr double bearable_beside = 3.0;

constexpr const char* linearised = "the linearised structure";
constexpr const char* not_stable = "the structure is not stable with the tangents of its laws";

/// A tangent K from a slope R = df / dj0 at the flexibilities c: K = (1 - R c)^-1 R, bounded.
/// @param rigid what slopes are reduced by
Matrix tangent_of(const Matrix& slope, const Vector& flexibility, double rigid) {
  const Matrix bounded = rigid * slope;
  if (slope.rows() == 1) {
    return bounded / (1.0 - bounded(0, 0) * flexibility(0));
  }
  const Matrix open =
      Matrix::Identity(slope.rows(), slope.cols()) - bounded * flexibility.asDiagonal();
  return open.partialPivLu().solve(bounded);
}

/// Whether a tangent is that of springs.
bool of_springs(const Matrix& tangent) {
  return tangent.diagonal().minCoeff() >= 0.0 &&
         (tangent - tangent.transpose()).cwiseAbs().maxCoeff<keep_nan>() <=
             same_slope * tangent.cwiseAbs().maxCoeff();
}

/// Product with the matrix whose lower triangle is given; BLAS refuses those of parts without active unknowns.
Vector symmetric_times(const Matrix& lower, const Vector& x) {
  return lower.rows() > 0 ? Vector(lower.selfadjointView<Eigen::Lower>() * x) : Vector(x);
}

}  // namespace

bool Tangent::possible(const Structure& structure) {
  const Structure::Work& work = structure.work();
  return structure.total_rows() > 0 &&
         work.condense <= std::max(negligible, affordable * work.factorise);
}

bool Tangent::bearable(const Structure& structure) {
  const Structure::Work& work = structure.work();
  return structure.total_rows() > 0 &&
         work.condense <= std::max(bearable_alone, bearable_beside * work.factorise);
}

Tangent::Tangent(const Structure& structure)
    : Tangent(structure, std::make_shared<const Joined>(structure)) {}

Tangent::Tangent(const Structure& structure, std::shared_ptr<const Joined> joined)
    : structure_(structure),
      joined_(std::move(joined)),
      active_(joined_->active()),
      most_components_(joined_->most_components()) {
  Triplets traces;
  double entries = 0.0;
  for (std::size_t b = 0; b < joined_->bodies().size(); ++b) {
    const Joined::JoinedBody& body = joined_->bodies()[b];
    const Index first = joined_->first_active()[b];
    for (Index i = 0; i < body.traces.rows(); ++i) {
      for (SparseRows::InnerIterator it(body.traces, i); it; ++it) {
        traces.emplace_back(static_cast<int>(body.first_row + i),
                            static_cast<int>(first + it.col()), it.value());
      }
    }
    entries += static_cast<double>(body.stiffness.size());
  }
  dense_ = entries > filled * static_cast<double>(active_ * active_);
  traces_ = algebra::sparse_of(traces, joined_->rows(), active_, linearised);
  const Index unknowns = joined_->unknowns();
  areas_.resize(unknowns);
  flexibility_.resize(unknowns);
  rigid_.resize(unknowns);
  springs_.resize(unknowns);
  Triplets sides;
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    for (Index i = 0; i < interface.size; ++i) {
      component_.push_back(i % interface.components);
    }
    areas_.segment(interface.first_unknown, interface.size) = interface.weights;
    flexibility_.segment(interface.first_unknown, interface.size) = interface.flexibility;
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      for (Index i = 0; i < interface.size; ++i) {
        sides.emplace_back(static_cast<int>(interface.first_unknown + i),
                           static_cast<int>(interface.rows[s] + i), s == 0 ? -1.0 : 1.0);
      }
    }
  }
  sides_ = algebra::sparse_of(sides, unknowns, joined_->rows(), linearised);
  set_rigid();
  jumps_ = sides_ * traces_;
  to_unknowns_ = traces_.transpose();
}

/// Bounds of what slopes of the laws may be.
void Tangent::set_rigid() {
  // stiffness of the nodes in the units of the rows, of each its own: rows are measured by what stretches like them
  const Vector units = joined_->weights().cwiseProduct(joined_->scales());
  const Vector& levers = joined_->levers();
  const Vector of_nodes = traces_.cwiseAbs().transpose() * units.cwiseProduct(levers);
  const Vector stiffness = diagonal();
  Vector of_rows = Vector::Zero(joined_->rows());
  for (Index row = 0; row < traces_.rows(); ++row) {
    for (SparseRows::InnerIterator it(traces_, row); it; ++it) {
      // nodes that see next to nothing of the interface have no say
      const double unit =
          std::max(of_nodes(it.col()), least_area * units(row) * levers(row) * levers(row));
      if (unit > 0.0) {
        of_rows(row) = std::max(of_rows(row), joined_->scales()(row) * stiffness(it.col()) / unit);
      }
    }
  }
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    for (Index i = 0; i < interface.size; ++i) {
      double stiffest = 0.0;
      for (const Index row : interface.rows) {
        stiffest = std::max(stiffest, of_rows(row + i));
      }
      const double nodes = stiffest * interface.flexibility(i);
      const auto bound = [](double most) { return std::min(most / (1.0 + most), stiffest_rigid); };
      rigid_(interface.first_unknown + i) =
          bound(std::max(rigid_in_series, rigid_beside_nodes * nodes));
      springs_(interface.first_unknown + i) =
          bound(std::max(rigid_in_series, springs_beside_nodes * nodes));
    }
  }
}

/// J^T W K J and what holds the bodies.
SparseRows Tangent::joined_springs() const {
  const Vector holding = joined_->weights().cwiseProduct(holding_);
  return SparseRows(jumps_.transpose() * SparseRows(tangent_ * jumps_)) +
         SparseRows(traces_.transpose() * SparseRows(holding.asDiagonal() * traces_));
}

/// The stiffest of the springs that are no rigid connections, relative to the search directions of its sides together.
double Tangent::stiffest_spring(const Matrix& slopes) const {
  double stiffest = 0.0;
  for (Index row = 0; row < slopes.rows(); ++row) {
    const double own = slopes(row, component(row)) * flexibility_(row);
    if (own < stiffest_rigid) {
      stiffest = std::max(stiffest, own / (1.0 - own));
    }
  }
  return stiffest;
}

/// What slopes of a point are reduced by.
double Tangent::reduction(const Matrix& slope, Index first, double stiffest_spring) const {
  double own = 0.0;
  for (Index i = 0; i < slope.rows(); ++i) {
    own = std::max(own, slope(i, i) * flexibility_(first + i));
  }
  const double stiffness = own < stiffest_rigid ? own / (1.0 - own) : stiffest_spring;
  const double most = stiffness / off_springs;
  return std::max(rigid_.segment(first, slope.rows()).maxCoeff(),
                  std::min(most / (1.0 + most), springs_.segment(first, slope.rows()).maxCoeff()));
}

Matrix Tangent::tangent_at(const Matrix& slopes, const Joined::JoinedInterface& interface,
                           Index first, double stiffest_spring) const {
  const Index components = interface.components;
  const Matrix slope = slopes.block(first, 0, components, components);
  return tangent_of(slope, flexibility_.segment(first, components),
                    reduction(slope, first, stiffest_spring));
}

/// W K of the points.
void Tangent::set_tangents(
    const std::function<Matrix(const Joined::JoinedInterface&, Index)>& of_point) {
  Triplets entries;
  symmetric_ = true;
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    const Index components = interface.components;
    for (Index point = 0; point < interface.size / components; ++point) {
      const Index first = interface.first_unknown + components * point;
      const Matrix tangent = of_point(interface, first);
      const double size = tangent.cwiseAbs().maxCoeff();
      for (Index a = 0; a < components; ++a) {
        symmetric_ = symmetric_ && tangent(a, a) >= 0.0;
        for (Index b = 0; b < components; ++b) {
          symmetric_ = symmetric_ && std::abs(tangent(a, b) - tangent(b, a)) <= same_slope * size;
          if (tangent(a, b) != 0.0) {
            const double entry = areas_(first) * tangent(a, b);
            entries.emplace_back(static_cast<int>(first + a), static_cast<int>(first + b), entry);
          }
        }
      }
    }
  }
  tangent_ = algebra::sparse_of(entries, areas_.size(), areas_.size(), linearised);
}

SparseColumns Tangent::assemble() const {
  Triplets entries;
  Index first = 0;
  for (const Joined::JoinedBody& body : joined_->bodies()) {
    const Matrix& each = body.stiffness;
    for (Index column = 0; column < each.cols(); ++column) {
      for (Index row = column; row < each.rows(); ++row) {
        entries.emplace_back(static_cast<int>(first + row), static_cast<int>(first + column),
                             each(row, column));
      }
    }
    first += each.rows();
  }
  count_of_entries(static_cast<Index>(entries.size()), linearised);
  SparseColumns matrix(active_, active_);
  matrix.setFromTriplets(entries.begin(), entries.end());
  const SparseColumns joined = joined_springs();
  if (symmetric_) {
    return matrix + SparseColumns(joined.triangularView<Eigen::Lower>());
  }
  return SparseColumns(matrix.selfadjointView<Eigen::Lower>()) + joined;
}

Matrix Tangent::assemble_dense() const {
  Matrix matrix = Matrix::Zero(active_, active_);
  Index first = 0;
  for (const Joined::JoinedBody& body : joined_->bodies()) {
    const Matrix& each = body.stiffness;
    matrix.block(first, first, each.rows(), each.cols()) = each.selfadjointView<Eigen::Lower>();
    first += each.rows();
  }
  const SparseRows joined = joined_springs();
  for (Index row = 0; row < joined.rows(); ++row) {
    for (SparseRows::InnerIterator it(joined, row); it; ++it) {
      matrix(row, it.col()) += it.value();
    }
  }
  return matrix;
}

/// What factorise_sparse() refuses is refused here: the answer must not depend on how much of the matrix is filled.
void Tangent::factorise_dense() {
  const Matrix matrix = assemble_dense();
  if (symmetric_) {
    cholesky_.compute(matrix);
    symmetric_ = algebra::is_definite(cholesky_, matrix.diagonal());
    if (symmetric_) {
      return;
    }  // not definite, yet there may be an answer
  }
  lu_.compute(matrix);
  if (!algebra::has_pivots(lu_)) {
    throw NumericalError(not_stable);
  }
}

void Tangent::factorise_sparse() {
  factor_ = nullptr;
  general_ = nullptr;
  if (symmetric_) {
    try {
      factor_ = algebra::factorise(SparseRows(assemble()), 0, algebra::FactorBackend::automatic,
                                   "structure of the check");
      return;
    } catch (const NumericalError&) {
      symmetric_ = false;  // not definite, yet there may be an answer
    }
  }
  try {
    general_ = std::make_unique<algebra::GeneralFactor>(assemble());
  } catch (const NumericalError&) {
    throw NumericalError(not_stable);
  }
}

void Tangent::invert() {
  inverse_ = symmetric_ ? algebra::inverse_of_factored(cholesky_.matrixLLT())
                        : Matrix(lu_.solve(Matrix::Identity(active_, active_)));
}

Matrix Tangent::solve(const Matrix& load) {
  solved_ += load.cols();
  if (dense_ && inverse_.size() == 0 && solved_ > 2 * active_) {
    // products are several times as fast as triangular solves: by now forming it is paid for
    invert();
  }
  if (inverse_.size() > 0) {
    return inverse_ * load;
  }
  if (dense_) {
    return symmetric_ ? Matrix(cholesky_.solve(load)) : Matrix(lu_.solve(load));
  }
  return symmetric_ ? factor_->solve(load) : Matrix(general_->solve(load));
}

void Tangent::factorise(const Matrix& slopes, double hold) {
  if (hold == hold_ && slopes_.size() == slopes.size() &&
      ((slopes_ - slopes).array().abs().colwise() * flexibility_.array()).maxCoeff<keep_nan>() <=
          same_slope) {
    return;
  }
  hold_with(hold);
  const double stiffest = stiffest_spring(slopes);
  softened_ = false;
  for (Index row = 0; row < slopes.rows() && !softened_; ++row) {
    softened_ = slopes(row, component(row)) * flexibility_(row) >= stiffest_rigid;
  }
  set_tangents([&](const Joined::JoinedInterface& interface, Index first) {
    return tangent_at(slopes, interface, first, stiffest);
  });
  combine();
  inverse_.resize(0, 0);
  solved_ = 0;
  if (dense_) {
    factorise_dense();
  } else {
    factorise_sparse();
  }
  slopes_ = slopes;
}

void Tangent::hold_with(double hold) {
  slopes_.resize(0, 0);
  hold_ = hold;
  holding_ = hold * joined_->directions();
  if (hold <= least_hold) {
    // a soft body beside a stiff one must not feel the springs of the stiff one, which are above rounding of its own
    const double softest = joined_->directions().cwiseQuotient(joined_->scales()).minCoeff();
    holding_ = (of_rounding * joined_->directions())
                   .cwiseMax(hold * softest * joined_->scales())
                   .cwiseMin(holding_);
  }
}

Vector Tangent::diagonal() const {
  Vector diagonal(active_);
  for (std::size_t b = 0; b < joined_->bodies().size(); ++b) {
    const Matrix& own = joined_->bodies()[b].stiffness;
    diagonal.segment(joined_->first_active()[b], own.rows()) = own.diagonal();
  }
  return diagonal;
}

/// What correct() multiplies with: all of it but the factor, in three matrices.
void Tangent::combine() {
  const Vector& weights = joined_->weights();
  const Vector inverse_directions = joined_->directions().cwiseInverse();
  const SparseRows jump_of_residual = sides_ * SparseRows(inverse_directions.asDiagonal());
  const SparseRows per_area =
      sides_.transpose() * SparseRows(areas_.cwiseInverse().asDiagonal() * tangent_);
  load_ = SparseRows(traces_.transpose() * SparseRows(weights.asDiagonal())) +
          SparseRows(jumps_.transpose() * SparseRows(tangent_ * jump_of_residual));
  // the springs that hold the bodies act as forces of the interfaces
  const Vector held = joined_->directions() - holding_;
  of_answer_ = SparseRows(held.asDiagonal() * traces_) - SparseRows(per_area * jumps_);
  of_residual_ = per_area * jump_of_residual;
}

void Tangent::correct(MatrixRef residual, MatrixRef moved) {
  if (structure_.communicator().alone()) {
    const Matrix half = 0.5 * residual;
    Matrix load(active_, half.cols());
    algebra::multiply_sparse(load_, half, load);
    const Matrix answer = solve(load);
    algebra::multiply_sparse(traces_, answer, moved);
    Matrix added(half.rows(), half.cols());
    algebra::multiply_sparse(of_answer_, answer, added);
    residual = half + added;
    algebra::multiply_sparse(of_residual_, half, added);
    residual += added;
    return;
  }
  const Matrix half = joined_->of_rows(0.5 * residual);
  structure_.communicator().answer_together("the linearised structure has no answer",
                                            [&] { correct_all(half, residual, moved); });
}

void Tangent::correct_all(const Matrix& half, MatrixRef step, MatrixRef moved) {
  const Matrix answer = solve(load_ * half);
  step = own(half + of_answer_ * answer + of_residual_ * half);
  moved = own(traces_ * answer);
}

/// W K of every column, side by side, (unknowns, columns times most components). @return whether all are springs
bool Tangent::own_tangents(const std::vector<Matrix>& slopes, Matrix& stiffness) const {
  const auto columns = static_cast<Index>(slopes.size());
  stiffness = Matrix::Zero(areas_.size(), columns * most_components_);
  for (Index column = 0; column < columns; ++column) {
    const Matrix& own = slopes[static_cast<std::size_t>(column)];
    const double stiffest = stiffest_spring(own);
    for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
      const Index components = interface.components;
      for (Index first = interface.first_unknown; first < interface.first_unknown + interface.size;
           first += components) {
        const Matrix slope = own.block(first, 0, components, components);
        auto into = stiffness.block(first, column * most_components_, components, components);
        if (slope.isDiagonal(0.0)) {
          // steps are to lead to the answer: only what is all but rigid is made softer
          const double rigid = reduction(slope, first, stiffest);
          for (Index i = 0; i < components; ++i) {
            const double bounded = std::min(slope(i, i), rigid / flexibility_(first + i));
            if (!(bounded >= 0.0)) {
              return false;
            }
            into(i, i) = areas_(first) * bounded / (1.0 - bounded * flexibility_(first + i));
          }
          continue;
        }
        const Matrix tangent = tangent_at(own, interface, first, stiffest);
        if (!of_springs(tangent)) {
          return false;
        }
        into = areas_(first) * tangent;
      }
    }
  }
  return true;
}

/// J' of rows: their differences between the sides.
void Tangent::subtract_sides(const Matrix& rows, Matrix& jumps) const {
  jumps.setZero();
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    auto own = jumps.middleRows(interface.first_unknown, interface.size);
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      const auto of_side = rows.middleRows(interface.rows[s], interface.size);
      if (s == 0) {
        own -= of_side;
      } else {
        own += of_side;
      }
    }
  }
}

/// Add J'^T of forces between the sides.
void Tangent::add_to_sides(const Matrix& between, Matrix& rows) const {
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    const auto own = between.middleRows(interface.first_unknown, interface.size);
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      auto of_side = rows.middleRows(interface.rows[s], interface.size);
      if (s == 0) {
        of_side -= own;
      } else {
        of_side += own;
      }
    }
  }
}

/// Of all columns, with stiffnesses from own_tangents(), or with one for all.
void Tangent::add_spring_forces(const Matrix& stiffness, const Matrix& jumps,
                                Matrix& forces) const {
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    const Index components = interface.components;
    const bool one = stiffness.cols() == most_components_;
    for (Index column = 0; column < jumps.cols(); ++column) {
      for (Index b = 0; b < components; ++b) {
        const double* of_component = &stiffness(0, (one ? 0 : column) * most_components_ + b);
        for (Index first = interface.first_unknown;
             first < interface.first_unknown + interface.size; first += components) {
          const double jump = jumps(first + b, column);
          for (Index a = 0; a < components; ++a) {
            forces(first + a, column) += of_component[first + a] * jump;
          }
        }
      }
    }
  }
}

void Tangent::add_body_forces(const Matrix& moved, Matrix& forces) const {
  for (std::size_t b = 0; b < joined_->bodies().size(); ++b) {
    const Matrix& own = joined_->bodies()[b].stiffness;
    const auto at = Eigen::seqN(joined_->first_active()[b], own.rows());
    if (own.rows() > 0) {
      forces(at, every).noalias() += own.selfadjointView<Eigen::Lower>() * moved(at, every);
    }
  }
}

/// The displacements in a basis that are best in the energies of all columns.
Matrix Tangent::best_in(const Matrix& basis, const Matrix& stiffness, const Vector& holding,
                        const Matrix& load) const {
  Matrix best = Matrix::Zero(active_, load.cols());
  if (basis.cols() == 0) {
    return best;
  }
  Matrix forces = Matrix::Zero(active_, basis.cols());
  add_body_forces(basis, forces);
  const Matrix rows = traces_ * basis;
  const Matrix common =
      basis.transpose() * forces + rows.transpose() * (holding.asDiagonal() * rows);
  const Matrix jumps = sides_ * rows;
  const Matrix loads = basis.transpose() * load;
  Matrix of_springs(jumps.rows(), jumps.cols());
  Matrix shares = Matrix::Zero(basis.cols(), load.cols());
  for (Index column = 0; column < load.cols(); ++column) {
    of_springs.setZero();
    add_spring_forces(stiffness.middleCols(column * most_components_, most_components_), jumps,
                      of_springs);
    Matrix whole = common;
    whole.noalias() += jumps.transpose() * of_springs;
    const Eigen::LLT<Matrix> factor(whole);
    if (factor.info() == Eigen::Success) {
      shares.col(column) = factor.solve(loads.col(column));
    }
  }
  best.noalias() = basis * shares;
  return best;
}

Matrix Tangent::correct_each(const std::vector<Matrix>& slopes, const Matrix& basis,
                             const Vector& fall, MatrixRef residual, MatrixRef moved) {
  const Index columns = residual.cols();
  Matrix stiffness;
  if (!symmetric_ || !own_tangents(slopes, stiffness)) {
    return {};
  }
  const Vector holding = joined_->weights().cwiseProduct(holding_);
  Matrix rows(traces_.rows(), columns);
  Matrix jumps(sides_.rows(), columns);
  Matrix between(sides_.rows(), columns);
  // of forces (rows) and of those of the springs: the forces on the active unknowns
  const auto nodal_forces = [&](const Matrix& of_jumps, Matrix& forces) {
    between.setZero();
    add_spring_forces(stiffness, of_jumps, between);
    add_to_sides(between, rows);
    algebra::multiply_sparse(to_unknowns_, rows, forces);
  };
  const auto multiply = [&](const Matrix& answer, Matrix& forces) {
    algebra::multiply_sparse(traces_, answer, rows);
    subtract_sides(rows, jumps);
    rows = holding.asDiagonal() * rows;
    nodal_forces(jumps, forces);
    add_body_forces(answer, forces);
  };

  const Matrix half = 0.5 * residual;
  Matrix apart(sides_.rows(), columns);
  subtract_sides(joined_->directions().cwiseInverse().asDiagonal() * half, apart);
  Matrix left(active_, columns);
  rows = joined_->weights().asDiagonal() * half;
  nodal_forces(apart, left);
  Matrix preconditioned = solve(left);
  Eigen::RowVectorXd size = left.cwiseProduct(preconditioned).colwise().sum();
  const Eigen::RowVectorXd enough = size.cwiseProduct(fall.cwiseAbs2().transpose());
  Matrix forces(active_, columns);
  Matrix answer = best_in(basis, stiffness, holding, left);
  if (basis.cols() > 0) {
    multiply(answer, forces);
    left -= forces;
    preconditioned = solve(left);
    size = left.cwiseProduct(preconditioned).colwise().sum();
  }
  Matrix direction = preconditioned;
  for (Index count = 0; count < most_search_gradients && (size.array() > enough.array()).any();
       ++count) {
    multiply(direction, forces);
    const Eigen::RowVectorXd work = direction.cwiseProduct(forces).colwise().sum();
    const Eigen::RowVectorXd share = (work.array() > 0.0).select(size.cwiseQuotient(work), 0.0);
    answer += direction * share.asDiagonal();
    left -= forces * share.asDiagonal();
    preconditioned = solve(left);
    const Eigen::RowVectorXd now = left.cwiseProduct(preconditioned).colwise().sum();
    const Eigen::RowVectorXd kept = (size.array() > 0.0).select(now.cwiseQuotient(size), 0.0);
    direction = preconditioned + direction * kept.asDiagonal();
    size = now;
  }
  algebra::multiply_sparse(traces_, answer, rows);
  moved = rows;
  subtract_sides(rows, jumps);
  jumps = apart - jumps;
  between.setZero();
  add_spring_forces(stiffness, jumps, between);
  between = areas_.cwiseInverse().asDiagonal() * between;
  rows = half + (joined_->directions() - holding_).asDiagonal() * moved;
  add_to_sides(between, rows);
  residual = rows;
  return answer;
}

void Tangent::expect(Index columns) {
  if (dense_ && inverse_.size() == 0 && some_gradients * columns > 2 * active_) {
    invert();
  }
}

Matrix Tangent::respond(const Matrix& forces, MatrixRef data, MatrixRef moved) {
  Matrix answer = solve(forces);
  moved = own(traces_ * answer);
  data = own(of_answer_ * answer);
  return answer;
}

double Tangent::strain(Index body, ConstVectorRef moved) const {
  const auto at = static_cast<std::size_t>(joined_->first_body() + body);
  const Matrix& stiffness = joined_->bodies()[at].stiffness;
  const auto of_body = moved.segment(joined_->first_active()[at], stiffness.rows());
  return std::max(of_body.dot(symmetric_times(stiffness, of_body)), 0.0);
}

Matrix Tangent::inner_forces(const Matrix& traces) const {
  const Matrix all = joined_->of_rows(traces);
  Matrix forces(active_, traces.cols());
  for (std::size_t b = 0; b < joined_->bodies().size(); ++b) {
    const Joined::JoinedBody& body = joined_->bodies()[b];
    const auto rows = Eigen::seqN(body.first_row, body.traces.rows());
    // what is glued into a body may be stiffer than its faces, and is added up with it more than once
    const Vector diagonal = body.stiffness.diagonal().cwiseMax(glued_sums * body.stiffest);
    for (Index column = 0; column < traces.cols(); ++column) {
      const auto moved = all.col(column)(rows).cwiseQuotient(joined_->levers()(rows));
      const double largest = moved.size() > 0 ? moved.cwiseAbs().maxCoeff() : 0.0;
      forces.col(column).segment(joined_->first_active()[b], diagonal.size()) = largest * diagonal;
    }
  }
  return forces;
}

}  // namespace latin::substructure
