#pragma once

#include <algorithm>
#include <array>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// A bolt's pretension section: loaded by a force, then fixed at the length that it has (with Delta = 0):
///
///     f_n = 0                                             in the steps with `locked` = -1,
///     f_n = `force`                                       in those with `locked` = 0,
///     j_n = j_0 + `slack` + `compliance` f_n              in those with `locked` = 1,
///     j_t = 0                                             always,
///
/// where j_0 = j_n - `compliance` f_n of the last step that was not locked (0 if there was none).
///
/// Memory: j_0. Parameters: `force` (force / area, positive in tension), `locked` (-1: not tightened yet), `slack` (length, by which the
/// section is longer than when it was locked: embedding, or less: a nut that is turned on), `compliance` (length^3 /
/// force, of what of the bolt is not modelled).
struct Preload {
  static constexpr const char* name = "preload";
  static constexpr bool monotone = true;
  static constexpr bool prescribes_jumps = true;
  static constexpr std::array parameters{Parameter{"force"}, Parameter{"locked", -1.0},
                                         Parameter{"slack"}, Parameter{"compliance", 0.0}};
  static constexpr std::size_t memory = 1;
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 4>& p,
                      std::array<double, 1>& length, PointForce force) {
    const auto [given, locked, slack, compliance] = p;
    if (locked <= 0.0) {
      force[0] = locked < 0.0 ? 0.0 : given;
      length[0] = jump[0] - (flexibility[0] + compliance) * force[0];
    } else {
      force[0] = (jump[0] - length[0] - slack) / (flexibility[0] + compliance);
    }
    for (std::size_t a = 1; a < jump.size(); ++a) {
      force[a] = jump[a] / flexibility[a];
    }
  }
  static void slopes(PointValues jump, PointValues flexibility, const std::array<double, 4>& p,
                     const std::array<double, 1>& /*length*/, PointForce slope) {
    const auto [given, locked, slack, compliance] = p;
    std::ranges::fill(slope, 0.0);
    slope[0] = locked > 0.0 ? 1.0 / (flexibility[0] + compliance) : 0.0;
    for (std::size_t a = 1; a < jump.size(); ++a) {
      slope[a * (jump.size() + 1)] = 1.0 / flexibility[a];
    }
  }
};

using PreloadLaw = PointwiseLawAdapter<Preload>;

}  // namespace latin::interface
