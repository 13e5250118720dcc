#pragma once

#include "latin/interface/law.hpp"

namespace latin::interface {

/// Perfect connection with imposed jump:  j = Delta  (paper, equation 7, with Delta = 0).
///
/// Parameter `jump` (per row, length): Delta in the local frame. With one side it prescribes the
/// displacement w1 = -Delta.
class PerfectLaw final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "perfect"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override;
  [[nodiscard]] std::unique_ptr<Law> blank() const override {
    return std::make_unique<PerfectLaw>();
  }
  [[nodiscard]] bool linear() const override { return true; }
  [[nodiscard]] bool prescribes_jumps() const override { return true; }
  void resolve(const LocalProblem& problem, MatrixRef force) const override;
  [[nodiscard]] bool slopes(const LocalProblem& problem, Index column, ConstMatrixRef memory,
                            MatrixRef slopes) const override;
};

}  // namespace latin::interface
