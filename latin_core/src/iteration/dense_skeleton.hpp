#pragma once

#include <utility>

#include "iteration/joined_system.hpp"
#include "iteration/skeleton.hpp"
#include "iteration/tangent_system.hpp"
#include "substructure/flexibility.hpp"

namespace latin::iteration {

/// The bodies eliminated: their dense flexibility, and the amplitudes of their modes as motions.
///
/// In terms of the iteration, with N = 1 - k A_b (A_b: the global stage) and E the map of a force per area onto
/// both sides (+1, -1): forces f + y on the bodies give N ds = F / 2 + E y. N is singular where a body
/// floats; N + mu with a tiny mu is the same body on springs mu k, whose forces the outer iteration takes
/// back. `Flexibility` has the dense matrix of it, once for a problem.
class DenseSkeleton : public Skeleton {
 public:
  /// @param system must outlive this object
  explicit DenseSkeleton(const JoinedSystem& system);

  [[nodiscard]] const Vector& own() const override { return own_; }
  [[nodiscard]] const Vector& areas() const override { return flexibility_.areas(); }
  [[nodiscard]] Index motions() const override { return flexibility_.modal_stiffness().size(); }
  [[nodiscard]] bool moves() const override { return motions() > 0; }
  [[nodiscard]] Start begin(const Vector& unbalanced, Vector& jump) const override;
  [[nodiscard]] Vector imbalance(const Start& start, const Vector& y,
                                 const Vector& motion) const override;
  [[nodiscard]] Vector moved(const Vector& y, const Vector& motion) const override {
    return tangent_system_.moved(y, motion);
  }
  [[nodiscard]] bool step(const Matrix& tangent, const Vector& phi, const Vector& imbalance,
                          Vector& dy, Vector& dm) override;
  void exactly(bool /*exact*/) override {}
  [[nodiscard]] double size_of(const Vector& force) const override;
  [[nodiscard]] double size_of_imbalance(const Vector& imbalance) const override {
    return imbalance.norm();
  }
  [[nodiscard]] bool loose(const Vector& motion, double force) const override;
  double hold(double spring) override {
    tangent_system_.hold(spring);
    return std::exchange(spring_, spring);
  }
  [[nodiscard]] double held(const Vector& motion) const override { return spring_ * motion.norm(); }
  [[nodiscard]] Vector further(const Vector& motion, double ratio) const override {
    return (ratio - 1.0) * motion;
  }
  [[nodiscard]] Vector data(ConstVectorRef data, ConstVectorRef traces, const Start& start,
                            const Vector& force, const Vector& y,
                            const Vector& motion) const override;
  [[nodiscard]] Index factorisations() const override { return tangent_system_.factorisations(); }

 private:
  const JoinedSystem& system_;
  const substructure::Flexibility& flexibility_;
  Vector own_;     ///< flexibility at which the laws are asked
  Vector metric_;  ///< areas * own_
  double spring_ = 0.0;
  Matrix modes_;  ///< orthonormal basis of the jumps of the modes times the root of the metric
  TangentSystem tangent_system_;
};

}  // namespace latin::iteration
