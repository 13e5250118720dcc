#include "latin/latin/newton.hpp"

#include <algorithm>

#include "latin/latin/flexibility.hpp"

namespace latin {
namespace {

/// Tangents closer than this are the same: they come from differences.
constexpr double same_tangent = 1e-6;
constexpr double with_mu = 1.0 + 2.0 * Flexibility::mu;

/// M y,  M = 2 E^T k^-1 E - (1 + 2 mu) E^T k^-1 N+ E
Vector times_m(const Flexibility& flexibility, const Vector& y) {
  return 2.0 * flexibility.direct().cwiseProduct(y) - with_mu * (flexibility.matrix() * y);
}

}  // namespace

bool Newton::step(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef residual,
                  double softening, bool settled, MatrixRef step) {
  const Flexibility& flexibility = problem_.flexibility();
  const Tangents tangents = problem_.tangents(data, traces);
  const Index columns = data.cols();
  const Index steps = problem_.steps();
  const Index unknowns = flexibility.unknowns();
  const Index modes = flexibility.modal_stiffness().size();
  zones_.resize(static_cast<std::size_t>(columns));

  // P ds = b + M y - g E^T V a, theta a = V^T W (r / 2 + E y)
  const Matrix half = flexibility.solve(0.5 * residual);
  const Matrix b = flexibility.jump(residual) - with_mu * flexibility.jump(half);
  const Matrix modal = flexibility.modal_loads(0.5 * residual);

  Matrix y = Matrix::Zero(unknowns, columns);
  Matrix amplitudes(modes, columns);
  Matrix jumps(unknowns, columns);  // P ds
  for (Index column = 0; column < columns; ++column) {
    const std::vector<Matrix>& of_column = tangents.blocks[static_cast<std::size_t>(column)];
    // what the earlier steps of the history do to the forces of this one
    Vector given = Vector::Zero(unknowns);
    for (Index lag = 1; lag <= column % steps; ++lag) {
      given += (1.0 - softening) * tangents.times(of_column[static_cast<std::size_t>(lag)],
                                                  jumps.col(column - lag));
    }
    Vector free = b.col(column);
    Vector loads = modal.col(column);
    if (!given.isZero(0.0)) {
      free += times_m(flexibility, given);
      loads += flexibility.modal_loads(flexibility.spread(given));
    }
    const Matrix& tangent = of_column.front();
    Zone& zone = zones_[static_cast<std::size_t>(column)];
    if (!zone.fits(tangent, softening)) {
      factorise(tangents, tangent, softening, zone);
    }
    const auto closed = static_cast<Index>(zone.rows.size());
    Vector right(closed + modes);
    right << ((1.0 - softening) * tangents.times(tangent, free))(zone.rows), loads;
    Vector answer = right.size() > 0 ? zone.lu.solve(right) : right;
    if (settled && closed > 0) {
      // forces that move nothing were divided by the softening alone, rounding and all: with K the system
      // without it, K_eps^-1 K leaves them out and everything else as it is
      Vector forces = Vector::Zero(unknowns);
      forces(zone.rows) = answer.head(closed);
      const Vector moved = times_m(flexibility, forces) -
                           with_mu / (1.0 + Flexibility::mu) *
                               (flexibility.modal_jumps() * answer.tail(modes));
      right.head(closed) -= softening * tangents.times(tangent, moved)(zone.rows);
      answer = zone.lu.solve(right);
    }
    y.col(column) = given;
    y(zone.rows, column) += answer.head(closed);
    amplitudes.col(column) = answer.tail(modes);
    jumps.col(column) = b.col(column) + times_m(flexibility, y.col(column)) -
                        with_mu / (1.0 + Flexibility::mu) *
                            (flexibility.modal_jumps() * amplitudes.col(column));
  }
  step = half + flexibility.solve(flexibility.spread(y)) + flexibility.modal_data(amplitudes);
  return step.allFinite();
}

bool Newton::Zone::fits(const Matrix& now, double softened) const {
  return tangent.size() == now.size() && softening == softened &&
         (tangent - now).cwiseAbs().maxCoeff() <= same_tangent * now.cwiseAbs().maxCoeff();
}

void Newton::factorise(const Tangents& tangents, const Matrix& tangent, double softening,
                       Zone& zone) const {
  const Flexibility& flexibility = problem_.flexibility();
  zone.tangent = tangent;
  zone.softening = softening;
  zone.rows.clear();
  for (Index unknown = 0; unknown < tangent.rows(); ++unknown) {
    if ((tangent.row(unknown).array() != 0.0).any()) {
      zone.rows.push_back(unknown);
    }
  }
  const auto closed = static_cast<Index>(zone.rows.size());
  const Index modes = flexibility.modal_stiffness().size();
  const Matrix& jumps = flexibility.modal_jumps();
  Matrix system = Matrix::Zero(closed + modes, closed + modes);
  for (Index i = 0; i < closed; ++i) {
    const Index row = zone.rows[static_cast<std::size_t>(i)];
    const Index first = tangents.first[static_cast<std::size_t>(row)];
    for (Index a = 0; a < tangents.components[static_cast<std::size_t>(row)]; ++a) {
      const double slope = (1.0 - softening) * tangent(row, a);
      if (slope != 0.0) {
        system.row(i).head(closed) += slope * with_mu * flexibility.matrix()(first + a, zone.rows);
        system.row(i).tail(modes) += slope * with_mu / (1.0 + Flexibility::mu) * jumps.row(first + a);
        const auto own = std::ranges::lower_bound(zone.rows, first + a);
        if (own != zone.rows.end() && *own == first + a) {
          system(i, own - zone.rows.begin()) -= slope * 2.0 * flexibility.direct()(first + a);
        }
      }
    }
    system(i, i) += 1.0;
  }
  if (modes > 0) {
    // V^T W E for the closed unknowns
    Matrix unit = Matrix::Zero(tangent.rows(), closed);
    for (Index i = 0; i < closed; ++i) {
      unit(zone.rows[static_cast<std::size_t>(i)], i) = 1.0;
    }
    system.bottomLeftCorner(modes, closed) = -flexibility.modal_loads(flexibility.spread(unit));
    system.bottomRightCorner(modes, modes) = flexibility.modal_stiffness().asDiagonal();
  }
  if (system.size() > 0) {
    zone.lu.compute(system);
  }
}

}  // namespace latin
