#pragma once

#include "latin/iteration/joined_laws.hpp"
#include "latin/substructure/global_stage.hpp"

namespace latin::iteration {

/// The bodies and interfaces of all ranks as Newton's method asks for them. Bodies are asked on the ranks that have
/// them, as laws are.
class JoinedSystem : public JoinedLaws {
 public:
  /// @param global stage of the run; it must outlive this object
  explicit JoinedSystem(substructure::GlobalStage& global);

  /// r = 2 (f^ - f) of forces (unknowns, c), data and traces (rows, c).
  [[nodiscard]] Matrix residual(const Matrix& forces, ConstMatrixRef data,
                                ConstMatrixRef traces) const;
  /// Traces (rows, c) of data under loads, (l, c).
  [[nodiscard]] Matrix traces(ConstMatrixRef data, ConstMatrixRef amplitudes) const;

 private:
  substructure::GlobalStage& global_;
};

}  // namespace latin::iteration
