#include "interface/debonding.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>

namespace latin::interface {
namespace {

std::string number(double value) {
  std::string text(32, '\0');
  text.resize(static_cast<std::size_t>(std::snprintf(text.data(), text.size(), "%.4g", value)));
  return text;
}

/// Bilinear softening: elastic up to the opening lambda_0, open from lambda_f on.
struct Softening {
  double first;  ///< lambda_0
  double last;   ///< lambda_f

  /// 1 - D once the opening has reached so far.
  [[nodiscard]] double intact(double reached) const {
    if (reached <= first) {
      return 1.0;
    }
    return std::max(0.0, first * (last - reached) / (reached * (last - first)));
  }
};

/// An opening beyond the largest one by less is rounding.
constexpr double touching = 1e-12;

/// What a point does under a trial jump.
struct Answer {
  double share;    ///< 1 - D
  double reached;  ///< the largest opening so far
  bool damages;    ///< whether it grows now, short of separation
};

/// @throws InputError on parameters without meaning, and where the law has several answers
Softening softening_of(const std::array<double, 5>& p, double steepest) {
  const auto [normal, tangential, strength, opening, energy] = p;
  if (!(normal > 0.0 && strength > 0.0)) {
    throw InputError("normal stiffness " + number(normal) + " and strength " + number(strength) +
                     " must be positive");
  }
  const double first = strength / normal;
  const double last = opening + 2.0 * energy / strength;
  if (!(last > first)) {
    throw InputError(
        "its final opening " + number(last) +
        " must be larger than the opening at its strength, strength / normal = " + number(first));
  }
  const double limit = (last - first) / strength;
  if (!(steepest < limit)) {
    throw InputError(
        "the search direction is too small for softening: its flexibility " + number(steepest) +
        " must be below (final opening - strength / normal) / strength = " + number(limit));
  }
  return {first, last};
}

/// The trial opening in the metric of lambda, normal and tangential, and the products m = c kappa.
struct DebondingTrial {
  std::array<double, 2> squares;
  std::array<double, 2> m;

  /// lambda with (1 - D) = share.
  [[nodiscard]] double opened(double share) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < 2; ++i) {
      sum += squares[i] / ((1.0 + m[i] * share) * (1.0 + m[i] * share));
    }
    return std::sqrt(sum);
  }
};

/// The opening between `low` and lambda_f at which the law holds.
///
/// With (1 - D) = a (lambda_f - lambda) / lambda the opening is that of the jumps over
/// g_i(lambda) = lambda + m_i a (lambda_f - lambda): solve |jump / g(lambda)| = 1. The inverse of the
/// left side is nearly linear (exactly, where both m are the same), so Newton takes a step or few.
double balanced(const Softening& law, const DebondingTrial& trial, double low) {
  const double a = law.first / (law.last - law.first);
  double high = law.last;
  double next = low;
  for (int iteration = 0; iteration < 200; ++iteration) {
    double sum = 0.0;
    double slope = 0.0;
    for (std::size_t i = 0; i < 2; ++i) {
      const double g = next + trial.m[i] * a * (law.last - next);
      sum += trial.squares[i] / (g * g);
      slope -= trial.squares[i] / (g * g * g) * (1.0 - trial.m[i] * a);
    }
    // 1 / sqrt(sum) - 1 and its derivative
    const double off = 1.0 / std::sqrt(sum) - 1.0;
    (off < 0.0 ? low : high) = next;
    double step = next - off / (-slope / (sum * std::sqrt(sum)));
    if (!(step >= low && step <= high)) {
      step = 0.5 * (low + high);
    }
    const bool settled = std::abs(step - next) <= 1e-15 * law.last;
    next = step;
    if (settled) {
      break;
    }
  }
  return next;
}

/// The point of a law under a trial jump, and what it answers.
struct DebondingPoint {
  Softening law;
  DebondingTrial trial;
  Answer answer;

  DebondingPoint(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                 double largest) {
    const double normal = p[0];
    const double tangential = p[1];
    const bool sheared = jump.size() > 1 && tangential > 0.0;
    const double ratio = tangential / normal;  // beta^2
    const double steepest =
        sheared ? std::max(flexibility[0], ratio * flexibility[1]) : flexibility[0];
    law = softening_of(p, steepest);
    const double pull = std::max(jump[0], 0.0);
    double slide = 0.0;
    for (std::size_t a = 1; sheared && a < jump.size(); ++a) {
      slide += ratio * jump[a] * jump[a];
    }
    trial = {{pull * pull, slide},
             {flexibility[0] * normal, sheared ? flexibility[1] * tangential : 0.0}};
    answer = {law.intact(largest), std::max(largest, law.first), false};
    if (trial.opened(answer.share) > answer.reached) {
      if (trial.opened(0.0) >= law.last) {
        answer = {0.0, std::max(answer.reached, trial.opened(0.0)), false};
      } else {
        const double before = answer.reached;
        answer.reached = balanced(law, trial, before);
        answer.share = law.intact(answer.reached);
        answer.damages = answer.reached > (1.0 + touching) * before;
      }
    }
  }
};

}  // namespace

void Debonding::resolve(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                        std::array<double, 1>& largest, PointForce force) {
  const DebondingPoint point(jump, flexibility, p, largest[0]);
  const double share = point.answer.share;
  if (point.answer.reached > point.law.first) {
    largest[0] = std::min(point.answer.reached, point.law.last);  // nothing grows after that
  }
  // every component from its own jump: no difference of close numbers
  const double normal_share = jump[0] > 0.0 ? share : 1.0;
  force[0] = normal_share * p[0] * jump[0] / (1.0 + normal_share * point.trial.m[0]);
  for (std::size_t a = 1; a < jump.size(); ++a) {
    force[a] = share * p[1] * jump[a] / (1.0 + share * point.trial.m[1]);
  }
}

void Debonding::slopes(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                       const std::array<double, 1>& largest, PointForce slope) {
  const DebondingPoint point(jump, flexibility, p, largest[0]);
  const auto [share, reached, damages] = point.answer;
  const std::size_t size = jump.size();
  std::array<double, 3> stiffness{};  // secant
  std::array<double, 3> opened{};     // the jump at the point, where damage sees it
  std::array<double, 3> grows{};      // d lambda / d jump, times lambda
  for (std::size_t a = 0; a < size; ++a) {
    const double whole = a == 0 ? p[0] : p[1];
    const double own = a == 0 && jump[0] <= 0.0 ? 1.0 : share;
    stiffness[a] = own * whole;
    const double at = jump[a] / (1.0 + stiffness[a] * flexibility[a]);
    opened[a] = whole * (a == 0 ? std::max(at, 0.0) : at);
    grows[a] = opened[a] / p[0];
  }
  // K = secant - u v^T; (1 + K c)^-1 K by Sherman and Morrison
  const double a_of_law = point.law.first / (point.law.last - point.law.first);
  const double soft = damages ? a_of_law * point.law.last / (reached * reached * reached) : 0.0;
  double product = 0.0;
  for (std::size_t a = 0; a < size; ++a) {
    product += grows[a] * flexibility[a] * opened[a] / (1.0 + stiffness[a] * flexibility[a]);
  }
  const double factor = soft / (1.0 - soft * product);
  for (std::size_t a = 0; a < size; ++a) {
    const double left = 1.0 / (1.0 + stiffness[a] * flexibility[a]);
    for (std::size_t b = 0; b < size; ++b) {
      const double right = 1.0 / (1.0 + stiffness[b] * flexibility[b]);
      slope[size * a + b] =
          (a == b ? stiffness[a] * left : 0.0) - factor * left * opened[a] * grows[b] * right;
    }
  }
}

}  // namespace latin::interface
