#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "latin/algebra/view.hpp"
#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"
#include "latin/common/sparse_view.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/options.hpp"
#include "latin/iteration/points.hpp"
#include "latin/solution.hpp"
#include "latin/substructure/description.hpp"

namespace latin {

using algebra::view_sparse;
using iteration::Axis;
using iteration::Callback;
using iteration::grid;
using iteration::Points;
using iteration::SweptParameter;
using substructure::BodyDescription;
using substructure::InterfaceDescription;
using substructure::LawParameter;
using substructure::Member;
using substructure::OperatorOptions;
using substructure::SideDescription;
using substructure::Spring;

// NOLINTBEGIN(readability-redundant-member-init): what callers may leave out
/// Settings of the iteration, and what a run starts from and reports to.
struct SolveOptions : iteration::Options {
  State start{};        ///< of a solution with as many columns; empty: from zero
  Callback callback{};  ///< after every iteration; throws Interrupted to end the run
};

/// The same of a sweep.
struct SweepOptions : iteration::Options {
  std::map<Index, State> solved{};  ///< points that are left out, and that others start from
  Callback callback{};
};
// NOLINTEND(readability-redundant-member-init)

/// Called after each finished point; throws Interrupted to end the sweep.
using PointCallback = std::function<void(Index point, const Solution&)>;

/// Parts, interfaces, laws and loads: what is solved.
///
/// A value: the `with` functions return a changed copy, which shares the factorised parts. Several threads may use
/// one. Parameters of laws are zero until they are given, and every load pattern has the amplitude 1.
///
/// On several ranks each describes the bodies it has and the interfaces that touch them; then the constructor, solve()
/// and sweep() are collective, and what is not on a rank is not named there.
class Study {
 public:
  struct Implementation;
  /// For the programs of the kernel.
  explicit Study(std::shared_ptr<const Implementation> implementation)
      : implementation_(std::move(implementation)) {}
  /// Checks and factorises.
  /// @throws InputError, NumericalError naming the body or interface
  Study(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
        const Communicator& communicator = {}, const OperatorOptions& options = {});

  /// Parameters of laws, each a matrix (points or rows, columns) of which one row, or column, stands for all.
  /// @throws InputError naming the interface on a wrong name, shape or value
  [[nodiscard]] Study with_parameters(const std::vector<LawParameter>& parameters) const;
  /// One parameter, the same at all points and in all columns.
  [[nodiscard]] Study with_parameter(const std::string& interface, const std::string& parameter,
                                     double value) const;
  /// @param amplitudes (load patterns, columns): every column is a load case by itself
  /// @throws InputError on another number of patterns, no columns, and numbers that are not finite
  [[nodiscard]] Study with_loads(Matrix amplitudes) const;
  /// @param amplitudes (load patterns, steps): the columns are the steps of one history, which laws with memory follow
  /// @throws InputError as with_loads()
  [[nodiscard]] Study with_history(Matrix amplitudes) const;

  /// @throws InputError on options out of range, a start of another shape, and parameters whose columns do not fit,
  ///         naming the interface; whatever a callback or a law of the user throws
  [[nodiscard]] Solution solve(const SolveOptions& options = {}) const;
  /// Solve for many parameter sets, each started from its solved neighbours.
  /// @return converged if it went through, else how it was ended; points that are finished by then are handed out
  /// @throws InputError on shapes, names and positions that do not fit
  [[nodiscard]] Status sweep(const Points& points, const SweepOptions& options,
                             const PointCallback& each) const;

  /// Names of the interfaces of this rank; one between two ranks is on both.
  [[nodiscard]] std::vector<std::string> interfaces() const;
  /// Whether the first side of an interface is on this rank: of two that have it, one tells others of it.
  /// @throws InputError with the known interfaces
  [[nodiscard]] bool has_first_side(const std::string& interface) const;
  /// Names of the parts of this rank.
  [[nodiscard]] std::vector<std::string> parts() const;

 private:
  std::shared_ptr<const Implementation> implementation_;
};

}  // namespace latin
