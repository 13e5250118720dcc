#pragma once

#include "chain.hpp"

namespace chain {

/// Bars end to end, held at the left and pulled at the right, both by interfaces: no spring outlasts the
/// iteration, so that only the coarse problem tells one end what happens at the other.
struct Bars {
  Index parts = 8;
  bool macro = true;
  bool paired = true;
  double stiffness = 3.0;  ///< of every joint; infinite: perfect
  double direction = 1.3;
  std::string joint_law = "elastic";
  latin::substructure::OperatorKind kind = latin::substructure::OperatorKind::automatic;

  static constexpr Index nodes = 5;
  static constexpr double force = 2.0;

  [[nodiscard]] latin::substructure::Laws build() const {
    std::vector<latin::substructure::BodyDescription> bodies;
    std::vector<latin::substructure::InterfaceDescription> interfaces;
    const auto side = [this](Index part, Index node, double factor = 1.0) {
      return latin::substructure::SideDescription{"bar" + std::to_string(part), at(node, nodes),
                                                  Vector::Constant(1, factor * direction), 1.0};
    };
    const Matrix one = Matrix::Ones(1, 1);
    const Vector area = Vector::Ones(1);
    const Matrix basis = macro ? one : Matrix{};
    for (Index part = 0; part < parts; ++part) {
      const std::string name = "bar" + std::to_string(part);
      bodies.push_back(
          {name, nodes, {{name, shared_bar(nodes), {}, Matrix::Zero(nodes, 1), {}}}, {}});
      if (part > 0) {
        interfaces.push_back({"joint" + std::to_string(part),
                              joint_law,
                              area,
                              one,
                              {side(part - 1, nodes - 1), side(part, 0)},
                              basis,
                              paired});
      }
    }
    const double far = paired ? 1e3 : 1.0;
    interfaces.push_back({"wall", "perfect", area, one, {side(0, 0, far)}, {}, paired});
    interfaces.push_back(
        {"pull", "force", area, one, {side(parts - 1, nodes - 1, 1.0 / far)}, basis, paired});
    latin::substructure::OperatorOptions options;
    options.kind = kind;
    std::vector<latin::substructure::LawParameter> parameters{
        {"pull", "force", Matrix::Constant(1, 1, force)}};
    for (Index part = 1; part < parts && joint_law == "elastic"; ++part) {
      parameters.push_back(
          {"joint" + std::to_string(part), "normal", Matrix::Constant(1, 1, stiffness)});
    }
    return latin::substructure::Laws(std::make_shared<const latin::substructure::Structure>(
                                         std::move(bodies), std::move(interfaces), options))
        .with_parameters(parameters);
  }

  /// Bars and springs in series.
  [[nodiscard]] double exact() const {
    const double joints = joint_law == "elastic" ? static_cast<double>(parts - 1) / stiffness : 0.0;
    return force * (static_cast<double>(parts) + joints);
  }
};

inline latin::iteration::Summary solved(const latin::substructure::Laws& laws,
                                        latin::iteration::State& state, Index acceleration = 10,
                                        double rtol = 1e-6) {
  latin::iteration::Options settings = options(acceleration, rtol);
  settings.max_iterations = 300;
  return latin::iteration::solve(laws, settings, Matrix::Ones(1, 1), state, {}, {});
}

}  // namespace chain
