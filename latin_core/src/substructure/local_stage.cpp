#include "substructure/local_stage.hpp"

#include <algorithm>
#include <functional>
#include <utility>

#include "interface/built_in.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

using Block = Eigen::Map<Matrix>;

/// Columns of a block times a matrix most of which is zero.
void multiply(Eigen::Map<const Matrix> block, const SparseColumns& by, Block result) {
  result.setZero();
  for (Index column = 0; column < by.outerSize(); ++column) {
    for (SparseColumns::InnerIterator entry(by, column); entry; ++entry) {
      result.col(column) += entry.value() * block.col(entry.row());
    }
  }
}

enum class Way { forward, backward };

/// Columns of a block (rows, steps * c) times one matrix for all points, or one for each. Time steps run
/// fastest, so that one product on the (rows * steps, c) view transforms all of them.
Block transform(const LawColumns& group, Way way, const Block& block, Index components, Index steps,
                Workspace& work) {
  const auto times = [way](const auto& given, const stochastic::ColumnTransform& by, auto result) {
    if (way == Way::forward) {
      result.noalias() = given * by.forward;
    } else if (by.backward.size() > 0) {
      result.noalias() = given * by.backward;
    } else {
      result.noalias() = given * by.forward.transpose();
    }
  };
  const Matrix& first = group.transforms.front().forward;
  const Index from = way == Way::forward ? first.rows() : first.cols();
  const Index to = way == Way::forward ? first.cols() : first.rows();
  Block result = work.shaped(block.rows(), to * steps);
  if (group.transforms.size() == 1) {
    const Index rows = block.rows() * steps;
    const Eigen::Map<const Matrix> given(block.data(), rows, from);
    Block found(result.data(), rows, to);
    if (group.sparse_forward.size() > 0) {
      multiply(given, way == Way::forward ? group.sparse_forward : group.sparse_backward, found);
    } else {
      times(given, group.transforms.front(), found);
    }
    return result;
  }
  Matrix own(components, block.cols());
  Matrix product(components, result.cols());
  for (std::size_t point = 0; point < group.transforms.size(); ++point) {
    const Index row = components * static_cast<Index>(point);
    own = block.middleRows(row, components);
    times(Eigen::Map<const Matrix>(own.data(), components * steps, from), group.transforms[point],
          Block(product.data(), components * steps, to));
    result.middleRows(row, components) = product;
  }
  return result;
}

/// Rows of the components [begin, end) of all points, from one block into another.
void copy_components(const Block& from, const ActiveInterface& interface, Index begin, Index end,
                     Block& to) {
  // maps: an indexed view would allocate with Eigen 5
  using Strides = Eigen::Stride<Eigen::Dynamic, Eigen::Dynamic>;
  const Strides strides(to.rows(), interface.geometry.components);
  const Index points = interface.geometry.points;
  for (Index component = begin; component < end; ++component) {
    Eigen::Map<Matrix, 0, Strides>(to.data() + component, points, to.cols(), strides) =
        Eigen::Map<const Matrix, 0, Strides>(from.data() + component, points, from.cols(), strides);
  }
}

}  // namespace

void share_of_jump(const Structure& structure, const ActiveInterface& interface, std::size_t side,
                   ConstMatrixRef data, ConstMatrixRef traces, MatrixRef share) {
  const Index rows = interface.size();
  const Index first = interface.rows[side];
  // a / k = (f - k w) / k = s / k - 2 w
  share = structure.inverse_directions().segment(first, rows).asDiagonal() *
              data.middleRows(first, rows) -
          2.0 * traces.middleRows(first, rows);
}

LocalStage::LocalStage(Laws laws, Index columns)
    : laws_(std::move(laws)), columns_(columns), exchange_(laws_.structure().communicator()) {
  laws_.check_columns(columns);
  const Structure& structure = laws_.structure();
  for (const std::size_t i : structure.shared_interfaces()) {
    const ActiveInterface& interface = structure.interface(i);
    slots_.push_back(exchange_.add(interface.away.rank, interface.size()));
  }
  exchange_.prepare(columns);
  constexpr double per_row = 20.0;  // numbers that a law calculates with
  for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
    if (structure.interface(i).shared()) {
      continue;
    }
    const bool own = interface::built_in(*laws_.of(i).law);
    (own ? in_lanes_ : by_caller_).push_back(i);
    numbers_ += own ? per_row * static_cast<double>(structure.interface(i).size() * columns) : 0.0;
  }
  std::ranges::stable_sort(in_lanes_, std::greater<>(),
                           [&structure](std::size_t i) { return structure.interface(i).size(); });
  lanes_.grow(1);
}

Block LocalStage::free_jump(const ActiveInterface& interface, ConstMatrixRef data,
                            ConstMatrixRef traces, ConstMatrixRef away, Lane& own) const {
  const Structure& structure = laws_.structure();
  Block jump = own.jump.shaped(interface.size(), data.cols());
  for (std::size_t s = 0; s < interface.rows.size(); ++s) {
    const bool elsewhere = interface.shared() && s == interface.away.side;
    if (s == 0 && elsewhere) {
      jump = away;
    } else if (s == 0) {
      share_of_jump(structure, interface, s, data, traces, jump);
    } else if (elsewhere) {
      jump -= away;
    } else {
      Block share = own.share.shaped(jump.rows(), jump.cols());
      share_of_jump(structure, interface, s, data, traces, share);
      jump -= share;
    }
  }
  return jump;
}

Block LocalStage::ask(const ActiveInterface& interface, const interface::Law& law,
                      const Block& jump, const Vector& flexibility, Workspace& work) const {
  Block answer = work.shaped(jump.rows(), jump.cols());
  law.resolve({interface.geometry.components, jump, flexibility, laws_.steps(), interface.name()},
              answer);
  return answer;
}

Block LocalStage::resolve(std::size_t i, const Block& free_jump, const Vector& flexibility,
                          Lane& own) const {
  const ActiveInterface& interface = laws_.structure().interface(i);
  const ActiveLaw& active = laws_.of(i);
  if (!active.transformed()) {
    return ask(interface, *active.law, free_jump, flexibility, own.force);
  }
  const Index components = interface.geometry.components;
  const Index steps = laws_.steps();
  Block force = own.force.shaped(free_jump.rows(), free_jump.cols());
  for (std::size_t g = 0; g < active.group_laws.size(); ++g) {
    const LawColumns& group = (*active.groups)[g];
    const interface::Law& law = *active.group_laws[g];
    const auto in_samples = [&] {
      const Block samples =
          transform(group, Way::forward, free_jump, components, steps, own.samples);
      return transform(group, Way::backward,
                       ask(interface, law, samples, flexibility, own.sample_forces), components,
                       steps, own.back);
    };
    const Block back = group.transforms.empty()
                           ? ask(interface, law, free_jump, flexibility, own.back)
                           : in_samples();
    copy_components(back, interface, group.begin, group.end, force);
  }
  return force;
}

void LocalStage::apply(std::size_t i, ConstMatrixRef data, ConstMatrixRef traces,
                       ConstMatrixRef away, MatrixRef residual, Lane& own) const {
  const ActiveInterface& interface = laws_.structure().interface(i);
  const Index rows = interface.size();
  const Block force =
      resolve(i, free_jump(interface, data, traces, away, own), interface.flexibility, own);
  for (std::size_t s = 0; s < interface.rows.size(); ++s) {
    const Index first = interface.rows[s];
    if (first < 0) {
      continue;
    }
    const auto k = laws_.structure().directions().segment(first, rows);
    const double sign = s == 0 ? 2.0 : -2.0;
    // f^ + k w^ - s = 2 f^ - a - s = 2 (f^ - s + k w)
    residual.middleRows(first, rows) = sign * force - 2.0 * data.middleRows(first, rows) +
                                       2.0 * (k.asDiagonal() * traces.middleRows(first, rows));
  }
}

void LocalStage::apply(ConstMatrixRef data, ConstMatrixRef traces, MatrixRef residual) {
  const Structure& structure = laws_.structure();
  const auto& shared = structure.shared_interfaces();
  for (std::size_t n = 0; n < shared.size(); ++n) {
    const ActiveInterface& interface = structure.interface(shared[n]);
    share_of_jump(structure, interface, interface.here(), data, traces,
                  exchange_.outgoing(slots_[n]));
  }
  Exchange::Transit transit = exchange_.start();
  const Matrix none;
  // while messages are on their way
  for (const std::size_t i : by_caller_) {
    apply(i, data, traces, none, residual, caller());
  }
  in_lanes(in_lanes_.size(), numbers_, lanes_, [&](std::size_t piece, Lane& own) {
    apply(in_lanes_[piece], data, traces, none, residual, own);
  });
  transit.finish();
  for (std::size_t n = 0; n < shared.size(); ++n) {
    apply(shared[n], data, traces, exchange_.incoming(slots_[n]), residual, caller());
  }
}

Block LocalStage::force(std::size_t i, ConstMatrixRef data, ConstMatrixRef traces) {
  const ActiveInterface& interface = laws_.structure().interface(i);
  return resolve(i, free_jump(interface, data, traces, Matrix(), caller()), interface.flexibility,
                 caller());
}

void LocalStage::forces_of_jumps(ConstMatrixRef jumps, MatrixRef forces,
                                 const std::vector<bool>& asked) {
  const auto& interfaces = laws_.structure().interfaces();
  for (std::size_t i = 0; i < interfaces.size(); ++i) {
    if (!asked.empty() && !asked[i]) {
      continue;
    }
    const auto rows = Eigen::seqN(interfaces[i].first_unknown, interfaces[i].size());
    Block jump = caller().jump.shaped(interfaces[i].size(), jumps.cols());
    jump = jumps(rows, every);
    forces(rows, every) = resolve(i, jump, Vector::Zero(interfaces[i].size()), caller());
  }
}

LocalFields LocalStage::fields(std::size_t i, ConstMatrixRef data, ConstMatrixRef traces) {
  const Structure& structure = laws_.structure();
  const ActiveInterface& interface = structure.interface(i);
  Matrix away;
  if (interface.shared()) {
    Exchange once(structure.communicator());
    const std::size_t slot = once.add(interface.away.rank, interface.size());
    once.prepare(data.cols());
    share_of_jump(structure, interface, interface.here(), data, traces, once.outgoing(slot));
    once.start().finish();
    away = once.incoming(slot);
  }
  LocalFields fields;
  const Block jump = free_jump(interface, data, traces, away, caller());
  fields.force = resolve(i, jump, interface.flexibility, caller());
  fields.jump = jump - interface.flexibility.asDiagonal() * fields.force;
  return fields;
}

LocalFields resolve_samples(const Laws& laws, std::size_t i, ConstMatrixRef free_jump,
                            const std::vector<std::pair<std::string, Matrix>>& parameters) {
  const ActiveInterface& interface = laws.structure().interface(i);
  const auto fail = [&interface](const std::string& text) {
    throw InputError("interface '" + interface.name() + "': " + text);
  };
  if (free_jump.rows() != interface.size()) {
    fail("a free jump of " + std::to_string(free_jump.rows()) + " rows, expected " +
         std::to_string(interface.size()));
  }
  const std::unique_ptr<interface::Law> law = laws.of(i).law->copy();
  for (const auto& [name, values] : parameters) {
    try {
      law->set(name, interface::ParameterField(values));
    } catch (const InputError& error) {
      fail(error.what());
    }
  }
  for (const auto& info : law->parameters()) {
    const Matrix& values = law->get(info.name).values();
    const Index rows = info.shape == interface::Law::Shape::per_point ? interface.geometry.points
                                                                      : free_jump.rows();
    if ((values.rows() != 1 && values.rows() != rows) ||
        (values.cols() != 1 && values.cols() != free_jump.cols())) {
      fail("parameter '" + info.name + "' is " + std::to_string(values.rows()) + " x " +
           std::to_string(values.cols()) + ", expected " + std::to_string(rows) + " x " +
           std::to_string(free_jump.cols()));
    }
  }
  if (free_jump.cols() % laws.steps() != 0) {
    fail(std::to_string(free_jump.cols()) + " columns are no whole number of histories of " +
         std::to_string(laws.steps()) + " time steps");
  }
  LocalFields fields;
  fields.force.resize(free_jump.rows(), free_jump.cols());
  law->resolve({interface.geometry.components, free_jump, interface.flexibility, laws.steps(),
                interface.name()},
               fields.force);
  fields.jump = free_jump - interface.flexibility.asDiagonal() * fields.force;
  return fields;
}

}  // namespace latin::substructure
