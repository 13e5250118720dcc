#include "substructure/size.hpp"

#include <algorithm>
#include <cmath>

#include "common/numbers.hpp"

namespace latin::substructure {
namespace {

/// Below this fraction of the work of the interface forces a strain energy is rounding of a rigid motion.
constexpr double strain_free = 1e-14;
/// Rounding of displacements and forces, relative to the largest ones.
constexpr double rounding_of_sums = 1e-14;
/// The same of the body's own largest step, in which forces of interfaces may cancel.
constexpr double own_rounding = 1e-13;
/// Displacements this many times larger than rounding are answers.
constexpr double above_rounding = 30.0;
/// A step is measured with this fraction of the largest step at least; a fluctuation below this one of the mean is
/// none, and is measured with the mean.
constexpr double quiet = 1e-9;
constexpr double still_motion = 5e-7;
/// Faces that move less than this, relative to what strains the body or to what their forces might do to it, are
/// held: they have no size of their own. Neither has a strain below the second, of a body that is held all around.
constexpr double held = 1e-3;
constexpr double held_strain = 1e-4;

constexpr double square(double x) { return x * x; }

/// Add the sizes of columns of a body: its data and traces (rows, columns).
template <class S, class W>
void add_sizes(const Structure& structure, std::size_t body, const ColumnGroups& groups,
               const S& data, const W& traces, Sizes& sizes) {
  const auto rows = Eigen::seqN(structure.body_rows()[body], structure.bodies()[body].rows());
  const auto at = static_cast<Index>(body);
  for (Index column = 0; column < data.cols(); ++column) {
    const Index group = groups.of(column);
    const auto w = traces.col(column);
    const auto force = data.col(column) - structure.directions()(rows).cwiseProduct(w);
    sizes.strain(group, at) +=
        structure.straining(body, w).cwiseProduct(structure.weights()(rows)).dot(force);
    sizes.trace(group, at) += structure.trace_size(body, w);
  }
}

/// Sizes of what `data(first, rows)` and `traces(first, rows)` say of the rows of a body, at the times if there are any.
template <class S, class W>
Sizes sizes_of(const Structure& structure, const ColumnGroups& groups, Index columns,
               const PatternTimes* in_time, const S& data, const W& traces) {
  const auto& bodies = structure.bodies();
  ColumnGroups own = groups;
  if (in_time != nullptr) {
    columns = columns / in_time->patterns() * in_time->sums().cols();
    own.steps = in_time->sums().cols();
  }
  Sizes sizes = Sizes::zero(own.count(columns), static_cast<Index>(bodies.size()));
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto of_body = [&](const auto& block) {
      return block(structure.body_rows()[b], bodies[b].rows());
    };
    if (in_time == nullptr) {
      add_sizes(structure, b, own, of_body(data), of_body(traces), sizes);
    } else {
      add_sizes(structure, b, own, summed(Matrix(of_body(data)), in_time->sums()),
                summed(Matrix(of_body(traces)), in_time->sums()), sizes);
    }
  }
  sizes.strain =
      sizes.strain.cwiseAbs();  // rounding may leave the energy of a rigid motion negative
  return in_time == nullptr ? sizes : in_time->at_times(sizes, groups.kinds());
}

/// Rows of groups of sets of `from` columns as those of sets of `to` columns, by what is done to a table of a set.
template <class F>
Matrix by_sets(const Matrix& rows, Index from, Index to, Index kinds, const F& each) {
  const Index sets = rows.rows() / (from * kinds);
  Matrix all(sets * to * kinds, rows.cols());
  for (Index set = 0; set < sets; ++set) {
    for (Index kind = 0; kind < kinds; ++kind) {
      all(Eigen::seqN(set * to * kinds + kind, to, kinds), every) =
          each(Matrix(rows(Eigen::seqN(set * from * kinds + kind, from, kinds), every)));
    }
  }
  return all;
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
    const double noise = square(rounding_of_sums) * farthest;
    for (Index g = 0; g < result.rows(); ++g) {
      // what double precision leaves of the largest step, and of the displacements of other bodies
      const auto history = Eigen::seqN(g / block * block, block);
      if (!(whole.strain(history, b).allFinite() && whole.trace(history, b).allFinite() &&
            whole.work(history, b).allFinite() && whole.pressed(history, b).allFinite() &&
            std::isfinite(farthest))) {
        result(g, b) = std::numeric_limits<double>::quiet_NaN();  // nothing is relative to that
        continue;
      }
      const double strain_noise = square(rounding_of_sums) *
                                  std::max({far * stiffness(b), whole.strain(history, b).maxCoeff(),
                                            whole.work(history, b).maxCoeff()});
      // of the same kind in the steps of the same history
      const auto steps = Eigen::seqN(g / block * block + g % kinds, groups.steps, kinds);
      const auto own = [&](const Matrix& sizes) {
        return std::max(sizes(g, b), square(quiet) * sizes(steps, b).maxCoeff());
      };
      const auto still_part = [&](const Matrix& sizes) {
        return square(still_motion) * sizes(g - 1, b);
      };
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
      // where nothing holds a body no work tells rounding of a rigid motion, which is a product of it, from a strain;
      // that of a body that is carried is not measured with its motion
      const bool with_motion = !carried[static_cast<std::size_t>(b)] && metric(b) > 0.0;
      const double of_motion = with_motion ? whole.trace(g, b) / metric(b) * stiffness(b) : 0.0;
      const bool strained = strain > strain_free * beside(whole.work, no_strain) &&
                            (ignored || strain > std::max(rounding_of_sums * of_motion,
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
      result(g, b) = std::sqrt(larger(of_trace, of_strain));
    }
  }
  return result;
}

Vector Yardstick::rounding_of_strains(const Sizes& whole) const {
  Vector relative = Vector::Zero(metric.size());
  for (Index b = 0; b < relative.size(); ++b) {
    const double strain = whole.strain.col(b).maxCoeff();
    const double far = reach(component[static_cast<std::size_t>(b)]);
    relative(b) = strain > 0.0 ? rounding_of_sums * std::sqrt(far * stiffness(b) / strain) : 0.0;
  }
  return relative;
}

Yardstick yardstick(const Structure& structure, const ColumnGroups& groups) {
  Vector metric(static_cast<Index>(structure.bodies().size()));
  for (Index b = 0; b < metric.size(); ++b) {
    metric(b) = structure.metric_of(static_cast<std::size_t>(b));
  }
  Vector stiffness(metric.size());
  for (Index b = 0; b < metric.size(); ++b) {
    stiffness(b) = structure.bodies()[static_cast<std::size_t>(b)].active_stiffness().sum();
  }
  std::vector<bool> carried(structure.bodies().size());
  for (std::size_t b = 0; b < carried.size(); ++b) {
    carried[b] = structure.carried(b);
  }
  return {groups,
          std::move(metric),
          std::move(stiffness),
          std::move(carried),
          structure.component(),
          Vector::Zero(structure.components())};
}

Matrix summed(ConstMatrixRef block, const Matrix& factors) {
  const Index sets = block.cols() / factors.rows();
  Matrix all(block.rows(), sets * factors.cols());
  for (Index set = 0; set < sets; ++set) {
    all.middleCols(set * factors.cols(), factors.cols()).noalias() =
        block.middleCols(set * factors.rows(), factors.rows()) * factors;
  }
  return all;
}

PatternTimes::PatternTimes(Matrix factors) : factors_(std::move(factors)) {
  const Index count = patterns();
  const Index pairs = count * (count + 1) / 2;
  if (pairs >= times()) {
    sums_ = factors_;
    return;
  }
  // as large as they become: a small one would be lost in a sum
  Vector largest = factors_.rowwise().lpNorm<Eigen::Infinity>();
  largest = (largest.array() > 0.0).select(largest, 1.0);
  single_ = largest.cwiseInverse().asDiagonal() * factors_;
  sums_ = Matrix::Zero(count, pairs);
  sums_.leftCols(count) = largest.asDiagonal();
  weights_ = Matrix::Zero(pairs, times());
  weights_.topRows(count) = single_.cwiseAbs2();
  Index at = count;
  for (Index p = 0; p < count; ++p) {
    for (Index q = p + 1; q < count; ++q, ++at) {
      sums_(p, at) = largest(p);
      sums_(q, at) = largest(q);
      const auto both = single_.row(p).cwiseProduct(single_.row(q)).eval();
      weights_.row(at) = both;
      weights_.row(p) -= both;
      weights_.row(q) -= both;
    }
  }
}

Sizes PatternTimes::at_times(const Sizes& of_sums, Index kinds) const {
  if (weights_.size() == 0) {
    return of_sums;
  }
  const Index count = patterns();
  const auto exact = [&](const Matrix& rows) {
    return by_sets(rows, sums_.cols(), times(), kinds, [&](const Matrix& each) -> Matrix {
      return (weights_.transpose() * each).cwiseMax(0.0);
    });
  };
  const auto bound = [&](const Matrix& rows) {
    return by_sets(rows, sums_.cols(), times(), kinds, [&](const Matrix& each) -> Matrix {
      return (single_.cwiseAbs().transpose() * each.topRows(count).cwiseAbs().cwiseSqrt())
          .cwiseAbs2();
    });
  };
  return {exact(of_sums.strain), exact(of_sums.trace), bound(of_sums.work), bound(of_sums.pressed)};
}

Sizes PatternTimes::bounds(const Sizes& of_patterns, Index kinds) const {
  const auto bound = [&](const Matrix& rows) {
    return by_sets(rows, patterns(), times(), kinds, [&](const Matrix& each) -> Matrix {
      return (factors_.cwiseAbs().transpose() * each.cwiseAbs().cwiseSqrt()).cwiseAbs2();
    });
  };
  return {bound(of_patterns.strain), bound(of_patterns.trace), bound(of_patterns.work),
          bound(of_patterns.pressed)};
}

Sizes sizes_of_difference(const Structure& structure, const ColumnGroups& groups,
                          ConstMatrixRef data, ConstMatrixRef traces, const PatternTimes* in_time) {
  return sizes_of(
      structure, groups, data.cols(), in_time,
      [&](Index first, Index rows) { return data.middleRows(first, rows); },
      [&](Index first, Index rows) { return traces.middleRows(first, rows); });
}

Sizes sizes_of_distance(const Structure& structure, const ColumnGroups& groups, ConstMatrixRef data,
                        ConstMatrixRef traces, ConstMatrixRef other_data,
                        ConstMatrixRef other_traces, const PatternTimes* in_time) {
  return sizes_of(
      structure, groups, data.cols(), in_time,
      [&](Index first, Index rows) {
        return data.middleRows(first, rows) - other_data.middleRows(first, rows);
      },
      [&](Index first, Index rows) {
        return traces.middleRows(first, rows) - other_traces.middleRows(first, rows);
      });
}

}  // namespace latin::substructure
