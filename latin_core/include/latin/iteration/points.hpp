#pragma once

#include <string>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::iteration {

/// A law parameter that changes from point to point: field = pattern * values.col(point), whose `columns`
/// blocks of rows are the columns of the field (time steps; one: the same in all). Without an interface it is a load,
/// pattern * values.col(point) is added to the amplitudes (l, c) of the load patterns, column by column.
struct SweptParameter {
  std::string interface;
  std::string parameter;
  Matrix pattern;  ///< (rows * columns, r): r = 1 for a number, more for a random field
  Matrix values;   ///< (r, points)
  Index columns = 1;
};

/// The parameter of a substructure, named in place of an interface, that is the factor of its stiffness; its pattern
/// is (1, 1).
inline constexpr const char* stiffness_parameter = "part.stiffness";

/// Parameter sets, and the order in which they are solved.
struct Points {
  std::vector<SweptParameter> parameters;
  std::vector<Index> order;
};

/// Values of one parameter of a law, each the same at all points of the interface and in all columns.
struct Axis {
  std::string interface;
  std::string parameter;
  std::vector<double> values;
};

/// All combinations of the values of these parameters, numbered with the last axis fastest, in snake_order().
/// @throws InputError on an axis without values, and if there are too many points
[[nodiscard]] Points grid(const std::vector<Axis>& axes);

/// Order in which a grid is walked: neighbours in the order differ in one parameter by one step
/// (boustrophedon), the last axis fastest.
[[nodiscard]] std::vector<Index> snake_order(const std::vector<Index>& shape);

/// What the swept loads among these parameters add to the amplitudes at a point, (rows, columns).
[[nodiscard]] Matrix loads_at(const std::vector<SweptParameter>& parameters, Index point,
                              Index rows, Index columns);

}  // namespace latin::iteration
