// Two bars in contact, described by hand and solved by the kernel: no Python, no meshes.
//
//     wall --/\/\-- [ bar 0 ]  |gap|  [ bar 1 ] --/\/\-- wall
//            spring            contact      <- P    spring
//
// Both bars have the axial stiffness EA / L = 1 and are cut into elements; they are held by springs. A force P
// pushes bar 1 to the left, against its own spring and, once the gap is closed, against bar 0. With the springs
// in series, the force in the contact is
//
//     N = max(0, (P / spring - gap) / (2 / spring + 2)).

#include <petscsys.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <string>

#include "latin/latin.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::Vector;

constexpr Index nodes = 11;
constexpr Index last = nodes - 1;
constexpr double spring = 0.5;  // force / length
constexpr double push = 0.2;    // P

double exact(double gap) { return std::max(0.0, (push / spring - gap) / (2.0 / spring + 2.0)); }

/// Stiffness (nodes, nodes) of a bar that nothing holds.
latin::SparseRows bar_stiffness() {
  latin::SparseRows matrix(nodes, nodes);
  for (Index e = 0; e < last; ++e) {
    for (const Index i : {e, e + 1}) {
      for (const Index j : {e, e + 1}) {
        matrix.coeffRef(i, j) += i == j ? last : -last;
      }
    }
  }
  matrix.makeCompressed();
  return matrix;
}

/// Trace (1, nodes): the displacement of one node.
latin::SparseRows at(Index node) {
  latin::SparseRows trace(1, nodes);
  trace.insert(0, node) = 1.0;
  trace.makeCompressed();
  return trace;
}

/// A bar with a force at its right end, held by a spring at one node.
latin::BodyDescription bar(const std::string& name, double force, Index held) {
  Matrix load = Matrix::Zero(nodes, 1);  // one load pattern
  load(last, 0) = force;
  return {
      .name = name,
      .size = nodes,
      .members = {{.name = name, .stiffness = latin::owning_view(bar_stiffness()), .load = load}},
      .springs = {{.name = name + " to wall",
                   .members = {0},
                   .traces = {at(held)},
                   .stiffness = Vector::Constant(1, spring),
                   .jump = Matrix::Zero(1, 1)}}};
}

/// The face of a bar at a node. The search direction sets how fast the iteration is: the stiffness of what the contact
/// acts on; the scale is modulus / length.
latin::SideDescription side(const std::string& name, Index node) {
  return {
      .member = name, .trace = at(node), .direction = Vector::Constant(1, spring), .scale = 1.0};
}

int run() {
  const latin::InterfaceDescription contact{
      .name = "contact",
      .law = "contact",
      .weights = Vector::Ones(1),    // area of the one point
      .frames = Matrix::Ones(1, 1),  // its normal, from bar 0 to bar 1: +x
      .sides = {side("bar 0", last), side("bar 1", 0)}};
  const latin::Study study({bar("bar 0", 0.0, 0), bar("bar 1", -push, last)}, {contact});

  latin::SolveOptions options;
  options.rtol = 1e-10;
  const latin::Solution solution = study.with_parameter("contact", "gap", 0.1).solve(options);
  double worst = std::abs(-solution.force("contact")(0) - exact(0.1));
  std::printf("gap 0.100: %s\n", solution.summary().brief().c_str());
  std::printf("contact force %.9f (exact %.9f), tip of bar 1 at %.6f\n",
              -solution.force("contact")(0), exact(0.1), solution.displacement("bar 1")(0, 0));

  // many gaps: each starts from its solved neighbours
  const latin::Axis gaps{"contact", "gap", {0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8}};
  latin::SweepOptions of_sweep;
  of_sweep.rtol = options.rtol;
  const auto each = [&](Index point, const latin::Solution& found) {
    const double gap = gaps.values[static_cast<std::size_t>(point)];
    const double force = -found.force("contact")(0);
    std::printf("gap %.3f: contact force %.9f (exact %.9f)\n", gap, force, exact(gap));
    worst = std::max(worst, std::abs(force - exact(gap)));
  };
  const latin::Status ended = study.sweep(latin::grid({gaps}), of_sweep, each);
  std::printf("largest difference %.1e\n", worst);
  return ended == latin::Status::converged && worst < 1e-8 * push ? 0 : 1;
}

}  // namespace

int main(int argc, char** argv) {
  // the kernel never starts PETSc (and with it MPI): its user does
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
