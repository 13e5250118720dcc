// Laws of a user as they were written when all headers were installed: they compile, and answer, as they are. The
// pad is that of docs/laws.md; the wire derives from Law, and knows nothing of slopes and of single columns.

#include <petscsys.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <latin/common/error.hpp>
#include <latin/common/types.hpp>
#include <latin/interface/law.hpp>
#include <latin/interface/pointwise.hpp>
#include <memory>
#include <string>
#include <vector>

using namespace latin::interface;

/// Elastic, perfectly plastic: f_n = k (j_n - p), |f_n| <= y; f_t = 0.
struct Pad {
  static constexpr const char* name = "pad";
  static constexpr std::array parameters{Parameter{"stiffness", 0.0}, Parameter{"limit", 0.0}};
  static constexpr std::size_t memory = 1;  // p; leave these two out for a law without memory

  static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
                      std::array<double, 1>& plastic, PointForce force) {
    const auto [stiffness, limit] = p;
    std::ranges::fill(force, 0.0);
    const double trial = (jump[0] - plastic[0]) / (flexibility[0] + 1.0 / stiffness);
    force[0] = std::clamp(trial, -limit, limit);
    plastic[0] = jump[0] - flexibility[0] * force[0] - force[0] / stiffness;
  }
};

/// f_n = max(0, k (j_n - s)).
class Wire final : public Law {
 public:
  [[nodiscard]] std::string name() const override { return "wire"; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override {
    return {{"stiffness", Shape::per_point, 0.0}, {"slack", Shape::per_point, 0.0}};
  }
  [[nodiscard]] std::unique_ptr<Law> blank() const override { return std::make_unique<Wire>(); }
  void resolve(const LocalProblem& problem, latin::MatrixRef force) const override {
    for (latin::Index column = 0; column < force.cols(); ++column) {
      for (latin::Index row = 0; row < force.rows(); ++row) {
        if (!std::isfinite(problem.jump(row, column))) {
          throw latin::NumericalError("a wire was torn");
        }
        const double stretch = problem.jump(row, column) - get("slack")(row, column);
        force(row, column) = std::max(
            0.0, stretch / (problem.flexibility(row) + 1.0 / get("stiffness")(row, column)));
      }
    }
  }
};

// what is above was there; what is below is the entry of now
#include <latin/study.hpp>

namespace {

constexpr double held = 3.0;  // stiffness of what a load of 1 pulls from the law

/// Forces (steps) of a law with one unknown on a spring to a wall, pulled by `pull`.
latin::Vector pulled(LawSource law, double first, const char* name, const latin::Vector& pull) {
  latin::SparseRows spring(1, 1);
  spring.insert(0, 0) = held;
  spring.makeCompressed();
  latin::SparseRows one(1, 1);
  one.setIdentity();
  latin::SolveOptions options;
  options.rtol = 1e-11;
  const latin::Matrix ones = latin::Matrix::Ones(1, 1);
  const latin::Study study(
      {{"part", 1, {{"part", latin::owning_view(spring), {}, -ones}}}},
      {{"law", law, latin::Vector::Ones(1), ones, {{"part", one, latin::Vector::Ones(1), 1.0}}}});
  const auto solution = study.with_parameter("law", "stiffness", 50.0)
                            .with_parameter("law", name, first)
                            .with_history(pull.transpose())
                            .solve(options);
  return solution.converged() ? latin::Vector(solution.force("law").values().row(0).transpose())
                              : latin::Vector::Constant(pull.size(), std::nan(""));
}

double run() {
  const latin::Vector pull{{4.0, 16.0, 4.0}};
  // the jump is minus the displacement: pull = held j + f(j)
  const double share = 50.0 / (50.0 + held);
  const latin::Vector pad{{4.0 * share, 8.0, 8.0 - 12.0 * share}};
  const latin::Vector wire = (pull.array() - held * 0.1) * share;
  const double of_pad =
      (pulled(std::shared_ptr<const Law>(law_factory<Pad>()->make()), 8.0, "limit", pull) - pad)
          .norm();
  const double of_wire =
      (pulled(LawSource(std::make_shared<const Wire>()), 0.1, "slack", pull) - wire).norm();
  std::printf("largest difference %.1e\n", std::max(of_pad, of_wire));
  return of_pad + of_wire;
}

}  // namespace

int main(int argc, char** argv) {
  if (PetscInitialize(&argc, &argv, nullptr, nullptr) != PETSC_SUCCESS) {
    return 1;
  }
  const bool right = run() < 1e-8;
  return PetscFinalize() == PETSC_SUCCESS && right ? 0 : 1;
}
