#pragma once

#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "latin/common/communicator.hpp"
#include "latin/common/workspace.hpp"
#include "latin/interface/interface.hpp"
#include "latin/substructure/body.hpp"
#include "latin/substructure/flexibility.hpp"
#include "latin/substructure/macro.hpp"
#include "latin/substructure/pair.hpp"

namespace latin::substructure {

/// One side of an interface, as the caller describes it. Of a side on another rank only the member is
/// given: the rest comes from there.
struct SideDescription {
  std::string member;  ///< substructure that the side belongs to
  SparseRows trace;    ///< T (dim * points, n), global components
  Vector direction;    ///< search direction k per row (components * points), > 0
  double scale;        ///< modulus / length of the body: what a displacement is measured with, > 0
};

/// Size of a global-stage solution, or of the difference of two.
struct Size {
  double strain = 0.0;  ///< u^T K u, summed over columns
  double trace = 0.0;   ///< sum of scale * W * w^2: sees the rigid motions that strain does not
  double work = 0.0;    ///< sum of |w| W |f|: what the strain energy is the balance of

  /// Error of which this is the size, relative to a solution of size `whole`: the larger of its shares in
  /// strain energy and in displacement of the interfaces. It does not depend on the search direction.
  [[nodiscard]] double relative_to(const Size& whole) const;
  /// Rounding may leave the energy of a rigid motion negative.
  [[nodiscard]] Size positive() const { return {std::abs(strain), trace, work}; }
};

/// An active interface: the caller's description. One side: boundary interface. An interface whose sides
/// lie on two ranks is described on both, alike.
struct InterfaceDescription {
  std::string name;
  interface::LawSource law;            ///< a name, see make_law(), or a law of the caller
  Vector weights;                      ///< (points) areas, > 0
  Matrix frames;                       ///< (components * points, dim), orthonormal rows
  std::vector<SideDescription> sides;  ///< one or two
  /// Z (components * points, moments) of the coarse problem, any unit; empty: not in it. On a boundary
  /// interface the forces are balanced against those of its law, which must not depend on the jump.
  // NOLINTNEXTLINE(readability-redundant-member-init): callers may leave it out
  Matrix basis{};
  /// Whether its residual is solved for instead of taken as it is (Pair); for linear laws. On a boundary
  /// interface half the residual is taken: the step for a k far above (prescribed displacement) or below
  /// (prescribed force) the stiffness of the body.
  bool paired = false;
};

/// How the columns of a run become columns in which the law of an interface is deterministic, and back,
/// for its components [begin, end): `samples = block * forward`, `block = samples * backward`.
///
/// Chaos modes take the eigenvectors of the Galerkin matrix of a random stiffness (exact: the coupled
/// systems of size P + 1 of the paper's section 4.3, one a point and direction, fall apart into P + 1
/// scalar ones), or the basis at quadrature points (a projection, for laws that are not linear).
struct LawColumns {
  Index begin = 0;
  Index end = 0;
  /// None: the identity, which costs nothing. One: (c, q), for all points. Several: one a point, for a
  /// stiffness that is a random field.
  std::vector<Matrix> forward;
  std::vector<Matrix> backward;  ///< (q, c) each
  /// Parameters as the law sees them in the samples: name -> field of q columns. They are not held to the
  /// law's minimum: eigenvalues of a Galerkin matrix are not values, and the caller guards their sign.
  std::vector<std::pair<std::string, interface::ParameterField>> parameters;
};

/// Substructures and active interfaces, factorised: everything of a scene that stays constant while
/// laws, parameters and columns change.
///
/// Interface data of all sides are stacked into one block (rows, c): bodies in order, the sides of a body
/// in the order of their interfaces. One iteration is
///
///     w = global_stage(s)          f = s - k w                 one solve a body, c right-hand sides
///     s + r = local_stage(s, w)    r = f^ + k w^ - s           laws, point by point
///
/// On several ranks each holds some of the bodies, with the interfaces that touch them. All rows here are
/// those of the rank's own bodies. The local stage of an interface between two ranks is done on both, from
/// the same numbers: what they swap is each side's share of the free jump. Members marked as collective
/// are called on all ranks together. One thread at a time: the stages keep their working blocks here.
class Problem {
 public:
  /// Collective. @throws InputError or NumericalError naming the body or interface
  Problem(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
          const OperatorOptions& options, const Communicator& communicator = {});

  [[nodiscard]] const Communicator& communicator() const { return communicator_; }
  [[nodiscard]] Index rows() const { return rows_; }
  /// Rows of all ranks.
  [[nodiscard]] Index total_rows() const { return total_rows_; }
  [[nodiscard]] Index loads() const { return loads_; }
  [[nodiscard]] Index unknowns() const;
  [[nodiscard]] Index active_unknowns() const;
  [[nodiscard]] const std::vector<Body>& bodies() const { return bodies_; }
  [[nodiscard]] std::size_t interfaces() const { return interfaces_.size(); }
  [[nodiscard]] const interface::Interface& interface(std::size_t i) const {
    return interfaces_.at(i).geometry;
  }
  /// @throws InputError with the known names
  [[nodiscard]] std::size_t find_interface(const std::string& name) const;
  [[nodiscard]] bool has_interface(const std::string& name) const;

  /// Set a law parameter; a field of one row (or column) stands for all rows (columns).
  /// @throws InputError naming the interface on a wrong name, shape or value
  void set_parameter(const std::string& interface, const std::string& parameter, Matrix values);
  [[nodiscard]] Matrix parameter(const std::string& interface, const std::string& parameter) const;
  /// Give an interface transforms for its columns (none: every column is a sample of its own).
  /// @throws InputError naming the interface if the groups do not cover its components once, or shapes
  ///         disagree
  void set_columns(const std::string& interface, std::vector<LawColumns> groups);

  /// Add forces on substructures to the load patterns, instead of all that were added before.
  /// @param loads (n, l), force, by substructure of this rank
  /// @throws InputError naming a substructure that is not on this rank, or whose load does not fit
  void set_extra_loads(const std::map<std::string, Matrix>& loads);

  /// Columns that are the time steps of one history, in order; laws with history follow them. With chaos
  /// modes beside them the time steps run fastest.
  void set_steps(Index steps);
  [[nodiscard]] Index steps() const { return steps_; }
  /// Whether laws and transforms fit a run of so many columns. @throws InputError naming the interface
  void check_columns(Index columns) const;

  /// Whether all laws on this rank are linear.
  [[nodiscard]] bool linear() const;
  /// Whether Newton steps are possible (every body condensed, every column a sample of its own, one rank),
  /// of use (some law is not linear) and affordable (at most `limit` unknowns: points times components).
  [[nodiscard]] bool suits_newton(Index limit) const;
  /// Dense flexibility of the interfaces, made when first asked for. Not to be called from two threads.
  [[nodiscard]] const Flexibility& flexibility() const;
  /// All interfaces as one: the points and components ("unknowns") of one after the other.
  [[nodiscard]] Index interface_unknowns() const { return interface_unknowns_; }
  /// First unknown of the point that each belongs to, and the number of its components.
  struct Layout {
    std::vector<Index> first;
    std::vector<Index> components;
  };
  [[nodiscard]] Layout layout() const;
  /// A flexibility (unknowns) with which the laws may be asked in place of 1/k1 + 1/k2: `wanted`, and no
  /// larger than that where a law may have several answers.
  [[nodiscard]] Vector law_flexibility(const Vector& wanted) const;
  /// j0 (unknowns, c).
  [[nodiscard]] Matrix free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const;
  /// Forces R(j0) (unknowns, c) for free jumps that belong to the given flexibility (unknowns).
  [[nodiscard]] Matrix forces(ConstMatrixRef jumps, ConstVectorRef flexibility) const;
  /// Derivatives of the forces of one column with respect to its own free jumps, by differences:
  /// block-diagonal by point, (unknowns, most components); row = a component of the force, column = one of
  /// the jump at the same point.
  [[nodiscard]] Matrix slopes(ConstMatrixRef jumps, ConstVectorRef flexibility, Index column) const;

  /// w of all sides, (rows, c). Bodies are independent: nothing is communicated.
  void global_stage(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces) const;
  /// Add to the traces what a change of the data (rows, c) adds to them, in single precision.
  void global_change(ConstMatrixRef change, MatrixRef traces) const;
  /// Whether the global stage is followed by a coarse problem.
  [[nodiscard]] bool balances() const;
  /// Balance the moments of the interface forces after a global stage, see Macro. The coarse problem is
  /// factorised when first asked for: not to be called from two threads then.
  /// @return what was added to the data, (rows, c)
  [[nodiscard]] Matrix balance(MatrixRef data, MatrixRef traces) const;
  [[nodiscard]] Index macro_size() const { return macro_ ? macro_->size() : 0; }
  /// Whether some interfaces are paired.
  [[nodiscard]] bool preconditions() const;
  /// Residual (rows, c) into a step on the data: paired interfaces are solved with their laws as they were
  /// when first asked for, the others take the residual as it is.
  void precondition(MatrixRef residual) const;
  /// r = f^ + k w^ - s, (rows, c). Collective among neighbours.
  void local_stage(ConstMatrixRef data, ConstMatrixRef traces, MatrixRef residual) const;

  /// f^ of one interface on its first side and the jump w^2 - w^1, both (components * points, c), as the
  /// local stage leaves them: the law holds exactly between them. Collective among the interface's ranks.
  struct LocalFields {
    Matrix force;
    Matrix jump;
  };
  [[nodiscard]] LocalFields local_fields(std::size_t interface, ConstMatrixRef data,
                                         ConstMatrixRef traces) const;
  /// The law of one interface, column by column and without transforms, for a given free jump j0
  /// (components * points, c): what a chaos is evaluated with sample by sample.
  /// @param parameters replace those of the law, c columns or one each
  /// @throws InputError naming the interface on a wrong name, shape or value
  [[nodiscard]] LocalFields resolve_samples(
      std::size_t interface, ConstMatrixRef free_jump,
      const std::vector<std::pair<std::string, Matrix>>& parameters) const;

  /// Row of the first value of a side in the stacked blocks; -1 for a side on another rank.
  [[nodiscard]] Index first_row(std::size_t interface, std::size_t side) const;
  /// 1/k1 (+ 1/k2), (components * points).
  [[nodiscard]] const Vector& point_flexibility(std::size_t interface) const {
    return interfaces_.at(interface).flexibility;
  }
  [[nodiscard]] std::size_t sides(std::size_t interface) const {
    return interfaces_.at(interface).rows.size();
  }

  /// weights and k of all rows
  [[nodiscard]] const Vector& weights() const { return weights_; }
  [[nodiscard]] const Vector& directions() const { return directions_; }

  /// This rank's share of size(): to be summed, then positive().
  [[nodiscard]] Size share_of_size(ConstMatrixRef data, ConstMatrixRef traces,
                                   ConstMatrixRef amplitudes) const;
  /// Size of the global-stage solution with the given data and traces. Collective.
  [[nodiscard]] Size size(ConstMatrixRef data, ConstMatrixRef traces,
                          ConstMatrixRef amplitudes) const;
  /// This rank's share of the size of the difference of two solutions.
  [[nodiscard]] Size share_of_distance(ConstMatrixRef data, ConstMatrixRef traces,
                                       ConstMatrixRef other_data,
                                       ConstMatrixRef other_traces) const;
  /// Size of a difference of two solutions (their loads cancel). Collective.
  [[nodiscard]] Size difference_size(ConstMatrixRef data, ConstMatrixRef traces) const;

  /// Displacements (n, c) of the named substructure's body, by substructure name.
  [[nodiscard]] std::vector<std::pair<std::string, Matrix>> displacements(
      ConstMatrixRef data, ConstMatrixRef amplitudes) const;

 private:
  struct Entry {
    interface::Interface geometry;
    std::vector<Index> rows;  ///< first row of each side
    Vector flexibility;       ///< 1/k1 (+ 1/k2)
    Index first_unknown = 0;  ///< among the points and components of all interfaces
    Matrix basis;
    bool paired = false;
    std::vector<LawColumns> groups;
    std::vector<std::shared_ptr<interface::Law>> group_laws;
    /// The side on another rank, with its slot in the exchange; rank -1: none.
    struct Away {
      std::size_t side = 0;
      int rank = -1;
      std::size_t slot = 0;
    } away;

    [[nodiscard]] bool shared() const { return away.rank >= 0; }
    /// The side on this rank of a shared interface.
    [[nodiscard]] std::size_t here() const { return 1 - away.side; }
  };

  void build(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
             const OperatorOptions& options, const std::map<std::string, int>& owners);
  void connect();

  [[nodiscard]] double squared_traces(ConstMatrixRef traces) const;
  [[nodiscard]] Eigen::Map<Matrix> resolve(const Entry& entry,
                                           const Eigen::Map<Matrix>& free_jump) const;
  /// The law without transforms, for any flexibility.
  void ask(const Entry& entry, ConstMatrixRef free_jump, ConstVectorRef flexibility,
           Matrix& force) const;
  /// What a side on this rank adds to (side 2: takes from) the free jump: s / k - 2 w.
  void share_of_jump(const Entry& entry, std::size_t side, ConstMatrixRef data,
                     ConstMatrixRef traces, MatrixRef share) const;
  /// @param away share of the side on another rank, where there is one
  [[nodiscard]] Eigen::Map<Matrix> free_jump(const Entry& entry, ConstMatrixRef data,
                                             ConstMatrixRef traces, ConstMatrixRef away) const;
  void local_stage(const Entry& entry, ConstMatrixRef data, ConstMatrixRef traces,
                   ConstMatrixRef away, MatrixRef residual) const;

  Communicator communicator_;
  std::unique_ptr<Exchange> exchange_;
  std::vector<Body> bodies_;
  std::vector<Index> body_rows_;
  std::vector<std::vector<std::string>> member_names_;
  std::vector<Entry> interfaces_;
  Vector weights_;
  Vector directions_;
  Vector inverse_directions_;
  Vector trace_metric_;  ///< scale * W
  Index rows_ = 0;
  Index total_rows_ = 0;
  Index loads_ = 0;
  Index steps_ = 1;
  Index interface_unknowns_ = 0;
  [[nodiscard]] std::size_t body_of(Index row) const;
  [[nodiscard]] Pair make_pair(const Entry& entry) const;

  // blocks of the local stage, kept from one to the next: no block is allocated in the iteration
  mutable Workspace jump_;
  mutable Workspace share_;
  mutable Workspace force_;
  mutable Workspace samples_;
  mutable Workspace sample_forces_;
  mutable Workspace back_;

  mutable std::unique_ptr<Flexibility> flexibility_;
  mutable std::unique_ptr<Macro> macro_;
  mutable std::vector<Pair> pairs_;
};

}  // namespace latin::substructure
