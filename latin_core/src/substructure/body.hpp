#pragma once

#include <memory>
#include <string>
#include <vector>

#include "algebra/factor.hpp"
#include "common/fingerprint.hpp"
#include "common/lazy.hpp"
#include "common/workspace.hpp"
#include "latin/common/sparse_view.hpp"
#include "latin/common/types.hpp"
#include "latin/substructure/description.hpp"

namespace latin::substructure {

/// A side of an active interface that lies on a body.
struct BodySide {
  Index member;
  SparseRows trace;  ///< local frame, (rows, n)
  Vector weights;    ///< (rows)
  Vector direction;  ///< search direction k (rows), force / length^3, > 0
};

/// Seconds and bytes that were spent on setting up a body.
struct BodyCost {
  double assemble_s = 0.0;
  double factorise_s = 0.0;
  double condense_s = 0.0;
  double factor_numbers = 0.0;  ///< doubles in the sparse factor
  double dense_numbers = 0.0;   ///< doubles in the condensed block

  /// Operations of the sparse factor: those of meshes go with this power of its numbers.
  [[nodiscard]] double operations() const;
};

/// What a body answers to its load patterns alone, and to forces that were added to them.
struct LoadResponse {
  Matrix extra;   ///< (n_body, l) forces beside those of the body itself; empty: none
  Matrix traces;  ///< (rows, l) at s = 0
  // energy = a^T work_loads a + a^T work_traces^T s + (w - T u0)^T W f, see Body::energies()
  Matrix work_loads;
  Matrix work_traces;
  // what it is less where springs are measured from their jumps, a^T jump_loads a + a^T jump_traces^T s; empty: none
  Matrix jump_loads;
  Matrix jump_traces;
  Matrix unknowns;  ///< (n_body, l): the solution itself where nothing is active; else empty
};

/// Trace of one side of a body on the active unknowns that it touches.
struct SideTrace {
  SparseRows trace;  ///< (rows, touched)
  std::vector<Index> touched;
};

/// What of a body has a factor at each of some points: the stiffness B^T a B of one member.
struct Stretch {
  std::string member;
  Index points = 0;
  SparseRows of_unknowns;  ///< B Z (points * components, n_body)
  SparseRows back;         ///< its transpose
  Matrix offset;           ///< B u0 (points * components, l)
  Matrix initial;          ///< g (points * components, l)

  [[nodiscard]] Index components() const { return of_unknowns.rows() / points; }
};

/// Working blocks of the operators of bodies: those of one thread.
struct BodyWork {
  Workspace weighted;
  Workspace unknowns;
  WorkspaceOf<float> unknowns_single;
  Workspace relative;
  Workspace of_loads;
};

/// Substructures glued together, with the Robin terms of the active interfaces on them, factorised once:
///
///     (K + sum T^T W k T) q = F + sum T^T W s,   w = T u,   f = s - k w.       (DESIGN, global stage)
///
/// All fields on its sides are stacked: block (rows, c), sides in the order given. Constant once it is built: several
/// threads may use it, each with working blocks of its own.
class Body {
 public:
  /// @param before a body whose factor serves again where it differs in its sides only; null: none
  /// @throws InputError on shapes that disagree, NumericalError if the operator is not definite.
  Body(BodyDescription description, const std::vector<BodySide>& sides,
       const OperatorOptions& options, const Body* before = nullptr);

  [[nodiscard]] const std::string& name() const { return name_; }
  [[nodiscard]] Index size() const { return size_; }
  [[nodiscard]] Index rows() const { return traces_.rows(); }
  [[nodiscard]] Index loads() const { return load_.cols(); }
  /// Whether all its load patterns are zero.
  [[nodiscard]] bool unloaded() const { return (load_.array() == 0.0).all(); }
  [[nodiscard]] Index active() const { return active_; }
  [[nodiscard]] bool condensed() const { return condensed_; }
  /// L of the Schur complement on the active unknowns of a condensed body: the lower triangle, a part of its factor.
  [[nodiscard]] MatrixView condensed_factor() const { return factor_->trailing_factor(); }
  /// Lower triangle of the operator, with the springs k, as a system of several bodies takes it: of the active unknowns
  /// where these are less work to factorise, else of all, if that was to be kept.
  [[nodiscard]] SparseRows kept_operator() const;
  [[nodiscard]] bool keeps_operator() const { return condensed_is_less() || lower_.rows() > 0; }
  /// Traces of the unknowns of that, (rows, kept).
  [[nodiscard]] const SparseRows& kept_traces() const {
    return condensed_is_less() ? active_traces_ : traces_;
  }
  /// @param row first of the side, among those of the body
  [[nodiscard]] SideTrace trace_of_side(Index row, Index rows) const;
  /// Traces of the active unknowns, (rows, active).
  [[nodiscard]] const SparseRows& active_traces() const { return active_traces_; }
  [[nodiscard]] const BodyCost& cost() const { return cost_; }
  /// Whether its sparse factor is that of a body before.
  [[nodiscard]] bool kept() const { return kept_; }
  [[nodiscard]] std::string backend() const { return factor_->backend(); }
  /// The largest stiffness of a member's unknown or of a spring in it, force / length; 0 of a single member.
  [[nodiscard]] double stiffest() const { return stiffest_; }
  /// Whether rounding may leave little of it, so that what it was made of was kept to measure it.
  [[nodiscard]] bool measurable() const { return !terms_.stiffnesses.empty(); }
  /// What rounding of the operator and its factor leaves of the global stage of a measurable body: the forces on the active unknowns,
  /// (active, c), that move them as far as the stage is wrong. Measured, with sums of higher precision over members
  /// and springs apart, which softer ones were rounded by when they were added up.
  [[nodiscard]] Matrix defect(ConstMatrixRef data, ConstMatrixRef amplitudes,
                              const LoadResponse& loads) const;
  /// A correction of the displacements of a measurable body, measured in the same way.
  struct Correction {
    Vector strain;  ///< (c) twice its energy, with the search directions
    Matrix traces;  ///< (rows, c)
  };
  [[nodiscard]] Correction correction(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                      const LoadResponse& loads) const;
  /// Relative error that rounding may leave in its displacements.
  [[nodiscard]] double rounding() const;

  /// Response of the traces to the interface data alone: w = T A^-1 T^T W s.
  /// @param data s (rows, c)  @param traces w (rows, c), overwritten
  void apply(ConstMatrixRef data, MatrixRef traces, BodyWork& work) const;
  /// As apply(), with the condensed factor in single precision where there is one: what it is fast for are
  /// changes of the data, whose own error shrinks with them. The copy is made when first asked for.
  void apply_single(ConstMatrixRef data, MatrixRef traces, BodyWork& work) const;
  /// Forces on all unknowns (n_body, c) as those on the active ones that move these alike, (active, c), with the
  /// operator of a condensed body.
  /// @param partial what expand() goes on from, (n_body, c)
  [[nodiscard]] Matrix reduce(ConstMatrixRef forces, Matrix& partial) const;
  /// Displacements of all unknowns (n_body, c) under these forces, where the active ones move by `active`, (active, c):
  /// whatever else pulls at them.
  [[nodiscard]] Matrix expand(ConstMatrixRef active, Matrix partial) const;
  /// Schur complement of the operator on the active unknowns, with the springs k: (active, active), lower triangle.
  /// Made when first asked for; a body that is not condensed solves for every active unknown.
  [[nodiscard]] const Matrix& schur() const;
  /// Vectors phi (active, active) with phi^T (S + R) phi = 1 and phi^T R phi = share in [0, 1], where S is the
  /// condensed stiffness and R the springs k: made when first asked for.
  struct Spectrum {
    Vector shares;
    Matrix vectors;
  };
  /// @throws InputError of a body without a dense factor
  [[nodiscard]] const Spectrum& spectrum() const;
  /// Block of the inverse A^-1 on some of the active unknowns, (unknowns, unknowns).
  [[nodiscard]] Matrix inverse_block(const std::vector<Index>& unknowns) const;

  /// Members whose stiffness may have a factor at each of some points.
  [[nodiscard]] const std::vector<Stretch>& stretches() const { return stretches_; }
  /// The body with such factors, factorised anew.
  /// @param factors (points) for each of the stretches
  [[nodiscard]] std::shared_ptr<const Body> with_factors(const std::vector<Vector>& factors) const;

  /// The answer to the load patterns.
  [[nodiscard]] const LoadResponse& response() const { return response_; }
  /// The answer to the load patterns and forces added to them.
  /// @param extra (n_body, l), force, or empty: none
  [[nodiscard]] LoadResponse response_to_extra(const Matrix& extra) const {
    return extra.size() > 0 ? respond(extra) : response_;
  }
  /// The same.
  /// @param loads (n, l), force, for each member, or empty: none
  /// @throws InputError on a shape that does not fit
  [[nodiscard]] LoadResponse response_with(const std::vector<Matrix>& loads) const;

  /// Displacements of each member, (n, c).
  /// @param data s (rows, c)  @param amplitudes (l, c) of the load patterns
  [[nodiscard]] std::vector<Matrix> displacements(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                                  const LoadResponse& loads) const;
  /// Displacements of each member under forces on the members and nothing else: Z A^-1 sum Z^T f.
  /// @param forces (n, c) for each member
  /// @throws InputError on a shape that does not fit
  [[nodiscard]] std::vector<Matrix> response_to(const std::vector<Matrix>& forces) const;

  /// Twice the strain energies u^T K u of the global-stage solution, (c).
  /// @param data s, traces w, forces f (rows, c)  @param amplitudes (l, c)
  [[nodiscard]] Vector energies(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef forces,
                                ConstMatrixRef amplitudes, const LoadResponse& loads,
                                BodyWork& work) const;

  /// Forces of the sides on the active unknowns: Z^T T^T W f, (active, c). Those of sides that lie on each other
  /// are added up.
  void gather(ConstMatrixRef forces, MatrixRef on_unknowns) const;
  /// Forces of the load patterns on the active unknowns without those of jumps that springs impose, (active, l).
  [[nodiscard]] const Matrix& active_patterns() const { return active_patterns_; }
  /// The latter, (active, l); empty without such jumps.
  [[nodiscard]] auto jump_patterns() const {
    return of_jumps_.bottomRows(of_jumps_.size() > 0 ? active_ : 0);
  }
  /// Stiffness of each of these alone, in the members and without springs, (active), force / length.
  [[nodiscard]] const Vector& active_stiffness() const { return active_stiffness_; }

  [[nodiscard]] const Vector& weights() const { return weights_; }
  [[nodiscard]] const Vector& directions() const { return direction_; }

 private:
  friend class ScaledBody;
  friend class FieldBody;
  Body() = default;
  /// Right-hand sides while the body is built, one column per load pattern.
  struct Loads {
    Matrix load;           ///< Z^T F with imposed jumps, less `of_offset`
    Matrix of_offset;      ///< Z^T K u0, empty without offsets
    Matrix offset_energy;  ///< u0^T K u0
    Matrix of_jumps;       ///< B^T kappa Delta, part of `load`; empty without jumps
    Matrix jump_energy;    ///< (Delta - B0)^T kappa (Delta - B0) - B0^T kappa B0
  };
  [[nodiscard]] bool condensed_is_less() const;
  // what the constructor does, in this order
  void order_active_last(const std::vector<BodySide>& sides);
  void stack_sides(const std::vector<BodySide>& sides);
  [[nodiscard]] Loads assemble_loads(const BodyDescription& description,
                                     const std::vector<SparseRows>& jumps) const;
  [[nodiscard]] SparseRows assemble_operator(const BodyDescription& description,
                                             const std::vector<SparseRows>& jumps) const;
  [[nodiscard]] Vector stiffness_of_active(const std::vector<Member>& members) const;
  [[nodiscard]] bool wants_condensation(const OperatorOptions& options) const;
  void factorise(const SparseRows& lower, bool condense, const OperatorOptions& options);
  [[nodiscard]] Fingerprint without_sides(const BodyDescription& description,
                                          const std::vector<SparseRows>& jumps) const;
  [[nodiscard]] bool take_over(const Body& before);
  void keep_stretches(BodyDescription& description, const SparseRows& lower,
                      const OperatorOptions& options);
  void keep_terms(BodyDescription& description, std::vector<SparseRows> jumps);
  void keep_loads(const Loads& loads, const std::vector<BodySide>& sides);

  /// T A^-1 T^T, or A^-1 if that is smaller, as a dense matrix where it is cheaper from now on; else null.
  [[nodiscard]] const Matrix* compliance(Index columns) const;
  /// The former of a body that is not condensed.
  [[nodiscard]] const Matrix* compliance_by_solves(Index columns) const;
  /// Right-hand side of the global stage, (n_body, c).
  [[nodiscard]] Matrix forces_of(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                 const LoadResponse& loads) const;
  /// What the solution of every column leaves of its equations, (n_body, c).
  [[nodiscard]] Matrix residuals(const Matrix& unknowns, ConstMatrixRef data,
                                 ConstMatrixRef amplitudes, const LoadResponse& loads) const;
  /// What the solution of one column leaves of its equations, in sums of higher precision.
  [[nodiscard]] Vector residual(const Vector& unknowns, ConstVectorRef data,
                                ConstVectorRef amplitudes, const LoadResponse& loads) const;
  /// Solve for the load patterns and the forces added to them.
  [[nodiscard]] LoadResponse respond(Matrix extra) const;

  std::string name_;
  Index size_ = 0;
  std::vector<Stretch> stretches_;
  /// How the operator is the sum of what its stretches add.
  struct Spread {
    SparseRows lower;  ///< the operator, columns in order
    std::vector<SparseColumns>
        slopes;  ///< of its entries by the factors of the stretches, (entries, points)
  };
  /// Of samples of a field: made when first asked for.
  [[nodiscard]] const Spread& spread() const;
  SparseRows lower_;  ///< of the operator, columns in order with stretches; empty: not kept
  Lazy<Spread> spread_;
  OperatorOptions options_;
  /// What it is the sum of, in its unknowns; empty where rounding leaves enough of it.
  struct Terms {
    std::vector<std::shared_ptr<const SparseView>> stiffnesses;
    std::vector<SparseRows> jumps;
    std::vector<Vector> springs;
  };
  Terms terms_;
  double stiffest_ = 0.0;
  bool sprung_ = false;  ///< whether springs are assembled into it
  Matrix of_stiffness_;  ///< Z^T of the loads that come from the stiffness, (size, l); empty: none
  Index active_ = 0;     ///< the last unknowns, those that a side touches
  std::vector<SparseRows> prolongations_;
  std::vector<Matrix> offsets_;
  SparseRows traces_;         ///< T Z, (rows, size)
  SparseRows active_traces_;  ///< its last `active_` columns
  SparseRows active_loads_;   ///< Z^T T^T W in these unknowns, (active, rows)
  Vector weights_;
  Vector direction_;
  std::shared_ptr<const algebra::Factor> factor_;
  bool condensed_ = false;  ///< whether the factor has L of the Schur complement
  /// What a body with other sides can take over: a factor that condenses, of the operator with `robin`.
  struct Origin {
    Fingerprint of;    ///< members and springs, in the order of the unknowns
    SparseRows robin;  ///< T^T W k T on the active unknowns
    std::shared_ptr<const algebra::Factor> factor;
  };
  std::shared_ptr<const Origin> origin_;  ///< null: nothing can be taken over
  bool kept_ = false;
  // T A^-1 T^T where the sides have fewer rows than unknowns (facet means do), else A^-1: after many products. Of a
  // body that is not condensed the former, if it is shorter to read than the sparse factor.
  Lazy<Matrix> compliance_;
  double dense_limit_ = 0.0;  ///< bytes that it may take there
  mutable Counter applied_;   ///< columns so far
  Lazy<Eigen::MatrixXf> condensed_single_;
  Lazy<Matrix> schur_;
  Lazy<Spectrum> spectrum_;
  Matrix load_;  ///< right-hand side of the load patterns, with offsets
  Matrix active_patterns_;
  Vector active_stiffness_;
  Matrix work_;           ///< load + 2 Z^T K u0; empty where there are no offsets
  Matrix offset_energy_;  ///< u0^T K u0
  Matrix of_jumps_;       ///< forces of the jumps of springs, (n_body, l); empty: none
  Matrix jump_energy_;    ///< what these do
  Matrix offset_traces_;  ///< T u0
  LoadResponse response_;
  BodyCost cost_;
};

}  // namespace latin::substructure
