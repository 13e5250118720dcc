#pragma once

#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/substructure/laws.hpp"
#include "latin/substructure/size.hpp"

namespace latin::iteration {

/// Interface data and their traces: the whole state of the method.
struct State {
  Matrix data;    ///< s (rows, c)
  Matrix traces;  ///< w (rows, c)
};

/// A history that explains less of the residual than this says nothing about the error.
inline constexpr double least_explained = 0.05;

/// The two stages of a converged run agree. Where a law has just changed its branch the history predicts
/// nothing, so no estimate is believed that lies further than this below the distance of the stages.
inline constexpr double least_of_indicator = 0.3;
/// A residual below this share of the data is rounding.
inline constexpr double rounding_share = 2e-13;

/// This rank's shares of the squared distance of the two stages and of their squared size, in k and 1/k.
std::array<double, 2> stage_shares(const substructure::Structure& structure, const State& state,
                                   ConstMatrixRef residual);
/// The paper's indicator (Ladeveze 1999), from the sums of the shares: distance over size.
double stage_distance(const std::array<double, 2>& shares);

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
Fit least_squares(const Matrix& gram, const Vector& projection, double norm);

/// Differences of past iterates, and what can be learned from them by one small least-squares problem.
///
/// The iteration is the fixed point s = G(s) of residual r = G(s) - s. From differences dS, dR of past
/// iterates, gamma = argmin | r - dR gamma | (norm sqrt(W/k)) gives at once
///  - the accelerated step  s + r - (dS + dR) gamma  (Anderson, of type II: D. G. Anderson, J. ACM 12
///    (1965) 547; equivalent to GMRES on linear scenes),
///  - the estimated error of the present iterate, dS gamma, whose energy follows from the traces dW that
///    were computed anyway. It depends on k only as much as the iterates themselves do.
class History {
 public:
  /// @param depth largest number of differences kept
  History(const substructure::Laws& laws, Index columns, Index depth);

  void clear();
  [[nodiscard]] Index size() const { return size_; }
  [[nodiscard]] Index depth() const { return depth_; }

  /// Add a difference of two iterates in (s, r, w), each (rows, c); the oldest makes room.
  void push(ConstMatrixRef data, ConstMatrixRef residual, ConstMatrixRef traces);

  /// Solve the least-squares problem for the residual of the present iterate. Collective, with one
  /// reduction, in which the caller's own `shares` are summed over the ranks, too.
  void fit(ConstMatrixRef residual, std::span<double> shares = {});
  /// |r| of the last fit.
  [[nodiscard]] double residual_norm() const { return residual_norm_; }

  /// Relative remainder |r - dR gamma| / |r| of the last fit (1 with an empty history).
  [[nodiscard]] double remainder() const { return remainder_; }
  /// What the last fit takes to be wrong with the present iterate: dS gamma and dW gamma.
  [[nodiscard]] const State& predicted_error() const;
  /// Estimated relative error of the present iterate, whose own size is `whole`; infinity with an empty
  /// history. Collective. A residual up to `rounding` is noise: no combination of differences is fitted to it, it is
  /// amplified as the worst of them was.
  [[nodiscard]] double error(const substructure::Size& whole, double rounding) const;
  /// step = beta r - (dS + beta dR) gamma: the predicted error taken off, the remainder mixed in.
  void step(ConstMatrixRef residual, double beta, MatrixRef step);

  /// This rank's share of |r|^2 in W/k.
  [[nodiscard]] double share_of_square(ConstMatrixRef residual) const;

 private:
  /// Largest |dS| / |dR| in the history, |dS| relative to `whole`.
  [[nodiscard]] double amplification(const substructure::Size& whole, double rounding) const;
  [[nodiscard]] Eigen::Map<const Matrix> block(const Matrix& store, Index slot) const;
  [[nodiscard]] Eigen::Map<Matrix> shaped(Vector& vector) const;

  substructure::Laws laws_;
  const substructure::Structure* structure_;
  Index rows_;
  Index columns_;
  Index depth_;
  Index size_ = 0;
  Index next_ = 0;
  Matrix data_;               ///< (rows * c, depth) dS
  Matrix residual_;           ///< dR
  Matrix traces_;             ///< dW
  Matrix gram_;               ///< dR^T W/k dR, of the slots that a fit has seen
  std::vector<Index> fresh_;  ///< slots that it has not
  Vector metric_;             ///< W/k
  Vector work_;
  mutable State error_;             ///< predicted_error() of the last fit
  mutable bool predicted_ = false;  ///< it is there
  Vector gamma_;
  double remainder_ = 1.0;
  double residual_norm_ = 0.0;
};

/// What earlier iterates turned out to be wrong by, and what follows for the present one.
///
/// An estimate sees an error only as far as the last steps have moved it: parts that hardly move (a search
/// direction far off) hide. In hindsight they do not: the distance from an earlier iterate to the present,
/// much better one is the error that the earlier one had. It is carried to the present iterate by the
/// geometric mean of the falls of its estimate and of its residual since then, of which the first
/// falls too fast where an error hides and the second depends on the search direction.
class Hindsight {
 public:
  static constexpr std::size_t most = 2;  ///< iterates kept

  Hindsight(const substructure::Structure& structure, Index columns);

  /// This rank's shares of the sizes (strain, trace) of the distances to the iterates kept.
  [[nodiscard]] std::array<double, 2 * most> shares(const State& state) const;
  /// The estimate of the present iterate of that residual and size, raised to what the iterates kept say.
  /// @param sums of the shares over all ranks
  [[nodiscard]] double raised(double estimate, double residual, const substructure::Size& whole,
                              std::span<const double> sums) const;
  /// Keep an iterate, if its residual is well below that of the last one kept.
  void keep(const State& state, double estimate, double residual);

 private:
  struct Kept {
    State state;
    double estimate = 0.0;
    double residual = 0.0;
  };

  const substructure::Structure* structure_;
  std::array<Kept, most> kept_;  ///< the newest first
  std::size_t size_ = 0;
};

}  // namespace latin::iteration
