#include "latin/latin/newton.hpp"

#include <cmath>

#include "latin/latin/flexibility.hpp"

namespace latin {
namespace {

/// Tangents closer than this are the same: they come from differences.
constexpr double same_tangent = 1e-6;

}  // namespace

bool Newton::step(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef residual,
                  double softening, MatrixRef step) {
  const Flexibility& flexibility = problem_.flexibility();
  const Tangents tangents = problem_.tangents(data, traces);
  const Index columns = data.cols();
  const Index steps = problem_.steps();
  const Index unknowns = flexibility.unknowns();
  constexpr double with_mu = 1.0 + 2.0 * Flexibility::mu;
  zones_.resize(static_cast<std::size_t>(columns));

  // P ds = b + M y,  M = 2 E^T k^-1 E - (1 + 2 mu) E^T k^-1 N^-1 E
  const Matrix half = flexibility.solve(0.5 * residual);
  const Matrix b = flexibility.jump(residual) - with_mu * flexibility.jump(half);
  const auto times_m = [&](const Vector& y) -> Vector {
    return 2.0 * flexibility.direct().cwiseProduct(y) - with_mu * (flexibility.matrix() * y);
  };
  const double share = 1.0 - softening;

  Matrix y = Matrix::Zero(unknowns, columns);
  Matrix jumps(unknowns, columns);  // P ds
  for (Index column = 0; column < columns; ++column) {
    const auto c = static_cast<std::size_t>(column);
    const std::vector<Matrix>& of_column = tangents.blocks[c];
    for (Index lag = 1; lag <= column % steps; ++lag) {
      y.col(column) += share * tangents.times(of_column[static_cast<std::size_t>(lag)],
                                              jumps.col(column - lag));
    }
    // y = R' (b + M y) + what the earlier steps left: solved where R' is not zero
    Vector free = b.col(column);
    if (y.col(column).squaredNorm() > 0.0) {
      free += times_m(y.col(column));
    }
    const Matrix& tangent = of_column.front();
    std::vector<Index> rows;
    for (Index unknown = 0; unknown < unknowns; ++unknown) {
      if ((tangent.row(unknown).array() != 0.0).any()) {
        rows.push_back(unknown);
      }
    }
    if (!rows.empty()) {
      Zone& zone = zones_[c];
      if (zone.rows != rows || zone.softening != softening ||
          (zone.tangent - tangent).cwiseAbs().maxCoeff() >
              same_tangent * tangent.cwiseAbs().maxCoeff()) {
        const auto size = static_cast<Index>(rows.size());
        std::vector<Index> position(static_cast<std::size_t>(unknowns), -1);
        for (Index i = 0; i < size; ++i) {
          position[static_cast<std::size_t>(rows[static_cast<std::size_t>(i)])] = i;
        }
        Matrix m = -with_mu * flexibility.matrix()(rows, rows);
        m.diagonal() += 2.0 * flexibility.direct()(rows);
        Matrix system = Matrix::Identity(size, size);
        for (Index i = 0; i < size; ++i) {
          const Index row = rows[static_cast<std::size_t>(i)];
          const Index first = tangents.first[static_cast<std::size_t>(row)];
          for (Index a = 0; a < tangents.components[static_cast<std::size_t>(row)]; ++a) {
            const Index other = position[static_cast<std::size_t>(first + a)];
            if (other >= 0) {
              system.row(i) -= share * tangent(row, a) * m.row(other);
            } else if (tangent(row, a) != 0.0) {
              // a component without a tangent of its own still moves the others
              system.row(i) -= share * tangent(row, a) *
                               (-with_mu * flexibility.matrix()(first + a, rows));
            }
          }
        }
        zone.lu.compute(system);
        zone.rows = rows;
        zone.tangent = tangent;
        zone.softening = softening;
      }
      const Vector right = share * tangents.times(tangent, free);
      const Vector change = zone.lu.solve(right(rows));
      for (std::size_t i = 0; i < rows.size(); ++i) {
        y(rows[i], column) += change(static_cast<Index>(i));
      }
    }
    if (steps > 1) {
      jumps.col(column) = b.col(column) + times_m(y.col(column));
    }
  }
  step = half + flexibility.solve(flexibility.spread(y));
  return step.allFinite();
}

}  // namespace latin
