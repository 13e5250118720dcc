#include "iteration/linearisation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "common/numbers.hpp"
#include "latin/common/error.hpp"
#include "substructure/coupled.hpp"
#include "substructure/interface_system.hpp"

namespace latin::iteration {
namespace {

using substructure::Tangent;

/// Columns that may each have a linearisation of their own.
constexpr std::size_t most_tangents = 16;
/// Slopes below this, relative to the stiffest possible, count as none.
constexpr double no_slope = 1e-9;
/// Forces of a column are measured with this fraction of the largest column at least.
constexpr double quiet_column = 1e-3;
/// Rounding of forces at faces, relative to their terms: of many inside the bodies; and of the forces in the bodies.
constexpr double rounding_of_faces = 1e-15;
constexpr double rounding_of_bodies = 2e-16;
/// Samples of what rounding may do.
constexpr Index rounding_samples = 3;
/// What was measured of one state and is said of others, too, in terms of itself.
constexpr double measured_again = 2.0;

constexpr const char* no_answer = "the linearised structure has no answer";

/// The slopes of the laws of all ranks in every column of a state, (unknowns, most components) each; of a chaos,
/// those of the mean stand for all modes of a step. Collective.
/// @throws NumericalError on all ranks if a law has no answer there
std::vector<Matrix> slopes_at(const substructure::Laws& laws, const State& state,
                              const substructure::Joined& joined) {
  const Index own = laws.modes() > 1 ? laws.steps() : state.data.cols();
  const substructure::InterfaceSystem system(laws);
  const Matrix jumps = system.free_jumps(state.data.leftCols(own), state.traces.leftCols(own));
  const Communicator& communicator = laws.structure().communicator();
  std::vector<Matrix> slopes;
  communicator.answer_together("a law has no answer at an iterate",
                               [&] { slopes = system.slopes_of_all(jumps, system.direct()); });
  if (communicator.alone()) {
    return slopes;
  }
  // in one message
  const Index most = joined.most_components();
  Matrix side_by_side = Matrix::Zero(system.unknowns(), own * most);
  for (Index column = 0; column < own; ++column) {
    const Matrix& each = slopes[static_cast<std::size_t>(column)];
    side_by_side.middleCols(column * most, each.cols()) = each;
  }
  side_by_side = joined.of_unknowns(side_by_side);
  for (Index column = 0; column < own; ++column) {
    slopes[static_cast<std::size_t>(column)] = side_by_side.middleCols(column * most, most);
  }
  return slopes;
}

/// The slopes of every point transposed, in place.
void transpose(std::vector<Matrix>& slopes, const substructure::Joined& joined) {
  for (Matrix& each : slopes) {
    for (const substructure::Joined::JoinedInterface& interface : joined.interfaces()) {
      for (Index i = 0; i < interface.size; i += interface.components) {
        each.block(interface.first_unknown + i, 0, interface.components, interface.components)
            .transposeInPlace();
      }
    }
  }
}

/// Slopes that differ by less are the same but for rounding of differences; and those of which steps leave no more than
/// this share of an error, which makes no factorisation worth its price.
constexpr double same = 1e-6;
constexpr double nearly_same = 1e-3;

/// Whether slopes differ by less than a share of the largest.
bool alike(const Matrix& a, const Matrix& b, double share) {
  return a.size() == b.size() && (a - b).cwiseAbs().maxCoeff<keep_nan>() <=
                                     share * std::max(a.cwiseAbs().maxCoeff(), 1e-300);
}

/// The factor between two stiffnesses, given as s / (1 + s) each.
double contrast(double a, double b) {
  const double one = std::abs(a) / std::max(1.0 - std::abs(a), no_slope) + no_slope;
  const double two = std::abs(b) / std::max(1.0 - std::abs(b), no_slope) + no_slope;
  return larger(one / two, two / one);
}

/// Sizes with any fixed signs without a pattern, of which there are as many as one likes.
void with_signs(Matrix& sizes, double unit, Index sample) {
  const double turn = 1.7 + 0.31 * static_cast<double>(sample);
  for (Index column = 0; column < sizes.cols(); ++column) {
    for (Index row = 0; row < sizes.rows(); ++row) {
      sizes(row, column) *=
          std::copysign(unit, std::sin(turn * static_cast<double>((row + 1) * (column + 3))));
    }
  }
}

}  // namespace

Linearisation::Slopes Linearisation::slopes_of(const substructure::Laws& laws,
                                               const State& state) const {
  Slopes slopes;
  for (Matrix& now : slopes_at(laws, state, tangents_.front()->joined())) {
    std::size_t at = 0;
    while (at < slopes.distinct.size() && !alike(slopes.distinct[at], now, same)) {
      ++at;
    }
    if (at == slopes.distinct.size()) {
      if (at == most_tangents) {
        at = most_tangents - 1;
      } else {
        slopes.distinct.push_back(std::move(now));
      }
    }
    slopes.of_column.push_back(at);
  }
  return slopes;
}

/// Every rank factorises the same matrices: they agree that all could.
void Linearisation::factorise(const std::vector<Matrix>& slopes, double hold,
                              const Communicator& communicator) {
  communicator.answer_together("the structure is not stable with the tangents of its laws", [&] {
    for (std::size_t i = 0; i < slopes.size(); ++i) {
      tangents_[i]->factorise(slopes[i], hold);
    }
  });
}

void Linearisation::take_transposed(const substructure::Laws& laws, const State& state) {
  know_structure(laws);
  Slopes slopes = slopes_of(laws, state);
  transpose(slopes.distinct, tangents_.front()->joined());
  take(laws, std::move(slopes), least_hold, same);
}

bool Linearisation::take(const substructure::Laws& laws, const State& state, double hold) {
  know_structure(laws);
  return take(laws, slopes_of(laws, state), hold, nearly_same);
}

void Linearisation::know_structure(const substructure::Laws& laws) {
  if (tangents_.empty()) {
    structure_ = laws.shared_structure();
    tangents_.push_back(std::make_shared<Tangent>(
        laws.structure(), std::make_shared<const substructure::Joined>(laws)));
  }
}

bool Linearisation::take(const substructure::Laws& laws, Slopes now, double hold, double share) {
  bool changed = now.distinct.size() != slopes_.size() || hold != hold_;
  for (std::size_t i = 0; i < now.distinct.size() && !changed; ++i) {
    changed = !alike(now.distinct[i], slopes_[i], share);
  }
  of_column_ = std::move(now.of_column);
  if (changed) {
    rounding_.resize(0, 0);
    slopes_.clear();  // if a factorisation fails there are none
    const std::shared_ptr<const substructure::Joined> joined = tangents_.front()->shared_joined();
    tangents_.resize(now.distinct.size());
    for (std::shared_ptr<Tangent>& each : tangents_) {
      if (!each || each.use_count() > 1) {  // a copy keeps its own
        each = std::make_shared<Tangent>(laws.structure(), joined);
      }
    }
    factorise(now.distinct, hold, laws.structure().communicator());
    slopes_ = std::move(now.distinct);
    hold_ = hold;
  }
  return changed;
}

bool Linearisation::near(const substructure::Laws& laws, const State& state) const {
  return std::ranges::all_of(contrasts(laws, state),
                             [](double contrast) { return contrast <= near_factor; });
}

std::vector<double> Linearisation::contrasts(const substructure::Laws& laws,
                                             const State& state) const {
  const auto own = static_cast<Index>(of_column_.size());
  const Tangent& any = *tangents_.front();
  std::vector<double> found;
  for (const Matrix& now : slopes_at(laws, state, any.joined())) {
    const auto column = static_cast<Index>(found.size());
    const Matrix& here = slopes_[of_column_[static_cast<std::size_t>(column % own)]];
    double largest = 1.0;
    for (Index row = 0; row < now.rows(); ++row) {
      // the stiffness of a point in its own direction
      const Index component = any.component(row);
      const double c = any.flexibility()(row);
      largest = larger(largest, contrast(c * now(row, component), c * here(row, component)));
    }
    found.push_back(largest);
  }
  laws.structure().communicator().follow_first(found);  // ranks decide by it
  return found;
}

const Matrix& Linearisation::rounding(const substructure::Laws& laws, const State& state,
                                      ConstMatrixRef amplitudes, const Whole& whole) {
  if (rounding_.rows() != whole.sizes.strain.rows()) {
    rounding_ = whole.relative_with_noise(rounding_sizes(laws, state, amplitudes));
  }
  return rounding_;
}

/// What rounding leaves of the bodies that measure it, in forces on the active unknowns of all ranks, (active, columns),
/// and a last column that is zero where it is not known; empty: it is known of none.
Matrix Linearisation::measured(const substructure::Laws& laws, const State& state,
                               ConstMatrixRef amplitudes) const {
  const substructure::Structure& structure = laws.structure();
  const auto& bodies = structure.bodies();
  if (structure.communicator().everywhere(
          std::ranges::none_of(bodies, &substructure::Body::measurable))) {
    return {};
  }
  Index active = 0;
  for (const substructure::Body& body : bodies) {
    active += body.rows() > 0 ? body.active() : 0;
  }
  Matrix own = Matrix::Zero(active, state.data.cols() + 1);  // the last column: whether it is known
  Index first = 0;
  const auto measure = [&](std::size_t b) {
    const substructure::Body& body = bodies[b];
    if (body.rows() == 0) {
      return;
    }
    if (body.measurable() && laws.scaled(b) == nullptr && laws.field(b) == nullptr) {
      auto rows = own.middleRows(first, body.active());
      rows.leftCols(state.data.cols()) =
          measured_again * body.defect(state.data.middleRows(structure.body_rows()[b], body.rows()),
                                       amplitudes, laws.response(b));
      rows.rightCols(1).setOnes();
    }
    first += body.active();
  };
  structure.communicator().answer_together(no_answer, [&] {
    for (std::size_t b = 0; b < bodies.size(); ++b) {
      measure(b);
    }
  });
  return tangents_.front()->joined().of_active(own);
}

substructure::Sizes Linearisation::rounding_sizes(const substructure::Laws& laws,
                                                  const State& state,
                                                  ConstMatrixRef amplitudes) const {
  const substructure::Structure& structure = laws.structure();
  const substructure::ColumnGroups groups = laws.groups();
  Tangent& tangent = *tangents_.front();
  const Matrix of_faces =
      state.data.cwiseAbs() + structure.directions().asDiagonal() * state.traces.cwiseAbs();
  const Matrix of_bodies = tangent.inner_forces(state.traces);
  const Matrix known = measured(laws, state, amplitudes);
  substructure::Sizes sizes = substructure::Sizes::zero(
      groups.count(of_faces.cols()), static_cast<Index>(structure.bodies().size()));
  // one sample may by chance leave alone the softest motion of a body
  for (Index sample = 0; sample < rounding_samples; ++sample) {
    substructure::Sizes one = substructure::Sizes::zero(sizes.strain.rows(), sizes.strain.cols());
    Matrix data = of_faces;
    with_signs(data, rounding_of_faces, sample);
    Matrix forces = of_bodies;
    with_signs(forces, rounding_of_bodies, sample);
    for (Index row = 0; row < known.rows(); ++row) {
      if (known(row, forces.cols()) > 0.0) {
        forces.row(row) = known.row(row).head(forces.cols());
      }
    }
    forces += tangent.nodal(data);
    Matrix moved(data.rows(), data.cols());
    Matrix answer;
    structure.communicator().answer_together(
        no_answer, [&] { answer = tangent.respond(forces, data, moved); });
    for (Index b = 0; b < sizes.strain.cols(); ++b) {
      const auto at = static_cast<std::size_t>(b);
      for (Index column = 0; column < forces.cols(); ++column) {
        one.strain(groups.of(column), b) += tangent.strain(b, answer.col(column));
        one.trace(groups.of(column), b) += structure.trace_size(
            at,
            moved.col(column).segment(structure.body_rows()[at], structure.bodies()[at].rows()));
      }
    }
    sizes.strain = larger(sizes.strain, one.strain);
    sizes.trace = larger(sizes.trace, one.trace);
  }
  if (const substructure::PatternTimes* in_time = laws.in_time()) {
    return in_time->bounds(sizes, groups.kinds());
  }
  return sizes;
}

double Linearisation::imbalance(const substructure::Laws& laws, const State& state,
                                const Matrix& residual, double rounding) const {
  const substructure::Structure& structure = laws.structure();
  const Matrix forces = nodal(state.data - structure.directions().asDiagonal() * state.traces);
  const Matrix left = nodal(0.5 * residual);
  const Matrix data = nodal(state.data);
  const std::vector<Index>& first = tangents_.front()->first_active();
  // what is rounding of rounding of others is no force
  constexpr double epsilon = std::numeric_limits<double>::epsilon();
  const double most = data.size() > 0 ? data.cwiseAbs().maxCoeff<keep_nan>() : 0.0;
  const double nothing = structure.communicator().largest(epsilon * epsilon * most);
  const auto beyond_rounding_of = [&](const Matrix& terms) {
    double largest = 0.0;
    for (std::size_t b = 0; b + 1 < first.size(); ++b) {
      const auto rows = Eigen::seq(first[b], first[b + 1] - 1);
      const Eigen::RowVectorXd sizes = forces(rows, every).colwise().norm();
      const Eigen::RowVectorXd missing = left(rows, every).colwise().norm();
      const double least = quiet_column * largest_of(sizes, 0.0);
      for (Index column = 0; column < sizes.size(); ++column) {
        const double size = larger(sizes(column), least);
        if (!(size <= nothing) && !(missing(column) <= rounding * terms.col(column)(rows).norm())) {
          largest = larger(largest, missing(column) / size);
        }
      }
    }
    return structure.communicator().agreed(largest);
  };
  const double largest = beyond_rounding_of(data);
  if (largest == 0.0) {
    return largest;
  }
  // the forces of a body that is held all around cancel at its nodes: rounding is that of forces that do not
  Matrix apart = state.data;
  with_signs(apart, 1.0, 0);
  return beyond_rounding_of(data.cwiseAbs().cwiseMax(nodal(apart).cwiseAbs()));
}

void Linearisation::correct(MatrixRef residual, Matrix& moved) const {
  moved.resize(residual.rows(), residual.cols());
  if (tangents_.size() == 1) {
    tangents_.front()->correct(residual, moved);
    return;
  }
  const auto own = of_column_.size();
  const Matrix half = tangents_.front()->joined().of_rows(0.5 * residual);
  const auto correct_columns_of = [&](std::size_t i) {
    std::vector<Index> columns;
    for (Index column = 0; column < residual.cols(); ++column) {
      if (of_column_[static_cast<std::size_t>(column) % own] == i) {
        columns.push_back(column);
      }
    }
    const auto count = static_cast<Index>(columns.size());
    Matrix block(residual.rows(), count);
    Matrix change(residual.rows(), count);
    tangents_[i]->correct_all(half(every, columns), block, change);
    residual(every, columns) = block;
    moved(every, columns) = change;
  };
  structure_->communicator().answer_together(no_answer, [&] {
    for (std::size_t i = 0; i < tangents_.size(); ++i) {
      correct_columns_of(i);
    }
  });
}

Matrix Linearisation::correct_each(const substructure::Laws& laws, const State& state,
                                   const Matrix& basis, const Vector& fall, MatrixRef residual,
                                   Matrix& moved) const {
  if (tangents_.size() != 1 || !laws.structure().communicator().alone()) {
    return {};
  }
  moved.resize(residual.rows(), residual.cols());
  return tangents_.front()->correct_each(slopes_at(laws, state, tangents_.front()->joined()), basis,
                                         fall, residual, moved);
}

double Linearisation::correct_coupled(substructure::LocalStage& local, double tolerance, int round,
                                      Vector& energies, MatrixRef residual, Matrix& moved) const {
  if (tangents_.size() != 1 || !substructure::Coupled::possible(local.laws())) {
    return 0.0;
  }
  moved.resize(residual.rows(), residual.cols());
  return substructure::Coupled(*tangents_.front(), local)
      .correct(tolerance, round, energies, residual, moved);
}

}  // namespace latin::iteration
