#pragma once

#include "latin/interface/law.hpp"

namespace latin::interface {

/// Given force per unit area:  f = g  (pressure: g_n = -p; traction: g in the local frame).
///
/// Parameter `force` (per row, force / length^2).
class ForceLaw final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "force"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override;
  [[nodiscard]] std::unique_ptr<Law> blank() const override { return std::make_unique<ForceLaw>(); }
  [[nodiscard]] bool linear() const override { return true; }
  void resolve(const LocalProblem& problem, MatrixRef force) const override;
  [[nodiscard]] bool slopes(const LocalProblem& problem, Index column, ConstMatrixRef memory,
                            MatrixRef slopes) const override;
};

}  // namespace latin::interface
