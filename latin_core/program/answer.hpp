#pragma once

#include <filesystem>
#include <string>

#include "folder.hpp"

namespace latin::program {

/// Form of a file of answers.
constexpr const char* answer_format = "latin-run";
constexpr Index answer_version = 1;

/// How a run ended: the worst status, all iterations, the largest error.
struct Outcome {
  std::string status;
  Index iterations = 0;
  double error = 0.0;
  Index points = 1;
};

/// Solve once: one column, the steps of a history or the modes of a chaos. Collective.
/// @param target file of the answer, which rank 0 writes
Outcome solve_once(const Folder& folder, const std::filesystem::path& target);

/// Solve for many parameter sets; forces and jumps at every point are kept. Collective.
/// @param displacements whether those of all parts are kept, too: a solution with the factors for every point
Outcome solve_sweep(const Folder& folder, const SweepRequest& request,
                    const std::filesystem::path& target, bool displacements);

}  // namespace latin::program
