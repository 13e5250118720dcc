// Methods of Multipliers for parts that nothing holds, or nothing yet.

#include <algorithm>
#include <utility>

#include "latin/iteration/error_estimate.hpp"
#include "latin/iteration/multipliers.hpp"

namespace latin::iteration {
namespace {

using substructure::Joined;

/// A body from which the others need less than this, beside the most, is one that may lie anywhere.
constexpr double idle = 1e-3;
/// Forces of a body below this fraction of its terms are none, as long as those of others are so many times larger than
/// that: what flies away has large terms.
constexpr double no_force = 10.0 * rounding_share;
constexpr double not_flown = 1e3;

}  // namespace

/// What others need nothing from and no linear law holds, as a pin with play, is kept near to where it was: a round
/// would throw it as far as rounding likes. Where the rounds end it bears no force of these springs.
void Multipliers::keep_idle() {
  const std::vector<bool> idles = idle_bodies();
  if (!contacts_) {
    for (std::size_t b = 0; b < idles.size(); ++b) {
      if (idles[b]) {
        const auto rows = rows_of(b);
        keeping_(rows) = keeping * system_.weights()(rows).cwiseProduct(system_.directions()(rows));
        keeps_ = true;
      }
    }
    return;
  }
  for (std::size_t i = 0; i < linear_.size(); ++i) {
    const Joined::JoinedInterface& interface = joined().interfaces()[i];
    const bool keeps = !linear_[i] && std::ranges::any_of(interface.rows, [&](Index row) {
      return idles[body_of(row)];
    });
    if (keeps) {
      keeping_.segment(interface.first_unknown, interface.size) =
          keeping * interface.weights.cwiseQuotient(interface.flexibility);
      keeps_ = true;
    }
  }
}

/// Bodies that others need nothing from, but for those that linear laws join with the ground or with what is needed.
std::vector<bool> Multipliers::idle_bodies() const {
  const Vector sizes = of_bodies(forces_on_bodies());
  std::vector<bool> idles(joined().bodies().size());
  for (Index b = 0; b < sizes.size(); ++b) {
    idles[static_cast<std::size_t>(b)] = sizes(b) <= idle * sizes.maxCoeff();
  }
  const Matrix slopes = system_.slopes(column_, memory_, free_jump(), flexibility_);
  for (bool more = true; std::exchange(more, false);) {
    for (std::size_t i = 0; i < linear_.size(); ++i) {
      const Joined::JoinedInterface& interface = joined().interfaces()[i];
      const auto unknowns = Eigen::seqN(interface.first_unknown, interface.size);
      const auto is_idle = [&](Index row) { return idles[body_of(row)]; };
      if (!linear_[i] || (slopes(unknowns, every).array() == 0.0).all() ||
          (interface.rows.size() > 1 && std::ranges::all_of(interface.rows, is_idle))) {
        continue;
      }
      for (const Index row : interface.rows) {
        more = more || is_idle(row);
        idles[body_of(row)] = false;
      }
    }
  }
  return idles;
}

/// Bodies without forces, and without interfaces that would hold them if they moved a little away.
void Multipliers::find_placeless() {
  Vector away = free_jump();
  const double little = of_rounding * farthest();
  for (const auto& [normal, count] : coupled_) {
    away(normal) += little;
  }
  for (const Index unknown : single_) {
    away(unknown) += little;
  }
  const Matrix slopes = system_.slopes(column_, memory_, away, flexibility_);
  auto found = placeless_.row(column_);
  const std::vector<bool> without_force = forceless();
  for (std::size_t b = 0; b < without_force.size(); ++b) {
    found(static_cast<Index>(b)) = without_force[b] && rows_of(b).size() > 0 ? 1.0 : 0.0;
  }
  for (const Joined::JoinedInterface& interface : joined().interfaces()) {
    const auto unknowns = Eigen::seqN(interface.first_unknown, interface.size);
    if ((slopes(unknowns, every).array() != 0.0).any()) {
      for (const Index row : interface.rows) {
        found(static_cast<Index>(body_of(row))) = 0.0;
      }
    }
  }
}

/// Which body has a row.
std::size_t Multipliers::body_of(Index row) const {
  const auto& bodies = joined().bodies();
  const auto after = std::ranges::upper_bound(bodies, row, {}, &Joined::JoinedBody::first_row);
  return static_cast<std::size_t>(after - bodies.begin()) - 1;
}

/// Bodies without load whose forces are rounding.
std::vector<bool> Multipliers::forceless() const {
  const Vector sizes = of_bodies(forces_on_bodies());
  const Vector of_terms = of_bodies(terms());
  std::vector<bool> found(static_cast<std::size_t>(sizes.size()));
  for (Index b = 0; b < sizes.size(); ++b) {
    const auto at = static_cast<std::size_t>(b);
    const double none = no_force * of_terms(b);
    found[at] =
        joined().bodies()[at].unloaded && sizes(b) <= none && not_flown * none <= sizes.maxCoeff();
  }
  return found;
}

/// Sizes of forces on the active unknowns, (bodies).
Vector Multipliers::of_bodies(const Vector& forces) const {
  const std::vector<Index>& first = joined().first_active();
  Vector sizes(static_cast<Index>(first.size()) - 1);
  for (Index b = 0; b < sizes.size(); ++b) {
    const auto at = static_cast<std::size_t>(b);
    sizes(b) = forces(Eigen::seq(first[at], first[at + 1] - 1)).norm();
  }
  system_.follow_first(sizes);
  return sizes;
}

/// What forces of the bodies are the balance of, at least, (active).
Vector Multipliers::terms() const {
  const Vector traces = traces_ + tangent_.traces() * moved_;
  return tangent_.nodal_of_all(system_.directions().cwiseProduct(traces.cwiseAbs()));
}

/// What the bodies need of the interfaces, (active).
Vector Multipliers::forces_on_bodies() const { return tangent_.stiffness_times(moved_) + pull_; }

/// Forces of the bodies, and of what keeps some of them.
Vector Multipliers::stiffness_times(const Vector& moved) const {
  return tangent_.stiffness_times(moved) + kept_forces(moved);
}

Vector Multipliers::kept_forces(const Vector& moved) const {
  if (!keeps_) {
    return Vector::Zero(moved.size());
  }
  return placed().transpose() * keeping_.cwiseProduct(placed() * moved);
}

/// What says where the bodies are: all their sides, or the jumps alone if steps are taken on these.
const SparseRows& Multipliers::placed() const {
  return contacts_ ? tangent_.jumps() : tangent_.traces();
}

}  // namespace latin::iteration
