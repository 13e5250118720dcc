#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "interface/interface.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(Interface, LocalFrameRotatesRowsAndDropsComponents) {
  latin::SparseRows trace(4, 2);  // two points in 2D, two unknowns
  trace.insert(0, 0) = 1.0;
  trace.insert(1, 1) = 1.0;
  trace.insert(2, 0) = 0.5;
  trace.insert(3, 1) = 0.5;
  trace.makeCompressed();
  const Matrix frames = (Matrix(2, 2) << 0.6, 0.8, -0.8, 0.6).finished();  // one row a point
  const Matrix local = to_local_frame(trace, frames, "joint");
  EXPECT_LT((local - (Matrix(2, 2) << 0.6, 0.8, -0.4, 0.3).finished()).norm(), 1e-15);
  EXPECT_THROW(to_local_frame(trace, Matrix::Ones(3, 2), "joint"), InputError);
}

}  // namespace latin::interface
