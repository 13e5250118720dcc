#pragma once

#include <vector>

#include "latin/common/types.hpp"

namespace latin::substructure {

class Structure;

/// Of the forces at the points of interfaces that prescribe jumps, what the displacements of their faces see.
///
/// Where a law prescribes the jump, nothing but equilibrium determines the force f, and with more points than the faces
/// have displacements to tell them apart every f + g with T^T W g = 0 on both sides is in equilibrium, too. Of all these
/// the smallest in the norm of W is the answer: the projection T x of f, which is smooth as the displacements are. So
/// pressures at points do not depend on the way to them.
class SeenForces {
 public:
  /// Collective.
  explicit SeenForces(const Structure& structure);

  /// Leave out of the forces f = s - k w what nothing sees. Displacements stay.
  /// @param data s (rows, c)  @param traces w (rows, c)
  void keep(MatrixRef data, ConstMatrixRef traces) const;

 private:
  struct Face {
    std::vector<Index> rows;  ///< first of each side on this rank
    Vector directions;        ///< k of the first of these
    Vector roots;             ///< of the weights, (size)
    SparseRows traces;        ///< (size, displacements of both sides), times these
  };
  std::vector<Face> faces_;
};

}  // namespace latin::substructure
