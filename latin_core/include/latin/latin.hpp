#pragma once

/// What a program that describes bodies and interfaces and solves them includes; see docs/kernel.md.

#include "latin/algebra/handle.hpp"
#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"
#include "latin/common/sparse_view.hpp"
#include "latin/common/threads.hpp"
#include "latin/common/types.hpp"
#include "latin/interface/law.hpp"
#include "latin/interface/pointwise.hpp"
#include "latin/iteration/solver.hpp"
#include "latin/iteration/sweep.hpp"
#include "latin/substructure/global_stage.hpp"
#include "latin/substructure/laws.hpp"
#include "latin/substructure/local_stage.hpp"
#include "latin/substructure/structure.hpp"
