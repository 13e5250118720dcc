#pragma once

#include <filesystem>
#include <string>

#include "folder.hpp"
#include "latin/iteration/summary.hpp"

// The file of the answer.
//
// The file has the same form (`latin-run`, version 1). Beside what it copies from `face` it has
//
// `run/status`, `iterations`, `error`
//     text, integer, number; of a sweep the worst, the sum, the largest
// `run/indicator`, `energy`
//     number; the paper's indicator; u^T K u of all columns; not of a sweep
// `run/errors`
//     (groups, bodies); estimated errors by time step (of a chaos its mean and its fluctuation) and body
// `run/interfaces/I/name`, `force`, `jump`
//     text, (k m, c); force on side 1 per area, and jump; of a sweep (points, c, k m), NaN where it was not
//     reached
// `run/parts/P/name`, `displacement`
//     text, (n, c); of every member; of a sweep (points, c, n), and only with `--displacements`
// `run/points/status`, `iterations`, `error`
//     (points); of a sweep
// `run/axes/names`, `run/axes/A/values`
//     texts, numbers; of a sweep that the command line asked for

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
/// @param max_seconds that it may take  @param watch may end the run, by iteration::Interrupted
Outcome solve_once(const Folder& folder, const std::filesystem::path& target, double max_seconds,
                   const iteration::Callback& watch);

/// Solve for many parameter sets; forces and jumps at every point are kept. Collective.
/// @param displacements whether those of all parts are kept, too: a solution with the factors for every point
/// @throws iteration::Interrupted if it ended before the first point
Outcome solve_sweep(const Folder& folder, const SweepRequest& request,
                    const std::filesystem::path& target, bool displacements, double max_seconds,
                    const iteration::Callback& watch);

}  // namespace latin::program
