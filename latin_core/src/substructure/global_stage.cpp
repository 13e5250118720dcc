#include "substructure/global_stage.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>

namespace latin::substructure {
namespace {

/// Numbers that a body reads for one column.
double numbers_of(const Body& body) {
  const auto active = static_cast<double>(body.active());
  const double factor = body.condensed() ? active * active : 2.0 * body.cost().factor_numbers;
  return factor + static_cast<double>(body.rows());
}

}  // namespace

GlobalStage::GlobalStage(Laws laws) : laws_(std::move(laws)) {
  const std::vector<Body>& bodies = laws_.structure().bodies();
  std::vector<double> numbers(bodies.size());
  std::ranges::transform(bodies, numbers.begin(), numbers_of);
  numbers_ = std::accumulate(numbers.begin(), numbers.end(), 0.0);
  largest_first_.resize(bodies.size());
  std::iota(largest_first_.begin(), largest_first_.end(), std::size_t{0});
  std::ranges::stable_sort(largest_first_, std::greater<>(),
                           [&numbers](std::size_t b) { return numbers[b]; });
}

template <class Work>
void GlobalStage::of_bodies(double numbers, const Work& work) {
  in_lanes(largest_first_.size(), numbers, lanes_,
           [&](std::size_t piece, Lane& own) { work(largest_first_[piece], own); });
}

void GlobalStage::apply(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces) {
  const Structure& structure = laws_.structure();
  of_bodies(numbers(data.cols()), [&](std::size_t b, Lane& own) {
    const Index row = structure.body_rows()[b];
    const Index rows = structure.bodies()[b].rows();
    apply(b, data.middleRows(row, rows), amplitudes, traces.middleRows(row, rows), own.work);
  });
}

void GlobalStage::apply(std::size_t b, ConstMatrixRef data, ConstMatrixRef amplitudes,
                        MatrixRef traces, BodyWork& work) {
  if (laws_.scaled(b) != nullptr) {
    apply_scaled(b, data, amplitudes, traces, work);
  } else if (laws_.field(b) != nullptr) {
    apply_field(b, data, amplitudes, traces, work);
  } else {
    laws_.structure().bodies()[b].apply(data, traces, work);
    traces.noalias() += laws_.response(b).traces * amplitudes;
  }
}

void GlobalStage::apply_scaled(std::size_t b, ConstMatrixRef data, ConstMatrixRef amplitudes,
                               MatrixRef traces, BodyWork& work) {
  const ScaledColumns& scaled = *laws_.scaled(b);
  const Vector factors = scaled.each(data.cols());
  if (!scaled.transformed()) {
    scaled.body->apply(data, amplitudes, factors, traces, work);
    return;
  }
  Matrix moved(traces.rows(), traces.cols());
  scaled.body->apply(scaled.into(data), scaled.into(amplitudes), factors, moved, work);
  traces = scaled.back(moved);
}

void GlobalStage::apply_field(std::size_t b, ConstMatrixRef data, ConstMatrixRef amplitudes,
                              MatrixRef traces, BodyWork& work) {
  const FieldColumns& field = *laws_.field(b);
  if (field.chaos != nullptr) {
    field.chaos->apply(data, amplitudes, traces, of_fields_);
    return;
  }
  if (field.body != nullptr) {
    field.body->apply(data, traces, work);
    traces.noalias() += field.response.traces * amplitudes;
    return;
  }
  const Index count = data.cols() / field.blocks();
  for (Index k = 0; k < field.blocks(); ++k) {
    const std::shared_ptr<const Body> sample = field.sample(laws_.structure().bodies()[b], k);
    auto of_sample = traces.middleCols(k * count, count);
    sample->apply(data.middleCols(k * count, count), of_sample, work);
    of_sample.noalias() +=
        sample->response_to_extra(field.extra).traces * amplitudes.middleCols(k * count, count);
  }
}

Vector GlobalStage::energies_of_field(std::size_t b, ConstMatrixRef data, ConstMatrixRef traces,
                                      ConstMatrixRef forces, ConstMatrixRef amplitudes,
                                      BodyWork& work) {
  const FieldColumns& field = *laws_.field(b);
  if (field.chaos != nullptr) {
    return field.chaos->energies(data, amplitudes, of_fields_);
  }
  return field.body->energies(data, traces, forces, amplitudes, field.response, work);
}

void GlobalStage::change(ConstMatrixRef change, MatrixRef traces) {
  const Structure& structure = laws_.structure();
  of_bodies(numbers(change.cols()), [&](std::size_t b, Lane& own) {
    const Index row = structure.body_rows()[b];
    const Index rows = structure.bodies()[b].rows();
    this->change(b, change.middleRows(row, rows), traces.middleRows(row, rows), own);
  });
}

void GlobalStage::change(std::size_t b, ConstMatrixRef change, MatrixRef traces, Lane& own) {
  Eigen::Map<Matrix> added = own.block.shaped(change.rows(), change.cols());
  if (const ScaledColumns* scaled = laws_.scaled(b)) {
    scaled->body->change(scaled->into(change), scaled->each(change.cols()), added, own.work);
    traces += scaled->back(added);
    return;
  }
  const FieldColumns* field = laws_.field(b);
  if (field != nullptr && field->chaos != nullptr) {
    field->chaos->change(change, added);
  } else if (field != nullptr) {
    field->body->apply_single(change, added, own.work);
  } else {
    laws_.structure().bodies()[b].apply_single(change, added, own.work);
  }
  traces += added;
}

Matrix GlobalStage::imbalance(LocalStage& local, ConstMatrixRef data, ConstMatrixRef traces) {
  const Structure& structure = laws_.structure();
  Matrix forces = data - structure.directions().asDiagonal() * traces;
  for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
    const ActiveInterface& interface = structure.interface(i);
    if (interface.basis.size() > 0 && interface.rows.size() == 1) {
      forces.middleRows(interface.rows.front(), interface.size()) -= local.force(i, data, traces);
    }
  }
  return structure.macro().imbalance(forces);
}

Matrix GlobalStage::balance(const Matrix& imbalance, ConstMatrixRef amplitudes, MatrixRef data,
                            MatrixRef traces) {
  const Structure& structure = laws_.structure();
  Matrix added = structure.macro().correct(imbalance, data, traces);
  // the coarse problem has the stiffnesses without factors
  for (std::size_t b = 0; b < structure.bodies().size(); ++b) {
    const Index first = structure.body_rows()[b];
    const Index rows = structure.bodies()[b].rows();
    if (laws_.scaled(b) != nullptr || laws_.field(b) != nullptr) {
      lanes_.grow(1);
      apply(b, data.middleRows(first, rows), amplitudes, traces.middleRows(first, rows),
            lanes_[0].work);
    }
  }
  return added;
}

/// sum of F^2 / K, (c), with the forces F on the nodes of the sides and their own stiffness: a bolt that presses its
/// own joint together holds nothing. Loads are counted only where they take forces away.
Vector GlobalStage::pressed_energies(std::size_t b, ConstMatrixRef forces,
                                     ConstMatrixRef amplitudes, BodyWork& work) {
  const Body& body = laws_.structure().bodies()[b];
  const Vector& stiffness = body.active_stiffness();
  // a node alone is stiffer than the body as a whole, by the number of nodes side by side
  const double whole = 2.0 * std::sqrt(static_cast<double>(body.active()));
  const Vector compliance = (stiffness.array() > 0.0).select(whole * stiffness.cwiseInverse(), 0.0);
  Eigen::Map<Matrix> net = work.unknowns.shaped(body.active(), forces.cols());
  body.gather(forces, net);
  Vector energies = compliance.transpose() * net.cwiseAbs2();
  // rows on nodes that are held move no unknown
  Vector of_held = Vector::Zero(body.rows());
  const Vector metric =
      laws_.structure().trace_metric().segment(laws_.structure().body_rows()[b], body.rows());
  for (Index row = 0; row < body.rows(); ++row) {
    if (body.active_traces().innerVector(row).nonZeros() == 0 && metric(row) > 0.0) {
      of_held(row) = body.weights()(row) * body.weights()(row) / metric(row);
    }
  }
  const Vector held = of_held.transpose() * forces.cwiseAbs2();
  if (body.loads() > 0) {
    net.noalias() += body.active_patterns() * amplitudes;
    const Matrix& extra = laws_.response(b).extra;
    if (extra.size() > 0) {
      net.noalias() += extra.bottomRows(body.active()) * amplitudes;
    }
    energies = energies.cwiseMin((compliance.transpose() * net.cwiseAbs2()).transpose());
    if (body.jump_patterns().size() > 0) {
      // a contact bears what springs in the body pull beside it
      net.noalias() += body.jump_patterns() * amplitudes;
      energies = energies.cwiseMin((compliance.transpose() * net.cwiseAbs2()).transpose());
    }
  }
  return energies + held;
}

Sizes GlobalStage::sizes(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef amplitudes) {
  const Structure& structure = laws_.structure();
  const PatternTimes* in_time = laws_.in_time();
  ColumnGroups groups = laws_.measured();
  Matrix of_sums;
  if (in_time != nullptr) {
    groups.steps = in_time->sums().cols();
    of_sums = summed(amplitudes, in_time->sums());
  }
  constexpr double per_row = 10.0;  // numbers that are calculated with
  const Index columns = in_time == nullptr ? data.cols() : of_sums.cols();
  Sizes sizes = Sizes::zero(groups.count(columns), static_cast<Index>(structure.bodies().size()));
  of_bodies(per_row * static_cast<double>(data.size()), [&](std::size_t b, Lane& own) {
    const Index first = structure.body_rows()[b];
    const Index rows = structure.bodies()[b].rows();
    const auto s = data.middleRows(first, rows);
    const auto w = traces.middleRows(first, rows);
    if (in_time == nullptr) {
      add_sizes(b, s, w, amplitudes, groups, sizes, own);
    } else {
      add_sizes(b, summed(s, in_time->sums()), summed(w, in_time->sums()), of_sums, groups, sizes,
                own);
    }
  });
  sizes.strain = sizes.strain.cwiseAbs();
  return in_time == nullptr ? sizes : in_time->at_times(sizes, groups.kinds());
}

void GlobalStage::add_sizes(std::size_t b, ConstMatrixRef data, ConstMatrixRef traces,
                            ConstMatrixRef amplitudes, const ColumnGroups& groups, Sizes& sizes,
                            Lane& own) {
  const Structure& structure = laws_.structure();
  const Body& body = structure.bodies()[b];
  Eigen::Map<Matrix> f = own.block.shaped(traces.rows(), traces.cols());
  f = data - body.directions().asDiagonal() * traces;
  const ScaledColumns* scaled = laws_.scaled(b);
  const auto of_body = [&] {
    if (!structure.carried(b) || laws_.response(b).extra.size() > 0) {
      return body.energies(data, traces, f, amplitudes, laws_.response(b), own.work);
    }
    Vector energies(traces.cols());
    for (Index column = 0; column < traces.cols(); ++column) {
      energies(column) = structure.straining(b, traces.col(column))
                             .cwiseProduct(body.weights())
                             .dot(f.col(column));
    }
    return energies;
  };
  const Vector energies =
      scaled != nullptr
          ? scaled->body->energies(scaled->into(data), scaled->into(traces),
                                   scaled->into(amplitudes), scaled->each(traces.cols()))
      : laws_.field(b) != nullptr ? energies_of_field(b, data, traces, f, amplitudes, own.work)
                                  : of_body();
  const Vector pressed = pressed_energies(b, f, amplitudes, own.work);
  const auto at = static_cast<Index>(b);
  for (Index column = 0; column < traces.cols(); ++column) {
    const Index group = groups.of(column);
    sizes.strain(group, at) += energies(column);
    sizes.trace(group, at) += structure.trace_size(b, traces.col(column));
    sizes.work(group, at) +=
        traces.col(column).cwiseProduct(f.col(column)).cwiseAbs().dot(body.weights());
    sizes.pressed(group, at) += pressed(column);
  }
}

std::vector<Matrix> GlobalStage::displacements(std::size_t body, ConstMatrixRef data,
                                               ConstMatrixRef amplitudes, Lane& own) {
  const Structure& structure = laws_.structure();
  const Body& mean = structure.bodies()[body];
  const auto of_sides = data.middleRows(structure.body_rows()[body], mean.rows());
  if (const ScaledColumns* scaled = laws_.scaled(body)) {
    Matrix traces(mean.rows(), data.cols());
    apply_scaled(body, of_sides, amplitudes, traces, own.work);
    std::vector<Matrix> found =
        scaled->body->displacements(scaled->into(of_sides), scaled->into(traces),
                                    scaled->into(amplitudes), scaled->each(data.cols()));
    for (Matrix& field : found) {
      field = scaled->back(field);
    }
    return found;
  }
  if (const FieldColumns* field = laws_.field(body)) {
    return field->displacements(mean, of_sides, amplitudes);
  }
  return mean.displacements(of_sides, amplitudes, laws_.response(body));
}

std::vector<Matrix> displacements_of(const Laws& laws, std::size_t body, ConstMatrixRef data,
                                     ConstMatrixRef amplitudes) {
  GlobalStage global(laws);
  GlobalStage::Lane own;
  return global.displacements(body, data, amplitudes, own);
}

std::vector<std::pair<std::string, Matrix>> displacements(const Laws& laws, ConstMatrixRef data,
                                                          ConstMatrixRef amplitudes) {
  const Structure& structure = laws.structure();
  GlobalStage global(laws);
  std::vector<std::vector<Matrix>> of_bodies(structure.bodies().size());
  global.of_bodies(global.numbers(data.cols()), [&](std::size_t b, GlobalStage::Lane& own) {
    of_bodies[b] = global.displacements(b, data, amplitudes, own);
  });
  std::vector<std::pair<std::string, Matrix>> fields;
  for (std::size_t b = 0; b < of_bodies.size(); ++b) {
    for (std::size_t e = 0; e < of_bodies[b].size(); ++e) {
      fields.emplace_back(structure.members()[b][e], std::move(of_bodies[b][e]));
    }
  }
  return fields;
}

}  // namespace latin::substructure
