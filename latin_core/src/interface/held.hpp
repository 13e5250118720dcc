#pragma once

#include <algorithm>
#include <array>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// A support that comes and goes (with Delta = 0):
///
///     f = 0                      in the steps with `held` = 0,
///     j = `kept` j_0             in those with `held` = 1,
///
/// where j_0 is the jump of the last step in which it did not hold (0 if there was none).
///
/// Memory: j_0. Parameters: `held`; `kept` (share of the way to Delta that it has not gone yet).
struct Held {
  static constexpr const char* name = "held";
  static constexpr bool monotone = true;
  static constexpr bool prescribes_jumps = true;
  static constexpr std::array parameters{Parameter{"held", 0.0}, Parameter{"kept"}};
  static constexpr std::size_t memory = 3;
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      std::array<double, 3>& before, PointForce force) {
    const auto [held, kept] = p;
    for (std::size_t a = 0; a < jump.size(); ++a) {
      if (held > 0.0) {
        force[a] = (jump[a] - kept * before[a]) / flexibility[a];
      } else {
        force[a] = 0.0;
        before[a] = jump[a];
      }
    }
  }
  static void slopes(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                     const std::array<double, 3>& /*before*/, PointForce slope) {
    std::ranges::fill(slope, 0.0);
    for (std::size_t a = 0; a < jump.size() && p[0] > 0.0; ++a) {
      slope[a * (jump.size() + 1)] = 1.0 / flexibility[a];
    }
  }
};

using HeldLaw = PointwiseLawAdapter<Held>;

}  // namespace latin::interface
