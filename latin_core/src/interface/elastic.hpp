#pragma once

#include "latin/interface/law.hpp"

namespace latin::interface {

/// Elastic interface with imposed jump:  f = kappa (j - Delta)  (paper, equation 10).
///
/// Parameters: `normal`, `tangential` (per point, force / length^3, >= 0, infinity = perfect) and
/// `jump` (per row, length; a bolt shortened by 0.2 mm has Delta_n = -0.2 mm).
class ElasticLaw final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "elastic"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override;
  [[nodiscard]] std::unique_ptr<Law> blank() const override {
    return std::make_unique<ElasticLaw>();
  }
  [[nodiscard]] bool linear() const override { return true; }
  void resolve(const LocalProblem& problem, MatrixRef force) const override;
  [[nodiscard]] bool slopes(const LocalProblem& problem, Index column, ConstMatrixRef memory,
                            MatrixRef slopes) const override;
};

}  // namespace latin::interface
