#pragma once

#include <array>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// A bolt's pretension section: loaded by a force, then fixed at the length that it has (with Delta = 0):
///
///     f_n = `force`                            in the steps with `locked` = 0,
///     j_n = j_n of the last such step          in those with `locked` = 1 (0 if there was none),
///     j_t = 0                                  always.
///
/// Memory: j_n of the last unlocked step. Parameters: `force` (force / area, positive in tension), `locked`.
struct Preload {
  static constexpr const char* name = "preload";
  static constexpr bool monotone = true;
  static constexpr std::array parameters{Parameter{"force"}, Parameter{"locked", 0.0}};
  static constexpr std::size_t memory = 1;
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      std::array<double, 1>& length, PointForce force) {
    const auto [given, locked] = p;
    if (locked == 0.0) {
      force[0] = given;
      length[0] = jump[0] - flexibility[0] * given;
    } else {
      force[0] = (jump[0] - length[0]) / flexibility[0];
    }
    for (std::size_t a = 1; a < jump.size(); ++a) {
      force[a] = jump[a] / flexibility[a];
    }
  }
};

using PreloadLaw = PointwiseLawAdapter<Preload>;

}  // namespace latin::interface
