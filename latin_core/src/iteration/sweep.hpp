#pragma once

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "iteration/solver.hpp"
#include "latin/iteration/points.hpp"

namespace latin::iteration {

/// Called after each finished point with its position, its laws, its summary and its state.
using PointCallback =
    std::function<void(Index point, const substructure::Laws&, const Summary&, const State&)>;

/// Further points, all of which start from what was known after the first ones; none: that was all.
using NextPoints = std::function<std::vector<Index>()>;

/// The tangents of linear laws themselves, from which sweeps of them begin, kept from one to the next: they take as
/// long as a hundred points. They are a function of laws and amplitudes, whoever asks first; one sweep has them at a
/// time.
class Beginning {
 public:
  /// They are not kept where they would take more memory than this, in bytes.
  static constexpr double most_bytes = 256e6;

  /// As long as this is held the rest of this is the caller's; not held: it is another sweep's.
  [[nodiscard]] std::unique_lock<std::mutex> take() {
    return std::unique_lock(mutex_, std::try_to_lock);
  }
  /// With what rounding does to the answer; made by the first call, and again for other laws or amplitudes. Not made
  /// if the structure is not stable with them.
  const Linearisation& of(const substructure::Laws& laws, const Matrix& amplitudes);

 private:
  std::mutex mutex_;
  std::optional<substructure::Laws> laws_;  ///< what is known is of these, and of their structure
  Linearisation known_;
  Matrix amplitudes_;
};

/// Multiresolution (paper, section 3): solve for many parameter sets, each started from the interface
/// states of the nearest points that are solved already.
///
/// A state that the combination of others reproduced at once is not kept as start material: it adds nothing.
///
/// @param laws       of all points, but for what changes from one to the next
/// @param order      points to solve, in this order (a restarted sweep leaves out finished ones)
/// @param known      states of points solved earlier: start material, e.g. from a checkpoint
/// @param known_points their positions
/// @param next       after `order`, asked for further points until there are none. Each of its answers starts from the
///                   same states, tangents and tolerance, whatever was solved before: so answers do not depend on who
///                   solves which
/// @param beginning  of `laws`, from which points of linear laws are solved; null: from the point in their middle
/// A callback that throws Interrupted ends the sweep, as does the end of Options::max_seconds: points that are
/// finished by then have been handed out.
///
/// @return Status::converged if it went through, else Status::interrupted or Status::time_limit
/// @throws InputError on shapes and positions that do not fit, naming the interface
/// @throws whatever else a callback throws, after the point it was called for
Status sweep(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
             const std::vector<SweptParameter>& parameters, const std::vector<Index>& order,
             std::vector<State> known, std::vector<Index> known_points, const Callback& callback,
             const PointCallback& point_callback, const NextPoints& next = {},
             Beginning* beginning = nullptr);

}  // namespace latin::iteration
