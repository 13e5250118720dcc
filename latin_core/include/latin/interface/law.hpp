#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "latin/common/types.hpp"

namespace latin {

/// Values of one law parameter: rows x columns, where a single row or column stands for all of them.
class ParameterField {
 public:
  ParameterField() : values_(Matrix::Zero(1, 1)) {}
  explicit ParameterField(double value) : values_(Matrix::Constant(1, 1, value)) {}
  explicit ParameterField(Matrix values) : values_(std::move(values)) {}

  [[nodiscard]] double operator()(Index row, Index column) const {
    return values_(values_.rows() == 1 ? 0 : row, values_.cols() == 1 ? 0 : column);
  }
  [[nodiscard]] const Matrix& values() const { return values_; }

 private:
  Matrix values_;
};

/// What a law is asked at the points of one interface, for all columns at once.
///
/// Rows are point-major: row = components * point + component, in the local frame (normal, then
/// tangents); columns are whatever the columns of the run are, after the column transform.
struct LocalProblem {
  Index components;     ///< unknown components at a point
  ConstMatrixRef jump;  ///< (rows, c) j0: the jump w2 - w1 that no interface force would leave
  /// (rows) c = 1/k1 + 1/k2 > 0: how much a unit force closes the jump
  ConstVectorRef flexibility;
  /// columns that follow each other in time; a law with history starts anew after so many
  Index steps = 1;
};

/// A pointwise interface law: a relation f = R(j) between the force f per unit area that the interface
/// exerts on side 1 (and -f on side 2) and the jump j = w2 - w1 (side 2 is the ground where there is
/// none). The local stage asks for its resolvent:
///
///     find f such that  f = R(j)  with  j = j0 - c f,        DESIGN: local stage, both sides eliminated
///
/// which for every monotone law has exactly one answer, whatever c > 0.
class Law {
 public:
  /// Shape of a parameter: one value a point, or one a row (point and component).
  enum class Shape { per_point, per_row };
  struct ParameterInfo {
    std::string name;
    Shape shape;
    double minimum;  ///< smallest admissible value
  };

  virtual ~Law() = default;
  Law() = default;
  Law(const Law&) = delete;
  Law& operator=(const Law&) = delete;
  Law(Law&&) = delete;
  Law& operator=(Law&&) = delete;

  [[nodiscard]] virtual std::string name() const = 0;
  [[nodiscard]] virtual std::vector<ParameterInfo> parameters() const = 0;
  /// Whether the force is an affine function of the jump, so that nothing is won by linearising it.
  [[nodiscard]] virtual bool linear() const { return false; }
  /// Write the forces (rows, c) into `force`.
  virtual void resolve(const LocalProblem& problem, MatrixRef force) const = 0;

  /// Whether values below a parameter's minimum are refused.
  enum class Range { admissible, any };
  /// Replace a parameter. @throws InputError on an unknown name, a NaN, or a value out of range.
  void set(const std::string& parameter, ParameterField field, Range range = Range::admissible);
  [[nodiscard]] const ParameterField& get(const std::string& parameter) const;

 private:
  std::map<std::string, ParameterField> fields_;
};

/// Law by name ("contact", "coulomb", "elastic", "force", "perfect") with its parameters at zero.
/// @throws InputError with the known names.
std::unique_ptr<Law> make_law(const std::string& name);

}  // namespace latin
