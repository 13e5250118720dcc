#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// Contact as in Contact, with dry friction. The tangential jump is an elastic slip c_t f_t and a slip s; the
/// columns of a history are its time steps, and with s' at the step before (0 before the first):
///
///     |f_t| <= mu |f_n| + tau   in contact,    f_t = 0 where open,
///     s - s' = l f_t with l >= 0,  l > 0 only where |f_t| reaches its bound           (Coulomb, Tresca)
///
/// The sign follows from f being the force on side 1 and j = w2 - w1: friction pulls side 1 along with
/// the slip of side 2. An implicit step: the law holds at the end of each one. c_t = 0: what sticks does not move.
///
/// Memory: s = j_t - c_t f_t (0 in directions that a point does not have). Parameters (per point): `gap`,
/// `compliance`, `friction` mu, `threshold` tau (force / area) and `tangential_compliance` c_t (length^3 / force), all
/// but the gap >= 0.
struct Coulomb {
  static constexpr const char* name = "coulomb";
  static constexpr bool monotone = true;
  static constexpr std::array parameters{Parameter{"gap"}, Parameter{"compliance", 0.0},
                                         Parameter{"friction", 0.0}, Parameter{"threshold", 0.0},
                                         Parameter{"tangential_compliance", 0.0}};
  static constexpr std::size_t memory = 2;
  static constexpr double touching = 1e-12;  ///< share of the bound that is rounding
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                      std::array<double, 2>& before, PointForce force) {
    const auto [gap, compliance, friction, threshold, tangential] = p;
    const double pressure = std::max(0.0, -(jump[0] + gap) / (flexibility[0] + compliance));
    force[0] = -pressure;
    // stick trial, then back onto the bound; c is the same for all tangents of a point
    double square = 0.0;
    for (std::size_t a = 1; a < jump.size(); ++a) {
      force[a] = (jump[a] - before[a - 1]) / (flexibility[a] + tangential);
      square += force[a] * force[a];
    }
    const double bound = pressure > 0.0 ? friction * pressure + threshold : 0.0;
    const double size = std::sqrt(square);
    for (std::size_t a = 1; a < jump.size(); ++a) {
      force[a] *= size > bound ? bound / size : 1.0;
      before[a - 1] = jump[a] - (flexibility[a] + tangential) * force[a];
    }
  }
  static void slopes(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                     const std::array<double, 2>& before, PointForce slope) {
    const auto [gap, compliance, friction, threshold, tangential] = p;
    std::ranges::fill(slope, 0.0);
    if (jump[0] + gap > 0.0) {
      return;
    }
    slope[0] = 1.0 / (flexibility[0] + compliance);
    const std::size_t size = jump.size();
    const double pressure = -(jump[0] + gap) * slope[0];
    const double bound = friction * pressure + threshold;
    std::array<double, 2> trial{};
    for (std::size_t a = 1; a < size; ++a) {
      trial[a - 1] = (jump[a] - before[a - 1]) / (flexibility[a] + tangential);
    }
    const double length = std::hypot(trial[0], trial[1]);
    // a point that has slipped lies on its bound, but for rounding: it sticks as long as nothing drives it on
    const bool slips = length > (1.0 + touching) * bound;
    for (std::size_t a = 1; a < size; ++a) {
      slope[size * a + a] = (slips ? bound / length : 1.0) / (flexibility[a] + tangential);
      if (slips) {
        const double along = trial[a - 1] / length;
        slope[size * a] = -friction * slope[0] * along;
        for (std::size_t b = 1; b < size; ++b) {
          slope[size * a + b] -=
              bound / length * along * trial[b - 1] / length / (flexibility[b] + tangential);
        }
      }
    }
  }
};

using CoulombLaw = PointwiseLawAdapter<Coulomb>;

}  // namespace latin::interface
