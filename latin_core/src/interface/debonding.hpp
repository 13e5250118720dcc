#pragma once

#include <array>

#include "latin/interface/pointwise.hpp"

namespace latin::interface {

/// Elastic with a limit: linear softening to separation, contact with the undamaged stiffness always. With
/// <x> = max(x, 0), kappa_n = `normal`, kappa_t = `tangential`, beta^2 = kappa_t / kappa_n:
///
///     f_n = (1 - D) kappa_n <j_n> - kappa_n <-j_n>,     f_t = (1 - D) kappa_t j_t,
///     lambda^2 = <j_n>^2 + beta^2 |j_t|^2,              lambda_0 = `strength` / kappa_n,
///     D = lambda_f (Lambda - lambda_0) / (Lambda (lambda_f - lambda_0)), held within [0, 1],
///     Lambda = largest lambda of the history so far: damage never heals,
///     lambda_f = `opening` + 2 `energy` / `strength`    (give one of the two, the other is 0).
///
/// This is the bilinear law of Alfano and Crisfield, Int. J. Numer. Meth. Engng 50 (2001) 1701-1736, and
/// Camanho and Davila, NASA/TM-2002-211737, in the case of one strength and one energy: beta makes
/// kappa_n lambda^2 / 2 the elastic energy whatever the mix of modes, so that a unit of area always takes
/// G = strength lambda_f / 2 to separate; in pure shear the strength is beta `strength`. An implicit step.
///
/// The law softens, with the slope -strength / (lambda_f - lambda_0), so it is not monotone. Its resolvent is
/// the minimum of a sum of two energies that is strictly convex, and the answer unique, if
///
///     c_n < (lambda_f - lambda_0) / strength      and      beta^2 c_t < the same;
///
/// otherwise it throws: the search direction has to be larger.
///
/// Memory: the largest lambda, lambda_f at most. Parameters: force / length^3, force / area, length, force / length.
struct Debonding {
  static constexpr const char* name = "debonding";
  static constexpr std::array parameters{Parameter{"normal", 0.0}, Parameter{"tangential", 0.0},
                                         Parameter{"strength", 0.0}, Parameter{"opening", 0.0},
                                         Parameter{"energy", 0.0}};
  static constexpr std::size_t memory = 1;
  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                      std::array<double, 1>& largest, PointForce force);
  /// At the end of the elastic branch, and where the largest opening is just reached again: as if it unloads.
  static void slopes(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                     const std::array<double, 1>& largest, PointForce slope);
};

using DebondingLaw = PointwiseLawAdapter<Debonding>;

}  // namespace latin::interface
