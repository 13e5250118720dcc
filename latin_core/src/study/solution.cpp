#include "latin/solution.hpp"

#include <algorithm>
#include <string_view>

#include "latin/common/error.hpp"
#include "study/implementation.hpp"
#include "substructure/global_stage.hpp"

namespace latin {
namespace {

void check_index(std::string_view what, Index index, Index count) {
  if (index < 0 || index >= count) {
    throw InputError(std::string(what) + " " + std::to_string(index) + ": give one of 0.." +
                     std::to_string(count - 1));
  }
}

const std::pair<Field, Field>& fields_of(const Solution::Implementation& of,
                                         const std::string& name) {
  const std::size_t number = of.laws.structure().find_interface(name);
  auto found = of.fields.find(number);
  if (found == of.fields.end()) {
    if (!of.stage) {
      of.stage.emplace(of.laws, of.state.data.cols());
    }
    substructure::LocalFields fields = of.stage->fields(number, of.state.data, of.state.traces);
    const Index components = of.laws.structure().interface(number).geometry.components;
    found = of.fields
                .emplace(number, std::pair{Field(std::move(fields.force), components),
                                           Field(std::move(fields.jump), components)})
                .first;
  }
  return found->second;
}

}  // namespace

double Field::operator()(Index point, Index component, Index column) const {
  check_index("point", point, points());
  check_index("component", component, components_);
  check_index("column", column, columns());
  return values_(components_ * point + component, column);
}

Field::Component Field::component(Index which) const {
  check_index("component", which, components_);
  return {values_.data() + which, points(), columns(), {values_.rows(), components_}};
}

Status Solution::status(Index step) const {
  check_index("step", step, static_cast<Index>(implementation_->statuses.size()));
  return implementation_->statuses[static_cast<std::size_t>(step)];
}

const Summary& Solution::summary() const { return implementation_->summary; }

const Field& Solution::force(const std::string& interface) const {
  return fields_of(*implementation_, interface).first;
}

const Field& Solution::jump(const std::string& interface) const {
  return fields_of(*implementation_, interface).second;
}

Matrix Solution::displacement(const std::string& part) const {
  const Implementation& own = *implementation_;
  const auto& bodies = own.laws.structure().members();
  std::string names;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const auto found = std::ranges::find(bodies[b], part);
    if (found != bodies[b].end()) {
      auto members = substructure::displacements_of(own.laws, b, own.state.data, own.amplitudes);
      return std::move(members[static_cast<std::size_t>(found - bodies[b].begin())]);
    }
    for (const std::string& each : bodies[b]) {
      names += (names.empty() ? "" : ", ") + each;
    }
  }
  throw InputError("there is no part '" + part + "' here; parts: " + names);
}

std::vector<std::pair<std::string, Matrix>> Solution::displacements() const {
  const Implementation& own = *implementation_;
  return substructure::displacements(own.laws, own.state.data, own.amplitudes);
}

const State& Solution::state() const { return implementation_->state; }

}  // namespace latin
