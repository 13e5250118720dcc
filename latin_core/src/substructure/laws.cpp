#include "substructure/laws.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "common/exchange.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// A law that takes up all but this fraction of a free jump is a perfect connection.
constexpr double rounding_of_share = 1e-14;

void check_shape(const ActiveInterface& interface, const interface::Law& law,
                 const LawParameter& change) {
  for (const auto& info : law.parameters()) {
    if (info.name != change.parameter) {
      continue;
    }
    const bool per_point = info.shape == interface::Law::Shape::per_point;
    const Index expected = per_point ? interface.geometry.points : interface.size();
    const Index given = change.values.rows();
    if (given != expected && !(given == 1 && per_point)) {
      refuse_interface(interface.name(),
                       "parameter '" + change.parameter + "' has " + std::to_string(given) +
                           " rows, expected " + std::to_string(expected) +
                           (per_point ? " (one a point) or 1" : " (one a point and component)"));
    }
  }
}

void check_groups(const ActiveInterface& interface, const std::vector<LawColumns>& groups) {
  const auto demand = [&interface](bool holds, const std::string& what) {
    if (!holds) {
      refuse_interface(interface.name(), "column transforms: " + what);
    }
  };
  const Index points = interface.geometry.points;
  Index covered = 0;
  for (const LawColumns& group : groups) {
    demand(group.begin == covered && group.end > group.begin,
           "groups must cover the components in order, without gaps");
    covered = group.end;
    const auto transforms = static_cast<Index>(group.transforms.size());
    demand(transforms <= 1 || transforms == points, std::to_string(transforms) + " matrices for " +
                                                        std::to_string(points) +
                                                        " points: give none, one, or one a point");
    for (const stochastic::ColumnTransform& each : group.transforms) {
      const bool orthogonal =
          each.backward.size() == 0 && each.forward.rows() == each.forward.cols();
      demand((orthogonal || (each.forward.rows() == each.backward.cols() &&
                             each.forward.cols() == each.backward.rows())) &&
                 each.forward.size() > 0,
             "forward is (c, q) and backward (q, c)");
      demand(each.forward.rows() == group.transforms.front().forward.rows() &&
                 each.forward.cols() == group.transforms.front().forward.cols(),
             "the matrices of all points must have one shape");
      demand(each.forward.allFinite() && each.backward.allFinite(), "a matrix is not finite");
    }
  }
  demand(groups.empty() || covered == interface.geometry.components,
         "groups must cover the components in order, without gaps");
}

/// The law with the parameters of each group.
std::vector<std::shared_ptr<const interface::Law>> laws_of_groups(
    const std::string& name, const interface::Law& law, const std::vector<LawColumns>& groups) {
  std::vector<std::shared_ptr<const interface::Law>> laws;
  for (const LawColumns& group : groups) {
    std::shared_ptr<interface::Law> own = law.copy();
    for (const auto& [parameter, field] : group.parameters) {
      try {
        own->set(parameter, field, interface::Law::Range::any);
      } catch (const InputError& error) {
        refuse_interface(name, error.what());
      }
    }
    laws.push_back(std::move(own));
  }
  return laws;
}

/// Means of values of the columns that transforms lead to, one for each row or point.
Matrix means_of(const Matrix& values, const std::vector<stochastic::ColumnTransform>& transforms) {
  const auto many = static_cast<Index>(transforms.size());
  Matrix means(std::max(values.rows(), many), 1);
  for (Index row = 0; row < means.rows(); ++row) {
    const auto& own = transforms[static_cast<std::size_t>(many > 1 ? row : 0)];
    const auto of_row = values.row(values.rows() > 1 ? row : 0);
    const Vector back =
        own.backward.size() > 0 ? own.backward.col(0) : Vector(own.forward.row(0).transpose());
    means(row, 0) = own.forward.row(0).cwiseProduct(of_row).dot(back);
  }
  return means;
}

/// The law with means of parameters of points that only the groups give: tangents start from them.
/// @return null if there is none
std::shared_ptr<interface::Law> with_means(const interface::Law& law,
                                           const std::vector<LawColumns>& groups) {
  std::shared_ptr<interface::Law> changed;
  const std::vector<interface::Law::ParameterInfo> known = law.parameters();
  const auto of_points = [&known](const std::string& parameter) {
    return std::ranges::find(known, parameter, &interface::Law::ParameterInfo::name)->shape ==
           interface::Law::Shape::per_point;
  };
  for (const LawColumns& group : groups) {
    for (const auto& [parameter, field] : group.parameters) {
      if (group.transforms.empty() || !of_points(parameter) ||
          field.values().cols() != group.transforms.front().forward.cols() ||
          !law.get(parameter).values().isZero(0.0)) {
        continue;
      }
      if (!changed) {
        changed = law.copy();
      }
      changed->set(parameter, interface::ParameterField(means_of(field.values(), group.transforms)),
                   interface::Law::Range::any);
    }
  }
  return changed;
}

void check_fields(const ActiveInterface& interface, const interface::Law& law, Index columns) {
  for (const auto& info : law.parameters()) {
    const Matrix& values = law.get(info.name).values();
    const bool per_point = info.shape == interface::Law::Shape::per_point;
    const Index rows = per_point ? interface.geometry.points : interface.size();
    if (values.rows() != 1 &&
        values.rows() != rows) {  // of a transform; others are checked when they are set
      refuse_interface(interface.name(), "parameter '" + info.name + "' has " +
                                             std::to_string(values.rows()) + " rows, expected " +
                                             std::to_string(rows) + " or 1");
    }
    if (values.cols() != 1 && values.cols() != columns) {
      refuse_interface(interface.name(), "parameter '" + info.name + "' has " +
                                             std::to_string(values.cols()) +
                                             " columns where the law sees " +
                                             std::to_string(columns) + ": give that many or one");
    }
  }
}

/// Stiffness of a linear law: f = kappa (j - jump) answers a free jump with kappa / (1 + c kappa).
Vector stiffness_of(const ActiveInterface& interface, const interface::Law& law) {
  const Index rows = interface.size();
  const Matrix zero = Matrix::Zero(rows, 1);
  const Matrix jump = interface.flexibility;
  Matrix at_rest(rows, 1);
  Matrix moved(rows, 1);
  const Index components = interface.geometry.components;
  law.resolve({components, zero, interface.flexibility, 1, interface.name()}, at_rest);
  law.resolve({components, jump, interface.flexibility, 1, interface.name()}, moved);
  const Vector share = (moved - at_rest).cwiseMax(0.0).cwiseMin(1.0);
  return share.array() /
         (interface.flexibility.array() * (1.0 - share.array()).max(rounding_of_share));
}

}  // namespace

bool ActiveLaw::gives(const std::string& parameter) const {
  return transformed() && std::ranges::any_of(*groups, [&](const LawColumns& group) {
           return std::ranges::any_of(group.parameters,
                                      [&](const auto& each) { return each.first == parameter; });
         });
}

Laws::Laws(std::shared_ptr<const Structure> structure) : structure_(std::move(structure)) {
  std::vector<ActiveLaw> active;
  for (const ActiveInterface& interface : structure_->interfaces()) {
    active.push_back({interface.geometry.law, nullptr, {}, std::make_shared<const Lazy<Pair>>()});
  }
  active_ = std::make_shared<const std::vector<ActiveLaw>>(std::move(active));
}

Laws Laws::with(std::map<std::size_t, ActiveLaw> changed) const {
  if (changed.empty()) {
    return *this;
  }
  std::vector<ActiveLaw> active = *active_;
  for (auto& [i, law] : changed) {
    active[i] = std::move(law);
  }
  Laws laws = *this;
  laws.active_ = std::make_shared<const std::vector<ActiveLaw>>(std::move(active));
  return laws;
}

const Matrix& Laws::parameter(const std::string& interface, const std::string& parameter) const {
  const interface::Law& law = *of(structure_->find_interface(interface)).law;
  if (std::ranges::count(law.parameters(), parameter, &interface::Law::ParameterInfo::name) == 0) {
    refuse_interface(interface,
                     "its law '" + law.name() + "' has no parameter '" + parameter + "'");
  }
  return law.get(parameter).values();
}

const LoadResponse& Laws::response(std::size_t body) const {
  return extra_ != nullptr ? extra_->at(body) : structure_->bodies()[body].response();
}

const ScaledColumns* Laws::scaled(std::size_t body) const {
  return scaled_ != nullptr && scaled_->at(body).body != nullptr ? &scaled_->at(body) : nullptr;
}

const FieldColumns* Laws::field(std::size_t body) const {
  return fields_ != nullptr ? fields_->at(body).get() : nullptr;
}

bool Laws::scales_anywhere() const {
  return !structure_->communicator().everywhere(scaled_ == nullptr && fields_ == nullptr);
}

bool Laws::stiffness_is_one() const {
  if (modes_ > 1) {
    return true;
  }
  for (std::size_t b = 0; b < structure_->bodies().size(); ++b) {
    if ((scaled(b) != nullptr && scaled(b)->factors.values.size() != 1) ||
        (field(b) != nullptr && field(b)->body == nullptr)) {
      return false;
    }
  }
  return true;
}

bool Laws::preconditions() const { return structure_->pairs(); }

void Laws::precondition(MatrixRef residual) const {
  const auto& interfaces = structure_->interfaces();
  const auto rows_of = [&](const ActiveInterface& interface, std::size_t side) {
    return residual.middleRows(interface.rows[side], interface.size());
  };
  Exchange exchange(structure_->communicator());
  std::vector<std::size_t> shared;
  std::vector<std::size_t> slots;
  for (const std::size_t i : structure_->shared_interfaces()) {
    if (interfaces[i].paired) {
      shared.push_back(i);
      slots.push_back(exchange.add(interfaces[i].away.rank, interfaces[i].size()));
    }
  }
  exchange.prepare(residual.cols());
  for (std::size_t n = 0; n < shared.size(); ++n) {
    exchange.outgoing(slots[n]) = rows_of(interfaces[shared[n]], interfaces[shared[n]].here());
  }
  Exchange::Transit transit = exchange.start();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const ActiveInterface& interface = interfaces[i];
    if (!interface.paired || interface.shared()) {
      continue;
    }
    if (interface.rows.size() == 1) {
      rows_of(interface, 0) *= 0.5;
    } else {
      pair(i).apply(rows_of(interface, 0), rows_of(interface, 1));
    }
  }
  transit.finish();
  for (std::size_t n = 0; n < shared.size(); ++n) {
    const ActiveInterface& interface = interfaces[shared[n]];
    Matrix away = exchange.incoming(slots[n]);
    if (interface.here() == 0) {
      pair(shared[n]).apply(rows_of(interface, 0), away);
    } else {
      pair(shared[n]).apply(away, rows_of(interface, 1));
    }
  }
}

const Pair& Laws::pair(std::size_t i) const {
  const ActiveInterface& interface = structure_->interface(i);
  const ActiveLaw& active = of(i);
  if (const Pair* made = active.pair->made()) {
    return *made;
  }
  const Vector stiffness = stiffness_of(interface, *active.law);  // before others are made to wait
  return active.pair->get([&] {
    std::array<PairSide, 2> sides;
    for (std::size_t s = 0; s < 2; ++s) {
      sides[s] = interface.rows[s] < 0 ? *interface.beyond : structure_->pair_side(interface, s);
    }
    return Pair(std::move(sides), interface.geometry.weights, stiffness);
  });
}

bool Laws::linear() const {
  return std::ranges::all_of(*active_, [](const ActiveLaw& each) { return each.law->linear(); });
}

bool Laws::remembers() const {
  return std::ranges::any_of(*active_, [](const ActiveLaw& each) { return each.law->history(); });
}

bool Laws::linear_everywhere() const { return structure_->communicator().everywhere(linear()); }

bool Laws::remembers_anywhere() const {
  return !structure_->communicator().everywhere(!remembers());
}

bool Laws::transformed() const { return std::ranges::any_of(*active_, &ActiveLaw::transformed); }

void Laws::check_columns(Index columns) const {
  if (columns < 1 || columns % steps_ != 0) {
    throw InputError(std::to_string(columns) + " columns are no whole number of histories of " +
                     std::to_string(steps_) + " time steps");
  }
  if (in_time_ != nullptr && (columns % in_time_->patterns() != 0 || remembers())) {
    throw InputError("in_time: " + std::to_string(columns) + " columns are no " +
                     std::to_string(in_time_->patterns()) + " load patterns of linear laws");
  }
  for (std::size_t b = 0; b < structure_->bodies().size(); ++b) {
    const ScaledColumns* scaled_body = scaled(b);
    const FieldColumns* of_field = field(b);
    const Index blocks = scaled_body != nullptr ? scaled_body->factors.values.size()
                         : of_field != nullptr  ? of_field->blocks()
                                                : 1;
    if (of_field != nullptr && of_field->chaos == nullptr && blocks > 1) {
      throw InputError("body '" + structure_->bodies()[b].name() + "': " + std::to_string(blocks) +
                       " samples of its field at once: each is a factorisation, and every stage "
                       "would make it again; run one after the other");
    }
    if (columns % blocks != 0) {
      throw InputError("body '" + structure_->bodies()[b].name() + "': " + std::to_string(blocks) +
                       " factors of its stiffness do not fit " + std::to_string(columns) +
                       " columns");
    }
  }
  for (std::size_t i = 0; i < active_->size(); ++i) {
    const ActiveInterface& interface = structure_->interface(i);
    const ActiveLaw& active = of(i);
    if (!active.transformed()) {
      check_fields(interface, *active.law, columns);
      continue;
    }
    for (std::size_t g = 0; g < active.group_laws.size(); ++g) {
      const LawColumns& group = (*active.groups)[g];
      if (!group.transforms.empty() &&
          group.transforms.front().forward.rows() * steps_ != columns) {
        refuse_interface(interface.name(),
                         "column transforms of " +
                             std::to_string(group.transforms.front().forward.rows()) +
                             " modes do not fit " + std::to_string(columns / steps_));
      }
      check_fields(interface, *active.group_laws[g], group.samples(columns, steps_));
    }
  }
}

ActiveLaw Laws::with_law(std::size_t i, std::shared_ptr<const interface::Law> law) const {
  const ActiveInterface& interface = structure_->interface(i);
  ActiveLaw active = of(i);
  active.law = std::move(law);
  const Pair* pair = active.pair->made();
  if (pair == nullptr || pair->stiffness() != stiffness_of(interface, *active.law)) {
    active.pair = std::make_shared<const Lazy<Pair>>();
  }
  if (active.transformed()) {
    active.group_laws = laws_of_groups(interface.name(), *active.law, *active.groups);
  }
  return active;
}

ActiveLaw Laws::with_parameters(std::size_t i,
                                const std::vector<const LawParameter*>& changes) const {
  const ActiveInterface& interface = structure_->interface(i);
  std::shared_ptr<interface::Law> law = of(i).law->copy();
  for (const LawParameter* change : changes) {
    check_shape(interface, *law, *change);
    try {
      law->set(change->parameter, interface::ParameterField(change->values));
    } catch (const InputError& error) {
      refuse_interface(interface.name(), error.what());
    }
    if (of(i).gives(change->parameter)) {
      refuse_interface(interface.name(),
                       "parameter '" + change->parameter +
                           "' is given by the transforms of its columns: set those anew, "
                           "or take them away first");
    }
  }
  return with_law(i, std::move(law));
}

Laws Laws::with_parameters(const std::vector<LawParameter>& changes) const {
  std::map<std::size_t, std::vector<const LawParameter*>> of_interface;
  for (const LawParameter& change : changes) {
    of_interface[structure_->find_interface(change.interface)].push_back(&change);
  }
  std::map<std::size_t, ActiveLaw> changed;
  for (const auto& [i, own] : of_interface) {
    changed.emplace(i, with_parameters(i, own));
  }
  return with(std::move(changed));
}

void LawColumns::find_zeros() {
  // a dense product takes some eight numbers in the time that a sparse one takes for one
  constexpr double quicker = 0.1;
  if (transforms.size() != 1) {
    return;
  }
  const Matrix& forward = transforms.front().forward;
  const Matrix& backward = transforms.front().backward;
  const auto entries = static_cast<double>((forward.array() != 0.0).count());
  if (entries <= quicker * static_cast<double>(forward.size())) {
    sparse_forward = forward.sparseView();
    sparse_backward = backward.size() > 0 ? SparseColumns(backward.sparseView())
                                          : SparseColumns(sparse_forward.transpose());
  }
}

Laws Laws::with_columns(const std::string& interface, std::vector<LawColumns> groups) const {
  const std::size_t i = structure_->find_interface(interface);
  check_groups(structure_->interface(i), groups);
  ActiveLaw active = of(i);
  for (LawColumns& group : groups) {
    group.find_zeros();
  }
  active.group_laws = laws_of_groups(interface, *active.law, groups);
  if (std::shared_ptr<interface::Law> law = with_means(*active.law, groups)) {
    active.law = std::move(law);
    active.pair = std::make_shared<const Lazy<Pair>>();
  }
  active.groups =
      groups.empty() ? nullptr : std::make_shared<const std::vector<LawColumns>>(std::move(groups));
  return with({{i, std::move(active)}});
}

Laws Laws::with_steps(Index steps) const {
  if (steps < 1) {
    throw InputError("a history has " + std::to_string(steps) + " time steps: give at least one");
  }
  Laws changed = *this;
  changed.steps_ = steps;
  return changed;
}

Laws Laws::with_modes(Index modes) const {
  if (modes < 1) {
    throw InputError("a solution has " + std::to_string(modes) + " modes: give at least one");
  }
  Laws changed = *this;
  changed.modes_ = modes;
  return changed;
}

Laws Laws::with_times(Matrix in_time) const {
  if (!in_time.allFinite()) {
    throw InputError("in_time: a factor of a load pattern is not finite");
  }
  Laws changed = *this;
  changed.in_time_ =
      in_time.size() > 0 ? std::make_shared<const PatternTimes>(std::move(in_time)) : nullptr;
  return changed;
}

Laws Laws::with_extra_loads(const std::map<std::string, Matrix>& loads) const {
  const auto& members = structure_->members();
  for (const auto& [name, load] : loads) {
    const auto here = [&name](const auto& of_body) {
      return std::ranges::count(of_body, name) > 0;
    };
    if (!std::ranges::any_of(members, here)) {
      throw InputError("extra loads: substructure '" + name + "' is not on this rank");
    }
    if (!load.allFinite()) {
      throw InputError("extra loads: that of substructure '" + name + "' is not finite");
    }
  }
  Laws changed = *this;
  if (loads.empty()) {
    changed.extra_ = nullptr;
    changed.scale_again();
    return changed;
  }
  std::vector<LoadResponse> responses;
  for (std::size_t b = 0; b < members.size(); ++b) {
    std::vector<Matrix> of_body;
    for (const std::string& member : members[b]) {
      const auto found = loads.find(member);
      of_body.push_back(found != loads.end() ? found->second : Matrix());
    }
    responses.push_back(structure_->bodies()[b].response_with(of_body));
  }
  changed.extra_ = std::make_shared<const std::vector<LoadResponse>>(std::move(responses));
  changed.scale_again();
  return changed;
}

/// The scaled bodies with the extra loads as they are now.
void Laws::scale_again() {
  if (fields_ != nullptr) {
    throw InputError("extra loads: give them before the fields of a stiffness");
  }
  if (scaled_ == nullptr) {
    return;
  }
  std::vector<ScaledColumns> all = *scaled_;
  for (std::size_t b = 0; b < all.size(); ++b) {
    if (all[b].body != nullptr) {
      all[b].body = std::make_shared<const ScaledBody>(structure_->bodies()[b], response(b).extra);
    }
  }
  scaled_ = std::make_shared<const std::vector<ScaledColumns>>(std::move(all));
}

FieldColumns Laws::field_of(std::size_t b,
                            const std::map<std::string, StiffnessFactors>& factors) const {
  const Body& body = structure_->bodies()[b];
  FieldColumns columns;
  columns.extra = response(b).extra;
  FieldBody::Couplings couplings;
  std::vector<std::pair<std::string, Matrix>> samples;
  for (const Stretch& stretch : body.stretches()) {
    const auto found = factors.find(stretch.member);
    if (found == factors.end()) {
      continue;
    }
    const StiffnessFactors& given = found->second;
    const auto refuse_part = [&stretch](const std::string& why) {
      throw InputError("substructure '" + stretch.member + "': " + why);
    };
    if (given.coupling != nullptr) {
      couplings.emplace(stretch.member, given.coupling);
      continue;
    }
    if (given.field.rows() != stretch.points || given.field.cols() < 1) {
      refuse_part(std::to_string(given.field.rows()) + " factors of its stiffness, it has " +
                  std::to_string(stretch.points) + " points");
    }
    if (!given.field.allFinite() || !(given.field.array() > 0.0).all()) {
      refuse_part("factor " + std::to_string(given.field.minCoeff()) +
                  " of its stiffness: it must be positive and finite");
    }
    samples.emplace_back(stretch.member, given.field);
  }
  if (!couplings.empty()) {
    if (!samples.empty()) {
      throw InputError("body '" + body.name() + "': fields in modes and in samples");
    }
    columns.chaos = std::make_shared<const FieldBody>(body, response(b).extra, couplings);
    return columns;
  }
  const Index count = samples.front().second.cols();
  for (const Stretch& stretch : body.stretches()) {
    const auto found =
        std::ranges::find(samples, stretch.member, &decltype(samples)::value_type::first);
    columns.factors.push_back(found != samples.end() ? found->second
                                                     : Matrix::Ones(stretch.points, count));
    if (columns.factors.back().cols() != count) {
      throw InputError("body '" + body.name() + "': fields in different numbers of samples");
    }
  }
  if (count == 1) {
    columns.body = columns.sample(body, 0);
    columns.response = columns.body->response_to_extra(columns.extra);
  }
  return columns;
}

Laws Laws::with_stiffness(const std::map<std::string, StiffnessFactors>& given_factors) const {
  // members that have stretches apart
  std::map<std::string, StiffnessFactors> factors = given_factors;
  Laws with_fields = *this;
  for (std::size_t b = 0; b < structure_->bodies().size(); ++b) {
    std::map<std::string, StiffnessFactors> own;
    for (const Stretch& stretch : structure_->bodies()[b].stretches()) {
      if (const auto found = factors.find(stretch.member); found != factors.end()) {
        own.insert(*found);
        factors.erase(found);
      }
    }
    if (!own.empty()) {
      auto all =
          with_fields.fields_ != nullptr
              ? *with_fields.fields_
              : std::vector<std::shared_ptr<const FieldColumns>>(structure_->bodies().size());
      all[b] = std::make_shared<const FieldColumns>(field_of(b, own));
      with_fields.fields_ =
          std::make_shared<const std::vector<std::shared_ptr<const FieldColumns>>>(std::move(all));
    }
  }
  return with_fields.with_factors(factors);
}

Laws Laws::with_factors(const std::map<std::string, StiffnessFactors>& factors) const {
  if (factors.empty()) {
    return *this;
  }
  const auto& members = structure_->members();
  std::vector<ScaledColumns> all =
      scaled_ != nullptr ? *scaled_ : std::vector<ScaledColumns>(members.size());
  for (const auto& [name, given] : factors) {
    const auto refuse_part = [&name = name](const std::string& why) {
      throw InputError("substructure '" + name + "': " + why);
    };
    const auto body = std::ranges::find_if(
        members, [&name = name](const auto& each) { return std::ranges::count(each, name) > 0; });
    if (body == members.end()) {
      refuse_part("a factor of its stiffness, but it is not on this rank");
    }
    if (given.values.size() == 0 || !(given.values.array() > 0.0).all() ||
        !given.values.allFinite()) {
      refuse_part("factor " +
                  std::to_string(given.values.size() > 0 ? given.values.minCoeff() : 0.0) +
                  " of its stiffness: it must be positive and finite");
    }
    const Index count = given.values.size();
    if (given.forward.size() > 0 &&
        (given.forward.rows() != count || given.forward.cols() != count)) {
      refuse_part("a transform that is not (factors, factors)");
    }
    for (const std::string& other : *body) {
      const auto same = factors.find(other);
      if (same == factors.end() || same->second.values != given.values ||
          same->second.forward != given.forward) {
        refuse_part("it is one body with '" + other + "', whose stiffness has other factors");
      }
    }
    const auto b = static_cast<std::size_t>(body - members.begin());
    if (all[b].body == nullptr) {
      all[b].body = std::make_shared<const ScaledBody>(structure_->bodies()[b], response(b).extra);
    }
    all[b].factors = given;
  }
  Laws changed = *this;
  changed.scaled_ = std::make_shared<const std::vector<ScaledColumns>>(std::move(all));
  return changed;
}

Laws Laws::repeated(Index sets) const {
  std::map<std::size_t, ActiveLaw> changed;
  for (std::size_t i = 0; i < active_->size(); ++i) {
    const interface::Law& own = *of(i).law;
    if (of(i).transformed()) {
      refuse_interface(structure_->interface(i).name(),
                       "parameter sets are not solved side by side where columns are transformed");
    }
    std::shared_ptr<interface::Law> law;
    for (const auto& info : own.parameters()) {
      const Matrix& values = own.get(info.name).values();
      if (values.cols() > 1) {
        if (law == nullptr) {
          law = own.copy();
        }
        law->set(info.name, interface::ParameterField(Matrix(values.replicate(1, sets))),
                 interface::Law::Range::any);
      }
    }
    if (law != nullptr) {
      changed.emplace(i, with_law(i, std::move(law)));
    }
  }
  return with(std::move(changed));
}

}  // namespace latin::substructure
