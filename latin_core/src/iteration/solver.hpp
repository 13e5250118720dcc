#pragma once

#include <memory>
#include <vector>

#include "iteration/linearisation.hpp"
#include "latin/iteration/options.hpp"
#include "latin/iteration/state.hpp"
#include "latin/iteration/summary.hpp"
#include "substructure/laws.hpp"

namespace latin::iteration {

/// Iterate to the fixed point from `state` (empty: from zero) and leave the answer in it.
///
/// @param amplitudes (l, c) of the load patterns
/// @param snapshots  states of other parameter sets with the same loads; the start is the affine
///                   combination of them that leaves the smallest residual, at the cost of local stages only
/// @param known      the structure linearised at a near parameter set, and then at this one; null: nothing is known
/// @param balanced   where it is not, a history ends before that column; empty: nothing is known
/// @throws InputError on options out of range
Summary solve(const substructure::Laws& laws, const Options& options, const Matrix& amplitudes,
              State& state, const std::vector<const State*>& snapshots, const Callback& callback,
              const std::shared_ptr<Linearisation>& known = {}, const Balanced& balanced = {});

}  // namespace latin::iteration
