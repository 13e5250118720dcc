#include "latin/interface/law.hpp"

#include <algorithm>
#include <cmath>

#include "latin/common/error.hpp"
#include "latin/interface/contact.hpp"
#include "latin/interface/coulomb.hpp"
#include "latin/interface/elastic.hpp"
#include "latin/interface/force.hpp"
#include "latin/interface/perfect.hpp"

namespace latin {

void Law::set(const std::string& parameter, ParameterField field, Range range) {
  const auto known = parameters();
  const auto info = std::ranges::find(known, parameter, &ParameterInfo::name);
  if (info == known.end()) {
    std::string names;
    for (const auto& each : known) {
      names += (names.empty() ? "" : ", ") + each.name;
    }
    throw InputError("law '" + name() + "' has no parameter '" + parameter + "'; it has: " + names);
  }
  if (field.values().size() == 0) {
    throw InputError("parameter '" + parameter + "' of law '" + name() + "' is empty");
  }
  for (const double value : field.values().reshaped()) {
    if (std::isnan(value)) {
      throw InputError("parameter '" + parameter + "' of law '" + name() + "' holds a NaN");
    }
    if (range == Range::admissible && value < info->minimum) {
      throw InputError("parameter '" + parameter + "' of law '" + name() + "' is " +
                       std::to_string(value) + ": it must be at least " +
                       std::to_string(info->minimum));
    }
  }
  fields_[parameter] = std::move(field);
}

const ParameterField& Law::get(const std::string& parameter) const {
  static const ParameterField zero;
  const auto found = fields_.find(parameter);
  return found == fields_.end() ? zero : found->second;
}

std::unique_ptr<Law> make_law(const std::string& name) {
  if (name == "contact") {
    return std::make_unique<ContactLaw>();
  }
  if (name == "coulomb") {
    return std::make_unique<CoulombLaw>();
  }
  if (name == "elastic") {
    return std::make_unique<ElasticLaw>();
  }
  if (name == "force") {
    return std::make_unique<ForceLaw>();
  }
  if (name == "perfect") {
    return std::make_unique<PerfectLaw>();
  }
  throw InputError("unknown law '" + name + "'; known: contact, coulomb, elastic, force, perfect");
}

}  // namespace latin
