#pragma once

#include <array>
#include <memory>
#include <string>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/interface/law.hpp"

namespace latin::interface {

/// Geometry of one interface (or boundary interface), and what kind of law it has. Rows of its fields are point-major in the
/// local frame: row = components * point + component.
struct Interface {
  std::string name;
  Index points;
  Index components;                ///< unknown components at a point, at most the space dimension
  Vector weights;                  ///< (rows) area of the point, repeated for its components
  std::shared_ptr<const Law> law;  ///< its kind: the parameters belong to those who ask it
};

/// Restrict a trace operator to the local frame: rows `components * point + a` are
/// sum_b frames(components * point + a, b) * trace(dim * point + b, :).
/// @param trace  (dim * points, n), global components
/// @param frames (components * points, dim), orthonormal rows
/// @throws InputError with `name` if shapes disagree
SparseRows to_local_frame(const SparseRows& trace, ConstMatrixRef frames, const std::string& name);

}  // namespace latin::interface
