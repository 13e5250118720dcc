#pragma once

#include <cmath>
#include <memory>
#include <utility>
#include <vector>

#include "algebra/factor.hpp"
#include "iteration/joined_system.hpp"
#include "iteration/skeleton.hpp"

namespace latin::iteration {

/// The whole bodies with springs where their interfaces are closed, factorised: for interfaces that are too large for
/// dense matrices.
///
/// With K the stiffness of all unknowns, J the jumps of these, A the areas and c the flexibility at which laws are
/// asked, a step dy = phi + R (J du + c dy) of K du = loads - J^T A dy is
///
///     (K + J^T A D J) du = loads - J^T A (phi + D c phi),     D = (1 - R c)^-1 R,     dy = D (J du + c phi) + phi.
///
/// One sparse Cholesky factor of that is kept over steps, with D bounded and its unsymmetric part (what friction takes
/// from the pressure) left out. GMRES does the rest: every solution is a motion with forces that balance, whatever D
/// it was made with, and the best sum of them takes products by point alone. So balance is exact, and vectors are as long
/// as the interfaces. The factor is made anew where it costs less than the solutions that it saves.
///
/// Motions are those of the rows, and the change of the loads that are left: springs that are next to nothing hold
/// what floats, and what they carry is balanced by the next step.
///
/// On several ranks each has all of it.
class SparseSkeleton : public Skeleton {
 public:
  /// Whether the bodies have kept their stiffness. Collective.
  [[nodiscard]] static bool possible(const substructure::Structure& structure);
  /// @param system must outlive this object
  explicit SparseSkeleton(const JoinedSystem& system);

  [[nodiscard]] const Vector& own() const override { return own_; }
  [[nodiscard]] const Vector& areas() const override { return areas_; }
  [[nodiscard]] Index motions() const override { return 2 * traces_.rows(); }
  [[nodiscard]] bool moves() const override { return true; }
  [[nodiscard]] Start begin(const Vector& unbalanced, Vector& jump) const override;
  [[nodiscard]] Vector imbalance(const Start& start, const Vector& y,
                                 const Vector& motion) const override;
  [[nodiscard]] Vector moved(const Vector& y, const Vector& motion) const override;
  [[nodiscard]] bool step(const Matrix& tangent, const Vector& phi, const Vector& imbalance,
                          Vector& dy, Vector& dm) override;
  void exactly(bool exact) override { exact_ = exact; }
  [[nodiscard]] double size_of(const Vector& force) const override;
  [[nodiscard]] double size_of_imbalance(const Vector& imbalance) const override;
  [[nodiscard]] bool loose(const Vector& motion, double force) const override;
  double hold(double spring) override {
    stale_ = stale_ || spring != spring_;
    return std::exchange(spring_, spring);
  }
  [[nodiscard]] double held(const Vector& motion) const override {
    return size_of_imbalance(sprung_rows(motion));
  }
  [[nodiscard]] Vector further(const Vector& /*motion*/, double /*ratio*/) const override {
    return {};
  }
  [[nodiscard]] Vector data(ConstVectorRef data, ConstVectorRef traces, const Start& start,
                            const Vector& force, const Vector& y,
                            const Vector& motion) const override;
  [[nodiscard]] Index factorisations() const override { return factorisations_; }
  /// Solutions so far.
  [[nodiscard]] Index solutions() const { return solutions_; }

 private:
  /// Forces with the motion of the rows that balances them.
  struct Pair {
    Vector y;
    Vector traces;
  };
  void gather();
  void find_own();
  void factorise(const Matrix& tangent);
  [[nodiscard]] Matrix springs_of(const Matrix& tangent, Index first, Index count) const;
  [[nodiscard]] Pair respond(const Vector& phi, const Vector& loads);
  /// @return whether the residual fell by as much as is asked for
  [[nodiscard]] bool approach(const Matrix& tangent, const Vector& phi, const Vector& loads,
                              Pair& pair);
  [[nodiscard]] double norm(const Vector& force) const {
    return std::sqrt(force.cwiseAbs2().dot(metric_));
  }
  [[nodiscard]] Vector sprung(const Vector& jump) const;
  /// Forces of the springs that hold rows where the column began.
  [[nodiscard]] Vector sprung_rows(const Vector& motion) const {
    return spring_ * system_.directions().cwiseProduct(motion.head(traces_.rows()));
  }

  const JoinedSystem& system_;
  SparseRows stiffness_;  ///< K, the lower triangle
  SparseRows traces_;     ///< (rows, nodes)
  SparseRows sides_;      ///< rows into jumps
  SparseRows jumps_;      ///< nodes into jumps
  Vector areas_;
  Vector weights_;   ///< (rows)
  Vector springs_;   ///< weights times directions, (rows)
  Vector diagonal_;  ///< of K where there are rows, else infinite
  Vector own_;
  Vector metric_;
  Vector least_corrected_;  ///< by a force, relative to it, that is none of a contradiction
  Matrix d_;                ///< D of the factor, as slopes are given
  double held_ = 0.0;       ///< springs of the factor on all rows, relative to the search direction
  double spring_ = 0.0;     ///< those that are meant
  bool exact_ = false;
  bool stale_ = true;  ///< whether the factor is to be made anew
  std::unique_ptr<algebra::Factor> factor_;
  Index factorisations_ = 0;
  Index solutions_ = 0;
};

}  // namespace latin::iteration
