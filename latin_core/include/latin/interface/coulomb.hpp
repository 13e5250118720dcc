#pragma once

#include "latin/interface/law.hpp"

namespace latin {

/// Contact as ContactLaw, with dry friction. The columns of a history are its time steps; with j_t' the
/// tangential jump at the step before (0 before the first):
///
///     |f_t| <= mu |f_n| + tau   in contact,    f_t = 0 where open,
///     j_t - j_t' = s f_t with s >= 0,  s > 0 only where |f_t| reaches its bound       (Coulomb, Tresca)
///
/// The sign follows from f being the force on side 1 and j = w2 - w1: friction pulls side 1 along with
/// the slip of side 2. An implicit step: the law holds at the end of each one.
///
/// Parameters: `gap`, `compliance`, `friction` mu and `threshold` tau (force / area) per point, all
/// but the gap >= 0; `jump` per row.
class CoulombLaw final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "coulomb"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override;
  void resolve(const LocalProblem& problem, MatrixRef force) const override;
};

}  // namespace latin
