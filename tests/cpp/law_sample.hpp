#pragma once

#include <gtest/gtest.h>

#include <limits>

#include "latin/common/error.hpp"
#include "latin/interface/law.hpp"

/// What the tests of the laws ask them.
namespace latin::interface {

/// Two points, two components (normal, tangent), two columns.
struct Asked {
  Matrix jump = (Matrix(4, 2) << 0.3, -1.0, 0.2, 0.5, -0.4, 2.0, 0.1, 0.0).finished();
  Vector flexibility = (Vector(4) << 0.5, 0.5, 2.0, 2.0).finished();

  [[nodiscard]] Matrix resolve(const Law& law) const {
    Matrix force(4, 2);
    law.resolve({2, jump, flexibility}, force);
    return force;
  }
};

inline constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace latin::interface
