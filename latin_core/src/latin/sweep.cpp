#include "latin/latin/sweep.hpp"

#include <algorithm>
#include <numeric>

#include "latin/common/error.hpp"

namespace latin {
namespace {

/// All swept values, one column a point, every one scaled by its range.
Matrix coordinates(const std::vector<SweptParameter>& parameters) {
  Index rows = 0;
  for (const SweptParameter& each : parameters) {
    rows += each.values.rows();
  }
  Matrix all(rows, parameters.empty() ? 1 : parameters.front().values.cols());
  rows = 0;
  for (const SweptParameter& each : parameters) {
    if (each.values.cols() != all.cols() || each.pattern.cols() != each.values.rows()) {
      throw InputError("sweep: parameter '" + each.parameter + "' of interface '" + each.interface +
                       "' has a pattern of " + std::to_string(each.pattern.cols()) +
                       " columns, values of shape (" + std::to_string(each.values.rows()) + ", " +
                       std::to_string(each.values.cols()) + ") and " + std::to_string(all.cols()) +
                       " points");
    }
    if (each.columns < 1 || each.pattern.rows() % each.columns != 0) {
      throw InputError("sweep: parameter '" + each.parameter + "' of interface '" + each.interface +
                       "' has a pattern of " + std::to_string(each.pattern.rows()) + " rows for " +
                       std::to_string(each.columns) + " columns");
    }
    for (Index i = 0; i < each.values.rows(); ++i) {
      const double range = each.values.row(i).maxCoeff() - each.values.row(i).minCoeff();
      all.row(rows++) = (range > 0.0 ? 1.0 / range : 0.0) * each.values.row(i);
    }
  }
  return all;
}

}  // namespace

void sweep(Problem& problem, const Options& options, const Matrix& amplitudes,
           const std::vector<SweptParameter>& parameters, const std::vector<Index>& order,
           std::vector<State> known, std::vector<Index> known_points, const Callback& callback,
           const PointCallback& point_callback) {
  if (known.size() != known_points.size()) {
    throw InputError("a sweep was given " + std::to_string(known.size()) + " states for " +
                     std::to_string(known_points.size()) + " points");
  }
  const Matrix where = coordinates(parameters);
  // of the interfaces of other ranks only the values count: they say which points are near
  std::vector<const SweptParameter*> own;
  for (const SweptParameter& each : parameters) {
    const bool here = problem.has_interface(each.interface);
    const bool somewhere = problem.communicator().maximum(here ? 1 : 0) > 0;
    if (here || !somewhere) {  // setting a parameter of none names it
      own.push_back(&each);
    }
  }
  for (const Index point : order) {
    problem.communicator().together([&] {
      for (const SweptParameter* each : own) {
        const Vector field = each->pattern * each->values.col(point);
        problem.set_parameter(each->interface, each->parameter,
                              field.reshaped(field.size() / each->columns, each->columns));
      }
    });
    std::vector<std::size_t> nearest(known.size());
    std::iota(nearest.begin(), nearest.end(), std::size_t{0});
    const auto wanted =
        std::min(known.size(), static_cast<std::size_t>(std::max<Index>(options.snapshots, 1)));
    std::vector<double> away(known.size());
    for (std::size_t i = 0; i < known.size(); ++i) {
      away[i] = (where.col(point) - where.col(known_points[i])).squaredNorm();
    }
    std::ranges::partial_sort(nearest, nearest.begin() + static_cast<std::ptrdiff_t>(wanted),
                              [&away](std::size_t a, std::size_t b) { return away[a] < away[b]; });
    std::vector<const State*> start;
    start.reserve(wanted);
    for (std::size_t i = 0; i < wanted; ++i) {
      start.push_back(&known[nearest[i]]);
    }
    State state;
    const Summary summary = solve(problem, options, amplitudes, state, start, callback);
    problem.communicator().together([&] { point_callback(point, summary, state); });
    const bool reproduced =
        summary.iterations <= 1 && wanted >= static_cast<std::size_t>(options.snapshots);
    if (summary.status == Status::converged && !reproduced) {
      known.push_back(std::move(state));
      known_points.push_back(point);
    }
  }
}

std::vector<Index> snake_order(const std::vector<Index>& shape) {
  Index total = 1;
  for (const Index extent : shape) {
    if (extent < 1) {
      throw InputError("a grid axis has " + std::to_string(extent) + " values: give at least one");
    }
    total *= extent;
  }
  std::vector<Index> order;
  order.reserve(static_cast<std::size_t>(total));
  for (Index position = 0; position < total; ++position) {
    // mixed-radix reflected Gray code: an axis runs backwards on every other pass
    Index flat = 0;
    Index block = total;
    for (const Index extent : shape) {
      const Index pass = position / block;
      block /= extent;
      const Index digit = (position / block) % extent;
      flat = flat * extent + (pass % 2 == 1 ? extent - 1 - digit : digit);
    }
    order.push_back(flat);
  }
  return order;
}

}  // namespace latin
