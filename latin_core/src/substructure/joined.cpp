#include "substructure/joined.hpp"

#include <algorithm>
#include <map>
#include <utility>

#include "common/exchange.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// S of a body on its active unknowns: without the springs k of its sides, the lower triangle.
Matrix stiffness_of(const Body& body) {
  Matrix stiffness = body.schur();
  const SparseRows& trace = body.active_traces();
  const Vector robin = body.weights().cwiseProduct(body.directions());
  const SparseRows springs = trace.transpose() * SparseRows(robin.asDiagonal() * trace);
  for (Index row = 0; row < springs.rows(); ++row) {
    for (SparseRows::InnerIterator it(springs, row); it; ++it) {
      stiffness(row, it.col()) -= it.value();
    }
  }
  return stiffness;
}

/// Numbers one after the other, as ranks tell them to each other.
class Packer {
 public:
  void add(double value) { numbers_.push_back(value); }
  void add(Index value) { numbers_.push_back(static_cast<double>(value)); }
  void add(const auto& values) {
    numbers_.insert(numbers_.end(), values.data(), values.data() + values.size());
  }
  [[nodiscard]] std::vector<double> take() { return std::move(numbers_); }

 private:
  std::vector<double> numbers_;
};

class Unpacker {
 public:
  explicit Unpacker(const std::vector<double>& numbers) : next_(numbers.data()) {}
  double number() { return *next_++; }
  Index index() { return static_cast<Index>(*next_++); }
  Matrix table(Index rows, Index columns) {
    const double* first = std::exchange(next_, next_ + rows * columns);
    return Eigen::Map<const Matrix>(first, rows, columns);
  }
  Vector list(Index size) { return table(size, 1); }

 private:
  const double* next_;
};

}  // namespace

Joined::Joined(const Structure& structure, const Laws* laws, bool bodies) : structure_(structure) {
  const auto& interfaces = structure.interfaces();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    if (!interfaces[i].shared() || interfaces[i].here() == 0) {
      spoken_for_.push_back(i);
    }
  }
  structure.communicator().together([&] { take_own(laws, bodies); });
  if (!structure.communicator().alone()) {
    exchange();
  }
  number_interfaces();
  for (const JoinedBody& body : bodies_) {
    first_active_.push_back(first_active_.back() + body.stiffness.rows());
  }
}

void Joined::take_own(const Laws* laws, bool matrices) {
  const auto& bodies = structure_.bodies();
  const bool varied = laws != nullptr && laws->modes() == 1;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const FieldColumns* field = varied ? laws->field(b) : nullptr;
    const ScaledColumns* scaled = varied ? laws->scaled(b) : nullptr;
    const double factor = scaled != nullptr ? scaled->factors.values(0) : 1.0;
    JoinedBody body;
    body.first_row = structure_.body_rows()[b];
    body.stiffest = factor * bodies[b].stiffest();
    body.unloaded = bodies[b].unloaded();
    if (!matrices) {
      body.traces = SparseRows(bodies[b].rows(), 0);
    } else if (bodies[b].rows() > 0) {
      body.stiffness = factor * stiffness_of(field != nullptr ? *field->body : bodies[b]);
      body.traces = bodies[b].active_traces();
    }
    bodies_.push_back(std::move(body));
  }
  for (const std::size_t i : spoken_for_) {
    const ActiveInterface& own = structure_.interface(i);
    interfaces_.push_back(
        {own.geometry.components, own.size(), 0, own.rows, own.geometry.weights, own.flexibility});
  }
  weights_ = structure_.weights();
  directions_ = structure_.directions();
  scales_ = structure_.trace_metric().cwiseQuotient(weights_);
  levers_ = structure_.levers();
}

void Joined::number_interfaces() {
  for (JoinedInterface& interface : interfaces_) {
    interface.first_unknown = unknowns_;
    unknowns_ += interface.size;
    most_components_ = std::max(most_components_, interface.components);
  }
  std::map<Index, Index> of_row;
  for (const JoinedInterface& interface : interfaces_) {
    for (const Index row : interface.rows) {
      of_row.emplace(row, interface.first_unknown);
    }
  }
  for (const ActiveInterface& own : structure_.interfaces()) {
    const Index row = own.shared() ? own.rows[own.here()] : own.rows.front();
    first_unknowns_.push_back(of_row.at(row + first_row_));
  }
}

/// Tell the other ranks what is here, and take the same of them.
void Joined::exchange() {
  const Communicator& communicator = structure_.communicator();
  const auto own = static_cast<double>(structure_.rows());
  const auto count = static_cast<double>(structure_.bodies().size());
  const auto of_ranks = communicator.gather(std::vector<double>{own, count});
  for (int rank = 0; rank < communicator.rank(); ++rank) {
    first_row_ += static_cast<Index>(of_ranks[static_cast<std::size_t>(rank)][0]);
    first_body_ += static_cast<Index>(of_ranks[static_cast<std::size_t>(rank)][1]);
  }
  // rows are those of all ranks from here on
  for (JoinedBody& body : bodies_) {
    body.first_row += first_row_;
  }
  Exchange neighbours(communicator);
  std::vector<std::size_t> slots;
  slots.reserve(structure_.shared_interfaces().size());
  for (const std::size_t i : structure_.shared_interfaces()) {
    slots.push_back(neighbours.add(structure_.interface(i).away.rank, 1));
  }
  neighbours.prepare(1);
  for (std::size_t n = 0; n < slots.size(); ++n) {
    const ActiveInterface& interface = structure_.interface(structure_.shared_interfaces()[n]);
    neighbours.outgoing(slots[n]).setConstant(
        static_cast<double>(first_row_ + interface.rows[interface.here()]));
  }
  neighbours.start().finish();
  std::vector<Index> away(structure_.interfaces().size(), -1);
  for (std::size_t n = 0; n < slots.size(); ++n) {
    away[structure_.shared_interfaces()[n]] =
        static_cast<Index>(neighbours.incoming(slots[n])(0, 0));
  }
  for (std::size_t n = 0; n < spoken_for_.size(); ++n) {
    for (Index& row : interfaces_[n].rows) {
      row = row < 0 ? away[spoken_for_[n]] : row + first_row_;
    }
  }
  std::vector<double> mine;
  communicator.together([&] { mine = packed(); });
  const std::vector<std::vector<double>> of_all = communicator.gather(mine);
  communicator.together([&] { unpack(of_all); });
}

std::vector<double> Joined::packed() const {
  Packer packer;
  packer.add(weights_.size());
  packer.add(weights_);
  packer.add(directions_);
  packer.add(scales_);
  packer.add(levers_);
  packer.add(static_cast<Index>(bodies_.size()));
  for (const JoinedBody& body : bodies_) {
    packer.add(body.first_row);
    packer.add(body.stiffest);
    packer.add(body.unloaded ? 1.0 : 0.0);
    packer.add(body.stiffness.rows());
    packer.add(body.stiffness);
    packer.add(body.traces.rows());
    packer.add(body.traces.nonZeros());
    for (Index row = 0; row < body.traces.rows(); ++row) {
      for (SparseRows::InnerIterator it(body.traces, row); it; ++it) {
        packer.add(row);
        packer.add(static_cast<Index>(it.col()));
        packer.add(it.value());
      }
    }
  }
  packer.add(static_cast<Index>(interfaces_.size()));
  for (const JoinedInterface& interface : interfaces_) {
    packer.add(interface.components);
    packer.add(interface.size);
    packer.add(static_cast<Index>(interface.rows.size()));
    for (const Index row : interface.rows) {
      packer.add(row);
    }
    packer.add(interface.weights);
    packer.add(interface.flexibility);
  }
  return packer.take();
}

void Joined::unpack(const std::vector<std::vector<double>>& of_ranks) {
  bodies_.clear();
  interfaces_.clear();
  std::vector<double> weights;
  std::vector<double> directions;
  std::vector<double> scales;
  std::vector<double> levers;
  for (const std::vector<double>& numbers : of_ranks) {
    Unpacker from(numbers);
    const Index rows = from.index();
    rows_of_ranks_.push_back(rows);
    active_of_ranks_.push_back(0);
    for (std::vector<double>* values : {&weights, &directions, &scales, &levers}) {
      const Vector own = from.list(rows);
      values->insert(values->end(), own.begin(), own.end());
    }
    for (Index left = from.index(); left > 0; --left) {
      JoinedBody body;
      body.first_row = from.index();
      body.stiffest = from.number();
      body.unloaded = from.number() > 0.5;
      const Index active = from.index();
      active_of_ranks_.back() += active;
      body.stiffness = from.table(active, active);
      const Index trace_rows = from.index();
      Triplets entries;
      for (Index entry = from.index(); entry > 0; --entry) {
        const auto row = static_cast<int>(from.index());
        const auto column = static_cast<int>(from.index());
        entries.emplace_back(row, column, from.number());
      }
      body.traces = SparseRows(trace_rows, active);
      body.traces.setFromTriplets(entries.begin(), entries.end());
      bodies_.push_back(std::move(body));
    }
    unknowns_of_ranks_.push_back(0);
    for (Index left = from.index(); left > 0; --left) {
      JoinedInterface interface;
      interface.components = from.index();
      interface.size = from.index();
      unknowns_of_ranks_.back() += interface.size;
      interface.rows.resize(static_cast<std::size_t>(from.index()));
      for (Index& row : interface.rows) {
        row = from.index();
      }
      interface.weights = from.list(interface.size);
      interface.flexibility = from.list(interface.size);
      interfaces_.push_back(std::move(interface));
    }
  }
  const auto total = static_cast<Index>(weights.size());
  weights_ = Eigen::Map<const Vector>(weights.data(), total);
  directions_ = Eigen::Map<const Vector>(directions.data(), total);
  scales_ = Eigen::Map<const Vector>(scales.data(), total);
  levers_ = Eigen::Map<const Vector>(levers.data(), total);
}

Matrix Joined::of_rows(ConstMatrixRef own) const {
  return structure_.communicator().stacked(own, rows_of_ranks_);
}

Matrix Joined::of_active(ConstMatrixRef own) const {
  return structure_.communicator().stacked(own, active_of_ranks_);
}

Matrix Joined::of_unknowns(const Matrix& own) const {
  const Communicator& communicator = structure_.communicator();
  if (communicator.alone()) {
    return own;
  }
  Matrix spoken(unknowns_of_ranks_[static_cast<std::size_t>(communicator.rank())], own.cols());
  Index first = 0;
  for (const std::size_t i : spoken_for_) {
    const ActiveInterface& interface = structure_.interface(i);
    spoken.middleRows(first, interface.size()) =
        own.middleRows(interface.first_unknown, interface.size());
    first += interface.size();
  }
  return communicator.stacked(spoken, unknowns_of_ranks_);
}

Matrix Joined::own_unknowns(ConstMatrixRef all) const {
  Matrix own(structure_.interface_unknowns(), all.cols());
  for (std::size_t i = 0; i < first_unknowns_.size(); ++i) {
    const ActiveInterface& interface = structure_.interface(i);
    own.middleRows(interface.first_unknown, interface.size()) =
        all.middleRows(first_unknowns_[i], interface.size());
  }
  return own;
}

Vector Joined::of_points(Vector flexibility) const {
  constexpr double least = 1e-2;
  // relative to what displacements are measured with: other than forces per area have units of their own
  Vector scales(flexibility.size());
  for (const JoinedInterface& interface : interfaces_) {
    for (Index i = 0; i < interface.size; i += interface.components) {
      auto point = flexibility.segment(interface.first_unknown + i, interface.components);
      point.setConstant(point.mean());
    }
    scales.segment(interface.first_unknown, interface.size) =
        scales_.segment(*std::ranges::max_element(interface.rows), interface.size);
  }
  const double mean = flexibility.size() > 0 ? flexibility.cwiseProduct(scales).mean() : 0.0;
  return flexibility.cwiseMax(least * mean * scales.cwiseInverse());
}

}  // namespace latin::substructure
