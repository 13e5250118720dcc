#pragma once

#include <algorithm>
#include <array>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// Unilateral contact without friction. With the opening g = j_n + g0 (and Delta = 0):
///
///     f_n <= 0,   g + f_n / kappa >= 0,   f_n (g + f_n / kappa) = 0,   f_t = 0       (Signorini)
///
/// kappa infinite: rigid contact; finite: elastic in compression, open in traction.
///
/// Parameters (per point): `gap` g0 (length; negative: interference), `compliance` 1 / kappa
/// (length^3 / force, >= 0, 0 = rigid).
struct Contact {
  static constexpr const char* name = "contact";
  static constexpr bool monotone = true;
  static constexpr std::array parameters{Parameter{"gap"}, Parameter{"compliance", 0.0}};
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      PointForce force) {
    const auto [gap, compliance] = p;
    std::ranges::fill(force, 0.0);
    force[0] = std::min(0.0, (jump[0] + gap) / (flexibility[0] + compliance));
  }
  static void slopes(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                     PointForce slope) {
    const auto [gap, compliance] = p;
    std::ranges::fill(slope, 0.0);
    slope[0] = jump[0] + gap <= 0.0 ? 1.0 / (flexibility[0] + compliance) : 0.0;
  }
};

using ContactLaw = PointwiseLawAdapter<Contact>;

}  // namespace latin::interface
