#pragma once

#include <map>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "iteration/sweep.hpp"
#include "latin/study.hpp"
#include "substructure/laws.hpp"
#include "substructure/local_stage.hpp"

namespace latin {

struct Study::Implementation {
  substructure::Laws laws;
  Matrix amplitudes;
  std::shared_ptr<iteration::Beginning> beginning = std::make_shared<iteration::Beginning>();
};

struct Solution::Implementation {
  substructure::Laws laws;
  Matrix amplitudes;
  State state;
  Summary summary;
  std::vector<Status> statuses;  ///< of the steps
  // NOLINTBEGIN(readability-redundant-member-init): made without them
  /// Force and jump by interface, and what they are made with when first asked for.
  mutable std::optional<substructure::LocalStage> stage{};
  mutable std::map<std::size_t, std::pair<Field, Field>> fields{};
  // NOLINTEND(readability-redundant-member-init)
};

}  // namespace latin
