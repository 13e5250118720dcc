#include "latin/substructure/interface_system.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "latin/substructure/local_stage.hpp"

namespace latin::substructure {
namespace {

/// Steps of the difference quotients, as shares of the largest free jump. The short one seldom crosses a
/// branch of the law, the long one has no rounding to speak of and is taken where both agree to
/// `same_slope` (in 1 / flexibility): within a branch most laws are linear.
constexpr std::array<double, 2> differences{1e-7, 1e-3};
constexpr double same_slope = 1e-7;

}  // namespace

bool InterfaceSystem::suits(const Laws& laws, Index limit) {
  const Structure& structure = laws.structure();
  return structure.interface_unknowns() <= limit && structure.has_flexibility() &&
         !laws.transformed() && !laws.linear();
}

InterfaceSystem::InterfaceSystem(Laws laws)
    : laws_(std::move(laws)), flexibility_(laws_.structure().flexibility()) {
  for (const ActiveInterface& interface : laws_.structure().interfaces()) {
    const Index components = interface.geometry.components;
    for (Index row = 0; row < interface.size(); ++row) {
      layout_.first.push_back(interface.first_unknown + row - row % components);
      layout_.components.push_back(components);
    }
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
  Matrix jumps(unknowns(), data.cols());
  Matrix share;
  for (const ActiveInterface& interface : laws_.structure().interfaces()) {
    auto jump = jumps.middleRows(interface.first_unknown, interface.size());
    share_of_jump(laws_.structure(), interface, 0, data, traces, jump);
    if (interface.rows.size() > 1) {
      share.resize(interface.size(), data.cols());
      share_of_jump(laws_.structure(), interface, 1, data, traces, share);
      jump -= share;
    }
  }
  return jumps;
}

void InterfaceSystem::ask(std::size_t i, ConstMatrixRef jump, ConstVectorRef flexibility,
                          Matrix& force) const {
  const ActiveInterface& interface = laws_.structure().interface(i);
  force.resize(jump.rows(), jump.cols());
  laws_.of(i).law->resolve(
      {interface.geometry.components, jump, flexibility, laws_.steps(), interface.name()}, force);
}

Matrix InterfaceSystem::forces(ConstMatrixRef jumps, ConstVectorRef flexibility) const {
  Matrix result(jumps.rows(), jumps.cols());
  Matrix force;
  for (std::size_t i = 0; i < laws_.structure().interfaces().size(); ++i) {
    const ActiveInterface& interface = laws_.structure().interface(i);
    const auto rows = Eigen::seqN(interface.first_unknown, interface.size());
    const Vector own = flexibility(rows);
    ask(i, jumps(rows, every), own, force);
    result(rows, every) = force;
  }
  return result;
}

Matrix InterfaceSystem::slopes(ConstMatrixRef jumps, ConstVectorRef flexibility,
                               Index column) const {
  const auto& interfaces = laws_.structure().interfaces();
  Index most = 0;
  for (const ActiveInterface& interface : interfaces) {
    most = std::max(most, interface.geometry.components);
  }
  Matrix result = Matrix::Zero(unknowns(), most);
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const Index rows = interfaces[i].size();
    const Index components = interfaces[i].geometry.components;
    const Matrix jump = jumps.middleRows(interfaces[i].first_unknown, rows);
    const Vector own = flexibility.segment(interfaces[i].first_unknown, rows);
    const interface::LocalProblem local{components, jump, own, laws_.steps(), interfaces[i].name()};
    Matrix found(rows, components);
    if (!laws_.of(i).law->slopes(local, column, found)) {
      slopes_by_differences(i, jump, own, column, found);
    }
    result.block(interfaces[i].first_unknown, 0, rows, components) = found;
  }
  return result;
}

void InterfaceSystem::slopes_by_differences(std::size_t i, const Matrix& jump,
                                            const Vector& flexibility, Index column,
                                            MatrixRef slopes) const {
  const interface::Interface& geometry = laws_.structure().interface(i).geometry;
  Matrix force;
  Matrix moved;
  ask(i, jump, flexibility, force);
  double size = jump.col(column).cwiseAbs().maxCoeff();
  if (size == 0.0) {
    const double largest = jump.cwiseAbs().maxCoeff();
    size = largest > 0.0 ? largest : flexibility.maxCoeff();
  }
  for (Index component = 0; component < geometry.components; ++component) {
    const auto of_component = Eigen::seqN(component, geometry.points, geometry.components);
    auto slope = slopes.col(component);
    for (const double difference : differences) {
      Matrix other = jump;
      // towards closing, so that a point that just touches counts as closed
      other(of_component, column).array() -= difference * size;
      ask(i, other, flexibility, moved);
      const Vector now = (force.col(column) - moved.col(column)) / (difference * size);
      if (difference == differences.front()) {
        slope = now;
      } else {
        slope = ((now - slope).cwiseAbs().cwiseProduct(flexibility).array() < same_slope)
                    .select(now, slope);
      }
    }
  }
}

}  // namespace latin::substructure
