#pragma once

#include <cmath>
#include <memory>

#include "chain.hpp"
#include "iteration/stages.hpp"

namespace chain {

/// A bar "held" by a spring at its left, and a bar "loose" that is pushed towards it over a gap; beside them a bar
/// "other" with a spring and a load of its own.
struct Pushed {
  double force = -2.0;
  double gap = 0.0;
  double other = 1.0;  ///< load
  double direction = 1.3;
  double spring = 5.0;

  static constexpr Index nodes = 5;

  [[nodiscard]] latin::substructure::Laws build() const {
    const Matrix one = Matrix::Ones(1, 1);
    const Vector area = Vector::Ones(1);
    std::vector<latin::substructure::BodyDescription> bodies;
    for (const auto& [name, load] :
         {std::pair{"held", 0.0}, std::pair{"loose", force}, std::pair{"other", other}}) {
      bodies.push_back(
          {name, nodes, {{name, shared_bar(nodes), {}, end_load(nodes, load), {}}}, {}});
    }
    const auto side = [this](const char* name, Index node) {
      return latin::substructure::SideDescription{name, at(node, nodes),
                                                  Vector::Constant(1, direction), 1.0};
    };
    std::vector<latin::substructure::InterfaceDescription> interfaces{
        {"wall", "elastic", area, one, {side("held", 0)}},
        {"contact", "contact", area, one, {side("held", nodes - 1), side("loose", 0)}},
        {"ground", "elastic", area, one, {side("other", 0)}}};
    return latin::substructure::Laws(std::make_shared<const latin::substructure::Structure>(
                                         std::move(bodies), std::move(interfaces),
                                         latin::substructure::OperatorOptions{}))
        .with_parameters({{"wall", "normal", Matrix::Constant(1, 1, spring)},
                          {"ground", "normal", Matrix::Constant(1, 1, spring)},
                          {"contact", "gap", Matrix::Constant(1, 1, gap)}});
  }

  /// Traces of the answer: wall, both sides of the contact, ground.
  [[nodiscard]] Vector exact() const {
    const double at_wall = force / spring;
    return Vector{{at_wall, at_wall + force, at_wall + force - gap, other / spring}};
  }
};

/// Blocks of two nodes in the plane, each pressed on a floor (along x) and pushed sidewise (along y) at one node,
/// with springs at the other. The load patterns are the pressing and the pushing.
struct Sliding {
  Index count = 1;
  double friction = 0.3;
  double spring = 2.0;
  double direction = 1.3;
  bool whole = false;  ///< whether bodies keep their operators

  [[nodiscard]] latin::substructure::Laws build() const {
    const Matrix frame = Matrix::Identity(2, 2);
    const Vector area = Vector::Ones(1);
    std::vector<Eigen::Triplet<double>> entries;
    for (int a = 0; a < 2; ++a) {
      entries.insert(entries.end(),
                     {{a, a, 1.0}, {a + 2, a + 2, 1.0}, {a, a + 2, -1.0}, {a + 2, a, -1.0}});
    }
    SparseRows stiffness(4, 4);
    stiffness.setFromTriplets(entries.begin(), entries.end());
    const auto shared = latin::owning_view(stiffness);
    Matrix load = Matrix::Zero(4, 2);
    load.topRows(2).setIdentity();
    std::vector<latin::substructure::BodyDescription> bodies;
    std::vector<latin::substructure::InterfaceDescription> interfaces;
    std::vector<latin::substructure::LawParameter> parameters;
    for (Index i = 0; i < count; ++i) {
      const std::string name = "block" + std::to_string(i);
      const std::string floor = "floor" + std::to_string(i);
      const std::string springs = "springs" + std::to_string(i);
      bodies.push_back({name, 4, {{name, shared, {}, load, {}}}, {}});
      for (const int node : {0, 1}) {
        SparseRows trace(2, 4);
        trace.insert(0, 2 * node) = 1.0;
        trace.insert(1, 2 * node + 1) = 1.0;
        interfaces.push_back({node == 0 ? floor : springs,
                              node == 0 ? "coulomb" : "elastic",
                              area,
                              frame,
                              {{name, trace, Vector::Constant(2, direction), 1.0}}});
      }
      parameters.push_back({floor, "friction", Matrix::Constant(1, 1, friction)});
      parameters.push_back({springs, "normal", Matrix::Constant(1, 1, spring)});
      parameters.push_back({springs, "tangential", Matrix::Constant(1, 1, spring)});
    }
    return latin::substructure::Laws(
               std::make_shared<const latin::substructure::Structure>(
                   std::move(bodies), std::move(interfaces),
                   latin::substructure::OperatorOptions{.keep_operator = whole}))
        .with_parameters(parameters);
  }

  /// Sidewise displacement of the pushed node per force of block and spring in series.
  [[nodiscard]] double compliance() const { return 1.0 + 1.0 / spring; }
};

/// A state with both stages behind it.
struct Evaluated {
  Matrix amplitudes;
  latin::iteration::Stages stages;
  latin::iteration::State state;
  Matrix residual;

  Evaluated(const latin::substructure::Laws& laws, Matrix loads, Matrix data = {})
      : amplitudes(std::move(loads)), stages(laws, amplitudes, false) {
    const Index rows = laws.structure().rows();
    state.data = data.size() > 0 ? std::move(data) : Matrix(Matrix::Zero(rows, amplitudes.cols()));
    state.traces.resize(rows, amplitudes.cols());
    residual.resize(rows, amplitudes.cols());
    evaluate();
  }
  void evaluate() { stages.evaluate({state, residual}); }
  [[nodiscard]] double norm() const {
    return latin::iteration::metric_of(stages.structure()).norm(residual);
  }
};

}  // namespace chain
