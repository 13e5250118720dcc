#pragma once

#include <cstdint>

#include "substructure/structure.hpp"

namespace latin::substructure {

/// Which columns of a block are measured together: each time step by itself, and of a chaos its mean apart from
/// its fluctuation (all other modes). Time steps run fastest, then modes, then parameter sets side by side.
struct ColumnGroups {
  Index steps = 1;
  Index modes = 1;

  /// Groups of a step: the mean, and the fluctuation where there is one.
  [[nodiscard]] Index kinds() const { return modes > 1 ? 2 : 1; }
  [[nodiscard]] Index count(Index columns) const {
    const Index whole = modes * steps;
    return (columns + whole - 1) / whole * steps * kinds();
  }
  [[nodiscard]] Index of(Index column) const {
    const Index set = column / (modes * steps);
    const Index within = column % (modes * steps);
    return (set * steps + within % steps) * kinds() + (within >= steps ? 1 : 0);
  }
};

/// Sizes of the global-stage solutions of this rank's bodies, or of the difference of two: (groups, bodies) each.
struct Sizes {
  Matrix strain;   ///< u^T K u
  Matrix trace;    ///< sum of scale * W * w^2: sees the rigid motions that strain does not
  Matrix work;     ///< sum of |w| W |f|: what the strain energy is the balance of
  Matrix pressed;  ///< sum of F^2 / K of nodes: like the strain energy of forces that nothing holds

  static Sizes zero(Index groups, Index bodies);
};

/// Whether what double precision leaves is an error.
enum class Noise : std::uint8_t { ignored, counted };

/// What errors are relative to.
struct Yardstick {
  ColumnGroups groups;
  Vector metric;     ///< (bodies) see Structure::metric_of()
  Vector stiffness;  ///< (bodies) sum of the stiffnesses of the active unknowns, each alone
  std::vector<bool> carried;     ///< (bodies) see Structure::carried()
  std::vector<Index> component;  ///< (bodies) see Structure::component()
  /// (components) Mean square displacement (length^2) of the bodies that move most, over all ranks: what rounding
  /// is a fraction of.
  Vector reach;

  /// This rank's share of the reach of a solution (components): to be summed.
  [[nodiscard]] Vector share_of_reach(const Sizes& whole) const;
  /// Relative errors (groups, bodies) of a solution of size `whole`: the larger of those in strain energy and in
  /// displacement of the interfaces, each relative to the body's own in that step. They do not depend on the
  /// search direction.
  ///
  /// A step is measured with no less than 1e-9 of the largest step, a fluctuation that is known to be below 5e-7 of
  /// the mean with the mean, and a body that does not move with those that do.
  /// @param noise whether errors count that may be rounding of the displacements of other bodies: an iteration that
  ///              waited for them to fall would not end, but an answer is not better than they are. What is rounding
  ///              of the body's own largest step is no error in any case
  [[nodiscard]] Matrix relative(const Sizes& error, const Sizes& whole,
                                Noise noise = Noise::ignored) const;
  /// What rounding of displacements may leave of the strain energies of a solution, (bodies), relative: much of stiff
  /// bodies that soft ones carry along.
  [[nodiscard]] Vector rounding_of_strains(const Sizes& whole) const;
};

/// The yardstick of a structure, its reach not known.
[[nodiscard]] Yardstick yardstick(const Structure& structure, const ColumnGroups& groups);
/// Sums of columns in sets, (., sets * from) times (from, to): load patterns at the times of a history, say.
[[nodiscard]] Matrix summed(ConstMatrixRef block, const Matrix& factors);

/// Load patterns of a linear history, which is measured at its times: there they may cancel.
///
/// Sizes are quadratic: those of all times follow from those of the patterns and of the sums of two. Work and
/// pressed energy are not, and no more than a bound is known of them.
class PatternTimes {
 public:
  /// @param factors of the patterns at the times, (patterns, times)
  explicit PatternTimes(Matrix factors);

  [[nodiscard]] Index patterns() const { return factors_.rows(); }
  [[nodiscard]] Index times() const { return factors_.cols(); }
  /// Which sums of patterns are to be measured, (patterns, sums): not more than times.
  [[nodiscard]] const Matrix& sums() const { return sums_; }
  /// Sizes of the sums (rows of groups, `kinds` a sum) as those of the times.
  [[nodiscard]] Sizes at_times(const Sizes& of_sums, Index kinds) const;
  /// No more than what sizes of the patterns alone may be at the times.
  [[nodiscard]] Sizes bounds(const Sizes& of_patterns, Index kinds) const;

 private:
  Matrix factors_;
  Matrix sums_;
  Matrix weights_;  ///< (sums, times): a size at a time as a sum of those of the sums
  Matrix
      single_;  ///< (patterns, times) factors relative to those in the sums; empty: the sums are the times
};

/// Sizes of the difference of two global-stage solutions under the same loads, which cancel.
/// @param in_time see Laws::in_time()
[[nodiscard]] Sizes sizes_of_difference(const Structure& structure, const ColumnGroups& groups,
                                        ConstMatrixRef data, ConstMatrixRef traces,
                                        const PatternTimes* in_time = nullptr);
/// The same of two states, without a block for their difference.
[[nodiscard]] Sizes sizes_of_distance(const Structure& structure, const ColumnGroups& groups,
                                      ConstMatrixRef data, ConstMatrixRef traces,
                                      ConstMatrixRef other_data, ConstMatrixRef other_traces,
                                      const PatternTimes* in_time = nullptr);

}  // namespace latin::substructure
