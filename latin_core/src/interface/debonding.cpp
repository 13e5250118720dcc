#include "latin/interface/debonding.hpp"

#include <cmath>
#include <cstdio>

namespace latin::interface {
namespace {

std::string number(double value) {
  std::string text(32, '\0');
  text.resize(static_cast<std::size_t>(std::snprintf(text.data(), text.size(), "%.4g", value)));
  return text;
}

}  // namespace

void Debonding::resolve(PointValues jump, PointValues flexibility, const std::array<double, 5>& p,
                        std::array<double, 1>& largest, PointForce force) {
  const auto [normal, tangential, strength, opening, energy] = p;
  if (!(normal > 0.0 && strength > 0.0)) {
    throw InputError("normal stiffness " + number(normal) + " and strength " + number(strength) +
                     " must be positive");
  }
  const double first = strength / normal;  // lambda_0
  const double last = opening + 2.0 * energy / strength;
  if (!(last > first)) {
    throw InputError(
        "its final opening " + number(last) +
        " must be larger than the opening at its strength, strength / normal = " + number(first));
  }
  const bool sheared = jump.size() > 1 && tangential > 0.0;
  const double ratio = tangential / normal;  // beta^2
  const double limit = (last - first) / strength;
  const double steepest =
      sheared ? std::max(flexibility[0], ratio * flexibility[1]) : flexibility[0];
  if (!(steepest < limit)) {
    throw InputError(
        "the search direction is too small for softening: its flexibility " + number(steepest) +
        " must be below (final opening - strength / normal) / strength = " + number(limit));
  }
  // trial opening, in the metric of lambda, and the products m = c kappa
  const double pull = std::max(jump[0], 0.0);
  double slide = 0.0;
  for (std::size_t a = 1; sheared && a < jump.size(); ++a) {
    slide += ratio * jump[a] * jump[a];
  }
  const double squares[2] = {pull * pull, slide};
  const double m[2] = {flexibility[0] * normal, sheared ? flexibility[1] * tangential : 0.0};
  const auto intact = [&](double reached) {  // 1 - D
    if (reached <= first) {
      return 1.0;
    }
    return std::max(0.0, first * (last - reached) / (reached * (last - first)));
  };
  const auto opened = [&](double share) {  // lambda with (1 - D) = share
    double sum = 0.0;
    for (int i = 0; i < 2; ++i) {
      sum += squares[i] / ((1.0 + m[i] * share) * (1.0 + m[i] * share));
    }
    return std::sqrt(sum);
  };
  double reached = std::max(largest[0], first);
  double share = intact(largest[0]);
  if (const double trial = opened(share); trial > reached) {
    if (opened(0.0) >= last) {
      reached = std::max(reached, opened(0.0));
      share = 0.0;
    } else {
      // With (1 - D) = a (lambda_f - lambda) / lambda the opening is that of the jumps over
      // g_i(lambda) = lambda + m_i a (lambda_f - lambda): solve |jump / g(lambda)| = 1. The inverse of the
      // left side is nearly linear (exactly, where both m are the same), so Newton takes a step or few.
      const double a = first / (last - first);
      double low = reached;
      double high = last;
      double next = low;
      for (int iteration = 0; iteration < 200; ++iteration) {
        double sum = 0.0;
        double slope = 0.0;
        for (int i = 0; i < 2; ++i) {
          const double g = next + m[i] * a * (last - next);
          sum += squares[i] / (g * g);
          slope -= squares[i] / (g * g * g) * (1.0 - m[i] * a);
        }
        // 1 / sqrt(sum) - 1 and its derivative
        const double off = 1.0 / std::sqrt(sum) - 1.0;
        (off < 0.0 ? low : high) = next;
        double step = next - off / (-slope / (sum * std::sqrt(sum)));
        if (!(step >= low && step <= high)) {
          step = 0.5 * (low + high);
        }
        const bool settled = std::abs(step - next) <= 1e-15 * last;
        next = step;
        if (settled) {
          break;
        }
      }
      reached = next;
      share = intact(reached);
    }
    largest[0] = reached;
  }
  // every component from its own jump: no difference of close numbers
  const double normal_share = jump[0] > 0.0 ? share : 1.0;
  force[0] = normal_share * normal * jump[0] / (1.0 + normal_share * m[0]);
  for (std::size_t a = 1; a < jump.size(); ++a) {
    force[a] = share * tangential * jump[a] / (1.0 + share * m[1]);
  }
}

}  // namespace latin::interface
