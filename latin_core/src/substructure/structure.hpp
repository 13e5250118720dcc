#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/lazy.hpp"
#include "interface/interface.hpp"
#include "latin/common/communicator.hpp"
#include "latin/substructure/description.hpp"
#include "substructure/body.hpp"
#include "substructure/flexibility.hpp"
#include "substructure/macro.hpp"
#include "substructure/pair.hpp"
#include "substructure/seen_forces.hpp"

namespace latin::substructure {

/// An interface that is iterated on, where it lies in the stacked blocks.
struct ActiveInterface {
  interface::Interface geometry;
  std::vector<Index>
      rows;  ///< first row of each side in the stacked blocks; -1 for a side on another rank
  Vector flexibility;       ///< 1/k1 (+ 1/k2), (components * points)
  Index first_unknown = 0;  ///< among the points and components of all interfaces
  Matrix basis;             ///< of the coarse problem; empty: not in it
  bool paired = false;
  /// What the side on another rank is to a pair; null: there is none.
  std::shared_ptr<const PairSide> beyond;
  /// The side on another rank; rank -1: none.
  struct Away {
    std::size_t side = 0;
    int rank = -1;
  } away;

  [[nodiscard]] const std::string& name() const { return geometry.name; }
  /// Rows of one side: components * points.
  [[nodiscard]] Index size() const { return flexibility.size(); }
  [[nodiscard]] bool shared() const { return away.rank >= 0; }
  /// The side on this rank of a shared interface.
  [[nodiscard]] std::size_t here() const { return 1 - away.side; }
};

/// Substructures and active interfaces, factorised: everything of a scene that stays constant while
/// laws, parameters and columns change. What changes is in Laws; a run adds the working blocks of its two stages,
/// GlobalStage and LocalStage.
///
/// Interface data of all sides are stacked into one block (rows, c): bodies in order, the sides of a body
/// in the order of their interfaces. One iteration is
///
///     w = global stage(s)          f = s - k w                 one solve per body, c right-hand sides
///     s + r = local stage(s, w)    r = f^ + k w^ - s           laws, point by point
///
/// On several ranks each holds some of the bodies, with the interfaces that touch them. All rows here are
/// those of the rank's own bodies. The local stage of an interface between two ranks is done on both, from
/// the same numbers: what they swap is each side's share of the free jump.
///
/// Constant once it is built: several threads may use it.
class Structure {
 public:
  /// Interface unknowns up to which dense matrices of them are always affordable.
  static constexpr Index few_unknowns = 500;

  /// Collective. @param before a structure whose bodies' factors serve again where only their sides differ; null: none
  /// @throws InputError or NumericalError naming the body or interface
  Structure(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
            const OperatorOptions& options, const Communicator& communicator = {},
            const Structure* before = nullptr);
  Structure(const Structure&) = delete;
  Structure(Structure&&) = delete;
  Structure& operator=(const Structure&) = delete;
  Structure& operator=(Structure&&) = delete;
  ~Structure() = default;

  [[nodiscard]] const Communicator& communicator() const { return communicator_; }
  [[nodiscard]] Index rows() const { return rows_; }
  /// Rows of all ranks.
  [[nodiscard]] Index total_rows() const { return total_rows_; }
  /// Operations on all ranks: of the bodies' factorisations, about, and of their Schur complements on what is active.
  struct Work {
    double factorise = 0.0;
    double condense = 0.0;
  };
  [[nodiscard]] const Work& work() const { return work_; }
  /// Load patterns.
  [[nodiscard]] Index loads() const { return loads_; }
  [[nodiscard]] Index unknowns() const;
  [[nodiscard]] Index active_unknowns() const;

  [[nodiscard]] const std::vector<Body>& bodies() const { return bodies_; }
  /// First row of every body in the stacked blocks.
  [[nodiscard]] const std::vector<Index>& body_rows() const { return body_rows_; }
  /// Names of the substructures of every body.
  [[nodiscard]] const std::vector<std::vector<std::string>>& members() const { return members_; }

  /// Of every body the number of what it is connected with by active interfaces, over all ranks: where there are
  /// several, nothing passes from one to another, and neither does rounding.
  [[nodiscard]] const std::vector<Index>& component() const { return component_; }
  /// Their count, the same on all ranks.
  [[nodiscard]] Index components() const { return components_; }

  [[nodiscard]] const std::vector<ActiveInterface>& interfaces() const { return interfaces_; }
  [[nodiscard]] const ActiveInterface& interface(std::size_t i) const { return interfaces_.at(i); }
  /// @throws InputError with the known names
  [[nodiscard]] std::size_t find_interface(const std::string& name) const;
  [[nodiscard]] bool has_interface(const std::string& name) const;
  /// Interfaces that this rank shares with another, in the order in which both go through them.
  [[nodiscard]] const std::vector<std::size_t>& shared_interfaces() const { return shared_; }
  /// All interfaces as one: the points and components ("unknowns") of one after the other.
  [[nodiscard]] Index interface_unknowns() const { return interface_unknowns_; }
  /// Those of all ranks, each interface once.
  [[nodiscard]] Index total_unknowns() const { return total_unknowns_; }

  /// Weights and search directions k of all rows.
  [[nodiscard]] const Vector& weights() const { return weights_; }
  [[nodiscard]] const Vector& directions() const { return directions_; }
  [[nodiscard]] const Vector& inverse_directions() const { return inverse_directions_; }
  /// scale * W: what displacements of the sides are measured with.
  [[nodiscard]] const Vector& trace_metric() const { return trace_metric_; }
  /// The same of all rows of a body, of displacements of 1: force / length.
  [[nodiscard]] double metric_of(std::size_t body) const;
  /// Traces (rows) where displacements are 1 at most: what turns rotations into lengths.
  [[nodiscard]] const Vector& levers() const { return levers_; }
  /// Square size of displacements (rows) of the sides of a body: on the sides, and, where the body can move as a
  /// whole, of that motion of the whole.
  template <class W>
  [[nodiscard]] double trace_size(std::size_t body, const W& traces) const {
    const Matrix& whole = motions_[body];
    const double of_sides =
        traces.cwiseAbs2().dot(trace_metric_.segment(body_rows_[body], bodies_[body].rows()));
    return whole.rows() == 0 ? of_sides : of_sides + (whole * traces).squaredNorm();
  }

  /// Displacements (rows) of the sides of a body, of one that is carried without its motion as a whole, which forces in
  /// equilibrium do no work on: products of the two are those of its strain, and not differences of larger ones.
  template <class W>
  [[nodiscard]] Vector straining(std::size_t body, const W& traces) const {
    if (!carried_[body]) {
      return traces;
    }
    return traces - rigid_[body] * (motions_[body] * traces);
  }
  /// Whether a body can move as a whole and nothing but forces of its sides strains it.
  [[nodiscard]] bool carried(std::size_t body) const { return carried_[body]; }

  /// Whether some interface is paired, on any rank.
  [[nodiscard]] bool pairs() const { return pairs_; }
  /// Body that has a row.
  [[nodiscard]] std::size_t body_of_row(Index row) const;
  /// Numbers of shared interfaces, of which the neighbour says its own, behind which there may be zeros. Collective.
  [[nodiscard]] std::vector<std::vector<double>> swapped(
      const std::vector<std::size_t>& interfaces,
      const std::vector<std::vector<double>>& own) const;
  /// A side of a paired interface that is on this rank.
  [[nodiscard]] PairSide pair_side(const ActiveInterface& interface, std::size_t side) const;
  /// Number of coarse unknowns of all ranks; 0: the global stage is not followed by a coarse problem.
  [[nodiscard]] Index macro_size() const { return macro_size_; }
  /// The coarse problem, factorised when first asked for, which is collective.
  [[nodiscard]] const Macro& macro() const;
  /// Whether flexibility() can be made: its matrix and the stiffnesses of the bodies on their sides keep to the memory
  /// limit of dense blocks. Collective.
  [[nodiscard]] bool has_flexibility() const;
  /// Dense flexibility of the interfaces, made when first asked for, which is collective.
  [[nodiscard]] const Flexibility& flexibility() const;
  /// Made when first asked for, which is collective.
  [[nodiscard]] const SeenForces& seen_forces() const;

 private:
  /// Where a substructure is; body and position among its members on its own rank only.
  struct Place {
    int rank = 0;
    std::size_t body = 0;
    Index member = 0;
  };
  using Owners = std::map<std::string, Place>;
  /// Sides of the bodies while they are gathered, with the interface and side that each is.
  struct Sides {
    std::vector<std::vector<BodySide>> of_body;
    std::vector<std::vector<std::pair<std::size_t, std::size_t>>> owner;
  };
  [[nodiscard]] Owners find_owners() const;
  void add_interface(InterfaceDescription description, const Owners& owners, Sides& sides);
  void build_bodies(std::vector<BodyDescription> bodies, Sides sides,
                    const OperatorOptions& options, const Structure* before);
  void stack_metrics(const std::vector<std::vector<double>>& scales,
                     const std::vector<std::vector<double>>& levers,
                     const std::vector<std::vector<Matrix>>& motions);
  [[nodiscard]] Matrix motion_of(std::size_t body, const Matrix& on_sides) const;
  void connect();
  void share_bases();
  void share_pairs();
  void find_components(const std::vector<std::string>& joined);
  void check_neighbours() const;

  Communicator communicator_;
  std::vector<Body> bodies_;
  std::vector<Index> body_rows_;
  std::vector<std::vector<std::string>> members_;
  std::vector<ActiveInterface> interfaces_;
  std::vector<std::size_t> shared_;
  std::vector<Index> component_;
  Index components_ = 0;
  Vector weights_;
  Vector directions_;
  Vector inverse_directions_;
  Vector trace_metric_;
  Vector levers_;
  std::vector<Matrix>
      motions_;  ///< by body: of the whole, measured, by the displacements of the sides (r, rows)
  std::vector<bool> carried_;  ///< by body
  std::vector<Matrix> rigid_;  ///< by body: displacements of the sides of these motions (rows, r)
  Index rows_ = 0;
  Index total_rows_ = 0;
  Work work_;
  Index loads_ = 0;
  Index interface_unknowns_ = 0;
  Index macro_size_ = 0;
  Index total_unknowns_ = 0;
  bool pairs_ = false;
  double memory_limit_;  ///< bytes of a dense block; 0: none
  Lazy<Macro> macro_;
  Lazy<Flexibility> flexibility_;
  Lazy<SeenForces> seen_forces_;
};

}  // namespace latin::substructure
