#include "latin/interface/law.hpp"

#include <string_view>
#include <type_traits>
#include <typeinfo>

#include "interface/built_in.hpp"
#include "interface/contact.hpp"
#include "interface/coulomb.hpp"
#include "interface/debonding.hpp"
#include "interface/elastic.hpp"
#include "interface/force.hpp"
#include "interface/held.hpp"
#include "interface/perfect.hpp"
#include "interface/preload.hpp"

namespace latin::interface {

std::unique_ptr<Law> make_law(const std::string& name) {
  if (name == "contact") {
    return std::make_unique<ContactLaw>();
  }
  if (name == "coulomb") {
    return std::make_unique<CoulombLaw>();
  }
  if (name == "debonding") {
    return std::make_unique<DebondingLaw>();
  }
  if (name == "elastic") {
    return std::make_unique<ElasticLaw>();
  }
  if (name == "force") {
    return std::make_unique<ForceLaw>();
  }
  if (name == "held") {
    return std::make_unique<HeldLaw>();
  }
  if (name == "perfect") {
    return std::make_unique<PerfectLaw>();
  }
  if (name == "preload") {
    return std::make_unique<PreloadLaw>();
  }
  throw InputError("unknown law '" + name +
                   "'; known: contact, coulomb, debonding, elastic, force, held, perfect, preload");
}

std::unique_ptr<Law> make_law(const LawFactory& factory) {
  if (std::string_view(factory.abi) != law_abi) {
    throw InputError("a compiled law was built for '" + std::string(factory.abi) +
                     "', the kernel is '" + law_abi +
                     "': compile it anew against latin_core.get_include(), with the Eigen and the "
                     "instruction set of the kernel");
  }
  return factory.make();
}

bool built_in(const Law& law) {
  const auto one_of = [&law]<class... Kinds>(std::type_identity<Kinds>...) {
    return ((typeid(law) == typeid(Kinds)) || ...);
  };
  return one_of(std::type_identity<ContactLaw>(), std::type_identity<CoulombLaw>(),
                std::type_identity<DebondingLaw>(), std::type_identity<ElasticLaw>(),
                std::type_identity<ForceLaw>(), std::type_identity<HeldLaw>(),
                std::type_identity<PerfectLaw>(), std::type_identity<PreloadLaw>());
}

}  // namespace latin::interface
