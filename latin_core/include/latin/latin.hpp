#pragma once

/// All that is installed: what a program that describes bodies and interfaces and solves them includes; see
/// docs/kernel.md.

#include "latin/common/interrupt.hpp"
#include "latin/interface/pointwise.hpp"
#include "latin/study.hpp"
