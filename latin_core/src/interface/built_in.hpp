#pragma once

#include "latin/interface/law.hpp"

namespace latin::interface {

/// Whether a law is one of make_law(), which any thread may ask. Laws of others are asked by the thread that calls.
[[nodiscard]] bool built_in(const Law& law);

}  // namespace latin::interface
