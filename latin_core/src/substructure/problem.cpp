#include "latin/substructure/problem.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <ranges>

#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// Below this share of the work of the interface forces a strain energy is rounding of a rigid motion.
constexpr double strain_free = 1e-12;
/// Steps of the difference quotients, as shares of the largest free jump. The short one seldom crosses a
/// branch of the law, the long one has no rounding to speak of and is taken where both agree to
/// `same_slope` (in 1 / flexibility): within a branch most laws are linear.
constexpr std::array<double, 2> differences{1e-7, 1e-3};
constexpr double same_slope = 1e-7;
/// A law that takes up all but this share of a free jump is a perfect connection.
constexpr double rounding_of_share = 1e-14;

void check_interface(const InterfaceDescription& interface, const auto& is_here) {
  const auto fail = [&interface](const std::string& text) {
    throw InputError("interface '" + interface.name + "': " + text);
  };
  if (interface.sides.empty() || interface.sides.size() > 2) {
    fail(std::to_string(interface.sides.size()) + " sides: give one (boundary) or two");
  }
  if (interface.weights.size() == 0 || !(interface.weights.array() > 0.0).all()) {
    fail("weights must be positive areas, one a point");
  }
  if (interface.frames.rows() % interface.weights.size() != 0) {
    fail(std::to_string(interface.frames.rows()) + " frame rows for " +
         std::to_string(interface.weights.size()) + " points");
  }
  for (const SideDescription& side : interface.sides) {
    if (!is_here(side)) {
      continue;
    }
    if (side.direction.size() != interface.frames.rows()) {
      fail("search direction has " + std::to_string(side.direction.size()) + " values for " +
           std::to_string(interface.frames.rows()) + " rows");
    }
    if (!(side.scale > 0.0)) {
      fail("scale is " + std::to_string(side.scale) + ": give modulus / length of the part, > 0");
    }
    if (!(side.direction.array() > 0.0).all() || !side.direction.allFinite()) {
      fail("search direction must be positive and finite (got " +
           std::to_string(side.direction.minCoeff()) + ")");
    }
  }
}

using Block = Eigen::Map<Matrix>;

/// Columns of a block (rows, steps * c) times one matrix for all points, or one for each. Time steps run
/// fastest, so that one product on the (rows * steps, c) view transforms all of them.
Block transform(const std::vector<Matrix>& by, const Block& block, Index components, Index steps,
                Workspace& work) {
  const Matrix& first = by.front();
  Block result = work.shaped(block.rows(), first.cols() * steps);
  if (by.size() == 1) {
    result.reshaped(block.rows() * steps, first.cols()).noalias() =
        block.reshaped(block.rows() * steps, first.rows()) * first;
    return result;
  }
  Matrix own(components, block.cols());
  Matrix product(components, result.cols());
  for (std::size_t point = 0; point < by.size(); ++point) {
    const Index row = components * static_cast<Index>(point);
    own = block.middleRows(row, components);
    product.reshaped(components * steps, first.cols()).noalias() =
        own.reshaped(components * steps, first.rows()) * by[point];
    result.middleRows(row, components) = product;
  }
  return result;
}

}  // namespace

Problem::Problem(std::vector<BodyDescription> bodies, std::vector<InterfaceDescription> interfaces,
                 const OperatorOptions& options, const Communicator& communicator)
    : communicator_(communicator), exchange_(std::make_unique<Exchange>(communicator)) {
  std::vector<std::string> names;
  for (const BodyDescription& body : bodies) {
    member_names_.emplace_back();
    for (const Member& member : body.members) {
      names.push_back(member.name);
      member_names_.back().push_back(member.name);
    }
  }
  std::map<std::string, int> owners;
  const auto all = communicator_.gather(names);
  for (std::size_t rank = 0; rank < all.size(); ++rank) {
    for (const std::string& name : all[rank]) {
      if (!owners.emplace(name, static_cast<int>(rank)).second) {
        throw InputError("substructure '" + name + "' is in two bodies");
      }
    }
  }
  communicator_.together([&] { build(std::move(bodies), std::move(interfaces), options, owners); });
  connect();
}

/// Everything of this rank.
void Problem::build(std::vector<BodyDescription> bodies,
                    std::vector<InterfaceDescription> interfaces, const OperatorOptions& options,
                    const std::map<std::string, int>& owners) {
  std::map<std::string, std::pair<std::size_t, Index>> where;  // member -> body, position
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    for (std::size_t m = 0; m < member_names_[b].size(); ++m) {
      where.emplace(member_names_[b][m], std::pair{b, static_cast<Index>(m)});
    }
  }
  const auto is_here = [&](const SideDescription& side) {
    const auto owner = owners.find(side.member);
    return owner == owners.end() || owner->second == communicator_.rank();
  };

  std::vector<std::vector<BodySide>> sides(bodies.size());
  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> owner(bodies.size());
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    InterfaceDescription& interface = interfaces[i];
    check_interface(interface, is_here);
    const Index points = interface.weights.size();
    const Index components = interface.frames.rows() / points;
    Entry entry;
    entry.geometry = {interface.name, points, components,
                      interface.weights.replicate(1, components).transpose().reshaped(),
                      interface.law.make()};
    entry.rows.assign(interface.sides.size(), -1);
    entry.flexibility = Vector::Zero(points * components);
    for (std::size_t s = 0; s < interface.sides.size(); ++s) {
      SideDescription& side = interface.sides[s];
      const auto found = where.find(side.member);
      if (found == where.end()) {
        const auto elsewhere = owners.find(side.member);
        if (elsewhere == owners.end()) {
          throw InputError("interface '" + interface.name + "': unknown substructure '" +
                           side.member + "'");
        }
        if (entry.shared() || interface.sides.size() == 1) {
          throw InputError("interface '" + interface.name + "': no side of it is on rank " +
                           std::to_string(communicator_.rank()));
        }
        entry.away = {s, elsewhere->second, 0};
        continue;
      }
      entry.flexibility += side.direction.cwiseInverse();
      const auto [body, member] = found->second;
      sides[body].push_back(
          {member, interface::to_local_frame(side.trace, interface.frames, interface.name),
           entry.geometry.weights, std::move(side.direction)});
      owner[body].emplace_back(i, s);
    }
    if (interface.basis.size() > 0 && interface.basis.rows() != points * components) {
      throw InputError("interface '" + interface.name + "': a coarse basis of " +
                       std::to_string(interface.basis.rows()) + " rows, expected " +
                       std::to_string(points * components));
    }
    if ((interface.paired || interface.basis.size() > 0) && !communicator_.alone()) {
      throw InputError("interface '" + interface.name +
                       "': a coarse problem and paired interfaces are not spread over ranks");
    }
    if (interface.paired && !entry.geometry.law->linear()) {
      throw InputError("interface '" + interface.name + "': law '" + entry.geometry.law->name() +
                       "' is not linear and cannot be paired");
    }
    entry.basis = std::move(interface.basis);
    entry.paired = interface.paired;
    entry.first_unknown = interface_unknowns_;
    interface_unknowns_ += points * components;
    interfaces_.push_back(std::move(entry));
  }

  bodies_.reserve(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    body_rows_.push_back(rows_);
    Index row = rows_;
    for (std::size_t s = 0; s < sides[b].size(); ++s) {
      interfaces_[owner[b][s].first].rows[owner[b][s].second] = row;
      row += sides[b][s].trace.rows();
    }
    bodies_.emplace_back(std::move(bodies[b]), sides[b], options);
    rows_ = row;
  }
  weights_.resize(rows_);
  directions_.resize(rows_);
  trace_metric_ = Vector::Zero(rows_);
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    const Entry& entry = interfaces_[i];
    for (std::size_t s = 0; s < entry.rows.size(); ++s) {
      if (entry.rows[s] >= 0) {
        trace_metric_.segment(entry.rows[s], entry.geometry.weights.size()) =
            interfaces[i].sides[s].scale * entry.geometry.weights;
      }
    }
  }
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    weights_.segment(body_rows_[b], bodies_[b].rows()) = bodies_[b].weights();
    directions_.segment(body_rows_[b], bodies_[b].rows()) = bodies_[b].directions();
  }
  inverse_directions_ = directions_.cwiseInverse();
}

/// What the ranks must know of each other.
void Problem::connect() {
  for (const Body& body : bodies_) {
    loads_ = std::max(loads_, body.loads());
  }
  loads_ = communicator_.maximum(loads_);
  total_rows_ = static_cast<Index>(std::llround(communicator_.sum(static_cast<double>(rows_))));

  // both ranks go through their common interfaces in the order of names
  std::vector<Entry*> shared;
  for (Entry& entry : interfaces_) {
    if (entry.shared()) {
      shared.push_back(&entry);
    }
  }
  std::ranges::sort(shared, {}, [](const Entry* entry) { return entry->geometry.name; });
  const auto label = [](const Entry& entry, int other) {
    return entry.geometry.name + "' between ranks " + std::to_string(other) + " with " +
           std::to_string(entry.geometry.points) + " points of " +
           std::to_string(entry.geometry.components) + " components, '" +
           entry.geometry.law->name();
  };
  std::vector<std::string> labels;
  labels.reserve(shared.size());
  for (const Entry* entry : shared) {
    labels.push_back(label(*entry, entry->away.rank));
  }
  const auto all = communicator_.gather(labels);
  communicator_.together([&] {
    for (const Body& body : bodies_) {
      if (body.loads() != loads_) {
        throw InputError("body '" + body.name() + "' has " + std::to_string(body.loads()) +
                         " load patterns, another has " + std::to_string(loads_));
      }
    }
    for (const Entry* entry : shared) {
      const auto& there = all[static_cast<std::size_t>(entry->away.rank)];
      if (std::ranges::find(there, label(*entry, communicator_.rank())) == there.end()) {
        throw InputError("interface '" + entry->geometry.name + "' is not the same on rank " +
                         std::to_string(entry->away.rank) +
                         ": describe it on both with the same points, components and law");
      }
    }
  });
  for (Entry* entry : shared) {
    entry->away.slot = exchange_->add(entry->away.rank, entry->flexibility.size());
  }
  exchange_->prepare(1);
  for (const Entry* entry : shared) {
    const Index row = entry->rows[entry->here()];
    exchange_->outgoing(entry->away.slot) = directions_.segment(row, entry->flexibility.size());
  }
  exchange_->start().finish();
  for (Entry* entry : shared) {
    // a sum of two: the same bits on both ranks
    const Matrix there = exchange_->incoming(entry->away.slot);
    entry->flexibility += there.col(0).cwiseInverse();
  }
}

Index Problem::unknowns() const {
  Index sum = 0;
  for (const Body& body : bodies_) {
    sum += body.size();
  }
  return sum;
}

Index Problem::active_unknowns() const {
  Index sum = 0;
  for (const Body& body : bodies_) {
    sum += body.active();
  }
  return sum;
}

std::size_t Problem::find_interface(const std::string& name) const {
  const auto found =
      std::ranges::find(interfaces_, name, [](const Entry& e) { return e.geometry.name; });
  if (found == interfaces_.end()) {
    std::string names;
    for (const Entry& entry : interfaces_) {
      names += (names.empty() ? "" : ", ") + entry.geometry.name;
    }
    throw InputError("no active interface '" + name + "'; active: " + names);
  }
  return static_cast<std::size_t>(found - interfaces_.begin());
}

bool Problem::has_interface(const std::string& name) const {
  return std::ranges::any_of(interfaces_,
                             [&name](const Entry& e) { return e.geometry.name == name; });
}

void Problem::set_parameter(const std::string& interface, const std::string& parameter,
                            Matrix values) {
  const Entry& entry = interfaces_[find_interface(interface)];
  interface::Law& law = *entry.geometry.law;
  for (const auto& info : law.parameters()) {
    if (info.name != parameter) {
      continue;
    }
    const Index expected = info.shape == interface::Law::Shape::per_point
                               ? entry.geometry.points
                               : entry.geometry.points * entry.geometry.components;
    if (values.rows() != expected &&
        !(values.rows() == 1 && info.shape == interface::Law::Shape::per_point)) {
      throw InputError(
          "interface '" + interface + "': parameter '" + parameter + "' has " +
          std::to_string(values.rows()) + " rows, expected " + std::to_string(expected) +
          (info.shape == interface::Law::Shape::per_point ? " (one a point) or 1"
                                                          : " (one a point and component)"));
    }
  }
  try {
    law.set(parameter, interface::ParameterField(std::move(values)));
  } catch (const InputError& error) {
    throw InputError("interface '" + interface + "': " + error.what());
  }
}

Matrix Problem::parameter(const std::string& interface, const std::string& parameter) const {
  return interfaces_[find_interface(interface)].geometry.law->get(parameter).values();
}

void Problem::set_columns(const std::string& interface, std::vector<LawColumns> groups) {
  Entry& entry = interfaces_[find_interface(interface)];
  const auto demand = [&interface](bool holds, const std::string& what) {
    if (!holds) {
      throw InputError("interface '" + interface + "': column transforms: " + what);
    }
  };
  Index covered = 0;
  for (const LawColumns& group : groups) {
    demand(group.begin == covered && group.end > group.begin,
           "groups must cover the components in order, without gaps");
    covered = group.end;
    const auto transforms = static_cast<Index>(group.forward.size());
    demand(transforms <= 1 || transforms == entry.geometry.points,
           std::to_string(transforms) + " matrices for " + std::to_string(entry.geometry.points) +
               " points: give none, one, or one a point");
    demand(group.backward.size() == group.forward.size(), "one backward for each forward");
    for (std::size_t i = 0; i < group.forward.size(); ++i) {
      demand(group.forward[i].rows() == group.backward[i].cols() &&
                 group.forward[i].cols() == group.backward[i].rows(),
             "forward is (c, q) and backward (q, c)");
    }
  }
  demand(groups.empty() || covered == entry.geometry.components,
         "groups must cover the components in order, without gaps");
  entry.group_laws.clear();
  for (const LawColumns& group : groups) {
    std::shared_ptr<interface::Law> law = entry.geometry.law->blank();
    for (const auto& info : law->parameters()) {
      law->set(info.name, entry.geometry.law->get(info.name));
    }
    for (const auto& [name, field] : group.parameters) {
      law->set(name, field, interface::Law::Range::any);
    }
    entry.group_laws.push_back(std::move(law));
  }
  entry.groups = std::move(groups);
}

void Problem::check_columns(Index columns) const {
  if (columns < 1 || columns % steps_ != 0) {
    throw InputError(std::to_string(columns) + " columns are no whole number of histories of " +
                     std::to_string(steps_) + " time steps");
  }
  const auto check = [](const std::string& name, const interface::Law& law, Index available) {
    for (const auto& info : law.parameters()) {
      const Index given = law.get(info.name).values().cols();
      if (given != 1 && given != available) {
        throw InputError("interface '" + name + "': parameter '" + info.name + "' has " +
                         std::to_string(given) + " columns where the law sees " +
                         std::to_string(available) + ": give that many or one");
      }
    }
  };
  for (const Entry& entry : interfaces_) {
    if (entry.groups.empty()) {
      check(entry.geometry.name, *entry.geometry.law, columns);
    }
    for (std::size_t g = 0; g < entry.groups.size(); ++g) {
      const auto& forward = entry.groups[g].forward;
      if (!forward.empty() && forward.front().rows() * steps_ != columns) {
        throw InputError("interface '" + entry.geometry.name + "': column transforms of " +
                         std::to_string(forward.front().rows()) + " modes do not fit " +
                         std::to_string(columns / steps_));
      }
      check(entry.geometry.name, *entry.group_laws[g],
            forward.empty() ? columns : forward.front().cols() * steps_);
    }
  }
}

void Problem::set_extra_loads(const std::map<std::string, Matrix>& loads) {
  for (const auto& [name, load] : loads) {
    const auto here = [&name](const auto& members) {
      return std::ranges::count(members, name) > 0;
    };
    if (!std::ranges::any_of(member_names_, here)) {
      throw InputError("extra loads: substructure '" + name + "' is not on this rank");
    }
  }
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    std::vector<Matrix> of_body;
    for (const std::string& member : member_names_[b]) {
      const auto found = loads.find(member);
      of_body.push_back(found != loads.end() ? found->second : Matrix());
    }
    bodies_[b].set_extra_loads(of_body);
  }
}

void Problem::set_steps(Index steps) {
  if (steps < 1) {
    throw InputError("a history has " + std::to_string(steps) + " time steps: give at least one");
  }
  steps_ = steps;
}

void Problem::global_stage(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces) const {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const Body& body = bodies_[b];
    auto of_body = traces.middleRows(body_rows_[b], body.rows());
    body.apply(data.middleRows(body_rows_[b], body.rows()), of_body);
    of_body.noalias() += body.load_traces() * amplitudes;
  }
}

void Problem::global_change(ConstMatrixRef change, MatrixRef traces) const {
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const Body& body = bodies_[b];
    Block added = share_.shaped(body.rows(), change.cols());
    body.apply_single(change.middleRows(body_rows_[b], body.rows()), added);
    traces.middleRows(body_rows_[b], body.rows()) += added;
  }
}

bool Problem::balances() const {
  return std::ranges::any_of(interfaces_, [](const Entry& each) { return each.basis.size() > 0; });
}

Matrix Problem::balance(MatrixRef data, MatrixRef traces) const {
  if (!macro_) {
    std::vector<MacroInterface> interfaces;
    for (const Entry& entry : interfaces_) {
      if (entry.basis.size() > 0) {
        interfaces.push_back({entry.rows, entry.basis});
      }
    }
    macro_ = std::make_unique<Macro>(bodies_, body_rows_, interfaces);
  }
  Matrix forces = data - directions_.asDiagonal() * traces;
  for (const Entry& entry : interfaces_) {
    if (entry.basis.size() > 0 && entry.rows.size() == 1) {
      forces.middleRows(entry.rows.front(), entry.flexibility.size()) -=
          resolve(entry, free_jump(entry, data, traces, Matrix()));
    }
  }
  return macro_->correct(forces, data, traces);
}

bool Problem::preconditions() const {
  return std::ranges::any_of(interfaces_, [](const Entry& each) { return each.paired; });
}

std::size_t Problem::body_of(Index row) const {
  return static_cast<std::size_t>(std::ranges::upper_bound(body_rows_, row) - body_rows_.begin()) -
         1;
}

Pair Problem::make_pair(const Entry& entry) const {
  const Index rows = entry.flexibility.size();
  // f = kappa (j - jump) answers a free jump with kappa / (1 + c kappa)
  Matrix at_rest(rows, 1);
  Matrix moved(rows, 1);
  const Index components = entry.geometry.components;
  const Matrix zero = Matrix::Zero(rows, 1);
  const Matrix jump = entry.flexibility;
  entry.geometry.law->resolve({components, zero, entry.flexibility, 1, entry.geometry.name},
                              at_rest);
  entry.geometry.law->resolve({components, jump, entry.flexibility, 1, entry.geometry.name}, moved);
  const Vector share = (moved - at_rest).cwiseMax(0.0).cwiseMin(1.0);
  const Vector stiffness =
      share.array() / (entry.flexibility.array() * (1.0 - share.array()).max(rounding_of_share));
  std::array<PairSide, 2> sides{};
  for (std::size_t s = 0; s < 2; ++s) {
    const std::size_t b = body_of(entry.rows[s]);
    sides[s] = {&bodies_[b], entry.rows[s] - body_rows_[b], entry.rows[s]};
  }
  return {sides, entry.geometry.weights, stiffness};
}

void Problem::precondition(MatrixRef residual) const {
  const bool first = pairs_.empty();
  for (const Entry& entry : interfaces_) {
    if (entry.paired && entry.rows.size() == 1) {
      residual.middleRows(entry.rows.front(), entry.flexibility.size()) *= 0.5;
    } else if (entry.paired && first) {
      pairs_.push_back(make_pair(entry));
    }
  }
  for (const Pair& pair : pairs_) {
    pair.apply(residual);
  }
}

void Problem::share_of_jump(const Entry& entry, std::size_t side, ConstMatrixRef data,
                            ConstMatrixRef traces, MatrixRef share) const {
  const Index rows = entry.flexibility.size();
  const Index first = entry.rows[side];
  // a / k = (f - k w) / k = s / k - 2 w
  share = inverse_directions_.segment(first, rows).asDiagonal() * data.middleRows(first, rows) -
          2.0 * traces.middleRows(first, rows);
}

Block Problem::free_jump(const Entry& entry, ConstMatrixRef data, ConstMatrixRef traces,
                         ConstMatrixRef away) const {
  Block jump = jump_.shaped(entry.flexibility.size(), data.cols());
  for (std::size_t s = 0; s < entry.rows.size(); ++s) {
    const bool elsewhere = entry.shared() && s == entry.away.side;
    if (s == 0 && elsewhere) {
      jump = away;
    } else if (s == 0) {
      share_of_jump(entry, s, data, traces, jump);
    } else if (elsewhere) {
      jump -= away;
    } else {
      Block share = share_.shaped(jump.rows(), jump.cols());
      share_of_jump(entry, s, data, traces, share);
      jump -= share;
    }
  }
  return jump;
}

Block Problem::resolve(const Entry& entry, const Block& free_jump) const {
  const Index components = entry.geometry.components;
  const auto ask = [&](const interface::Law& law, const Block& jump, Workspace& work) {
    Block answer = work.shaped(jump.rows(), jump.cols());
    law.resolve({components, jump, entry.flexibility, steps_, entry.geometry.name}, answer);
    return answer;
  };
  if (entry.groups.empty()) {
    return ask(*entry.geometry.law, free_jump, force_);
  }
  Block force = force_.shaped(free_jump.rows(), free_jump.cols());
  for (std::size_t g = 0; g < entry.groups.size(); ++g) {
    const LawColumns& group = entry.groups[g];
    const interface::Law& law = *entry.group_laws[g];
    const Block back =
        group.forward.empty()
            ? ask(law, free_jump, back_)
            : transform(group.backward,
                        ask(law, transform(group.forward, free_jump, components, steps_, samples_),
                            sample_forces_),
                        components, steps_, back_);
    for (Index component = group.begin; component < group.end; ++component) {
      // maps: an indexed view would allocate with Eigen 5
      using Strides = Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>;
      const Index points = entry.geometry.points;
      const Strides strides(force.rows(), components);
      Eigen::Map<Matrix, 0, Strides>(force.data() + component, points, force.cols(), strides) =
          Eigen::Map<const Matrix, 0, Strides>(back.data() + component, points, back.cols(),
                                               strides);
    }
  }
  return force;
}

void Problem::local_stage(const Entry& entry, ConstMatrixRef data, ConstMatrixRef traces,
                          ConstMatrixRef away, MatrixRef residual) const {
  const Index rows = entry.flexibility.size();
  const Block force = resolve(entry, free_jump(entry, data, traces, away));
  for (std::size_t s = 0; s < entry.rows.size(); ++s) {
    if (entry.rows[s] < 0) {
      continue;
    }
    const auto k = directions_.segment(entry.rows[s], rows);
    const double sign = s == 0 ? 2.0 : -2.0;
    // f^ + k w^ - s = 2 f^ - a - s = 2 (f^ - s + k w)
    residual.middleRows(entry.rows[s], rows) =
        sign * force - 2.0 * data.middleRows(entry.rows[s], rows) +
        2.0 * (k.asDiagonal() * traces.middleRows(entry.rows[s], rows));
  }
}

void Problem::local_stage(ConstMatrixRef data, ConstMatrixRef traces, MatrixRef residual) const {
  exchange_->prepare(data.cols());
  for (const Entry& entry : interfaces_) {
    if (entry.shared()) {
      share_of_jump(entry, entry.here(), data, traces, exchange_->outgoing(entry.away.slot));
    }
  }
  Exchange::Transit transit = exchange_->start();
  const Matrix none;
  for (const Entry& entry : interfaces_) {  // while messages are on their way
    if (!entry.shared()) {
      local_stage(entry, data, traces, none, residual);
    }
  }
  transit.finish();
  for (const Entry& entry : interfaces_) {
    if (entry.shared()) {
      local_stage(entry, data, traces, exchange_->incoming(entry.away.slot), residual);
    }
  }
}

bool Problem::linear() const {
  return std::ranges::all_of(interfaces_,
                             [](const Entry& each) { return each.geometry.law->linear(); });
}

bool Problem::suits_newton(Index limit) const {
  return communicator_.alone() && interface_unknowns_ <= limit &&
         std::ranges::all_of(
             bodies_, [](const Body& body) { return body.rows() == 0 || body.condensed(); }) &&
         std::ranges::all_of(interfaces_, [](const Entry& each) { return each.groups.empty(); }) &&
         !linear();
}

const Flexibility& Problem::flexibility() const {
  if (!flexibility_) {
    std::vector<Index> unknown(static_cast<std::size_t>(rows_));
    Vector sign(rows_);
    for (const Entry& entry : interfaces_) {
      for (std::size_t s = 0; s < entry.rows.size(); ++s) {
        for (Index row = 0; row < entry.flexibility.size(); ++row) {
          unknown[static_cast<std::size_t>(entry.rows[s] + row)] = entry.first_unknown + row;
          sign(entry.rows[s] + row) = s == 0 ? 1.0 : -1.0;
        }
      }
    }
    flexibility_ = std::make_unique<Flexibility>(bodies_, body_rows_, std::move(unknown),
                                                 std::move(sign), layout().components);
  }
  return *flexibility_;
}

Problem::Layout Problem::layout() const {
  Layout layout;
  for (const Entry& entry : interfaces_) {
    const Index components = entry.geometry.components;
    for (Index row = 0; row < entry.flexibility.size(); ++row) {
      layout.first.push_back(entry.first_unknown + row - row % components);
      layout.components.push_back(components);
    }
  }
  return layout;
}

Vector Problem::law_flexibility(const Vector& wanted) const {
  Vector result = wanted;
  for (const Entry& entry : interfaces_) {
    if (!entry.geometry.law->monotone()) {
      auto own = result.segment(entry.first_unknown, entry.flexibility.size());
      own = own.cwiseMin(entry.flexibility);
    }
  }
  return result;
}

Matrix Problem::free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const {
  Matrix jumps(interface_unknowns_, data.cols());
  for (const Entry& entry : interfaces_) {
    jumps.middleRows(entry.first_unknown, entry.flexibility.size()) =
        free_jump(entry, data, traces, Matrix());  // no side is elsewhere
  }
  return jumps;
}

void Problem::ask(const Entry& entry, ConstMatrixRef free_jump, ConstVectorRef flexibility,
                  Matrix& force) const {
  force.resize(free_jump.rows(), free_jump.cols());
  entry.geometry.law->resolve(
      {entry.geometry.components, free_jump, flexibility, steps_, entry.geometry.name}, force);
}

Matrix Problem::forces(ConstMatrixRef jumps, ConstVectorRef flexibility) const {
  Matrix result(jumps.rows(), jumps.cols());
  Matrix force;
  for (const Entry& entry : interfaces_) {
    const auto rows = Eigen::seqN(entry.first_unknown, entry.flexibility.size());
    const Vector own = flexibility(rows);
    ask(entry, jumps(rows, every), own, force);
    result(rows, every) = force;
  }
  return result;
}

Matrix Problem::slopes(ConstMatrixRef jumps, ConstVectorRef flexibility, Index column) const {
  Index most = 0;
  for (const Entry& entry : interfaces_) {
    most = std::max(most, entry.geometry.components);
  }
  Matrix result = Matrix::Zero(interface_unknowns_, most);
  Matrix force;
  Matrix moved;
  for (const Entry& entry : interfaces_) {
    const Index rows = entry.flexibility.size();
    const Matrix jump = jumps.middleRows(entry.first_unknown, rows);
    const Vector own = flexibility.segment(entry.first_unknown, rows);
    const interface::LocalProblem local{entry.geometry.components, jump, own, steps_,
                                        entry.geometry.name};
    Matrix known(rows, entry.geometry.components);
    if (entry.geometry.law->slopes(local, column, known)) {
      result.block(entry.first_unknown, 0, rows, known.cols()) = known;
      continue;
    }
    ask(entry, jump, own, force);
    double size = jump.col(column).cwiseAbs().maxCoeff();
    if (size == 0.0) {
      const double largest = jump.cwiseAbs().maxCoeff();
      size = largest > 0.0 ? largest : own.maxCoeff();
    }
    for (Index component = 0; component < entry.geometry.components; ++component) {
      const auto of_component =
          Eigen::seqN(component, entry.geometry.points, entry.geometry.components);
      auto slope = result.col(component).segment(entry.first_unknown, rows);
      for (const double difference : differences) {
        Matrix other = jump;
        // towards closing, so that a point that just touches counts as closed
        other(of_component, column).array() -= difference * size;
        ask(entry, other, own, moved);
        const Vector now = (force.col(column) - moved.col(column)) / (difference * size);
        if (difference == differences.front()) {
          slope = now;
        } else {
          slope =
              ((now - slope).cwiseAbs().cwiseProduct(own).array() < same_slope).select(now, slope);
        }
      }
    }
  }
  return result;
}

Problem::LocalFields Problem::local_fields(std::size_t interface, ConstMatrixRef data,
                                           ConstMatrixRef traces) const {
  const Entry& entry = interfaces_.at(interface);
  Matrix away;
  if (entry.shared()) {
    Exchange once(communicator_);
    const std::size_t slot = once.add(entry.away.rank, entry.flexibility.size());
    once.prepare(data.cols());
    share_of_jump(entry, entry.here(), data, traces, once.outgoing(slot));
    once.start().finish();
    away = once.incoming(slot);
  }
  LocalFields fields;
  const Block jump = free_jump(entry, data, traces, away);
  fields.force = resolve(entry, jump);
  fields.jump = jump - entry.flexibility.asDiagonal() * fields.force;
  return fields;
}

Problem::LocalFields Problem::resolve_samples(
    std::size_t interface, ConstMatrixRef free_jump,
    const std::vector<std::pair<std::string, Matrix>>& parameters) const {
  const Entry& entry = interfaces_.at(interface);
  const auto fail = [&entry](const std::string& text) {
    throw InputError("interface '" + entry.geometry.name + "': " + text);
  };
  if (free_jump.rows() != entry.flexibility.size()) {
    fail("a free jump of " + std::to_string(free_jump.rows()) + " rows, expected " +
         std::to_string(entry.flexibility.size()));
  }
  const std::unique_ptr<interface::Law> law = entry.geometry.law->blank();
  for (const auto& info : law->parameters()) {
    law->set(info.name, entry.geometry.law->get(info.name));
  }
  for (const auto& [name, values] : parameters) {
    try {
      law->set(name, interface::ParameterField(values));
    } catch (const InputError& error) {
      fail(error.what());
    }
  }
  for (const auto& info : law->parameters()) {
    const Matrix& values = law->get(info.name).values();
    const Index rows =
        info.shape == interface::Law::Shape::per_point ? entry.geometry.points : free_jump.rows();
    if ((values.rows() != 1 && values.rows() != rows) ||
        (values.cols() != 1 && values.cols() != free_jump.cols())) {
      fail("parameter '" + info.name + "' is " + std::to_string(values.rows()) + " x " +
           std::to_string(values.cols()) + ", expected " + std::to_string(rows) + " x " +
           std::to_string(free_jump.cols()));
    }
  }
  LocalFields fields;
  fields.force.resize(free_jump.rows(), free_jump.cols());
  law->resolve({entry.geometry.components, free_jump, entry.flexibility, steps_}, fields.force);
  fields.jump = free_jump - entry.flexibility.asDiagonal() * fields.force;
  return fields;
}

Index Problem::first_row(std::size_t interface, std::size_t side) const {
  return interfaces_.at(interface).rows.at(side);
}

double Size::relative_to(const Size& whole) const {
  const double total = whole.strain + whole.trace;
  if (!(total > 0.0)) {
    return strain + trace > 0.0 ? std::numeric_limits<double>::infinity() : 0.0;
  }
  const double of_trace = std::sqrt(trace / total);
  // a solution without strain (rigid motion) has no strain error to speak of
  const bool strained = whole.strain > strain_free * whole.work;
  return strained ? std::max(of_trace, std::sqrt(strain / whole.strain)) : of_trace;
}

Size Problem::share_of_size(ConstMatrixRef data, ConstMatrixRef traces,
                            ConstMatrixRef amplitudes) const {
  Size size;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    const Body& body = bodies_[b];
    const auto s = data.middleRows(body_rows_[b], body.rows());
    const auto w = traces.middleRows(body_rows_[b], body.rows());
    Block f = force_.shaped(w.rows(), w.cols());
    f = s - body.directions().asDiagonal() * w;
    size.strain += body.energy(s, w, f, amplitudes);
    for (Index column = 0; column < w.cols(); ++column) {
      size.work += w.col(column).cwiseProduct(f.col(column)).cwiseAbs().dot(body.weights());
    }
  }
  size.trace = squared_traces(traces);
  return size;
}

Size Problem::size(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef amplitudes) const {
  const Size share = share_of_size(data, traces, amplitudes);
  std::array<double, 3> sums{share.strain, share.trace, share.work};
  communicator_.sum(sums);
  return Size{sums[0], sums[1], sums[2]}.positive();
}

Size Problem::share_of_distance(ConstMatrixRef data, ConstMatrixRef traces,
                                ConstMatrixRef other_data, ConstMatrixRef other_traces) const {
  Size share;
  for (Index column = 0; column < data.cols(); ++column) {
    const auto s = data.col(column).array() - other_data.col(column).array();
    const auto w = traces.col(column).array() - other_traces.col(column).array();
    share.strain += (w * weights_.array() * (s - directions_.array() * w)).sum();
    share.trace += (w.square() * trace_metric_.array()).sum();
  }
  return share;
}

Size Problem::difference_size(ConstMatrixRef data, ConstMatrixRef traces) const {
  std::array<double, 2> sums{0.0, squared_traces(traces)};
  for (Index column = 0; column < data.cols(); ++column) {
    sums[0] += (traces.col(column).array() * weights_.array() *
                (data.col(column).array() - directions_.array() * traces.col(column).array()))
                   .sum();
  }
  communicator_.sum(sums);
  return Size{sums[0], sums[1], 0.0}.positive();
}

double Problem::squared_traces(ConstMatrixRef traces) const {
  double sum = 0.0;
  for (Index column = 0; column < traces.cols(); ++column) {
    sum += (traces.col(column).array().square() * trace_metric_.array()).sum();
  }
  return sum;
}

std::vector<std::pair<std::string, Matrix>> Problem::displacements(
    ConstMatrixRef data, ConstMatrixRef amplitudes) const {
  std::vector<std::pair<std::string, Matrix>> fields;
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    auto of_body =
        bodies_[b].displacements(data.middleRows(body_rows_[b], bodies_[b].rows()), amplitudes);
    for (std::size_t e = 0; e < of_body.size(); ++e) {
      fields.emplace_back(member_names_[b][e], std::move(of_body[e]));
    }
  }
  return fields;
}

}  // namespace latin::substructure
