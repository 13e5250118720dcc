#pragma once

#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "latin/iteration/joined_laws.hpp"
#include "latin/iteration/state.hpp"
#include "latin/substructure/contact_tangent.hpp"
#include "latin/substructure/tangent.hpp"

namespace latin::iteration {

/// The method of multipliers on the condensed structure, from wherever an iteration got stuck.
///
/// With forces f of the interfaces from the round before and a flexibility c that is small beside that of the bodies,
/// a round finds the displacements u for which the bodies are in equilibrium under
///
///     R_c(J u + c f),
///
/// which become the next forces: the proximal point method for the forces (R. T. Rockafellar, Math. Oper. Res. 1 (1976)
/// 97). For laws that have a potential every round is the minimum of a convex function, found by Newton's method with
/// a line search, and the rounds converge from anywhere. Where friction has no potential and Newton's method fails,
/// some rounds hold the bounds of friction at those of the round before (J. Necas, J. Jarusek, J. Haslinger, Boll. Un.
/// Mat. Ital. 17 (1980) 796): the tangential forces are asked for with the normal jumps held.
///
/// On several ranks every one takes the same steps on the whole structure, those of the first; laws are asked where they
/// are. Tables are those of all ranks, unless it is said.
class Multipliers {
 public:
  /// Steps below this that become no shorter are rounding, relative to the displacement of a body.
  static constexpr double of_rounding = 1e-7;
  /// Springs that keep a body where the round before has left it, relative to the search direction.
  static constexpr double keeping = 1e-6;

  /// Whether there is such a search: with columns that are steps of one history. Collective.
  [[nodiscard]] static bool suits(const substructure::Laws& laws);

  /// @param laws of the run; they must outlive this object
  /// @param known the structure, condensed; null: it is condensed here
  explicit Multipliers(const substructure::Laws& laws,
                       std::shared_ptr<const substructure::Joined> known = nullptr);

  /// Replace the data and traces of a state by those of the answer, column by column. Collective.
  /// @param state of this rank, whose traces are those of its data
  /// @param most  factorisations
  /// @return whether all columns have settled; otherwise those that have not are where they got to
  /// @throws NumericalError if a law has no answer on the way
  bool solve(State& state, Index most);
  /// This rank's state before the last round: how far it is away is what the rounds have left of an error, at most.
  [[nodiscard]] const State& before_last() const { return before_last_; }
  /// (columns, bodies of this rank) 1 where a body touches nothing, or touches without force what it can leave: its place is one of
  /// many, and what rounding does to that no error.
  [[nodiscard]] const Matrix& placeless() const { return placeless_; }

 private:
  struct Answered {
    Vector force;
    Matrix slopes;
    bool symmetric;
  };
  [[nodiscard]] bool solve_columns(State& state, Index most);
  [[nodiscard]] bool solve_column(const Vector& force, bool lands);
  [[nodiscard]] Vector forces_on_bodies() const;
  [[nodiscard]] Vector terms() const;
  [[nodiscard]] std::vector<bool> forceless() const;
  [[nodiscard]] Vector of_bodies(const Vector& forces) const;
  /// Equilibrium with the forces at hand. @return whether it was found
  [[nodiscard]] bool find_equilibrium();
  [[nodiscard]] const substructure::Joined& joined() const { return tangent_.joined(); }
  /// Rows of a body.
  [[nodiscard]] auto rows_of(std::size_t body) const {
    const substructure::Joined::JoinedBody& own = joined().bodies()[body];
    return Eigen::seqN(own.first_row, own.traces.rows());
  }
  [[nodiscard]] Answered ask() const;
  [[nodiscard]] Vector force_at(const Vector& jump) const;
  [[nodiscard]] Vector residual_of(const Vector& force) const;
  void keep_idle();
  [[nodiscard]] std::vector<bool> idle_bodies() const;
  void find_placeless();
  [[nodiscard]] std::size_t body_of(Index row) const;
  [[nodiscard]] Vector stiffness_times(const Vector& moved) const;
  [[nodiscard]] Vector kept_forces(const Vector& moved) const;
  [[nodiscard]] const SparseRows& placed() const;
  [[nodiscard]] bool try_step(const Answered& at, const Vector& residual, double hold,
                              Vector& step);
  [[nodiscard]] bool step_from(const Answered& at, const Vector& residual, Vector& step);
  [[nodiscard]] double line_search(const Answered& at, const Vector& residual,
                                   const Vector& step) const;
  [[nodiscard]] double step_length(const Answered& at, const Vector& residual, const Vector& step);
  [[nodiscard]] Vector free_jump() const;
  [[nodiscard]] double farthest() const;
  [[nodiscard]] Vector all_pressed() const;
  void follow(Vector& bounds, const Vector& now) const;
  [[nodiscard]] double change(const Vector& step, const std::vector<bool>& apart) const;
  void set_flexibility(double factor);
  void write(const Vector& moved, const Vector& force, State& state) const;

  const substructure::Laws& laws_;
  substructure::Tangent tangent_;
  JoinedLaws system_;
  bool remembers_;
  std::vector<bool> linear_;                              ///< (interfaces)
  std::vector<Index> nonlinear_;                          ///< unknowns of nonlinear laws
  std::optional<substructure::ContactTangent> contacts_;  ///< where it pays
  Vector areas_;                                          ///< (unknowns)
  Vector softness_;  ///< length / modulus of the softer side, (unknowns)
  /// First unknowns of points with tangential components, and the number of their components.
  std::vector<std::pair<Index, Index>> coupled_;
  std::vector<Index> single_;  ///< unknowns of points without
  Vector scale_;               ///< 1 / sqrt of the diagonal of S, (active)
  // of the column at hand
  Index column_ = 0;
  JoinedLaws::Memory memory_;
  double factor_ = 1.0;
  Vector flexibility_;   ///< c, (unknowns)
  Vector traces_;        ///< where it began, (rows)
  Vector jump_;          ///< the same, (unknowns)
  Vector pull_;          ///< forces of the interfaces on the bodies there, (active)
  Vector moved_;         ///< since then, (active)
  Vector force_;         ///< multipliers, (unknowns)
  Vector moved_before_;  ///< the same, before the last round
  Vector force_before_;
  State before_last_;
  Matrix placeless_;
  Vector frozen_;  ///< free jumps of which friction takes its bounds; empty: of those at hand
  Vector
      keeping_;  ///< springs that keep bodies where the round before has left them (force / length), (placed())
  bool keeps_ = false;  ///< whether there are any
  bool held_ = false;   ///< whether more springs than least hold the bodies in a step
  bool loose_ = false;  ///< whether an equilibrium was found but for where its parts are
  double best_ = 0.0;
  Index since_ = 0;
  Index left_ = 0;  ///< factorisations
};

}  // namespace latin::iteration
