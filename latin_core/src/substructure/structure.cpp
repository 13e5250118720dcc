#include "substructure/structure.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <memory>
#include <numeric>
#include <ranges>
#include <utility>

#include "common/exchange.hpp"
#include "common/threads.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// Motions of a body that its sides see by less, relative to what they see most, are not known.
constexpr double unseen = 1e-6;

void check_side(const InterfaceDescription& interface, const SideDescription& side) {
  if (side.direction.size() != interface.frames.rows()) {
    refuse_interface(interface.name, "search direction has " +
                                         std::to_string(side.direction.size()) + " values for " +
                                         std::to_string(interface.frames.rows()) + " rows");
  }
  if (!(side.scale > 0.0) || !std::isfinite(side.scale)) {
    refuse_interface(interface.name, "scale is " + std::to_string(side.scale) +
                                         ": give modulus / length of the part, > 0");
  }
  if (!(side.lever > 0.0) || !std::isfinite(side.lever)) {
    refuse_interface(interface.name, "lever is " + std::to_string(side.lever) +
                                         ": give 1, or of a rotation 1 / length, > 0");
  }
  if (!(side.direction.array() > 0.0).all() || !side.direction.allFinite()) {
    refuse_interface(interface.name, "search direction must be positive and finite (got " +
                                         std::to_string(side.direction.minCoeff()) + ")");
  }
}

/// Forces and jumps along rows of another length would be those of other units, and no error would say so.
void check_frames(const InterfaceDescription& interface) {
  constexpr double rounded = 1e-6;
  const Index components = interface.frames.rows() / interface.weights.size();
  for (Index point = 0; point < interface.weights.size(); ++point) {
    const auto frame = interface.frames.middleRows(components * point, components);
    const Matrix products = frame * frame.transpose();
    if (!products.isIdentity(rounded)) {
      refuse_interface(interface.name,
                       "the frame of point " + std::to_string(point) +
                           " has rows that are no unit vectors at right angles: give the normal "
                           "out of side 1, then tangents");
    }
  }
}

void check_interface(const InterfaceDescription& interface, const auto& is_here) {
  if (interface.sides.empty() || interface.sides.size() > 2) {
    refuse_interface(interface.name,
                     std::to_string(interface.sides.size()) + " sides: give one (boundary) or two");
  }
  if (interface.weights.size() == 0 || !(interface.weights.array() > 0.0).all() ||
      !interface.weights.allFinite()) {
    refuse_interface(interface.name, "weights must be positive areas, one a point");
  }
  if (interface.frames.rows() % interface.weights.size() != 0 || interface.frames.size() == 0 ||
      !interface.frames.allFinite()) {
    refuse_interface(interface.name, std::to_string(interface.frames.rows()) + " frame rows for " +
                                         std::to_string(interface.weights.size()) +
                                         " points: give the components of every point, finite");
  }
  check_frames(interface);
  if (interface.basis.size() > 0 &&
      (interface.basis.rows() != interface.frames.rows() || !interface.basis.allFinite())) {
    refuse_interface(interface.name, "a coarse basis of " + std::to_string(interface.basis.rows()) +
                                         " rows, expected " +
                                         std::to_string(interface.frames.rows()) + ", finite");
  }
  for (const SideDescription& side : interface.sides) {
    if (is_here(side)) {
      check_side(interface, side);
    }
  }
}

/// An interface between two ranks, as both of them must describe it.
std::string label(const ActiveInterface& interface, int other) {
  return interface.name() + "' between ranks " + std::to_string(other) + " with " +
         std::to_string(interface.geometry.points) + " points of " +
         std::to_string(interface.geometry.components) + " components, " +
         std::to_string(interface.basis.cols()) + " moments, " +
         (interface.paired ? "paired, '" : "'") + interface.geometry.law->name();
}

}  // namespace

Structure::Structure(std::vector<BodyDescription> bodies,
                     std::vector<InterfaceDescription> interfaces, const OperatorOptions& options,
                     const Communicator& communicator, const Structure* before)
    : communicator_(communicator), memory_limit_(options.memory_limit) {
  for (const BodyDescription& body : bodies) {
    auto& names = members_.emplace_back();
    std::ranges::transform(body.members, std::back_inserter(names), &Member::name);
  }
  const Owners owners = find_owners();
  std::vector<std::string> joined;
  double unknowns = 0.0;
  bool linear = true;
  for (const InterfaceDescription& interface : interfaces) {
    unknowns += static_cast<double>(interface.frames.rows());
    linear = linear && interface.law.make()->linear();
    if (interface.sides.size() == 2) {
      joined.insert(joined.end(), {interface.sides[0].member, interface.sides[1].member});
    }
  }
  OperatorOptions of_bodies = options;
  unknowns = communicator_.sum(unknowns);
  const bool many = unknowns > static_cast<double>(few_unknowns) ||
                    (memory_limit_ > 0.0 && 8.0 * unknowns * unknowns > memory_limit_);
  of_bodies.keep_operator = options.keep_operator || (many && !communicator_.everywhere(linear));
  communicator_.together([&] {
    Sides sides{std::vector<std::vector<BodySide>>(bodies.size()), {}};
    sides.owner.resize(bodies.size());
    std::vector<std::vector<double>> scales;
    std::vector<std::vector<double>> levers;
    std::vector<std::vector<Matrix>> motions;
    for (InterfaceDescription& interface : interfaces) {
      auto& own = scales.emplace_back();
      std::ranges::transform(interface.sides, std::back_inserter(own), &SideDescription::scale);
      auto& lever = levers.emplace_back();
      std::ranges::transform(interface.sides, std::back_inserter(lever), &SideDescription::lever);
      auto& moved = motions.emplace_back();
      std::ranges::transform(interface.sides, std::back_inserter(moved), &SideDescription::motions);
      add_interface(std::move(interface), owners, sides);
    }
    build_bodies(std::move(bodies), std::move(sides), of_bodies, before);
    stack_metrics(scales, levers, motions);
  });
  connect();
  find_components(joined);
}

Structure::Owners Structure::find_owners() const {
  std::vector<std::string> names;
  for (const auto& of_body : members_) {
    names.insert(names.end(), of_body.begin(), of_body.end());
  }
  Owners owners;
  const auto all = communicator_.gather(names);
  for (std::size_t rank = 0; rank < all.size(); ++rank) {
    for (const std::string& name : all[rank]) {
      if (!owners.emplace(name, Place{static_cast<int>(rank), 0, 0}).second) {
        throw InputError("substructure '" + name + "' is in two bodies");
      }
    }
  }
  for (std::size_t b = 0; b < members_.size(); ++b) {
    for (std::size_t m = 0; m < members_[b].size(); ++m) {
      owners.at(members_[b][m]) = {communicator_.rank(), b, static_cast<Index>(m)};
    }
  }
  return owners;
}

void Structure::add_interface(InterfaceDescription description, const Owners& owners,
                              Sides& sides) {
  const std::string& name = description.name;
  check_interface(description, [&](const SideDescription& side) {
    const auto owner = owners.find(side.member);
    return owner == owners.end() || owner->second.rank == communicator_.rank();
  });
  if (has_interface(name)) {
    refuse_interface(name, "there are two of this name");
  }
  const Index points = description.weights.size();
  const Index components = description.frames.rows() / points;
  ActiveInterface entry;
  entry.geometry = {name, points, components,
                    description.weights.replicate(1, components).transpose().reshaped(),
                    description.law.make()};
  entry.rows.assign(description.sides.size(), -1);
  entry.flexibility = Vector::Zero(points * components);
  for (std::size_t s = 0; s < description.sides.size(); ++s) {
    SideDescription& side = description.sides[s];
    const auto owner = owners.find(side.member);
    if (owner == owners.end()) {
      refuse_interface(name, "unknown substructure '" + side.member + "'");
    }
    if (owner->second.rank != communicator_.rank()) {
      if (entry.shared() || description.sides.size() == 1) {
        refuse_interface(name, "no side of it is on rank " + std::to_string(communicator_.rank()));
      }
      entry.away = {s, owner->second.rank};
      continue;
    }
    entry.flexibility += side.direction.cwiseInverse();
    const Place& place = owner->second;
    sides.of_body[place.body].push_back(
        {place.member, interface::to_local_frame(side.trace, description.frames, name),
         entry.geometry.weights, std::move(side.direction)});
    sides.owner[place.body].emplace_back(interfaces_.size(), s);
  }
  if (description.paired && !entry.geometry.law->linear()) {
    refuse_interface(name,
                     "law '" + entry.geometry.law->name() + "' is nonlinear and cannot be paired");
  }
  entry.basis = std::move(description.basis);
  entry.paired = description.paired;
  entry.first_unknown = interface_unknowns_;
  interface_unknowns_ += points * components;
  interfaces_.push_back(std::move(entry));
}

void Structure::build_bodies(std::vector<BodyDescription> bodies, Sides sides,
                             const OperatorOptions& options, const Structure* before) {
  std::vector<const Body*> old(bodies.size());
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    body_rows_.push_back(rows_);
    for (std::size_t s = 0; s < sides.of_body[b].size(); ++s) {
      const auto [interface, side] = sides.owner[b][s];
      interfaces_[interface].rows[side] = rows_;
      rows_ += sides.of_body[b][s].trace.rows();
    }
    if (before != nullptr) {
      const auto found = std::ranges::find(before->bodies_, bodies[b].name, &Body::name);
      old[b] = found == before->bodies_.end() ? nullptr : &*found;
    }
  }
  // the largest first: what is left at the end are small ones, of which all threads have some
  std::vector<std::size_t> order(bodies.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_sort(order, std::greater<>(),
                           [&bodies](std::size_t b) { return bodies[b].size; });
  std::vector<std::unique_ptr<Body>> made(bodies.size());
  const auto make = [&](std::size_t b) {
    made[b] = std::make_unique<Body>(std::move(bodies[b]), sides.of_body[b], options, old[b]);
  };
  // one that would keep a thread busy for long after all others is made by all of them
  const auto work = [&bodies](std::size_t b) {
    return std::pow(static_cast<double>(bodies[b].size), 5.0 / 3.0);
  };
  double left = 0.0;
  for (const std::size_t b : order) {
    left += work(b);
  }
  constexpr double too_much = 1.3;
  const double threads = threads_of_algebra();
  auto rest = order.begin();
  for (; rest != order.end() && threads * work(*rest) > too_much * left; ++rest) {
    left -= work(*rest);
    make(*rest);
  }
  order.erase(order.begin(), rest);
  side_by_side(order, make);
  bodies_.reserve(bodies.size());
  for (const std::unique_ptr<Body>& body : made) {
    bodies_.push_back(std::move(*body));
  }
}

void Structure::stack_metrics(const std::vector<std::vector<double>>& scales,
                              const std::vector<std::vector<double>>& levers,
                              const std::vector<std::vector<Matrix>>& motions) {
  weights_.resize(rows_);
  directions_.resize(rows_);
  trace_metric_ = Vector::Zero(rows_);
  levers_ = Vector::Ones(rows_);
  std::vector<Matrix> on_sides(bodies_.size());
  for (std::size_t i = 0; i < interfaces_.size(); ++i) {
    const ActiveInterface& interface = interfaces_[i];
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      if (interface.rows[s] >= 0) {
        trace_metric_.segment(interface.rows[s], interface.size()) =
            scales[i][s] * interface.geometry.weights;
        levers_.segment(interface.rows[s], interface.size()).setConstant(levers[i][s]);
        const std::size_t b = body_of_row(interface.rows[s]);
        Matrix& all = on_sides[b];
        const Matrix& own = motions[i][s];
        if (own.cols() > 0 && all.size() == 0) {
          all = Matrix::Zero(bodies_[b].rows(), own.cols());
        }
        if (own.rows() != (own.cols() > 0 ? interface.size() : 0) || own.cols() != all.cols()) {
          refuse_interface(interface.name(),
                           "motions of the body do not fit: give as many on each of its sides");
        }
        if (own.cols() > 0) {
          all.middleRows(interface.rows[s] - body_rows_[b], own.rows()) = own;
        }
      }
    }
  }
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    weights_.segment(body_rows_[b], bodies_[b].rows()) = bodies_[b].weights();
    directions_.segment(body_rows_[b], bodies_[b].rows()) = bodies_[b].directions();
  }
  inverse_directions_ = directions_.cwiseInverse();
  for (std::size_t b = 0; b < bodies_.size(); ++b) {
    motions_.push_back(motion_of(b, on_sides[b]));
    carried_.push_back(motions_[b].rows() > 0 && bodies_[b].unloaded());
    rigid_.emplace_back(on_sides[b] / std::sqrt(metric_of(b)));
  }
}

double Structure::metric_of(std::size_t body) const {
  const auto rows = Eigen::seqN(body_rows_[body], bodies_[body].rows());
  return trace_metric_(rows).dot(levers_(rows).cwiseAbs2());
}

/// How the motion of a body as a whole follows from the displacements of its sides, by least squares.
Matrix Structure::motion_of(std::size_t body, const Matrix& on_sides) const {
  if (on_sides.cols() == 0) {
    return {};
  }
  const auto metric = trace_metric_.segment(body_rows_[body], bodies_[body].rows());
  const Eigen::SelfAdjointEigenSolver<Matrix> seen(on_sides.transpose() * metric.asDiagonal() *
                                                   on_sides);
  const double largest = seen.eigenvalues().maxCoeff();
  const Vector inverse = (seen.eigenvalues().array() > unseen * largest)
                             .select(seen.eigenvalues().array().inverse(), 0.0);
  return std::sqrt(metric_of(body)) * seen.eigenvectors() * inverse.asDiagonal() *
         seen.eigenvectors().transpose() * on_sides.transpose() * metric.asDiagonal();
}

/// What the ranks must know of each other.
void Structure::connect() {
  for (const Body& body : bodies_) {
    loads_ = std::max(loads_, body.loads());
  }
  loads_ = communicator_.maximum(loads_);
  std::array<double, 3> sums{static_cast<double>(rows_), 0.0, 0.0};
  for (const Body& body : bodies_) {
    const auto active = static_cast<double>(body.active());
    const double numbers = body.cost().factor_numbers;
    sums[1] += body.cost().operations();
    sums[2] += active * active * active;
    sums[2] += body.condensed() ? 0.0 : 2.0 * active * numbers;
  }
  communicator_.sum(sums);
  total_rows_ = static_cast<Index>(std::llround(sums[0]));
  work_ = {sums[1], sums[2]};

  // both ranks go through their common interfaces in the order of names
  for (std::size_t i = 0; i < interfaces_.size(); ++i) {
    if (interfaces_[i].shared()) {
      shared_.push_back(i);
    }
  }
  std::ranges::sort(shared_, {}, [this](std::size_t i) { return interfaces_[i].name(); });
  check_neighbours();

  Exchange exchange(communicator_);
  std::vector<std::size_t> slots;
  slots.reserve(shared_.size());
  for (const std::size_t i : shared_) {
    slots.push_back(exchange.add(interfaces_[i].away.rank, interfaces_[i].size()));
  }
  exchange.prepare(1);
  for (std::size_t n = 0; n < shared_.size(); ++n) {
    const ActiveInterface& interface = interfaces_[shared_[n]];
    exchange.outgoing(slots[n]) =
        directions_.segment(interface.rows[interface.here()], interface.size());
  }
  exchange.start().finish();
  for (std::size_t n = 0; n < shared_.size(); ++n) {
    // a sum of two: the same bits on both ranks
    const Matrix there = exchange.incoming(slots[n]);
    interfaces_[shared_[n]].flexibility += there.col(0).cwiseInverse();
  }
  share_bases();
  if (pairs_ && !communicator_.alone()) {
    share_pairs();
  }
}

/// The displacements of the coarse problem must be the same on both ranks of an interface, to the last bit.
void Structure::share_bases() {
  std::array<double, 3> sums{};
  for (const ActiveInterface& interface : interfaces_) {
    sums[2] += interface.paired ? 1.0 : 0.0;
    if (interface.rows.front() >= 0) {
      sums[0] += static_cast<double>(interface.basis.cols());
      sums[1] += static_cast<double>(interface.size());
    }
  }
  communicator_.sum(sums);
  macro_size_ = static_cast<Index>(std::llround(sums[0]));
  total_unknowns_ = static_cast<Index>(std::llround(sums[1]));
  pairs_ = sums[2] > 0.0;
  Exchange exchange(communicator_);
  std::vector<std::size_t> slots;
  slots.reserve(shared_.size());
  for (const std::size_t i : shared_) {
    slots.push_back(exchange.add(interfaces_[i].away.rank, interfaces_[i].basis.size()));
  }
  exchange.prepare(1);
  for (std::size_t n = 0; n < shared_.size(); ++n) {
    exchange.outgoing(slots[n]) = interfaces_[shared_[n]].basis.reshaped();
  }
  exchange.start().finish();
  for (std::size_t n = 0; n < shared_.size(); ++n) {
    ActiveInterface& interface = interfaces_[shared_[n]];
    if (interface.away.side == 0) {
      interface.basis.reshaped() = exchange.incoming(slots[n]);
    }
  }
}

std::size_t Structure::body_of_row(Index row) const {
  // a body without rows begins where the next one does
  return static_cast<std::size_t>(std::ranges::upper_bound(body_rows_, row) - body_rows_.begin()) -
         1;
}

PairSide Structure::pair_side(const ActiveInterface& interface, std::size_t side) const {
  const Index row = interface.rows[side];
  const std::size_t b = body_of_row(row);
  return {bodies_[b], row - body_rows_[b], interface.geometry.weights};
}

std::vector<std::vector<double>> Structure::swapped(
    const std::vector<std::size_t>& interfaces, const std::vector<std::vector<double>>& own) const {
  const auto swap = [&](const auto& size_of, const auto& value_of) {
    Exchange exchange(communicator_);
    std::vector<std::size_t> slots;
    slots.reserve(interfaces.size());
    for (std::size_t n = 0; n < interfaces.size(); ++n) {
      slots.push_back(exchange.add(interfaces_[interfaces[n]].away.rank, size_of(n)));
    }
    exchange.prepare(1);
    for (std::size_t n = 0; n < interfaces.size(); ++n) {
      auto block = exchange.outgoing(slots[n]);
      for (Index row = 0; row < block.rows(); ++row) {
        block(row, 0) = value_of(n, row);
      }
    }
    exchange.start().finish();
    std::vector<std::vector<double>> found;
    for (const std::size_t slot : slots) {
      const Matrix block = exchange.incoming(slot);
      found.emplace_back(block.data(), block.data() + block.size());
    }
    return found;
  };
  // both ways have one length: that of the longer one
  const auto lengths =
      swap([](std::size_t) { return Index{1}; },
           [&](std::size_t n, Index) { return static_cast<double>(own[n].size()); });
  const auto longer = [&](std::size_t n) {
    return std::max(static_cast<Index>(own[n].size()), static_cast<Index>(lengths[n].front()));
  };
  return swap(longer, [&](std::size_t n, Index row) {
    const auto at = static_cast<std::size_t>(row);
    return at < own[n].size() ? own[n][at] : 0.0;
  });
}

/// Tell neighbours the sides of the pairs that they share.
void Structure::share_pairs() {
  std::vector<std::size_t> paired;
  std::ranges::copy_if(shared_, std::back_inserter(paired),
                       [this](std::size_t i) { return interfaces_[i].paired; });
  std::vector<std::vector<double>> own(paired.size());
  communicator_.together([&] {
    for (std::size_t n = 0; n < paired.size(); ++n) {
      const ActiveInterface& interface = interfaces_[paired[n]];
      own[n] = pair_side(interface, interface.here()).packed();
    }
  });
  const std::vector<std::vector<double>> beyond = swapped(paired, own);
  for (std::size_t n = 0; n < paired.size(); ++n) {
    ActiveInterface& interface = interfaces_[paired[n]];
    interface.beyond = std::make_shared<const PairSide>(
        PairSide::unpacked(beyond[n], "of interface " + interface.name()));
  }
}

/// @param joined substructures, two of each interface one after the other
void Structure::find_components(const std::vector<std::string>& joined) {
  std::vector<std::string> edges = joined;
  for (const auto& members : members_) {
    for (const std::string& member : members) {
      edges.insert(edges.end(), {members.front(), member});
    }
  }
  std::map<std::string, std::string> parent;
  const auto root = [&parent](std::string name) {
    while (parent.at(name) != name) {
      name = parent.at(name) = parent.at(parent.at(name));
    }
    return name;
  };
  for (const auto& of_rank : communicator_.gather(edges)) {
    for (std::size_t i = 0; i + 1 < of_rank.size(); i += 2) {
      parent.try_emplace(of_rank[i], of_rank[i]);
      parent.try_emplace(of_rank[i + 1], of_rank[i + 1]);
      parent.at(root(of_rank[i])) = root(of_rank[i + 1]);
    }
  }
  std::map<std::string, Index> number;
  for (const auto& [name, above] : parent) {
    number.try_emplace(root(name), static_cast<Index>(number.size()));
  }
  for (const auto& members : members_) {
    component_.push_back(number.at(root(members.front())));
  }
  components_ = static_cast<Index>(number.size());
}

void Structure::check_neighbours() const {
  std::vector<std::string> labels;
  labels.reserve(shared_.size());
  for (const std::size_t i : shared_) {
    labels.push_back(label(interfaces_[i], interfaces_[i].away.rank));
  }
  const auto all = communicator_.gather(labels);
  communicator_.together([&] {
    for (const Body& body : bodies_) {
      if (body.loads() != loads_) {
        throw InputError("body '" + body.name() + "' has " + std::to_string(body.loads()) +
                         " load patterns, another has " + std::to_string(loads_));
      }
    }
    for (const std::size_t i : shared_) {
      const int rank = interfaces_[i].away.rank;
      const auto& there = all[static_cast<std::size_t>(rank)];
      if (std::ranges::find(there, label(interfaces_[i], communicator_.rank())) == there.end()) {
        throw InputError("interface '" + interfaces_[i].name() + "' is not the same on rank " +
                         std::to_string(rank) +
                         ": describe it on both with the same points, components, moments and law");
      }
    }
  });
}

Index Structure::unknowns() const {
  return std::transform_reduce(bodies_.begin(), bodies_.end(), Index{0}, std::plus<>(),
                               [](const Body& body) { return body.size(); });
}

Index Structure::active_unknowns() const {
  return std::transform_reduce(bodies_.begin(), bodies_.end(), Index{0}, std::plus<>(),
                               [](const Body& body) { return body.active(); });
}

std::size_t Structure::find_interface(const std::string& name) const {
  const auto found = std::ranges::find(interfaces_, name, &ActiveInterface::name);
  if (found == interfaces_.end()) {
    std::string names;
    for (const ActiveInterface& interface : interfaces_) {
      names += (names.empty() ? "" : ", ") + interface.name();
    }
    throw InputError("no active interface '" + name + "'; active: " + names);
  }
  return static_cast<std::size_t>(found - interfaces_.begin());
}

bool Structure::has_interface(const std::string& name) const {
  return std::ranges::find(interfaces_, name, &ActiveInterface::name) != interfaces_.end();
}

const Macro& Structure::macro() const {
  return macro_.get([this] {
    std::vector<MacroInterface> interfaces;
    for (const ActiveInterface& interface : interfaces_) {
      if (interface.basis.size() > 0) {
        interfaces.push_back({interface.name(), interface.rows, interface.basis});
      }
    }
    return Macro(bodies_, body_rows_, interfaces, communicator_);
  });
}

bool Structure::has_flexibility() const {
  double numbers = 0.0;
  for (const Body& body : bodies_) {
    const auto active = static_cast<double>(body.rows() > 0 ? body.active() : 0);
    numbers += active * active;
  }
  numbers = communicator_.sum(numbers);
  const auto unknowns = static_cast<double>(total_unknowns_);
  return memory_limit_ <= 0.0 || 8.0 * (numbers + unknowns * unknowns) <= memory_limit_;
}

const SeenForces& Structure::seen_forces() const {
  return seen_forces_.get([this] { return SeenForces(*this); });
}

const Flexibility& Structure::flexibility() const {
  return flexibility_.get([this] { return Flexibility(*this); });
}

}  // namespace latin::substructure
