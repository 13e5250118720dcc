#include "substructure/seen_forces.hpp"

#include <Eigen/IterativeLinearSolvers>
#include <algorithm>
#include <cmath>
#include <iterator>

#include "algebra/sparse_product.hpp"
#include "substructure/structure.hpp"

namespace latin::substructure {
namespace {

/// Of the numbers of a trace and of forces.
constexpr double rounding = 1e-14;
/// Steps to a projection: with a mass matrix they are 20 to 60. More are needed where two meshes see nearly the same, and
/// then nothing is left out.
constexpr Index most_steps = 200;

SparseRows trace_of(const Structure& structure, Index row, Index rows) {
  const std::size_t b = structure.body_of_row(row);
  return structure.bodies()[b].trace_of_side(row - structure.body_rows()[b], rows).trace;
}

/// Both sides beside each other, without what frames leave of a component that is none: it would be a displacement.
SparseRows beside(const std::vector<SparseRows>& sides, Index rows) {
  Triplets entries;
  Index first = 0;
  for (const SparseRows& side : sides) {
    const double least = side.nonZeros() > 0 ? rounding * side.coeffs().abs().maxCoeff() : 0.0;
    for (Index row = 0; row < rows; ++row) {
      for (SparseRows::InnerIterator it(side, row); it; ++it) {
        if (std::abs(it.value()) > least) {
          entries.emplace_back(static_cast<int>(row), static_cast<int>(first + it.col()),
                               it.value());
        }
      }
    }
    first += side.cols();
  }
  return algebra::sparse_of(entries, rows, first, "the traces of a face");
}

}  // namespace

SeenForces::SeenForces(const Structure& structure) {
  const auto prescribes = [&](std::size_t i) {
    return structure.interface(i).geometry.law->prescribes_jumps();
  };
  std::vector<std::size_t> shared;
  std::ranges::copy_if(structure.shared_interfaces(), std::back_inserter(shared), prescribes);
  std::vector<std::vector<double>> own(shared.size());
  structure.communicator().together([&] {
    for (std::size_t n = 0; n < shared.size(); ++n) {
      const ActiveInterface& interface = structure.interface(shared[n]);
      algebra::append(trace_of(structure, interface.rows[interface.here()], interface.size()),
                      own[n]);
    }
  });
  const std::vector<std::vector<double>> beyond = structure.swapped(shared, own);
  for (std::size_t i = 0; i < structure.interfaces().size(); ++i) {
    if (!prescribes(i)) {
      continue;
    }
    const ActiveInterface& interface = structure.interface(i);
    Face face;
    std::vector<SparseRows> sides;
    for (const Index row : interface.rows) {
      if (row >= 0) {
        face.rows.push_back(row);
        sides.push_back(trace_of(structure, row, interface.size()));
      } else {
        const double* next =
            beyond[static_cast<std::size_t>(std::ranges::find(shared, i) - shared.begin())].data();
        sides.push_back(algebra::take(next));
      }
    }
    face.directions = structure.directions().segment(face.rows.front(), interface.size());
    face.roots = structure.weights().segment(face.rows.front(), interface.size()).cwiseSqrt();
    face.traces = face.roots.asDiagonal() * beside(sides, interface.size());
    if (face.traces.cols() > 0) {  // else it is held entirely
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
    const double size_of_traces = face.traces.norm();
    for (Index column = 0; column < data.cols(); ++column) {
      const Vector force = face.roots.cwiseProduct(
          data.col(column).segment(face.rows.front(), size) -
          face.directions.cwiseProduct(traces.col(column).segment(face.rows.front(), size)));
      const double seen = (face.traces.transpose() * force).norm();
      const double unseen = rounding * size_of_traces * force.norm();
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
