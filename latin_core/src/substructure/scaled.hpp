#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "stochastic/coupling.hpp"
#include "substructure/body.hpp"

namespace latin::substructure {

/// Factors of the stiffness of a body in the columns of a run.
struct StiffnessFactors {
  /// > 0, for as many blocks of columns of the same length; they are columns * forward where that is not empty.
  Vector values;
  Matrix
      forward;  ///< (q, q) orthogonal, of q values: those of a Galerkin matrix; empty: the identity
  /// Of a member with stretches, in place of these: factors > 0, (points, blocks of columns).
  // NOLINTNEXTLINE(readability-redundant-member-init): callers leave it out
  Matrix field{};
  /// Or what is added to the factors 1 at its points, projected on the modes that are columns.
  // NOLINTNEXTLINE(readability-redundant-member-init)
  std::shared_ptr<const stochastic::Coupling> coupling{};
};

/// A body whose members have their stiffness multiplied by a factor a, which differs from column to column.
///
/// With the factorised operator S + R of the active unknowns, S the condensed stiffness and R = T^T W k T, and
/// R phi = lambda (S + R) phi solved once, a S + R is diagonal in the vectors phi: a (1 - lambda) + lambda. So no
/// factor needs a factorisation. Loads that come from the stiffness (initial strains, prescribed displacements) are
/// multiplied by a, too. Constant; several threads may use it, each with working blocks of its own.
class ScaledBody {
 public:
  /// @param body   must outlive this object
  /// @param extra  (n_body, l) forces added to the load patterns, or empty
  /// @throws InputError if the body has springs, or active unknowns without a dense factor
  ScaledBody(const Body& body, const Matrix& extra);

  /// w of all sides, (rows, c). @param factors a (c)  @param amplitudes (l, c)
  void apply(ConstMatrixRef data, ConstMatrixRef amplitudes, const Vector& factors,
             MatrixRef traces, BodyWork& work) const;
  /// The same without loads.
  void change(ConstMatrixRef data, const Vector& factors, MatrixRef traces, BodyWork& work) const;
  /// Twice the strain energies a u^T K u, (c), as Body::energies().
  [[nodiscard]] Vector energies(ConstMatrixRef data, ConstMatrixRef traces,
                                ConstMatrixRef amplitudes, const Vector& factors) const;
  /// Displacements of each member, (n, c).
  [[nodiscard]] std::vector<Matrix> displacements(ConstMatrixRef data, ConstMatrixRef traces,
                                                  ConstMatrixRef amplitudes,
                                                  const Vector& factors) const;

 private:
  /// Amplitudes (2 l, c) of the patterns of a body with the factor 1 that moves in the same way.
  [[nodiscard]] Matrix alike(ConstMatrixRef amplitudes, const Vector& factors) const;
  void solve(Eigen::Map<Matrix>& modal, const Vector& factors, MatrixRef traces,
             BodyWork& work) const;

  const Body* body_;
  // in the vectors phi, (active, l): loads as they are, those that come from the stiffness, and of offsets in R
  Matrix fixed_;
  Matrix of_stiffness_;
  Matrix of_springs_;
  // of the body with the factor 1: first the loads as they are, then those that come from the stiffness, (.., 2 l)
  Matrix load_;
  Matrix offset_traces_;
  Matrix work_loads_;
  Matrix work_traces_;
};

/// A scaled body in the columns of a run.
struct ScaledColumns {
  std::shared_ptr<const ScaledBody> body;
  StiffnessFactors factors;

  /// Whether columns of a run are others than those with the factors.
  [[nodiscard]] bool transformed() const { return factors.forward.size() > 0; }
  /// The factor of every one of c columns.
  [[nodiscard]] Vector each(Index columns) const;
  /// Columns of a run as those that have the factors, and back.
  [[nodiscard]] Matrix into(ConstMatrixRef block) const;
  [[nodiscard]] Matrix back(ConstMatrixRef block) const;
};

}  // namespace latin::substructure
