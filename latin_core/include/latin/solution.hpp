#pragma once

#include <Eigen/Core>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "latin/iteration/summary.hpp"

namespace latin {

using iteration::State;
using iteration::Status;
using iteration::Summary;

/// A vector at the points of an interface in each column of a run, in the local frame of each point: component 0 is
/// the normal one, then the tangents.
class Field {
 public:
  /// Of one component, (points, columns).
  using Component = Eigen::Map<const Matrix, Eigen::Unaligned, Eigen::Stride<-1, -1>>;

  /// @param values (components * points, columns), the components of the first point, then of the second
  Field(Matrix values, Index components) : values_(std::move(values)), components_(components) {}

  [[nodiscard]] Index points() const { return values_.rows() / components_; }
  [[nodiscard]] Index components() const { return components_; }
  [[nodiscard]] Index columns() const { return values_.cols(); }
  /// @throws InputError naming an index that is out of range, and the range
  [[nodiscard]] double operator()(Index point, Index component = 0, Index column = 0) const;
  /// (points, columns), valid as long as this field is. @throws InputError as operator()
  [[nodiscard]] Component component(Index which) const;
  /// (components * points, columns), as they were given.
  [[nodiscard]] const Matrix& values() const { return values_; }

 private:
  Matrix values_;
  Index components_;
};

/// What a study answers. A value: a copy shares what it holds. One thread may use it at a time.
///
/// Units are those of the study: forces of interfaces are per area (force, where the weights are 1), jumps and
/// displacements are lengths. On several ranks a rank has the interfaces and parts that were described on it, and the
/// first question for an interface between two ranks is asked on both.
class Solution {
 public:
  struct Implementation;
  /// For Study.
  explicit Solution(std::shared_ptr<const Implementation> implementation)
      : implementation_(std::move(implementation)) {}

  [[nodiscard]] bool converged() const { return status() == Status::converged; }
  [[nodiscard]] Status status() const { return summary().status; }
  /// Of one time step, or one column where columns are solutions by themselves: converged if it and all before it are
  /// within the tolerance; inexact where its error is known and larger, and it stands before a step without
  /// equilibrium; else the status of the run. @throws InputError naming a step that is out of range
  [[nodiscard]] Status status(Index step) const;
  [[nodiscard]] const Summary& summary() const;

  /// Force that an interface exerts on its first side, and the opposite on its second. Valid as long as a copy of this
  /// solution is. @throws InputError with the known interfaces
  [[nodiscard]] const Field& force(const std::string& interface) const;
  /// Displacement of the second side (of the ground: none) less that of the first. As force().
  [[nodiscard]] const Field& jump(const std::string& interface) const;
  /// Displacements of a part, (its unknowns, columns): a solution with the factors of its body.
  /// @throws InputError with the known parts
  [[nodiscard]] Matrix displacement(const std::string& part) const;
  /// Those of all parts of this rank, by name: quicker than one after the other.
  [[nodiscard]] std::vector<std::pair<std::string, Matrix>> displacements() const;
  /// What another run can start from, see SolveOptions.
  [[nodiscard]] const State& state() const;

 private:
  std::shared_ptr<const Implementation> implementation_;
};

}  // namespace latin
