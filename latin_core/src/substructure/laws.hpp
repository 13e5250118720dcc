#pragma once

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "common/lazy.hpp"
#include "latin/interface/law.hpp"
#include "stochastic/transform.hpp"
#include "substructure/field.hpp"
#include "substructure/pair.hpp"
#include "substructure/scaled.hpp"
#include "substructure/size.hpp"
#include "substructure/structure.hpp"

namespace latin::substructure {

/// How the columns of a run become columns in which the law of an interface is deterministic, and back,
/// for its components [begin, end): `samples = block * forward`, `block = samples * backward`.
///
/// Chaos modes take the eigenvectors of the Galerkin matrix of a random stiffness (exact: the coupled
/// systems of size P + 1 of the paper's section 4.3, one per point and direction, fall apart into P + 1
/// scalar ones), or the basis at quadrature points (a projection, for nonlinear laws).
struct LawColumns {
  Index begin = 0;
  Index end = 0;
  /// None: the identity, which costs nothing. One: (c, q), for all points. Several: one per point, for a
  /// stiffness that is a random field.
  std::vector<stochastic::ColumnTransform> transforms;
  /// Parameters as the law sees them in the samples: name -> field of q columns. They are not held to the
  /// law's minimum: eigenvalues of a Galerkin matrix are not values, and the caller guards their sign.
  std::vector<std::pair<std::string, interface::ParameterField>> parameters;
  /// The one transform again where most of it is zero, because few modes are coupled with each other; else empty.
  // NOLINTNEXTLINE(readability-redundant-member-init): callers leave it out
  SparseColumns sparse_forward{}, sparse_backward{};

  /// Fill the sparse ones where they are the quicker ones.
  void find_zeros();
  /// Columns of a sample block for a run of c columns in histories of this many steps.
  [[nodiscard]] Index samples(Index columns, Index steps) const {
    return transforms.empty() ? columns : transforms.front().forward.cols() * steps;
  }
};

/// The law of one interface with its parameters, as it is asked in the columns of a run. Immutable.
struct ActiveLaw {
  std::shared_ptr<const interface::Law> law;
  /// Transforms of its columns; empty: every column is a sample of its own.
  std::shared_ptr<const std::vector<LawColumns>> groups;
  std::vector<std::shared_ptr<const interface::Law>> group_laws;  ///< with the group's parameters
  /// Its matrix search directions, made when first asked for.
  std::shared_ptr<const Lazy<Pair>> pair;

  [[nodiscard]] bool transformed() const { return groups != nullptr && !groups->empty(); }
  /// Whether the transforms give a parameter, so that the law's own is not seen.
  [[nodiscard]] bool gives(const std::string& parameter) const;
};

/// Everything that may change between two runs on one structure: parameters of the laws of its interfaces,
/// transforms of their columns, the numbers of time steps and of modes, and loads beside those of the load patterns.
///
/// A value: it never changes, and a copy costs a few pointers. The `with_` functions return a changed copy,
/// which shares what they leave as it was. Several threads may use one.
class Laws {
 public:
  /// Every parameter zero, no transforms, one time step, no extra loads.
  explicit Laws(std::shared_ptr<const Structure> structure);

  [[nodiscard]] const Structure& structure() const { return *structure_; }
  [[nodiscard]] const std::shared_ptr<const Structure>& shared_structure() const {
    return structure_;
  }
  /// Whether both are copies of one value, which share all that they hold.
  [[nodiscard]] bool operator==(const Laws& other) const = default;
  /// Columns that are the time steps of one history, in order; laws with history follow them. With chaos
  /// modes beside them the time steps run fastest.
  [[nodiscard]] Index steps() const { return steps_; }
  /// Chaos modes that a solution has at every time step; 1: every column is a solution of its own.
  [[nodiscard]] Index modes() const { return modes_; }
  /// Which columns make up one.
  [[nodiscard]] ColumnGroups groups() const { return {steps_, modes_}; }
  /// Of columns that are load patterns of a linear history: the times whose solutions are their sums; null: columns
  /// are what they are.
  [[nodiscard]] const PatternTimes* in_time() const { return in_time_.get(); }
  /// Which columns are measured together, see in_time().
  [[nodiscard]] ColumnGroups measured() const {
    return {in_time_ == nullptr ? steps_ : in_time_->times(), modes_};
  }
  [[nodiscard]] const ActiveLaw& of(std::size_t interface) const { return active_->at(interface); }
  /// A parameter without transforms. @throws InputError on an unknown name
  [[nodiscard]] const Matrix& parameter(const std::string& interface,
                                        const std::string& parameter) const;
  /// What a body answers to its load patterns and the extra loads.
  [[nodiscard]] const LoadResponse& response(std::size_t body) const;
  /// A body whose stiffness has factors; null: it has none.
  [[nodiscard]] const ScaledColumns* scaled(std::size_t body) const;
  /// A body whose stiffness has factors that differ inside it; null: it has none.
  [[nodiscard]] const FieldColumns* field(std::size_t body) const;
  /// Whether the stiffness of some body has factors. Collective.
  [[nodiscard]] bool scales_anywhere() const;
  /// Whether the stiffness of every body is the same in all columns, factors included; of a chaos: at the means.
  [[nodiscard]] bool stiffness_is_one() const;
  /// Whether the structure has paired interfaces.
  [[nodiscard]] bool preconditions() const;
  /// Residual (rows, c) into a step on the data: paired interfaces are solved with their laws, the others take
  /// the residual as it is.
  void precondition(MatrixRef residual) const;

  /// Whether all laws on this rank are linear.
  [[nodiscard]] bool linear() const;
  /// Whether some law on this rank looks back on earlier time steps.
  [[nodiscard]] bool remembers() const;
  /// The same of the laws on all ranks. Collective.
  [[nodiscard]] bool linear_everywhere() const;
  [[nodiscard]] bool remembers_anywhere() const;
  /// Whether some columns are transformed.
  [[nodiscard]] bool transformed() const;
  /// Whether laws and transforms fit a run of this many columns. @throws InputError naming the interface
  void check_columns(Index columns) const;

  /// Parameters replaced. They reach transformed columns, too.
  /// @throws InputError naming the interface on a wrong name, shape or value, and for a parameter that a
  ///         transform of its columns gives: it would not be seen
  [[nodiscard]] Laws with_parameters(const std::vector<LawParameter>& changes) const;
  /// The transforms of an interface replaced (none: every column is a sample of its own).
  /// @throws InputError naming the interface if the groups do not cover its components once, or shapes
  ///         disagree
  [[nodiscard]] Laws with_columns(const std::string& interface,
                                  std::vector<LawColumns> groups) const;
  /// @throws InputError below one
  [[nodiscard]] Laws with_steps(Index steps) const;
  /// @throws InputError below one
  [[nodiscard]] Laws with_modes(Index modes) const;
  /// @param in_time factors of the patterns, (patterns, times); empty: none
  /// @throws InputError on numbers that are not finite
  [[nodiscard]] Laws with_times(Matrix in_time) const;
  /// Forces on substructures added to the load patterns, instead of all extra loads before.
  /// @param loads (n, l), force, by substructure of this rank
  /// @throws InputError naming a substructure that is not on this rank, or whose load does not fit
  [[nodiscard]] Laws with_extra_loads(const std::map<std::string, Matrix>& loads) const;
  /// Factors of the stiffness of substructures, also those that differ inside one; those that are not named keep theirs.
  /// @param factors by substructure of this rank; the members of a body have the same
  /// @throws InputError naming a substructure that is not on this rank, a factor that is not positive, and a body that
  ///         cannot have any, see ScaledBody
  [[nodiscard]] Laws with_stiffness(const std::map<std::string, StiffnessFactors>& factors) const;
  /// For this many parameter sets side by side: parameters that change from column to column are repeated.
  /// @throws InputError naming an interface whose columns are transformed
  [[nodiscard]] Laws repeated(Index sets) const;

 private:
  /// Matrix search directions of a paired interface with two sides.
  [[nodiscard]] const Pair& pair(std::size_t interface) const;
  [[nodiscard]] ActiveLaw with_parameters(std::size_t interface,
                                          const std::vector<const LawParameter*>& changes) const;
  [[nodiscard]] ActiveLaw with_law(std::size_t interface,
                                   std::shared_ptr<const interface::Law> law) const;
  void scale_again();
  /// Of with_stiffness(): substructures without stretches.
  [[nodiscard]] Laws with_factors(const std::map<std::string, StiffnessFactors>& factors) const;
  /// A body of which a member has a field.
  [[nodiscard]] FieldColumns field_of(std::size_t body,
                                      const std::map<std::string, StiffnessFactors>& factors) const;
  /// A copy with the laws of some interfaces replaced.
  [[nodiscard]] Laws with(std::map<std::size_t, ActiveLaw> changed) const;

  std::shared_ptr<const Structure> structure_;
  std::shared_ptr<const std::vector<ActiveLaw>> active_;
  Index steps_ = 1;
  Index modes_ = 1;
  std::shared_ptr<const PatternTimes> in_time_;             ///< null: columns are what they are
  std::shared_ptr<const std::vector<LoadResponse>> extra_;  ///< by body; null: no extra loads
  std::shared_ptr<const std::vector<ScaledColumns>>
      scaled_;  ///< by body, without body: 1; null: all are 1
  std::shared_ptr<const std::vector<std::shared_ptr<const FieldColumns>>>
      fields_;  ///< by body, null: none; null: none has any
};

}  // namespace latin::substructure
