#pragma once

#include <cmath>

#include "latin/substructure/structure.hpp"

namespace latin::substructure {

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

/// This rank's share of the size of the difference of two global-stage solutions under the same loads, which
/// cancel: to be summed over the ranks, then positive().
[[nodiscard]] Size share_of_distance(const Structure& structure, ConstMatrixRef data,
                                     ConstMatrixRef traces, ConstMatrixRef other_data,
                                     ConstMatrixRef other_traces);
/// Size of such a difference. Collective.
[[nodiscard]] Size difference_size(const Structure& structure, ConstMatrixRef data,
                                   ConstMatrixRef traces);
/// This rank's share of `Size::trace`.
[[nodiscard]] double squared_traces(const Structure& structure, ConstMatrixRef traces);

}  // namespace latin::substructure
