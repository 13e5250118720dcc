#include "substructure/scaled.hpp"

#include "algebra/sparse_product.hpp"
#include "latin/common/error.hpp"

namespace latin::substructure {
namespace {

/// Blocks of columns times a matrix: column (k, s), s fastest, becomes sum_k (k, s) by(k, q).
Matrix multiply_blocks(ConstMatrixRef block, const Matrix& by, bool transposed) {
  const Index steps = block.cols() / by.rows();
  Matrix result(block.rows(), block.cols());
  if (block.rows() == 0) {
    return result;
  }
  using Strided = Eigen::OuterStride<>;
  for (Index step = 0; step < steps; ++step) {
    const Eigen::Map<const Matrix, 0, Strided> from(block.data() + step * block.outerStride(),
                                                    block.rows(), by.rows(),
                                                    Strided(steps * block.outerStride()));
    Eigen::Map<Matrix, 0, Strided> to(result.data() + step * result.rows(), result.rows(),
                                      by.rows(), Strided(steps * result.rows()));
    if (transposed) {
      to.noalias() = from * by.transpose();
    } else {
      to.noalias() = from * by;
    }
  }
  return result;
}

}  // namespace

Vector ScaledColumns::each(Index columns) const {
  const Index steps = columns / factors.values.size();
  Vector all(columns);
  for (Index k = 0; k < factors.values.size(); ++k) {
    all.segment(k * steps, steps).setConstant(factors.values(k));
  }
  return all;
}

Matrix ScaledColumns::into(ConstMatrixRef block) const {
  return transformed() ? multiply_blocks(block, factors.forward, false) : Matrix(block);
}

Matrix ScaledColumns::back(ConstMatrixRef block) const {
  return transformed() ? multiply_blocks(block, factors.forward, true) : Matrix(block);
}

ScaledBody::ScaledBody(const Body& body, const Matrix& extra) : body_(&body) {
  if (body.sprung_) {
    throw InputError("body '" + body.name() +
                     "': its stiffness has a factor, and it has springs, which have none: make "
                     "these active interfaces");
  }
  const Index loads = body.loads();
  const Vector robin = body.weights_.cwiseProduct(body.direction_);
  const Matrix of_springs = body.traces_.transpose() * (robin.asDiagonal() * body.offset_traces_);
  const Matrix whole = body.load_ + of_springs;  // Z^T F - Z^T K u0
  const bool shifted = body.work_.size() > 0;
  const Matrix of_offset = shifted ? Matrix(0.5 * (body.work_ - whole)) : Matrix();
  Matrix of_stiffness = Matrix::Zero(body.size(), loads);
  if (body.of_stiffness_.size() > 0) {
    of_stiffness = body.of_stiffness_;
  }
  if (shifted) {
    of_stiffness -= of_offset;
  }
  Matrix fixed = whole - of_stiffness;
  if (extra.size() > 0) {
    fixed += extra;
  }
  load_.resize(body.size(), 2 * loads);
  load_ << fixed, of_stiffness - of_springs;
  offset_traces_ = Matrix::Zero(body.rows(), 2 * loads);
  offset_traces_.rightCols(loads) = body.offset_traces_;
  if (loads > 0) {
    Matrix work(body.size(), 2 * loads);
    work << fixed, of_stiffness;
    if (shifted) {
      work.rightCols(loads) += 2.0 * of_offset;
    }
    work_loads_ = work.transpose() * body.factor_->solve(load_);
    work_loads_.bottomRightCorner(loads, loads) += body.offset_energy_;
    work_traces_ = body.weights_.asDiagonal() * (body.traces_ * body.factor_->solve(work));
  }
  if (body.active() > 0) {
    const Body::Spectrum& spectrum = body.spectrum();
    const auto modal = [&](const Matrix& forces) -> Matrix {
      if (loads == 0) {
        return Matrix::Zero(body.active(), 0);
      }
      const Matrix moved = body.factor_->solve(forces).bottomRows(body.active());
      const MatrixView lower = body.condensed_factor();
      const Matrix half = lower.transpose().triangularView<Eigen::Upper>() * moved;
      return spectrum.vectors.transpose() * Matrix(lower.triangularView<Eigen::Lower>() * half);
    };
    fixed_ = modal(fixed);
    of_stiffness_ = modal(of_stiffness);
    of_springs_ = modal(of_springs);
  }
}

Matrix ScaledBody::alike(ConstMatrixRef amplitudes, const Vector& factors) const {
  Matrix both(2 * amplitudes.rows(), amplitudes.cols());
  if (amplitudes.rows() > 0) {
    both << amplitudes * factors.cwiseInverse().asDiagonal(), amplitudes;
  }
  return both;
}

void ScaledBody::solve(Eigen::Map<Matrix>& modal, const Vector& factors, MatrixRef traces,
                       BodyWork& work) const {
  const Body::Spectrum& spectrum = body_->spectrum();
  for (Index column = 0; column < modal.cols(); ++column) {
    const double a = factors(column);
    modal.col(column).array() /= a + (1.0 - a) * spectrum.shares.array();
  }
  Eigen::Map<Matrix> unknowns = work.unknowns.shaped(modal.rows(), modal.cols());
  unknowns.noalias() = spectrum.vectors * modal;
  algebra::multiply_sparse(body_->active_traces_, unknowns, traces);
}

void ScaledBody::change(ConstMatrixRef data, const Vector& factors, MatrixRef traces,
                        BodyWork& work) const {
  if (body_->active() == 0) {
    traces.setZero();
    return;
  }
  Eigen::Map<Matrix> unknowns = work.unknowns.shaped(body_->active(), data.cols());
  algebra::multiply_sparse(body_->active_loads_, data, unknowns);
  Eigen::Map<Matrix> modal = work.weighted.shaped(body_->active(), data.cols());
  modal.noalias() = body_->spectrum().vectors.transpose() * unknowns;
  solve(modal, factors, traces, work);
}

void ScaledBody::apply(ConstMatrixRef data, ConstMatrixRef amplitudes, const Vector& factors,
                       MatrixRef traces, BodyWork& work) const {
  const bool loaded = amplitudes.rows() > 0;
  if (body_->active() == 0) {
    traces.setZero();
  } else {
    Eigen::Map<Matrix> unknowns = work.unknowns.shaped(body_->active(), data.cols());
    algebra::multiply_sparse(body_->active_loads_, data, unknowns);
    Eigen::Map<Matrix> modal = work.weighted.shaped(body_->active(), data.cols());
    modal.noalias() = body_->spectrum().vectors.transpose() * unknowns;
    if (loaded) {
      modal.noalias() += (fixed_ - of_springs_) * amplitudes;
      modal.noalias() += of_stiffness_ * (amplitudes * factors.asDiagonal());
    }
    solve(modal, factors, traces, work);
  }
  if (loaded && body_->rows() > 0) {
    traces.noalias() += body_->offset_traces_ * amplitudes;
  }
}

/// u is that of the body with the factor 1 under the forces and loads, less those that come from the stiffness,
/// divided by the factor.
Vector ScaledBody::energies(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef amplitudes,
                            const Vector& factors) const {
  const Matrix both = alike(amplitudes, factors);
  const Vector& k = body_->direction_;
  Vector energies = Vector::Zero(traces.cols());
  for (Index column = 0; column < traces.cols(); ++column) {
    double energy = 0.0;
    const auto loads = both.col(column);
    if (body_->rows() > 0) {
      const Vector force =
          (data.col(column) - k.cwiseProduct(traces.col(column))) / factors(column);
      Vector relative = traces.col(column);
      if (both.rows() > 0) {
        relative.noalias() -= offset_traces_ * loads;
        const Vector alike = force + k.cwiseProduct(traces.col(column));
        energy += loads.dot(work_traces_.transpose() * alike);
      }
      energy += relative.cwiseProduct(force).dot(body_->weights_);
    }
    if (both.rows() > 0) {
      energy += loads.dot(work_loads_ * loads);
    }
    energies(column) = factors(column) * energy;
  }
  return energies;
}

std::vector<Matrix> ScaledBody::displacements(ConstMatrixRef data, ConstMatrixRef traces,
                                              ConstMatrixRef amplitudes,
                                              const Vector& factors) const {
  Matrix forces = load_ * alike(amplitudes, factors);
  if (body_->rows() > 0) {
    const auto k = body_->direction_.asDiagonal();
    const Matrix moved = k * traces;
    const Matrix alike = (data - moved) * factors.cwiseInverse().asDiagonal() + moved;
    forces += body_->traces_.transpose() * (body_->weights_.asDiagonal() * alike);
  }
  const Matrix unknowns = body_->factor_->solve(forces);
  std::vector<Matrix> fields;
  for (std::size_t e = 0; e < body_->prolongations_.size(); ++e) {
    fields.emplace_back(body_->prolongations_[e] * unknowns);
    if (body_->offsets_[e].size() > 0) {
      fields.back() += body_->offsets_[e] * amplitudes;
    }
  }
  return fields;
}

}  // namespace latin::substructure
