#pragma once

#include <memory>
#include <string>
#include <vector>

#include "latin/algebra/factor_backend.hpp"
#include "latin/common/sparse_view.hpp"
#include "latin/common/types.hpp"
#include "latin/interface/law.hpp"

namespace latin::substructure {

// NOLINTBEGIN(readability-redundant-member-init): what callers may leave out

/// One substructure of a body: u = Z q + u0, with q the unknowns of the body.
struct Member {
  std::string name;
  /// K (n, n), symmetric, force / length; let go when the body is built
  std::shared_ptr<const SparseView> stiffness;
  SparseRows prolongation{};  ///< Z (n, n_body); empty: the identity
  Matrix load;                ///< F (n, l), force, one column per load pattern
  Matrix offset{};            ///< u0 (n, l), length; empty: zero
  /// The part of the load that comes from the stiffness and changes with it (initial strains), (n, l); empty: none
  Matrix of_stiffness{};
  /// K = B^T B with rows of B for each of some points, whose stiffness may have factors (a random field): B u is
  /// (points * components, n). Empty: none.
  SparseRows stretch{};
  Index stretch_points = 0;  ///< of the stretches; 0: none
  /// g (points * components, l): loads that come from the stiffness are B^T g; empty: none
  Matrix initial_stretch{};
};

/// A deterministic elastic interface that is assembled into a body instead of being iterated on:
/// f1 = kappa (B q + B0 - Delta) with B = T2 Z2 - T1 Z1.
struct Spring {
  std::string name;
  std::vector<Index> members;      ///< one (ground on side 2) or two
  std::vector<SparseRows> traces;  ///< local frame, (rows, n) each
  Vector stiffness;                ///< kappa * weight, (rows)
  Matrix jump;                     ///< Delta, (rows, l), one column per load pattern
};

/// Substructures that are glued together, and the springs that hold them or lie between them.
struct BodyDescription {
  std::string name;
  Index size;  ///< n_body, unknowns
  std::vector<Member> members;
  std::vector<Spring> springs{};
};

/// How the global stage applies the inverse of a body's operator.
enum class OperatorKind {
  automatic,  ///< condensed, unless the dense block would not fit in `memory_limit`
  condensed,  ///< dense triangular factor of the Schur complement on the active unknowns
  factored    ///< sparse triangular solves
};

struct OperatorOptions {
  OperatorKind kind = OperatorKind::automatic;
  algebra::FactorBackend backend = algebra::FactorBackend::automatic;
  double memory_limit = 8e9;   ///< bytes for the dense blocks of all bodies; 0: no limit
  bool keep_operator = false;  ///< for systems of the whole bodies, see Body::kept_operator()
};

/// One side of an interface, as the caller describes it. Of a side on another rank only the member is
/// given: the rest comes from there.
struct SideDescription {
  std::string member;  ///< substructure that the side belongs to
  SparseRows trace;    ///< T (dim * points, n), global components
  Vector direction;    ///< search direction k per row (components * points), > 0
  /// What a displacement is measured with, > 0: modulus / length of the body, or in the unit of the law's stiffness
  /// that of the place where a force acts that is no force per area.
  double scale;
  /// (rows, r) Rigid motions of the body that nothing in it resists, of mean square 1 over the body, local frame:
  /// faces say little of what a motion about them does far away. Empty: none.
  Matrix motions{};
  /// Trace where displacements of the body are 1 at most, > 0: of a rotation 1 / length.
  double lever = 1.0;
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
  Matrix basis{};
  /// Whether its residual is solved for instead of taken as it is (Pair); for linear laws. On a boundary
  /// interface half the residual is taken: the step for a k far above (prescribed displacement) or below
  /// (prescribed force) the stiffness of the body.
  bool paired = false;
};

/// A parameter of the law of an interface; a field of one row (or column) stands for all rows (columns).
struct LawParameter {
  std::string interface;
  std::string parameter;
  Matrix values;
};

// NOLINTEND(readability-redundant-member-init)

}  // namespace latin::substructure
