#include "latin/substructure/seen_forces.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <algorithm>
#include <map>

#include "latin/algebra/sparse_product.hpp"
#include "latin/substructure/structure.hpp"

namespace latin::substructure {
namespace {

/// Of the numbers of a trace and of forces.
constexpr double rounding = 1e-14;
/// Steps to a projection: with a mass matrix they are 20 to 60. More are needed where two meshes see nearly the same, and
/// then nothing is left out.
constexpr Index most_steps = 200;
constexpr const char* what = "the traces of a face";

void append(const SparseRows& traces, Index first, Triplets& entries) {
  for (Index row = 0; row < traces.outerSize(); ++row) {
    for (SparseRows::InnerIterator it(traces, row); it; ++it) {
      entries.emplace_back(static_cast<int>(row), static_cast<int>(first + it.col()), it.value());
    }
  }
}

/// T of one side of a face, (size, displacements that are not zero on it).
SparseRows side_of(const Structure& structure, std::size_t interface, std::size_t side) {
  const ActiveInterface& of = structure.interface(interface);
  const std::vector<Index>& firsts = structure.body_rows();
  const Index first = of.rows[side];
  auto b = static_cast<std::size_t>(std::ranges::upper_bound(firsts, first) - firsts.begin()) - 1;
  while (structure.bodies()[b].rows() == 0) {
    --b;
  }
  const SparseRows& all = structure.bodies()[b].active_traces();
  const SparseRows rows = all.middleRows(first - firsts[b], of.size());
  // what frames leave of a component that is none would be a displacement of its own
  const double least = rows.nonZeros() > 0 ? rounding * rows.coeffs().abs().maxCoeff() : 0.0;
  std::map<Index, int> numbers;
  Triplets entries;
  for (Index row = 0; row < of.size(); ++row) {
    for (SparseRows::InnerIterator it(rows, row); it; ++it) {
      if (std::abs(it.value()) <= least) {
        continue;
      }
      const int number =
          numbers.try_emplace(it.col(), static_cast<int>(numbers.size())).first->second;
      entries.emplace_back(static_cast<int>(row), number, it.value());
    }
  }
  return algebra::sparse_of(entries, of.size(), static_cast<Index>(numbers.size()), what);
}

/// Of every interface the side on another rank, which both swap.
std::vector<SparseRows> sides_elsewhere(const Structure& structure) {
  std::vector<SparseRows> sides(structure.interfaces().size());
  const Communicator& communicator = structure.communicator();
  if (communicator.alone()) {
    return sides;
  }
  std::vector<double> mine;
  communicator.together([&] {
    for (const std::size_t i : structure.shared_interfaces()) {
      const ActiveInterface& interface = structure.interface(i);
      const SparseRows own = side_of(structure, i, interface.here());
      mine.insert(mine.end(),
                  {static_cast<double>(interface.away.rank), static_cast<double>(own.nonZeros()),
                   static_cast<double>(own.cols())});
      for (Index row = 0; row < own.outerSize(); ++row) {
        for (SparseRows::InnerIterator it(own, row); it; ++it) {
          mine.insert(mine.end(),
                      {static_cast<double>(row), static_cast<double>(it.col()), it.value()});
        }
      }
    }
  });
  const std::vector<std::vector<double>> all = communicator.gather(mine);
  std::vector<const double*> next;
  std::ranges::transform(all, std::back_inserter(next), [](const auto& of) { return of.data(); });
  for (const std::size_t i : structure.shared_interfaces()) {
    const ActiveInterface& interface = structure.interface(i);
    const double*& from = next[static_cast<std::size_t>(interface.away.rank)];
    while (static_cast<int>(from[0]) != communicator.rank()) {
      from += 3 + 3 * static_cast<std::ptrdiff_t>(from[1]);
    }
    Triplets entries;
    const auto columns = static_cast<Index>(from[2]);
    const double* end = from + 3 + 3 * static_cast<std::ptrdiff_t>(from[1]);
    for (from += 3; from != end; from += 3) {
      entries.emplace_back(static_cast<int>(from[0]), static_cast<int>(from[1]), from[2]);
    }
    sides[i] = algebra::sparse_of(entries, interface.size(), columns, what);
  }
  return sides;
}

}  // namespace

SeenForces::SeenForces(const Structure& structure) {
  const std::vector<SparseRows> elsewhere = sides_elsewhere(structure);
  for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
    const ActiveInterface& interface = structure.interface(i);
    if (!interface.geometry.law->prescribes_jumps()) {
      continue;
    }
    Face face;
    Triplets entries;
    Index columns = 0;
    for (std::size_t s = 0; s < interface.rows.size(); ++s) {
      const bool here = interface.rows[s] >= 0;
      if (here) {
        face.rows.push_back(interface.rows[s]);
      }
      const SparseRows traces = here ? side_of(structure, i, s) : elsewhere[i];
      append(traces, columns, entries);
      columns += traces.cols();
    }
    if (columns > 0) {
      face.directions = structure.directions().segment(face.rows.front(), interface.size());
      face.roots = structure.weights().segment(face.rows.front(), interface.size()).cwiseSqrt();
      face.traces =
          face.roots.asDiagonal() * algebra::sparse_of(entries, interface.size(), columns, what);
      faces_.push_back(std::move(face));
    }
  }
}

void SeenForces::keep(MatrixRef data, ConstMatrixRef traces) const {
  for (const Face& face : faces_) {
    const Index size = face.roots.size();
    Eigen::LeastSquaresConjugateGradient<SparseRows> projection;
    projection.setMaxIterations(most_steps);
    projection.compute(face.traces);
    const SparseRows sizes = face.traces.cwiseAbs();
    for (Index column = 0; column < data.cols(); ++column) {
      const Vector force = face.roots.cwiseProduct(
          data.col(column).segment(face.rows.front(), size) -
          face.directions.cwiseProduct(traces.col(column).segment(face.rows.front(), size)));
      const double seen = (face.traces.transpose() * force).norm();
      const double unseen = rounding * (sizes.transpose() * force.cwiseAbs()).norm();
      Vector left = force;
      if (seen > unseen) {
        projection.setTolerance(unseen / seen);
        left -= face.traces * projection.solve(force);
        if (projection.info() != Eigen::Success) {
          continue;
        }
      }
      left = left.cwiseQuotient(face.roots);
      for (const Index first : face.rows) {
        data.col(column).segment(first, size) -= left;
        left = -left;
      }
    }
  }
}

}  // namespace latin::substructure
