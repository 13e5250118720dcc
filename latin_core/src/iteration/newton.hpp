#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "iteration/joined_system.hpp"
#include "iteration/newton_proposal.hpp"
#include "iteration/skeleton.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "latin/iteration/summary.hpp"
#include "substructure/global_stage.hpp"
#include "substructure/interface_system.hpp"

namespace latin::iteration {

/// Semi-smooth Newton on the interface forces, marched through the columns of a history.
///
/// With the bodies eliminated a column is f = R(j0), j0 = b - A f + G a + c f: A the flexibility of the bodies, b
/// the jump that the loads alone would leave, a the amplitudes of modes that nothing else holds, with the
/// equilibrium of those as further equations. The flexibility c at which the laws are asked is free; it is that of
/// the bodies at the point itself, so that nothing here depends on the search direction. With that c a step is that of
/// P. Alart and A. Curnier, Comput. Methods Appl. Mech. Engng 92 (1991) 353, for every law that answers.
///
/// The columns of a history are solved in their order, each from the answer of the step before it under its own loads:
/// the first iteration takes the laws linearised where that step has left them (what was closed sticks, what was open
/// stays open, what was damaged unloads), and no step moves what nothing holds much further than the jumps are large. Where
/// one would, it is asked whether anything balances the loads, and springs hold that motion. Where whole steps go in
/// circles, steps are shortened by the residual; then the modes are held by springs that become ever weaker (where these
/// end up carrying a constant share of the loads, however weak they are, something slides away); then compliances in
/// series with the laws make them softer; at last the loads are added in parts. What none of these solves ends the march:
/// the columns before it are answers.
///
/// Bonds that soften are followed along their path: elastic up to the load at which the first point is damaged, then by
/// what is dissipated, with the load as one more unknown, through loads that fall, until the step's is reached. Where
/// the load falls, a structure under the loads of the history snaps.
///
/// A step solves dy = Phi + R' dj0 for the residual Phi = R(j0) - f: see Skeleton.
///
/// On several ranks the bodies and laws are asked where they are, and each rank takes the same steps, see JoinedSystem.
class Newton {
 public:
  /// @param global stage of the run, amplitudes of its load patterns; they must outlive this object
  /// @param dense   by the dense flexibility of the interfaces, or with the whole bodies
  /// @param goes_on asked before every step with the number of those so far: whether to take it. Collective.
  /// @param balanced asked at the first flight of a column: where nothing balances its loads, it has no equilibrium
  Newton(substructure::GlobalStage& global, const Matrix& amplitudes, bool dense = true,
         std::function<bool(Index)> goes_on = {}, Balanced balanced = {});

  /// Solve column after column, until one of them fails. Collective.
  /// @param state of the iterate; replaced in the columns that are solved
  /// @param tolerance    on the forces, relative to the largest column of them
  /// @param most         columns that are solved
  NewtonOutcome solve(State& state, double tolerance, Index most);

  [[nodiscard]] const Skeleton& skeleton() const { return *skeleton_; }
  /// The laws of this rank.
  [[nodiscard]] const substructure::InterfaceSystem& system() const { return system_.own(); }

 private:
  /// A residual that no step makes better is rounding if it is below this share of the forces.
  static constexpr double rounding_of_forces = 1e-9;
  /// One column: where it starts, and what Newton changes.
  struct Column {
    Index index;
    Skeleton::Start start;
    Vector before;  ///< forces f with y = 0
    Vector y;       ///< change of the forces
    Vector motion;  ///< of the bodies beside it
    Vector jump;    ///< j0 (at the laws' flexibility) now
    Vector phi;     ///< R(j0) - f
    double norm = 0.0;
    double softness = 0.0;  ///< of compliances in series, as a share of the laws' flexibility
    Vector stretching;      ///< forces that have stretched these already

    [[nodiscard]] Vector force() const { return before + y; }
  };
  /// The laws linearised at the answer of the step before: f = force + slopes (j0 - jump).
  struct Predictor {
    Vector force;
    Vector jump;
    Matrix slopes;
  };
  /// How steps are taken: as the predictor says at first, and shortened where the residual does not fall.
  struct Way {
    const Predictor* predictor = nullptr;
    bool searched = false;
  };
  NewtonOutcome solve_all(State& state, double tolerance, Index most);
  [[nodiscard]] double size_of_forces(const Matrix& data, const Matrix& traces) const;
  [[nodiscard]] Vector loads_of(Index index) const;
  [[nodiscard]] double reach_of_loads(const State& state);
  [[nodiscard]] Column begin(const State& state, Index index);
  /// With given forces, not evaluated.
  [[nodiscard]] Column started(Index index, const Vector& force, ConstVectorRef data,
                               ConstVectorRef traces) const;
  /// From where an iteration is, if that is near, and else from the step before.
  [[nodiscard]] bool solve_column(State& state, Column& column, double tolerance, Index& steps);
  /// Looks at an answer again: a long way has left its rounding in it.
  void refine(State& state, Column& column, double tolerance, Index& steps);
  [[nodiscard]] bool march(const State& state, Column& column, double tolerance, Index& steps);
  /// The way between the loads of the step before and those of a column.
  struct Course {
    Skeleton::Start start;  ///< change of that, and of the free jumps
    Vector jump;
    Vector before;  ///< amplitudes of the step before, and their change
    Vector change;
    Vector opens;       ///< change of the jumps on the way so far; empty: there is none
    double load = 0.0;  ///< reached so far: 0 to 1
    /// Change of it with what an increment dissipates, at its beginning and its end.
    double rate_at_first = 0.0;
    double rate = 0.0;
  };
  /// Along the path on which bonds are damaged.
  [[nodiscard]] bool follow(const State& state, Column& column, double tolerance, Index& steps);
  [[nodiscard]] Course course_of(const State& state, Column& column);
  [[nodiscard]] double advance(Course& course, Column& column, double tolerance, Index& steps);
  [[nodiscard]] bool arrive(const Course& course, const Column& column, Course& on, Column& next,
                            double tolerance, Index& steps);
  [[nodiscard]] Vector stiffness_of_bonds(Index index) const;
  [[nodiscard]] Vector integrity(const Column& column) const;
  [[nodiscard]] Vector tension(const Column& column) const;
  [[nodiscard]] Vector opening(const Column& column) const {
    return column.jump - own_.cwiseProduct(column.force());
  }
  [[nodiscard]] Vector opened_on(const Course& course, const Column& column) const;
  [[nodiscard]] bool at_strength(const Course& course, const Column& column) const;
  [[nodiscard]] double damage(const Column& from, const Column& to) const;
  /// Without damage, as far as that goes.
  [[nodiscard]] bool go_elastic(Course& course, Column& column, double tolerance, Index& steps);
  /// So much more dissipated.
  [[nodiscard]] bool dissipate(Course& course, Column& column, double amount, double tolerance,
                               Index& steps);
  static void load(Course& course, Column& column, double more);
  [[nodiscard]] JoinedSystem::Memory after(const Column& column) const;
  [[nodiscard]] bool attempt(Column& column, double tolerance, Way way, Index& steps);
  [[nodiscard]] bool in_parts(const State& state, Column& column, double tolerance, Index& steps);
  [[nodiscard]] bool drift(Column& column, double tolerance, Index& steps);
  [[nodiscard]] bool gone(const Column& column) const;
  [[nodiscard]] bool unbalanced(const Column& column);
  [[nodiscard]] bool hangs(const Column& column, const Vector& loads);
  [[nodiscard]] bool settle(Column& column, double ratio, double tolerance, Index& steps);
  [[nodiscard]] bool soften(Column& column, double tolerance, Index& steps);
  [[nodiscard]] Vector forces(const Column& column) const;
  [[nodiscard]] Matrix slopes(const Column& column) const;
  [[nodiscard]] Vector stretched(const Column& column) const {
    return column.jump + column.softness * own_.cwiseProduct(column.stretching);
  }
  void evaluate(Column& column);
  [[nodiscard]] Vector imbalance(const Column& column) const {
    return skeleton_->imbalance(column.start, column.y, column.motion);
  }
  /// Of Newton's: changes of the forces, of the motion beside them, and of the free jumps with both.
  struct Step {
    Vector dy;
    Vector dm;
    Vector change;
  };
  [[nodiscard]] bool stay(const Column& column, const Matrix& tangent, double tolerance, Step& step,
                          Index& steps);
  [[nodiscard]] double step_on_springs(const Column& column, const Matrix& tangent, double far,
                                       Step& step, Index& steps);
  /// @param share  of the step, or less
  /// @return the share that was taken
  double take(Column& column, const Step& step, double share, bool searched);
  /// What has changed in a column, as data and traces.
  void commit(State& state, const Column& column);
  /// Traces of the data of one column.
  void apply(State& state, Index index);
  /// The largest jump, in units of the flexibility at its point.
  [[nodiscard]] double reach(const Vector& jump) const {
    return jump.size() > 0 ? jump.cwiseQuotient(roots_).cwiseAbs().maxCoeff() : 0.0;
  }

  const Matrix& amplitudes_;
  JoinedSystem system_;
  std::unique_ptr<Skeleton> skeleton_;
  Vector own_;    ///< flexibility at which the laws are asked
  Vector roots_;  ///< what jumps are measured with, as these are lengths or rotations
  JoinedSystem::Memory memory_;  ///< of the columns before
  Predictor last_;               ///< of the answer of the column before
  bool remembers_ = false;       ///< whether the way to an answer matters
  bool softens_ = false;         ///< whether there are bonds
  Vector softening_;             ///< areas of their unknowns, else 0
  bool torn_ = false;            ///< whether the last path ended where nothing holds the parts
  double energy_ = 0.0;          ///< that the next increment of their path dissipates
  double fall_ = 0.0;            ///< of the load on their path, see NewtonOutcome
  Vector intact_;                ///< stiffness of bonds that nothing has damaged, else 0
  double scale_ = 0.0;           ///< size of the forces
  std::function<bool(Index)> goes_on_;
  bool stopped_ = false;  ///< by that
  Balanced balanced_;
  Index asked_ = -1;               ///< column that this was asked of
  std::optional<Status> lost_;     ///< why the column has no equilibrium
  bool hangs_on_nothing_ = false;  ///< whether something of a column does
  double far_ = 0.0;               ///< reach of a step
  double lengths_ = 0.0;  ///< reach of the gaps and of what else the laws impose on the jumps
};

}  // namespace latin::iteration
