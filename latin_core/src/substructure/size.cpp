#include "latin/substructure/size.hpp"

#include <algorithm>
#include <cmath>

namespace latin::substructure {
namespace {

/// Below this fraction of the work of the interface forces a strain energy is rounding of a rigid motion.
constexpr double strain_free = 1e-14;
/// Rounding of displacements and forces, relative to the largest ones.
constexpr double rounding = 1e-14;
/// The same of the body's own largest step, in which forces of interfaces may cancel.
constexpr double own_rounding = 1e-13;
/// Displacements this many times larger than rounding are answers.
constexpr double above_rounding = 30.0;
/// A step is measured with this fraction of the largest step at least; a fluctuation below this one of the mean is
/// none, and is measured with the mean.
constexpr double quiet = 1e-9;
constexpr double still = 5e-7;
/// Faces that move less than this, relative to what strains the body or to what their forces might do to it, are
/// held: they have no size of their own. Neither has a strain below the second, of a body that is held all around.
constexpr double held = 1e-3;
constexpr double held_strain = 1e-4;

constexpr double square(double x) { return x * x; }

/// Add what `column_sizes(column, rows of a body, sizes, group, body)` says.
template <class F>
Sizes sum_over(const Structure& structure, const ColumnGroups& groups, Index columns,
               const F& add) {
  const auto& bodies = structure.bodies();
  Sizes sizes = Sizes::zero(groups.count(columns), static_cast<Index>(bodies.size()));
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto rows = Eigen::seqN(structure.body_rows()[b], bodies[b].rows());
    for (Index column = 0; column < columns; ++column) {
      const Index group = groups.of(column);
      const auto [strain, trace] = add(rows, column);
      sizes.strain(group, static_cast<Index>(b)) += strain;
      sizes.trace(group, static_cast<Index>(b)) += trace;
    }
  }
  sizes.strain =
      sizes.strain.cwiseAbs();  // rounding may leave the energy of a rigid motion negative
  return sizes;
}

}  // namespace

Sizes Sizes::zero(Index groups, Index bodies) {
  return {Matrix::Zero(groups, bodies), Matrix::Zero(groups, bodies), Matrix::Zero(groups, bodies),
          Matrix::Zero(groups, bodies)};
}

Vector Yardstick::share_of_reach(const Sizes& whole) const {
  Vector sum = Vector::Zero(reach.size());
  for (Index b = 0; b < metric.size(); ++b) {
    if (metric(b) > 0.0) {
      sum(component[static_cast<std::size_t>(b)]) += whole.trace.col(b).maxCoeff() / metric(b);
    }
  }
  return sum;
}

Matrix Yardstick::relative(const Sizes& error, const Sizes& whole, Noise counts) const {
  Matrix result = Matrix::Zero(error.strain.rows(), error.strain.cols());
  const Index kinds = groups.kinds();
  const Index block = groups.steps * kinds;
  for (Index b = 0; b < result.cols(); ++b) {
    const double far = reach(component[static_cast<std::size_t>(b)]);
    const double farthest = far * metric(b);
    const double noise = square(rounding) * farthest;
    for (Index g = 0; g < result.rows(); ++g) {
      // what double precision leaves of the largest step, and of the displacements of other bodies
      const auto history = Eigen::seqN(g / block * block, block);
      const double strain_noise =
          square(rounding) * std::max({far * stiffness(b), whole.strain(history, b).maxCoeff(),
                                       whole.work(history, b).maxCoeff()});
      // of the same kind in the steps of the same history
      const auto steps = Eigen::seqN(g / block * block + g % kinds, groups.steps, kinds);
      const auto own = [&](const Matrix& sizes) {
        return std::max(sizes(g, b), square(quiet) * sizes(steps, b).maxCoeff());
      };
      const auto still_part = [&](const Matrix& sizes) { return square(still) * sizes(g - 1, b); };
      // an iterate may not yet have the fluctuation that the answer has
      const auto is_none = [&](const Matrix& sizes, double wrong) {
        return g % kinds > 0 && std::max(own(sizes), wrong) < still_part(sizes);
      };
      const auto least = [&](const Matrix& sizes, double wrong) {
        if (is_none(sizes, wrong)) {
          return sizes(g - 1, b);
        }
        const bool little = g % kinds > 0 && own(sizes) < still_part(sizes);
        return little ? std::max(own(sizes), wrong) : own(sizes);
      };
      // what is measured with the mean goes with the forces of the mean
      const auto beside = [&](const Matrix& sizes, bool none) {
        return none ? sizes(g - 1, b) : own(sizes);
      };
      const bool no_strain = is_none(whole.strain, error.strain(g, b));
      const bool no_trace = is_none(whole.trace, error.trace(g, b));
      double strain = least(whole.strain, error.strain(g, b));
      const bool ignored = counts == Noise::ignored;
      // where nothing holds a body no work tells rounding of a rigid motion, which is a product of it, from a strain
      const double of_motion = metric(b) > 0.0 ? whole.trace(g, b) / metric(b) * stiffness(b) : 0.0;
      const bool strained = strain > strain_free * beside(whole.work, no_strain) &&
                            (ignored || strain > std::max(rounding * of_motion,
                                                          square(above_rounding) * strain_noise));
      double moved = std::max(least(whole.trace, error.trace(g, b)),
                              square(held) * beside(whole.pressed, no_trace));
      if (strained) {
        // not with the strain of the mean, where the part scatters as a rigid body
        const double own_strain = no_strain && !no_trace ? own(whole.strain) : strain;
        moved = std::max(moved, square(held) * own_strain);
        strain = std::max(strain, square(held_strain) * beside(whole.pressed, no_strain));
      }
      if (moved <= square(above_rounding) * noise) {
        moved = farthest;
      }
      // the body's own largest step leaves rounding in all
      const double trace_none =
          ignored ? noise : square(own_rounding) * whole.trace(history, b).maxCoeff();
      const double strain_none =
          ignored ? strain_noise
                  : square(own_rounding) * std::max(whole.strain(history, b).maxCoeff(),
                                                    whole.work(history, b).maxCoeff());
      // infinite where nothing moves; what is NaN stays NaN
      const double of_trace = error.trace(g, b) <= trace_none ? 0.0 : error.trace(g, b) / moved;
      const double of_strain =
          !strained || error.strain(g, b) <= strain_none ? 0.0 : error.strain(g, b) / strain;
      const bool by_trace = of_trace >= of_strain || std::isnan(of_trace);
      result(g, b) = std::sqrt(by_trace ? of_trace : of_strain);
    }
  }
  return result;
}

Yardstick yardstick(const Structure& structure, const ColumnGroups& groups) {
  Vector metric(static_cast<Index>(structure.bodies().size()));
  for (Index b = 0; b < metric.size(); ++b) {
    const auto at = static_cast<std::size_t>(b);
    metric(b) = structure.trace_metric()
                    .segment(structure.body_rows()[at], structure.bodies()[at].rows())
                    .sum();
  }
  Vector stiffness(metric.size());
  for (Index b = 0; b < metric.size(); ++b) {
    stiffness(b) = structure.bodies()[static_cast<std::size_t>(b)].active_stiffness().sum();
  }
  return {groups, std::move(metric), std::move(stiffness), structure.component(),
          Vector::Zero(structure.components())};
}

Sizes sizes_of_difference(const Structure& structure, const ColumnGroups& groups,
                          ConstMatrixRef data, ConstMatrixRef traces) {
  return sum_over(structure, groups, data.cols(), [&](const auto& rows, Index column) {
    const auto w = traces.col(column)(rows).array();
    const auto force = data.col(column)(rows).array() - structure.directions()(rows).array() * w;
    return std::pair{(w * structure.weights()(rows).array() * force).sum(),
                     (w.square() * structure.trace_metric()(rows).array()).sum()};
  });
}

Sizes sizes_of_distance(const Structure& structure, const ColumnGroups& groups, ConstMatrixRef data,
                        ConstMatrixRef traces, ConstMatrixRef other_data,
                        ConstMatrixRef other_traces) {
  return sum_over(structure, groups, data.cols(), [&](const auto& rows, Index column) {
    const auto w = traces.col(column)(rows).array() - other_traces.col(column)(rows).array();
    const auto s = data.col(column)(rows).array() - other_data.col(column)(rows).array();
    const auto force = s - structure.directions()(rows).array() * w;
    return std::pair{(w * structure.weights()(rows).array() * force).sum(),
                     (w.square() * structure.trace_metric()(rows).array()).sum()};
  });
}

}  // namespace latin::substructure
