#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "latin/common/types.hpp"
#include "substructure/body.hpp"

namespace latin::substructure {

class Joined;
class Structure;

/// Dense flexibility of the interfaces of condensed bodies: what Newton's step needs of the global stage.
///
/// With A the global stage, N = 1 + mu - k A and E the map of a force per area of an interface to its sides
/// (+1 on side 1, -1 on side 2), N^-1 is a body on springs mu k instead of k, factorised here. Modes that only
/// those springs hold (rigid motions of a floating body, very soft ones) have a flexibility of about 1 / mu, in
/// which that of all others would be lost to rounding; they are kept apart:
///
///     N^-1 v = N+ v + k V theta^-1 V^T W v / (1 + mu),
///
/// V (rows, r) their traces and theta (r) their stiffness. E^T k^-1 N+ E is the matrix (unknowns, unknowns).
///
/// On several ranks rows and unknowns are those of all, see Joined, and every rank has the matrix; the factors of the
/// bodies stay where the bodies are.
class Flexibility {
 public:
  /// Springs that hold the bodies, relative to the search direction k.
  static constexpr double mu = 1e-7;

  /// Collective. @param structure must outlive this object
  /// @throws NumericalError naming a body that is not definite
  explicit Flexibility(const Structure& structure);

  [[nodiscard]] Index unknowns() const { return matrix_.rows(); }
  /// E^T k^-1 N+ E
  [[nodiscard]] const Matrix& matrix() const { return matrix_; }
  /// The matrix times y (unknowns), on several threads: their number changes no bit.
  [[nodiscard]] Vector product(ConstVectorRef y) const;
  /// E^T k^-1 E
  [[nodiscard]] const Vector& direct() const { return direct_; }
  /// (unknowns) how much a unit force at a point changes its jump by the deformation of the bodies alone: the mean
  /// over the components, but at least a hundredth of the mean over all points.
  [[nodiscard]] const Vector& own() const { return own_; }
  /// (unknowns) areas
  [[nodiscard]] const Vector& areas() const { return areas_; }
  /// N+ v, (rows, c). Collective.
  [[nodiscard]] Matrix solve(ConstMatrixRef v) const;
  /// theta (r), without the springs mu k
  [[nodiscard]] const Vector& modal_stiffness() const { return modal_stiffness_; }
  /// E^T V, (unknowns, r)
  [[nodiscard]] const Matrix& modal_jumps() const { return modal_jumps_; }
  /// V^T W v, (r, c)
  [[nodiscard]] Matrix modal_loads(ConstMatrixRef v) const;
  /// k V a / (1 + mu), (rows, c)
  [[nodiscard]] Matrix modal_data(ConstMatrixRef amplitudes) const;
  /// E y: (unknowns, c) -> (rows, c)
  [[nodiscard]] Matrix spread(ConstMatrixRef y) const;
  /// Mean of the sides, with their signs: (rows) -> (unknowns)
  [[nodiscard]] Vector force(ConstVectorRef v) const;
  /// E^T k^-1 v: (rows, c) -> (unknowns, c)
  [[nodiscard]] Matrix jump(ConstMatrixRef v) const;

 private:
  struct Part {
    const Body* body;
    Index first_row;
    Matrix factor;  ///< L of K = (1 + mu) S + mu T^T W k T
    Matrix
        modes;  ///< Z: those of K Z = T^T W k T Z theta with a small theta, Z^T (T^T W k T) Z = 1
    Matrix springs;  ///< T^T W k T Z
  };
  void number();
  void add_bodies();
  void add_body(const Body& body, Index first_row);
  void gather();
  void find_modes(Part& part, const SparseRows& springs);
  /// @param adding held while the matrix is added to
  void add_matrix(const Part& part, std::mutex& adding);
  void find_own();

  const Structure& structure_;
  std::shared_ptr<const Joined> joined_;
  std::vector<Part> parts_;        ///< of this rank, with rows of all, the largest first
  std::vector<Index> unknown_;     ///< (rows) the point and component that a row belongs to
  std::vector<Index> components_;  ///< (unknowns) of the point
  Vector sign_;                    ///< (rows) +1 on side 1, -1 on side 2
  Vector inverse_direction_;
  Vector weights_;
  Vector direct_;
  Vector areas_;
  Vector own_;
  Matrix matrix_;
  Matrix modal_traces_;  ///< V
  Matrix modal_jumps_;
  Vector modal_stiffness_;
};

}  // namespace latin::substructure
