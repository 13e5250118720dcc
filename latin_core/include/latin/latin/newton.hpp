#pragma once

#include <Eigen/LU>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/latin/problem.hpp"

namespace latin {

/// Newton's step for the fixed point of the two stages, F(s) = 0 with F the residual of the local stage.
///
/// With N = 1 - k A (A: the global stage), P ds the change of the free jump, and R' the derivative of the
/// laws' resolvents, which is block-diagonal by point (and lower triangular over the steps of a history),
///
///     dF = 2 E R' P - 2 N,      P = E^T (1/k - 2 A),      E: a force per area onto both sides, +1 and -1.
///
/// N ds = F / 2 + E y leaves y = R' P ds as unknowns, and only where R' is not zero: a dense system of the
/// size of the closed zone. Its matrix is that of the interface's own flexibility E^T k^-1 N^-1 E and does
/// not change with laws, parameters and columns; `Flexibility` has it once for a problem.
///
/// N is singular where a body floats. N + mu with a tiny mu is the same body on springs mu k, whose forces
/// the outer iteration takes back. Amplitudes of modes that nothing else holds are unknowns of their own.
class Newton {
 public:
  explicit Newton(const Problem& problem) : problem_(problem) {}

  /// The step from (data, traces), whose residual is known.
  /// @param softening share eps by which R' is reduced: multipliers that the meshes do not determine (more
  ///                  closed points than unknowns) get a unique, bounded change. In (0, 1).
  /// @param settled   the closed zone is known: leave out changes of multipliers that move nothing
  /// @param step      ds (rows, c)
  /// @return false if the linear system has no usable solution
  bool step(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef residual, double softening,
            bool settled, MatrixRef step);

 private:
  /// LU of the closed zone of one column, kept as long as its tangent stays what it was.
  struct Zone {
    std::vector<Index> rows;
    Matrix tangent;
    double softening = -1.0;
    Eigen::PartialPivLU<Matrix> lu;

    [[nodiscard]] bool fits(const Matrix& now, double softened) const;
  };
  void factorise(const Tangents& tangents, const Matrix& tangent, double softening,
                 Zone& zone) const;

  const Problem& problem_;
  std::vector<Zone> zones_;
};

}  // namespace latin
