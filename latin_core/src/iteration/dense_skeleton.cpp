#include "iteration/dense_skeleton.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace latin::iteration {
namespace {

constexpr double with_mu = 1.0 + 2.0 * substructure::Flexibility::mu;
/// What hangs on a stiffness below this, relative to the search direction, hangs on nothing: some times that of a rigid
/// motion, see Flexibility.
constexpr double nothing = 1e-10;

}  // namespace

DenseSkeleton::DenseSkeleton(const JoinedSystem& system)
    : system_(system),
      flexibility_(system.laws().structure().flexibility()),
      own_(system.law_flexibility(flexibility_.own())),
      metric_(own_.cwiseProduct(flexibility_.areas())),
      tangent_system_(flexibility_, system.layout(), own_ + flexibility_.direct()) {
  const Matrix& jumps = flexibility_.modal_jumps();
  modes_.resize(jumps.rows(), 0);
  if (jumps.cols() > 0) {
    const Matrix weighted = metric_.cwiseSqrt().asDiagonal() * jumps;
    modes_ = Eigen::HouseholderQR<Matrix>(weighted).householderQ() *
             Matrix::Identity(jumps.rows(), std::min(jumps.rows(), jumps.cols()));
  }
}

/// Forces count by the work that they do on the bodies: the meshes do not determine all of them, and what moves
/// nothing need not be known. Modes have no share in the flexibility: resultants count as forces do by themselves.
double DenseSkeleton::size_of(const Vector& force) const {
  const Vector given = own_.cwiseProduct(force) - moved(force, Vector());
  const double work = given.cwiseProduct(flexibility_.areas()).dot(force);
  const Vector resultants = modes_.transpose() * force.cwiseProduct(metric_.cwiseSqrt());
  return system_.follow_first(std::sqrt(std::max(work, 0.0) + resultants.squaredNorm()));
}

Skeleton::Start DenseSkeleton::begin(const Vector& unbalanced, Vector& jump) const {
  // F / 2 = E f - (s - k w)
  Start start{flexibility_.solve(unbalanced), flexibility_.modal_loads(unbalanced)};
  jump += flexibility_.jump(unbalanced) - with_mu * flexibility_.jump(start.answer);
  return start;
}

Vector DenseSkeleton::imbalance(const Start& start, const Vector& y, const Vector& motion) const {
  return start.loads +
         flexibility_.modal_jumps().transpose() * flexibility_.areas().cwiseProduct(y) -
         tangent_system_.modal_stiffness().cwiseProduct(motion);
}

bool DenseSkeleton::step(const Matrix& tangent, const Vector& phi, const Vector& imbalance,
                         Vector& dy, Vector& dm) {
  // dy - R' m(dy, da) = Phi,  theta da - V^T W E dy = imbalance
  Vector right(phi.size() + imbalance.size());
  right << phi, imbalance;
  Matrix answer = tangent_system_.solve(tangent, right);
  system_.follow_first(answer);
  dy = answer.topRows(phi.size());
  dm = answer.bottomRows(imbalance.size());
  return answer.allFinite();
}

bool DenseSkeleton::loose(const Vector& motion, double force) const {
  return nothing * motion.norm() > force;
}

Vector DenseSkeleton::data(ConstVectorRef data, ConstVectorRef /*traces*/, const Start& start,
                           const Vector& /*force*/, const Vector& y, const Vector& motion) const {
  return data + start.answer + flexibility_.solve(flexibility_.spread(y)) +
         flexibility_.modal_data(motion);
}

}  // namespace latin::iteration
