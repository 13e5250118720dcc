#include "substructure/interface_system.hpp"

#include <algorithm>
#include <array>
#include <memory>
#include <utility>

#include "common/exchange.hpp"
#include "substructure/local_stage.hpp"

namespace latin::substructure {
namespace {

/// Steps of the difference quotients, as shares of the free jump. The short one seldom crosses a
/// branch of the law, the long one has no rounding to speak of and is taken where both agree to
/// `same_slope` (in 1 / flexibility): within a branch most laws are linear.
constexpr std::array<double, 2> differences{1e-7, 1e-3};
constexpr double same_slope = 1e-7;
/// Jumps of a point below this fraction of the largest are rounding to the difference quotients.
constexpr double least_jump = 1e-3;

/// How large jumps (rows, c) are at each point, and no less than a fraction of the largest of the column, (rows, c).
/// @param unit where there is none at all
Matrix sizes_of_points(const Matrix& jumps, Index components, double unit) {
  Matrix sizes(jumps.rows(), jumps.cols());
  for (Index column = 0; column < jumps.cols(); ++column) {
    const double largest = jumps.col(column).cwiseAbs().maxCoeff();
    for (Index first = 0; first < jumps.rows(); first += components) {
      const double own = jumps.col(column).segment(first, components).cwiseAbs().maxCoeff();
      sizes.col(column)
          .segment(first, components)
          .setConstant(largest > 0.0 ? std::max(own, least_jump * largest) : unit);
    }
  }
  return sizes;
}

}  // namespace

bool InterfaceSystem::suits(const Laws& laws) {
  return laws.structure().communicator().everywhere(!laws.transformed()) &&
         !laws.linear_everywhere() && !laws.scales_anywhere();
}

InterfaceSystem::InterfaceSystem(Laws laws) : laws_(std::move(laws)), direct_(unknowns()) {
  for (const ActiveInterface& interface : laws_.structure().interfaces()) {
    const Index components = interface.geometry.components;
    for (Index row = 0; row < interface.size(); ++row) {
      layout_.first.push_back(interface.first_unknown + row - row % components);
      layout_.components.push_back(components);
    }
    direct_.segment(interface.first_unknown, interface.size()) = interface.flexibility;
  }
}

Vector InterfaceSystem::law_flexibility(const Vector& wanted) const {
  Vector result = wanted;
  for (const ActiveInterface& interface : laws_.structure().interfaces()) {
    if (!interface.geometry.law->monotone()) {
      auto own = result.segment(interface.first_unknown, interface.size());
      own = own.cwiseMin(interface.flexibility);
    }
  }
  return result;
}

Matrix InterfaceSystem::free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const {
  const Structure& structure = laws_.structure();
  Exchange exchange(structure.communicator());
  std::vector<std::size_t> slots;
  slots.reserve(structure.shared_interfaces().size());
  for (const std::size_t i : structure.shared_interfaces()) {
    const ActiveInterface& interface = structure.interface(i);
    slots.push_back(exchange.add(interface.away.rank, interface.size()));
  }
  exchange.prepare(data.cols());
  for (std::size_t n = 0; n < slots.size(); ++n) {
    const ActiveInterface& interface = structure.interface(structure.shared_interfaces()[n]);
    share_of_jump(structure, interface, interface.here(), data, traces,
                  exchange.outgoing(slots[n]));
  }
  exchange.start().finish();
  Matrix jumps(unknowns(), data.cols());
  for (std::size_t n = 0; n < slots.size(); ++n) {
    const ActiveInterface& interface = structure.interface(structure.shared_interfaces()[n]);
    const auto here = exchange.outgoing(slots[n]);
    const auto away = exchange.incoming(slots[n]);
    auto jump = jumps.middleRows(interface.first_unknown, interface.size());
    if (interface.away.side == 0) {
      jump = away - here;
    } else {
      jump = here - away;
    }
  }
  Matrix share;
  for (const ActiveInterface& interface : structure.interfaces()) {
    if (interface.shared()) {
      continue;
    }
    auto jump = jumps.middleRows(interface.first_unknown, interface.size());
    share_of_jump(structure, interface, 0, data, traces, jump);
    if (interface.rows.size() > 1) {
      share.resize(interface.size(), data.cols());
      share_of_jump(structure, interface, 1, data, traces, share);
      jump -= share;
    }
  }
  return jumps;
}

InterfaceSystem::Memory InterfaceSystem::blank() const {
  const std::size_t count = laws_.structure().interfaces().size();
  Memory memory{std::vector<Matrix>(count), std::vector<Matrix>(count), std::vector<Matrix>(count)};
  for (std::size_t i = 0; i < count; ++i) {
    forget(i, memory);
  }
  return memory;
}

void InterfaceSystem::forget(std::size_t i, Memory& memory) const {
  const interface::Interface& geometry = laws_.structure().interface(i).geometry;
  memory.kept[i] = Matrix::Zero(laws_.of(i).law->memory(), geometry.points);
  memory.jumps[i].resize(geometry.points * geometry.components, 0);
  memory.forces[i].resize(geometry.points * geometry.components, 0);
}

interface::LocalProblem InterfaceSystem::problem(std::size_t i, ConstMatrixRef jump,
                                                 ConstVectorRef flexibility, Index steps) const {
  const ActiveInterface& interface = laws_.structure().interface(i);
  return {interface.geometry.components, jump, flexibility, steps, interface.name()};
}

void InterfaceSystem::ask(std::size_t i, Index column, const Memory& before, const Vector& jump,
                          const Vector& flexibility, Matrix& kept, Vector& force) const {
  const interface::Law& law = *laws_.of(i).law;
  force.resize(jump.size());
  ++asked_;
  if (law.resolve_column(problem(i, jump, flexibility, laws_.steps()), column, kept, force)) {
    return;
  }
  // the history so far, as if it had been asked with this flexibility
  const Index past = before.jumps[i].cols();
  asked_ += past;
  Matrix jumps(jump.size(), past + 1);
  jumps.leftCols(past) = before.jumps[i] + flexibility.asDiagonal() * before.forces[i];
  jumps.col(past) = jump;
  Matrix forces(jumps.rows(), jumps.cols());
  const std::unique_ptr<interface::Law> part = law.at_columns(column - past, past + 1);
  (part ? *part : law).resolve(problem(i, jumps, flexibility, past + 1), forces);
  force = forces.col(past);
}

Vector InterfaceSystem::forces(Index column, const Memory& before, ConstVectorRef jump,
                               ConstVectorRef flexibility) const {
  Vector result(jump.size());
  Matrix kept;
  Vector force;
  for (std::size_t i = 0; i < laws_.structure().interfaces().size(); ++i) {
    const ActiveInterface& interface = laws_.structure().interface(i);
    const auto rows = Eigen::seqN(interface.first_unknown, interface.size());
    kept = before.kept[i];
    ask(i, column, before, jump(rows), flexibility(rows), kept, force);
    result(rows) = force;
  }
  return result;
}

Vector InterfaceSystem::advance(Index column, Memory& memory, ConstVectorRef jump,
                                ConstVectorRef flexibility) const {
  Vector result(jump.size());
  for (std::size_t i = 0; i < laws_.structure().interfaces().size(); ++i) {
    const ActiveInterface& interface = laws_.structure().interface(i);
    const auto rows = Eigen::seqN(interface.first_unknown, interface.size());
    result(rows) = advance_one(i, column, memory, jump(rows), flexibility(rows));
  }
  return result;
}

Vector InterfaceSystem::advance_one(std::size_t i, Index column, Memory& memory, const Vector& jump,
                                    const Vector& flexibility) const {
  Vector force;
  Matrix kept = memory.kept[i];
  ask(i, column, memory, jump, flexibility, kept, force);
  memory.kept[i].swap(kept);
  const interface::Law& law = *laws_.of(i).law;
  if (law.history() && law.memory() == 0) {
    const Index past = memory.jumps[i].cols();
    memory.jumps[i].conservativeResize(Eigen::NoChange, past + 1);
    memory.forces[i].conservativeResize(Eigen::NoChange, past + 1);
    memory.jumps[i].col(past) = jump - flexibility.cwiseProduct(force);
    memory.forces[i].col(past) = force;
  }
  return force;
}

Index InterfaceSystem::most_components() const {
  Index most = 0;
  for (const ActiveInterface& interface : laws_.structure().interfaces()) {
    most = std::max(most, interface.geometry.components);
  }
  return most;
}

Matrix InterfaceSystem::slopes(Index column, const Memory& before, ConstVectorRef jump,
                               ConstVectorRef flexibility) const {
  const auto& interfaces = laws_.structure().interfaces();
  Matrix result = Matrix::Zero(unknowns(), most_components());
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const auto rows = Eigen::seqN(interfaces[i].first_unknown, interfaces[i].size());
    slopes_of_one(i, column, before, jump(rows), flexibility(rows),
                  result(rows, Eigen::seqN(0, interfaces[i].geometry.components)));
  }
  return result;
}

std::vector<Matrix> InterfaceSystem::slopes_of_all(ConstMatrixRef jumps,
                                                   ConstVectorRef flexibility) const {
  const auto& interfaces = laws_.structure().interfaces();
  std::vector<Matrix> result(static_cast<std::size_t>(jumps.cols()),
                             Matrix::Zero(unknowns(), most_components()));
  Memory memory = blank();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const auto rows = Eigen::seqN(interfaces[i].first_unknown, interfaces[i].size());
    const auto components = Eigen::seqN(0, interfaces[i].geometry.components);
    const Matrix own_jumps = jumps(rows, every);
    const Vector own = flexibility(rows);
    const interface::Law& law = *laws_.of(i).law;
    Matrix first(own_jumps.rows(), interfaces[i].geometry.components);
    if (!law.history() && jumps.cols() > 1 &&
        !law.slopes(problem(i, own_jumps.col(0), own, laws_.steps()), 0, memory.kept[i], first)) {
      const std::unique_ptr<interface::Law> part = law.at_columns(0, jumps.cols());
      const auto forces = [&](const Matrix& jump) {
        asked_ += jump.cols();
        Matrix force(jump.rows(), jump.cols());
        (part ? *part : law).resolve(problem(i, jump, own, laws_.steps()), force);
        return force;
      };
      const std::vector<Matrix> found = slopes_by_differences(i, own_jumps, own, forces);
      for (std::size_t column = 0; column < found.size(); ++column) {
        result[column](rows, components) = found[column];
      }
      continue;
    }
    for (Index column = 0; column < jumps.cols(); ++column) {
      if (law.history() && column % laws_.steps() == 0) {
        forget(i, memory);
      }
      slopes_of_one(i, column, memory, own_jumps.col(column), own,
                    result[static_cast<std::size_t>(column)](rows, components));
      if (law.history()) {
        advance_one(i, column, memory, own_jumps.col(column), own);
      }
    }
  }
  return result;
}

void InterfaceSystem::slopes_of_one(std::size_t i, Index column, const Memory& before,
                                    const Vector& jump, const Vector& flexibility,
                                    MatrixRef slopes) const {
  ++asked_;
  if (laws_.of(i).law->slopes(problem(i, jump, flexibility, laws_.steps()), column, before.kept[i],
                              slopes)) {
    return;
  }
  const auto forces = [&](const Matrix& jumps) {
    Vector force;
    Matrix kept = before.kept[i];
    ask(i, column, before, jumps, flexibility, kept, force);
    return Matrix(force);
  };
  slopes = slopes_by_differences(i, jump, flexibility, forces).front();
}

std::vector<Matrix> InterfaceSystem::slopes_by_differences(std::size_t i, const Matrix& jumps,
                                                           const Vector& flexibility,
                                                           const Asked& forces) const {
  const interface::Interface& geometry = laws_.structure().interface(i).geometry;
  const Matrix force = forces(jumps);
  const Matrix sizes = sizes_of_points(jumps, geometry.components, flexibility.maxCoeff());
  std::vector<Matrix> slopes(static_cast<std::size_t>(jumps.cols()),
                             Matrix(jumps.rows(), geometry.components));
  for (Index component = 0; component < geometry.components; ++component) {
    const auto of_component = Eigen::seqN(component, geometry.points, geometry.components);
    for (const double difference : differences) {
      Matrix others = jumps;
      // towards closing, so that a point that just touches counts as closed
      others(of_component, every) -= difference * sizes(of_component, every);
      const Matrix moved = forces(others);
      for (Index column = 0; column < jumps.cols(); ++column) {
        auto slope = slopes[static_cast<std::size_t>(column)].col(component);
        const Vector now =
            (force.col(column) - moved.col(column)).cwiseQuotient(difference * sizes.col(column));
        if (difference == differences.front()) {
          slope = now;
        } else {
          slope = ((now - slope).cwiseAbs().cwiseProduct(flexibility).array() < same_slope)
                      .select(now, slope);
        }
      }
    }
  }
  return slopes;
}

}  // namespace latin::substructure
