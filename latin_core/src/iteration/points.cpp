#include "latin/iteration/points.hpp"

#include <utility>

#include "latin/common/error.hpp"

namespace latin::iteration {
namespace {

constexpr Index most_points = 10'000'000;  ///< of a grid: some GB

}  // namespace

Points grid(const std::vector<Axis>& axes) {
  Points points;
  std::vector<Index> shape;
  Index count = 1;
  for (const Axis& axis : axes) {
    shape.push_back(static_cast<Index>(axis.values.size()));
    count *= shape.back();
    if (count > most_points) {
      throw InputError("a grid of more than " + std::to_string(most_points) +
                       " points: give fewer values, and solve for the others in another run");
    }
  }
  points.order = snake_order(shape);
  Index repeats = count;
  for (const Axis& axis : axes) {
    const auto extent = static_cast<Index>(axis.values.size());
    repeats /= extent;  // points until the value changes
    Matrix at_points(1, count);
    for (Index point = 0; point < count; ++point) {
      at_points(0, point) = axis.values[static_cast<std::size_t>((point / repeats) % extent)];
    }
    points.parameters.push_back(
        {axis.interface, axis.parameter, Matrix::Ones(1, 1), std::move(at_points), 1});
  }
  return points;
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

Matrix loads_at(const std::vector<SweptParameter>& parameters, Index point, Index rows,
                Index columns) {
  Matrix added = Matrix::Zero(rows, columns);
  for (const SweptParameter& each : parameters) {
    if (each.interface.empty()) {
      const Vector values = each.pattern * each.values.col(point);
      added += values.reshaped(rows, columns);
    }
  }
  return added;
}

}  // namespace latin::iteration
