// A block on a floor that is pulled to and fro, with a law of the floor's surface that is written here.
//
//                 | weight W
//                 v
//     wall --/\/\-- [ block ] -> P(t)
//            spring ~~~~~~~~~  floor: sticks elastically, slides at mu W
//
// The surface shears by t = k (u - s) until |t| reaches mu W; then the slip s follows. Step by step the block is at
//
//     u = (P + k s) / (spring + k)        where it sticks,
//     u = (P -+ mu W) / spring            where it slides to the right or left,
//
// so that it does not come back to where it was: friction keeps it.

#include <petscsys.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>

#include "latin/latin.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::Vector;
using latin::interface::Parameter;
using latin::interface::PointForce;
using latin::interface::PointValues;

constexpr double spring = 2.0;    // force / length
constexpr double shear = 8.0;     // k, force / length
constexpr double friction = 0.3;  // mu
constexpr double weight = 10.0;   // W

/// Unilateral contact whose shear stress is elastic up to mu times the pressure. Component 0 is the normal one; a
/// negative normal force presses. `slip` is kept from step to step.
struct Surface {
  static constexpr const char* name = "surface";
  static constexpr std::array parameters{Parameter{"friction", 0.0}, Parameter{"stiffness", 0.0}};
  static constexpr std::size_t memory = 1;

  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      std::array<double, 1>& slip, PointForce force) {
    const auto [mu, k] = p;
    force[0] = std::min(0.0, jump[0] / flexibility[0]);
    const double bound = -mu * force[0];
    force[1] = std::clamp((jump[1] - slip[0]) / (flexibility[1] + 1.0 / k), -bound, bound);
    slip[0] = jump[1] - flexibility[1] * force[1] - force[1] / k;
  }
};

latin::Study block_on_floor() {
  latin::SparseRows stiffness(2, 2);  // of the spring, on the unknowns (right, up)
  stiffness.insert(0, 0) = spring;
  stiffness.insert(1, 1) = 0.0;
  stiffness.makeCompressed();
  latin::SparseRows both(2, 2);
  both.setIdentity();
  const Matrix load{{0.0, 1.0}, {-weight, 0.0}};  // patterns: the weight, and a pull of 1
  const Matrix frame{{0.0, -1.0}, {1.0, 0.0}};    // normal out of the block: down; tangent: right
  const latin::BodyDescription block{
      .name = "block",
      .size = 2,
      .members = {{.name = "block", .stiffness = latin::owning_view(stiffness), .load = load}}};
  const latin::InterfaceDescription floor{.name = "floor",
                                          .law = latin::interface::law_of<Surface>(),
                                          .weights = Vector::Ones(1),
                                          .frames = frame,
                                          .sides = {{.member = "block",
                                                     .trace = both,
                                                     .direction = Vector::Constant(2, shear),
                                                     .scale = spring}}};
  return latin::Study({block}, {floor})
      .with_parameter("floor", "friction", friction)
      .with_parameter("floor", "stiffness", shear);
}

int run() {
  const Vector pull{{1.0, 3.0, 6.0, 8.0, 5.0, 0.0, -4.0, -8.0, 0.0}};
  Matrix amplitudes = Matrix::Ones(2, pull.size());
  amplitudes.row(1) = pull.transpose();
  latin::SolveOptions options;
  options.rtol = 1e-10;
  const latin::Solution solution = block_on_floor().with_history(amplitudes).solve(options);
  std::printf("%s\n", solution.summary().brief().c_str());

  const Matrix places = solution.displacement("block");
  const latin::Field& forces = solution.force("floor");
  double slip = 0.0;
  double worst = 0.0;
  for (Index step = 0; step < pull.size(); ++step) {
    double place = (pull(step) + shear * slip) / (spring + shear);
    double stress = shear * (place - slip);
    if (std::abs(stress) > friction * weight) {
      stress = std::copysign(friction * weight, stress);
      place = (pull(step) - stress) / spring;
      slip = place - stress / shear;
    }
    std::printf("P %5.1f: %s, block at %9.6f (exact %9.6f), pressure %.6f, friction %9.6f\n",
                pull(step), to_string(solution.status(step)).c_str(), places(0, step), place,
                -forces(0, 0, step), forces(0, 1, step));
    worst = std::max({worst, std::abs(places(0, step) - place),
                      std::abs(forces(0, 1, step) + stress) / weight,
                      std::abs(forces(0, 0, step) + weight) / weight});
  }
  std::printf("largest difference %.1e\n", worst);
  return solution.converged() && worst < 1e-8 ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  if (PetscInitialize(&argc, &argv, nullptr, nullptr) != PETSC_SUCCESS) {
    return 1;
  }
  int failed = 1;
  try {
    failed = run();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  return PetscFinalize() == PETSC_SUCCESS ? failed : 1;
}
