#include "latin/substructure/size.hpp"

#include <algorithm>
#include <array>
#include <limits>

namespace latin::substructure {
namespace {

/// Below this share of the work of the interface forces a strain energy is rounding of a rigid motion.
constexpr double strain_free = 1e-12;

}  // namespace

double Size::relative_to(const Size& whole) const {
  const double total = whole.strain + whole.trace;
  if (!(total > 0.0)) {
    return strain + trace > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
  }
  const double of_trace = std::sqrt(trace / total);
  // a solution without strain (rigid motion) has no strain error to speak of
  const bool strained = whole.strain > strain_free * whole.work;
  return strained ? std::max(of_trace, std::sqrt(strain / whole.strain)) : of_trace;
}

Size share_of_distance(const Structure& structure, ConstMatrixRef data, ConstMatrixRef traces,
                       ConstMatrixRef other_data, ConstMatrixRef other_traces) {
  Size share;
  const auto weights = structure.weights().array();
  const auto directions = structure.directions().array();
  for (Index column = 0; column < data.cols(); ++column) {
    const auto s = data.col(column).array() - other_data.col(column).array();
    const auto w = traces.col(column).array() - other_traces.col(column).array();
    share.strain += (w * weights * (s - directions * w)).sum();
    share.trace += (w.square() * structure.trace_metric().array()).sum();
  }
  return share;
}

Size difference_size(const Structure& structure, ConstMatrixRef data, ConstMatrixRef traces) {
  std::array<double, 2> sums{0.0, squared_traces(structure, traces)};
  const auto weights = structure.weights().array();
  const auto directions = structure.directions().array();
  for (Index column = 0; column < data.cols(); ++column) {
    const auto w = traces.col(column).array();
    sums[0] += (w * weights * (data.col(column).array() - directions * w)).sum();
  }
  structure.communicator().sum(sums);
  return Size{sums[0], sums[1], 0.0}.positive();
}

double squared_traces(const Structure& structure, ConstMatrixRef traces) {
  double sum = 0.0;
  for (Index column = 0; column < traces.cols(); ++column) {
    sum += (traces.col(column).array().square() * structure.trace_metric().array()).sum();
  }
  return sum;
}

}  // namespace latin::substructure
