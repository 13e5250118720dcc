#pragma once

#include <filesystem>
#include <string>

#include "folder.hpp"
#include "latin/iteration/summary.hpp"

namespace latin::program {

/// Form of a file of answers.
constexpr const char* answer_format = "latin-run";
constexpr Index answer_version = 1;

/// How a run ended: the worst status, all iterations, the largest error.
struct Outcome {
  iteration::Status status = iteration::Status::converged;
  Index iterations = 0;
  double error = 0.0;
  Index points = 1;
};

/// Solve once: one column, the steps of a history or the modes of a chaos. Collective.
/// @param target file of the answer, which rank 0 writes
/// @param max_seconds that it may take  @param watch may end the run, by Interrupted
Outcome solve_once(const Folder& folder, const std::filesystem::path& target, double max_seconds,
                   const iteration::Callback& watch);

/// Solve for many parameter sets; forces and jumps at every point are kept. Collective.
/// @param displacements whether those of all parts are kept, too: a solution with the factors for every point
/// @throws Interrupted if it ended before the first point
Outcome solve_sweep(const Folder& folder, const SweepRequest& request,
                    const std::filesystem::path& target, bool displacements, double max_seconds,
                    const iteration::Callback& watch);

}  // namespace latin::program
