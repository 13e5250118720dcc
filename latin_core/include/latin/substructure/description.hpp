#pragma once

#include <string>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/interface/law.hpp"

namespace latin::substructure {

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
  // NOLINTNEXTLINE(readability-redundant-member-init): callers may leave it out
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
  // NOLINTNEXTLINE(readability-redundant-member-init): callers may leave it out
  Matrix basis{};
  /// Whether its residual is solved for instead of taken as it is (Pair); for linear laws. On a boundary
  /// interface half the residual is taken: the step for a k far above (prescribed displacement) or below
  /// (prescribed force) the stiffness of the body.
  bool paired = false;
};

}  // namespace latin::substructure
