#include "latin/iteration/joined_system.hpp"

#include <memory>

namespace latin::iteration {

using substructure::Joined;
using substructure::Structure;

JoinedSystem::JoinedSystem(substructure::GlobalStage& global)
    : JoinedLaws(global.laws(),
                 std::make_shared<const Joined>(Joined::numbered(global.laws().structure()))),
      global_(global) {}

Matrix JoinedSystem::residual(const Matrix& forces, ConstMatrixRef data,
                              ConstMatrixRef traces) const {
  Matrix result = directions().asDiagonal() * traces;
  result -= data;
  for (const Joined::JoinedInterface& interface : joined().interfaces()) {
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
    global_.apply(joined().own_rows(data), amplitudes, traces);
    return traces;
  });
}

}  // namespace latin::iteration
