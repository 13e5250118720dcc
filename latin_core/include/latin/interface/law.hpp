#pragma once

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "latin/common/error.hpp"
#include "latin/common/types.hpp"

namespace latin::interface {

/// Values of one law parameter: rows x columns, where a single row or column stands for all of them.
/// Immutable; a copy shares the values.
class ParameterField {
 public:
  ParameterField() : ParameterField(0.0) {}
  explicit ParameterField(double value) : ParameterField(Matrix(Matrix::Constant(1, 1, value))) {}
  explicit ParameterField(Matrix values)
      : values_(std::make_shared<const Matrix>(std::move(values))),
        first_(values_->data()),
        down_(values_->rows() == 1 ? 0 : 1),
        across_(values_->cols() == 1 ? 0 : values_->rows()) {}

  [[nodiscard]] double operator()(Index row, Index column) const {
    return first_[row * down_ + column * across_];
  }
  [[nodiscard]] const Matrix& values() const { return *values_; }

 private:
  std::shared_ptr<const Matrix> values_;
  const double* first_;
  Index down_;    ///< from one row to the next
  Index across_;  ///< from one column to the next
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
  std::string_view interface = "?";  ///< name, for messages
};

/// A pointwise interface law: a relation f = R(j) between the force f per unit area that the interface
/// exerts on side 1 (and -f on side 2) and the jump j = w2 - w1 (side 2 is the ground where there is
/// none). The local stage asks for its resolvent:
///
///     find f such that  f = R(j)  with  j = j0 - c f,        DESIGN: local stage, both sides eliminated
///
/// which for every monotone law has exactly one answer, whatever c > 0. A law that softens has one only for
/// c small enough and must throw otherwise.
///
/// The class is complete in its headers: a module of a user is compiled against them alone and hands its law
/// to the kernel as a LawFactory. A ten-line struct is enough for most: see PointwiseLaw.
class LATIN_SHARED Law {
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
  /// Whether a column depends on those before it in its history.
  [[nodiscard]] virtual bool history() const { return false; }
  /// A law of the same kind with its parameters at zero.
  [[nodiscard]] virtual std::unique_ptr<Law> blank() const = 0;
  /// Whether the force is an affine function of the jump, so that nothing is won by linearising it.
  [[nodiscard]] virtual bool linear() const { return false; }
  /// Whether the law is known to have one answer for every flexibility, and one that is cheap to ask for.
  [[nodiscard]] virtual bool monotone() const { return linear(); }
  /// Whether nothing but equilibrium determines its forces, as the jump is prescribed or the force uniform.
  [[nodiscard]] virtual bool prescribes_jumps() const { return false; }
  /// Write the forces (rows, c) into `force`.
  virtual void resolve(const LocalProblem& problem, MatrixRef force) const = 0;
  /// Numbers that the law keeps at a point from one column of a history to the next, for resolve_column().
  [[nodiscard]] virtual Index memory() const { return 0; }
  /// As resolve(), for one column by itself: what a solver asks that takes the columns one after the other.
  /// @param problem with a jump (rows, 1)
  /// @param column  of the parameters
  /// @param memory  (memory(), points) what the column before has left, zeros in the first one of a history;
  ///                replaced by what this column leaves
  /// @param force   (rows, 1)
  /// @return false if the law remembers and can only be asked for whole histories: resolve() is called for all
  ///         columns so far, each time
  [[nodiscard]] virtual bool resolve_column(const LocalProblem& problem, Index column,
                                            MatrixRef /*memory*/, MatrixRef force) const {
    if (history()) {
      return false;
    }
    if (const std::unique_ptr<Law> one = at_columns(column, 1)) {
      one->resolve(problem, force);
    } else {
      resolve(problem, force);
    }
    return true;
  }
  /// Write df/dj0 of one column (rows, components) into `slopes`: row = a component of the force, column = one
  /// of the free jump at the same point and in the same time step. Where the law has a kink, any side; a
  /// point that just touches is best taken as closed and sticking. Arguments as in resolve_column().
  /// @return false if the law does not know: they are taken by differences
  [[nodiscard]] virtual bool slopes(const LocalProblem& /*problem*/, Index /*column*/,
                                    ConstMatrixRef /*memory*/, MatrixRef /*slopes*/) const {
    return false;
  }

  /// Whether values below a parameter's minimum are refused.
  enum class Range { admissible, any };
  /// Replace a parameter. @throws InputError on an unknown name, a NaN, or a value out of range.
  void set(const std::string& parameter, ParameterField field, Range range = Range::admissible) {
    const auto known = parameters();
    const auto info = std::ranges::find(known, parameter, &ParameterInfo::name);
    if (info == known.end()) {
      std::string names;
      for (const auto& each : known) {
        names += (names.empty() ? "" : ", ") + each.name;
      }
      throw InputError("law '" + name() + "' has no parameter '" + parameter +
                       "'; it has: " + names);
    }
    const auto refuse = [&](const std::string& why) {
      throw InputError("parameter '" + parameter + "' of law '" + name() + "' " + why);
    };
    if (field.values().size() == 0) {
      refuse("is empty");
    }
    for (const double value : field.values().reshaped()) {
      if (std::isnan(value)) {
        refuse("holds a NaN");
      }
      if (range == Range::admissible && value < info->minimum) {
        refuse("is " + std::to_string(value) + ": it must be at least " +
               std::to_string(info->minimum));
      }
    }
    fields_[parameter] = std::move(field);
  }
  /// A law of the same kind with the same parameters.
  [[nodiscard]] std::unique_ptr<Law> copy() const {
    std::unique_ptr<Law> law = blank();
    law->fields_ = fields_;
    return law;
  }
  /// The law with the parameters of `count` columns from `first` on; null where they are the same in all.
  [[nodiscard]] std::unique_ptr<Law> at_columns(Index first, Index count) const {
    std::unique_ptr<Law> law;
    for (const auto& [parameter, field] : fields_) {
      if (field.values().cols() > 1) {
        if (law == nullptr) {
          law = copy();
        }
        law->fields_[parameter] = ParameterField(Matrix(field.values().middleCols(first, count)));
      }
    }
    return law;
  }
  /// A parameter; zero as long as it was not set.
  [[nodiscard]] const ParameterField& get(const std::string& parameter) const {
    static const ParameterField zero;
    const auto found = fields_.find(parameter);
    return found == fields_.end() ? zero : found->second;
  }

 private:
  std::map<std::string, ParameterField> fields_;
};

/// Law by name ("contact", "coulomb", "debonding", "elastic", "force", "held", "perfect", "preload") with its
/// parameters at zero.
/// @throws InputError with the known names.
std::unique_ptr<Law> make_law(const std::string& name);

#define LATIN_TEXT_(x) #x
#define LATIN_TEXT(x) LATIN_TEXT_(x)

/// What a module of a user and the kernel must have in common: layout of Law, of Eigen's matrices and of
/// the standard library. Both see this macro, each compiled in its own way.
inline constexpr const char* law_abi =
    "laws 4, Eigen " LATIN_TEXT(EIGEN_WORLD_VERSION) "." LATIN_TEXT(
        EIGEN_MAJOR_VERSION) "." LATIN_TEXT(EIGEN_MINOR_VERSION) ", alignment " LATIN_TEXT(EIGEN_MAX_ALIGN_BYTES)
#ifdef _GLIBCXX_USE_CXX11_ABI
        ", strings " LATIN_TEXT(_GLIBCXX_USE_CXX11_ABI)
#endif
    ;

/// How a compiled law of a user comes to the kernel: in a Python capsule of the name `law_capsule`.
struct LawFactory {
  const char* abi;
  std::unique_ptr<Law> (*make)();
};
inline constexpr const char* law_capsule = "latin_core.LawFactory";

/// A law of the factory. @throws InputError if it was compiled in a way that does not fit the kernel.
std::unique_ptr<Law> make_law(const LawFactory& factory);

/// Where the law of an interface comes from: its name, or a law whose kind is taken.
class LawSource {
 public:
  LawSource(const char* name) : name_(name) {}
  LawSource(std::string name) : name_(std::move(name)) {}
  LawSource(std::shared_ptr<const Law> kind) : kind_(std::move(kind)) {}
  [[nodiscard]] std::unique_ptr<Law> make() const {
    return kind_ ? kind_->blank() : make_law(name_);
  }

 private:
  std::string name_;
  std::shared_ptr<const Law> kind_;
};

}  // namespace latin::interface
