#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <stdexcept>

#include "latin/interface/law.hpp"
#include "law_sample.hpp"

namespace latin::interface {

TEST(Law, RefuseWhatTheyCannotTake) {
  EXPECT_THROW(make_law("glue"), InputError);
  const auto law = make_law("elastic");
  EXPECT_THROW(law->set("stifness", ParameterField(1.0)), InputError);
  EXPECT_THROW(law->set("normal", ParameterField(-1.0)), InputError);
  EXPECT_THROW(law->set("normal", ParameterField(std::nan(""))), InputError);
  EXPECT_THROW(law->set("normal", ParameterField(Matrix(0, 1))), InputError);
}

}  // namespace latin::interface
