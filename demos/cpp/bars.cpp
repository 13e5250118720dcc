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
//
// docs/kernel.md goes through this program step by step.

#include <petscmat.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <string>
#include <vector>

#include "latin/latin.hpp"

namespace {

using latin::Index;
using latin::Matrix;
using latin::Vector;

constexpr Index nodes = 11;
constexpr double spring = 0.5;  // force / length
constexpr double push = 0.2;    // P

/// Stiffness (nodes, nodes) of a bar that nothing holds, as a matrix of PETSc.
latin::algebra::MatHandle bar_stiffness() {
  using latin::algebra::check;
  latin::algebra::MatHandle matrix;
  const auto size = static_cast<PetscInt>(nodes);
  check(MatCreateSeqAIJ(PETSC_COMM_SELF, size, size, 3, nullptr, matrix.out()), "create a matrix");
  const double element = static_cast<double>(nodes - 1);
  for (PetscInt e = 0; e + 1 < size; ++e) {
    for (const PetscInt i : {e, e + 1}) {
      for (const PetscInt j : {e, e + 1}) {
        check(MatSetValue(matrix.get(), i, j, i == j ? element : -element, ADD_VALUES), "add");
      }
    }
  }
  check(MatAssemblyBegin(matrix.get(), MAT_FINAL_ASSEMBLY), "assemble");
  check(MatAssemblyEnd(matrix.get(), MAT_FINAL_ASSEMBLY), "assemble");
  return matrix;
}

/// Trace (1, nodes): the displacement of one node.
latin::SparseRows at(Index node) {
  latin::SparseRows trace(1, nodes);
  trace.insert(0, node) = 1.0;
  trace.makeCompressed();
  return trace;
}

/// One bar as a body: a member, its load (nodes, 1), and the spring that holds it at a node.
latin::substructure::BodyDescription bar(const std::string& name, const Matrix& load, Index held) {
  const auto stiffness = bar_stiffness();
  return {name,
          nodes,
          {{name, latin::algebra::view_sparse(stiffness.get(), name), {}, load, {}}},
          {{name + " to wall", {0}, {at(held)}, Vector::Constant(1, spring), Matrix::Zero(1, 1)}}};
}

/// The contact between the right end of bar 0 and the left end of bar 1.
latin::substructure::InterfaceDescription contact() {
  // search direction: about the stiffness of what the contact acts on; scale: modulus / length
  const auto side = [](const std::string& name, Index node) {
    return latin::substructure::SideDescription{name, at(node), Vector::Constant(1, spring), 1.0};
  };
  // a jump of one component: its frame, the normal from side 1 to side 2, is +x
  const Matrix frame = Matrix::Ones(1, 1);
  return {
      "contact", "contact", Vector::Ones(1), frame, {side("bar 0", nodes - 1), side("bar 1", 0)}};
}

double exact(double gap) { return std::max(0.0, (push / spring - gap) / (2.0 / spring + 2.0)); }

int run() {
  Matrix load = Matrix::Zero(nodes, 1);
  load(nodes - 1, 0) = -push;
  std::vector<latin::substructure::BodyDescription> bodies;
  bodies.push_back(bar("bar 0", Matrix::Zero(nodes, 1), 0));
  bodies.push_back(bar("bar 1", load, nodes - 1));
  const auto structure = std::make_shared<const latin::substructure::Structure>(
      std::move(bodies), std::vector{contact()}, latin::substructure::OperatorOptions{});

  // one solve: laws are a value, and the structure stays as it is
  const latin::substructure::Laws laws = latin::substructure::Laws(structure).with_parameters(
      {{"contact", "gap", Matrix::Constant(1, 1, 0.1)}});
  const Matrix amplitudes = Matrix::Ones(1, 1);  // of the one load pattern, in one column
  latin::iteration::Options options;
  options.rtol = 1e-10;
  latin::iteration::State state;
  const auto summary = latin::iteration::solve(laws, options, amplitudes, state, {}, {});
  const auto fields = latin::substructure::LocalStage(laws, 1).fields(
      structure->find_interface("contact"), state.data, state.traces);
  const auto displacements = latin::substructure::displacements(laws, state.data, amplitudes);
  std::printf(
      "gap 0.100: %s after %td iterations, contact force %.9f (exact %.9f), tip of %s at %.6f\n",
      to_string(summary.status).c_str(), summary.iterations, -fields.force(0, 0), exact(0.1),
      displacements.back().first.c_str(), displacements.back().second(0, 0));
  double worst = std::abs(-fields.force(0, 0) - exact(0.1));

  // many gaps: each starts from its solved neighbours
  const Vector gaps = Vector::LinSpaced(9, 0.0, 0.8);
  const std::vector<latin::iteration::SweptParameter> swept{
      {"contact", "gap", Matrix::Ones(1, 1), gaps.transpose(), 1}};
  latin::iteration::sweep(
      laws, options, amplitudes, swept, latin::iteration::snake_order({gaps.size()}), {}, {}, {},
      [&](Index point, const latin::substructure::Laws& of_point,
          const latin::iteration::Summary& /*how*/, const latin::iteration::State& found) {
        const auto there =
            latin::substructure::LocalStage(of_point, 1).fields(0, found.data, found.traces);
        const double force = -there.force(0, 0);
        std::printf("gap %.3f: contact force %.9f (exact %.9f)\n", gaps(point), force,
                    exact(gaps(point)));
        worst = std::max(worst, std::abs(force - exact(gaps(point))));
      });
  std::printf("largest difference %.1e\n", worst);
  return worst < 1e-8 * push ? 0 : 1;
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
