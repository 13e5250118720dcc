#include "iteration/joined_system.hpp"

#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

/// What is remembered grows by more than this, or it is rounding.
constexpr double grows = 1e-9;

bool softens(const interface::Law& law) { return !law.monotone() && law.memory() > 0; }

}  // namespace

using substructure::Joined;

JoinedSystem::JoinedSystem(substructure::GlobalStage& global)
    : global_(global),
      system_(global.laws()),
      joined_(std::make_shared<const Joined>(Joined::numbered(global.laws().structure()))),
      direct_(joined_->unknowns()) {
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    for (Index row = 0; row < interface.size; ++row) {
      layout_.first.push_back(interface.first_unknown + row - row % interface.components);
      layout_.components.push_back(interface.components);
    }
    direct_.segment(interface.first_unknown, interface.size) = interface.flexibility;
  }
}

void JoinedSystem::follow_first(MatrixRef values) const {
  if (communicator().alone()) {
    return;
  }
  Matrix block = values;
  communicator().follow_first({block.data(), static_cast<std::size_t>(block.size())});
  values = block;
}

double JoinedSystem::follow_first(double value) const { return communicator().agreed(value); }

bool JoinedSystem::follow_first(bool value) const { return follow_first(value ? 1.0 : 0.0) > 0.5; }

/// All ranks go on, or all throw.
Matrix JoinedSystem::attempted(Index rows, Index columns, const Own& ask) const {
  Matrix own = Matrix::Zero(rows, columns);
  communicator().answer_together("a law or a body has no answer at an iterate", [&] {
    const Matrix found = ask();
    own.leftCols(found.cols()) = found;
  });
  return own;
}

Matrix JoinedSystem::of_unknowns(Index columns, const Own& ask) const {
  if (communicator().alone()) {
    return ask();
  }
  return joined_->of_unknowns(attempted(system_.unknowns(), columns, ask));
}

Matrix JoinedSystem::of_rows(Index columns, const Own& ask) const {
  if (communicator().alone()) {
    return ask();
  }
  return joined_->of_rows(attempted(laws().structure().rows(), columns, ask));
}

Vector JoinedSystem::softening() const {
  return of_unknowns(1, [&] {
    Vector own = Vector::Zero(system_.unknowns());
    const substructure::Structure& structure = laws().structure();
    for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
      const substructure::ActiveInterface& interface = structure.interface(i);
      own.segment(interface.first_unknown, interface.size())
          .setConstant(softens(*laws().of(i).law) ? 1.0 : 0.0);
    }
    return own;
  });
}

bool JoinedSystem::damages(const Memory& before, const Memory& after) const {
  bool none = true;
  for (std::size_t i = 0; i < before.kept.size(); ++i) {
    none = none &&
           !(softens(*laws().of(i).law) &&
             ((after.kept[i] - before.kept[i]).array() > grows * before.kept[i].array()).any());
  }
  return !communicator().everywhere(none);
}

Vector JoinedSystem::lengths() const {
  return of_unknowns(1, [&] {
    Vector own = Vector::Zero(system_.unknowns());
    const substructure::Structure& structure = laws().structure();
    for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
      const substructure::ActiveInterface& interface = structure.interface(i);
      const Index components = interface.geometry.components;
      const interface::Law& law = *laws().of(i).law;
      const Matrix& gaps = law.get("gap").values();
      const Matrix& jumps = law.get("jump").values();
      for (Index row = 0; row < interface.size(); ++row) {
        double& length = own(interface.first_unknown + row);
        length = jumps.row(jumps.rows() == 1 ? 0 : row).cwiseAbs().maxCoeff();
        if (row % components == 0) {
          length += gaps.row(gaps.rows() == 1 ? 0 : row / components).cwiseAbs().maxCoeff();
        }
      }
    }
    return own;
  });
}

Vector JoinedSystem::law_flexibility(const Vector& wanted) const {
  return of_unknowns(1, [&] { return system_.law_flexibility(joined_->own_unknowns(wanted)); });
}

Vector JoinedSystem::forces(Index column, const Memory& before, ConstVectorRef jump,
                            ConstVectorRef flexibility) const {
  return of_unknowns(1, [&] {
    return system_.forces(column, before, joined_->own_unknowns(jump).col(0),
                          joined_->own_unknowns(flexibility).col(0));
  });
}

Vector JoinedSystem::advance(Index column, Memory& memory, ConstVectorRef jump,
                             ConstVectorRef flexibility) const {
  return of_unknowns(1, [&] {
    return system_.advance(column, memory, joined_->own_unknowns(jump).col(0),
                           joined_->own_unknowns(flexibility).col(0));
  });
}

Matrix JoinedSystem::slopes(Index column, const Memory& before, ConstVectorRef jump,
                            ConstVectorRef flexibility) const {
  return of_unknowns(joined_->most_components(), [&] {
    return system_.slopes(column, before, joined_->own_unknowns(jump).col(0),
                          joined_->own_unknowns(flexibility).col(0));
  });
}

/// A side's share of the free jump: a / k = (f - k w) / k = s / k - 2 w.
Matrix JoinedSystem::share(const Joined::JoinedInterface& interface, std::size_t side,
                           ConstMatrixRef data, ConstMatrixRef traces) const {
  const Index first = interface.rows[side];
  return directions().segment(first, interface.size).cwiseInverse().asDiagonal() *
             data.middleRows(first, interface.size) -
         2.0 * traces.middleRows(first, interface.size);
}

Matrix JoinedSystem::free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const {
  Matrix jumps(unknowns(), data.cols());
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    auto jump = jumps.middleRows(interface.first_unknown, interface.size);
    jump = share(interface, 0, data, traces);
    if (interface.rows.size() > 1) {
      jump -= share(interface, 1, data, traces);
    }
  }
  return jumps;
}

Matrix JoinedSystem::jumps(ConstMatrixRef traces) const {
  Matrix jumps(unknowns(), traces.cols());
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    auto jump = jumps.middleRows(interface.first_unknown, interface.size);
    jump = -traces.middleRows(interface.rows[0], interface.size);
    if (interface.rows.size() > 1) {
      jump += traces.middleRows(interface.rows[1], interface.size);
    }
  }
  return jumps;
}

Matrix JoinedSystem::residual(const Matrix& forces, ConstMatrixRef data,
                              ConstMatrixRef traces) const {
  Matrix result = directions().asDiagonal() * traces;
  result -= data;
  for (const Joined::JoinedInterface& interface : joined_->interfaces()) {
    const auto force = forces.middleRows(interface.first_unknown, interface.size);
    result.middleRows(interface.rows.front(), interface.size) += force;
    if (interface.rows.size() > 1) {
      result.middleRows(interface.rows.back(), interface.size) -= force;
    }
  }
  return 2.0 * result;
}

Matrix JoinedSystem::traces(ConstMatrixRef data, ConstMatrixRef amplitudes) const {
  return of_rows(data.cols(), [&] {
    Matrix traces(laws().structure().rows(), data.cols());
    global_.apply(joined_->own_rows(data), amplitudes, traces);
    return traces;
  });
}

}  // namespace latin::iteration
