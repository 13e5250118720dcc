#pragma once

#include "latin/interface/law.hpp"

namespace latin {

/// Unilateral contact without friction. With the opening g = j_n - Delta_n + g0:
///
///     f_n <= 0,   g + f_n / kappa >= 0,   f_n (g + f_n / kappa) = 0,   f_t = 0       (Signorini)
///
/// kappa infinite: rigid contact; finite: elastic in compression, open in traction.
///
/// Parameters (per point): `gap` g0 (length; negative: interference), `jump` Delta (per row, length),
/// `compliance` 1 / kappa (length^3 / force, >= 0, 0 = rigid).
class ContactLaw final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "contact"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override;
  void resolve(const LocalProblem& problem, MatrixRef force) const override;
};

}  // namespace latin
