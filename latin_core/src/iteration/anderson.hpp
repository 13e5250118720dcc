#pragma once

#include <functional>
#include <span>
#include <vector>

#include "iteration/metric.hpp"
#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"

namespace latin::iteration {

/// gamma = argmin | r - D gamma |, and the share |r - D gamma| / |r| that remains.
struct Fit {
  Vector gamma;
  double remainder = 1.0;
};

/// Least squares through the normal equations; directions that rounding of the Gram matrix has made
/// meaningless are left out.
/// @param gram       D^T D
/// @param projection D^T r
/// @param norm       |r|
[[nodiscard]] Fit least_squares(const Matrix& gram, const Vector& projection, double norm);

/// Residual (rows, c) into a step on the data, in place; empty: the residual as it is.
using Preconditioner = std::function<void(MatrixRef)>;

/// Differences of past iterates, and what can be learned from them by one small least-squares problem.
///
/// The iteration is the fixed point s = G(s) of residual r = G(s) - s. From differences dS, dR of past
/// iterates, gamma = argmin | r - dR gamma | gives at once
///  - the accelerated step  s + r - (dS + dR) gamma  (Anderson, of type II: D. G. Anderson, J. ACM 12
///    (1965) 547; equivalent to GMRES on linear scenes),
///  - the estimated error of the present iterate, dS gamma, whose energy follows from the traces dW that
///    were computed anyway. It depends on k only as much as the iterates themselves do.
///
/// Several parameter sets that start from the same snapshots may be advanced side by side: a block then has
/// the columns of one set after those of another, and every set has residuals and a gamma of its own. The
/// differences of data and traces between snapshots are common to all sets; one of their own may follow.
class Anderson {
 public:
  /// @param metric  of data and residuals
  /// @param columns of one set
  /// @param depth   largest number of differences kept
  Anderson(Metric metric, Index columns, Index depth, Index sets = 1);

  [[nodiscard]] const Metric& metric() const { return metric_; }
  [[nodiscard]] Index size() const { return size_; }
  [[nodiscard]] Index depth() const { return depth_; }
  [[nodiscard]] Index sets() const { return sets_; }
  void clear();

  /// Add a difference of two iterates in (s, r, w), each (rows, sets * c); the oldest makes room.
  /// With several sets: once, after all common ones. @throws std::logic_error otherwise
  void push(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces);
  /// The same for data and traces (rows, c) that are common to all sets.
  void push_common(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces);

  /// Solve the least-squares problem for the residual (rows, sets * c) of the present iterate. Collective,
  /// with one reduction, in which the caller's own `shares` are summed over the ranks, too.
  void fit(ConstMatrixRef residual, std::span<double> shares = {});
  /// |r| of the last fit.
  [[nodiscard]] double residual_norm(Index set = 0) const { return norms_(set); }
  /// Relative remainder |r - dR gamma| / |r| of the last fit (1 with an empty history).
  [[nodiscard]] double remainder(Index set = 0) const { return remainders_(set); }
  /// The share of the residual that the last fit explains.
  [[nodiscard]] double explained(Index set = 0) const;
  /// What the last fit takes to be wrong with the present iterate: dS gamma and dW gamma, (rows, sets * c).
  [[nodiscard]] const State& predicted_error() const;
  /// step = beta P (r - dR gamma) - dS gamma: the predicted error taken off, the remainder mixed in.
  void step(ConstMatrixRef residual, double beta, const Preconditioner& precondition,
            MatrixRef step);

  /// A difference of a single set; its norm in the residual is known after a fit.
  struct Difference {
    Eigen::Map<const Matrix> data;
    Eigen::Map<const Matrix> traces;
    double norm;
  };
  [[nodiscard]] Difference difference(Index slot) const;

 private:
  void stack(ConstMatrixRef block, Eigen::Ref<Vector> into) const;
  /// Make room for a difference and put its residual there. @return its slot
  Index take_slot(ConstMatrixRef residual);
  /// (size, 1 + fresh): dR^T W/k times the residual and the fresh differences, of this rank
  const Matrix& products_of(Index set, ConstMatrixRef residual);
  [[nodiscard]] const Matrix& predicted_data() const;
  void combine(const Matrix& common, const Matrix& own, Matrix& sum) const;

  Metric metric_;
  Index rows_;
  Index columns_;
  Index depth_;
  Index sets_;
  Index size_ = 0;
  Index next_ = 0;
  Index common_ = 0;          ///< of several sets: differences that are common to them
  Matrix data_;               ///< (rows * c, depth) dS
  Matrix traces_;             ///< dW
  Matrix residual_;           ///< (rows * c, sets * depth) dR, those of a set side by side
  Matrix own_data_;           ///< (rows * c, sets) of several sets: the last dS, each set's own
  Matrix own_traces_;         ///< and dW
  std::vector<Matrix> gram_;  ///< dR^T W/k dR of every set, of the slots that a fit has seen
  std::vector<Index> fresh_;  ///< slots that it has not
  Matrix work_;               ///< (rows * c, sets)
  Matrix products_;           ///< products_of() the last set
  Matrix of_pieces_;  ///< (size * (1 + fresh), pieces) their sums over the rows of each piece
  Vector weighted_;   ///< (rows * c) a column, weighted, piece by piece
  Matrix gamma_;      ///< (size, sets) of the last fit
  Vector remainders_;
  Vector norms_;
  mutable State error_;                    ///< predicted_error() of the last fit
  mutable bool predicted_data_ = false;    ///< its data are there
  mutable bool predicted_traces_ = false;  ///< its traces are there
};

}  // namespace latin::iteration
