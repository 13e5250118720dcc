#include "latin/iteration/joined_system.hpp"

#include <algorithm>
#include <exception>
#include <utility>

#include "latin/common/error.hpp"

namespace latin::iteration {

using substructure::Joined;
using substructure::Structure;

JoinedSystem::JoinedSystem(substructure::GlobalStage& global)
    : global_(global),
      system_(global.laws()),
      joined_(Joined::numbered(global.laws().structure())),
      direct_(joined_.unknowns()) {
  for (const Joined::JoinedInterface& interface : joined_.interfaces()) {
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

double JoinedSystem::follow_first(double value) const {
  communicator().follow_first({&value, 1});
  return value;
}

/// All ranks go on, or all throw.
Matrix JoinedSystem::attempted(Index rows, Index columns, const Own& ask) const {
  Matrix own = Matrix::Zero(rows, columns);
  std::exception_ptr failure;
  try {
    Matrix found = ask();
    own.leftCols(found.cols()) = found;
  } catch (...) {
    failure = std::current_exception();
  }
  if (!communicator().none_failed(failure)) {
    throw NumericalError("a law or a body has no answer at an iterate");
  }
  return own;
}

Matrix JoinedSystem::of_unknowns(Index columns, const Own& ask) const {
  if (communicator().alone()) {
    return ask();
  }
  return joined_.of_unknowns(attempted(system_.unknowns(), columns, ask));
}

Matrix JoinedSystem::of_rows(Index columns, const Own& ask) const {
  if (communicator().alone()) {
    return ask();
  }
  return joined_.of_rows(attempted(laws().structure().rows(), columns, ask));
}

Vector JoinedSystem::law_flexibility(const Vector& wanted) const {
  return of_unknowns(1, [&] { return system_.law_flexibility(joined_.own_unknowns(wanted)); });
}

Vector JoinedSystem::forces(Index column, const Memory& before, ConstVectorRef jump,
                            ConstVectorRef flexibility) const {
  return of_unknowns(1, [&] {
    return system_.forces(column, before, joined_.own_unknowns(jump).col(0),
                          joined_.own_unknowns(flexibility).col(0));
  });
}

Vector JoinedSystem::advance(Index column, Memory& memory, ConstVectorRef jump,
                             ConstVectorRef flexibility) const {
  return of_unknowns(1, [&] {
    return system_.advance(column, memory, joined_.own_unknowns(jump).col(0),
                           joined_.own_unknowns(flexibility).col(0));
  });
}

Matrix JoinedSystem::slopes(Index column, const Memory& before, ConstVectorRef jump,
                            ConstVectorRef flexibility) const {
  return of_unknowns(joined_.most_components(), [&] {
    return system_.slopes(column, before, joined_.own_unknowns(jump).col(0),
                          joined_.own_unknowns(flexibility).col(0));
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
  for (const Joined::JoinedInterface& interface : joined_.interfaces()) {
    auto jump = jumps.middleRows(interface.first_unknown, interface.size);
    jump = share(interface, 0, data, traces);
    if (interface.rows.size() > 1) {
      jump -= share(interface, 1, data, traces);
    }
  }
  return jumps;
}

Matrix JoinedSystem::residual(const Matrix& forces, ConstMatrixRef data,
                              ConstMatrixRef traces) const {
  Matrix result = directions().asDiagonal() * traces;
  result -= data;
  for (const Joined::JoinedInterface& interface : joined_.interfaces()) {
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
    global_.apply(joined_.own_rows(data), amplitudes, traces);
    return traces;
  });
}

void JoinedSystem::precondition(Matrix& residual) const {
  if (!laws().preconditions()) {
    return;
  }
  residual = of_rows(residual.cols(), [&] {
    Matrix own = joined_.own_rows(residual);
    laws().precondition(own);
    return own;
  });
}

void JoinedSystem::balance(Matrix& data, Matrix& traces) const {
  const Structure& structure = laws().structure();
  const substructure::Macro& macro = structure.macro();
  Matrix own_data = joined_.own_rows(data);
  Matrix own_traces = joined_.own_rows(traces);
  Matrix imbalance = macro.imbalance(own_data - structure.directions().asDiagonal() * own_traces);
  communicator().sum({imbalance.data(), static_cast<std::size_t>(imbalance.size())});
  static_cast<void>(macro.correct(imbalance, own_data, own_traces));
  data = joined_.of_rows(own_data);
  traces = joined_.of_rows(own_traces);
}

}  // namespace latin::iteration
