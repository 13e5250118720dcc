#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "iteration/solver.hpp"
#include "substructure/global_stage.hpp"
#include "substructure/laws.hpp"
#include "substructure/local_stage.hpp"

/// One-dimensional bars end to end: the smallest scene in which every part of the kernel has work to do.
namespace chain {

using latin::Index;
using latin::Matrix;
using latin::SparseRows;
using latin::Vector;

/// Stiffness of a bar of `n` nodes, axial stiffness `ea`, unit length.
inline SparseRows bar(Index n, double ea = 1.0) {
  SparseRows k(n, n);
  const double element = ea * static_cast<double>(n - 1);
  for (Index i = 0; i + 1 < n; ++i) {
    k.coeffRef(i, i) += element;
    k.coeffRef(i + 1, i + 1) += element;
    k.coeffRef(i, i + 1) -= element;
    k.coeffRef(i + 1, i) -= element;
  }
  k.makeCompressed();
  return k;
}

inline std::shared_ptr<const latin::SparseView> shared_bar(Index n) {
  return latin::owning_view(bar(n));
}

inline SparseRows at(Index node, Index n) {
  SparseRows trace(1, n);
  trace.insert(0, node) = 1.0;
  trace.makeCompressed();
  return trace;
}

inline Matrix end_load(Index n, double value) {
  Matrix load = Matrix::Zero(n, 1);
  load(n - 1, 0) = value;
  return load;
}

/// Bars "bar0".."bar{parts-1}", held at the left ("wall"), joined by "joint1"..., pulled at the right.
struct Scene {
  Index parts = 2;
  Index nodes = 5;
  double force = 2.0;
  double stiffness = 3.0;  ///< of every joint
  double jump = 0.0;
  double direction = 1.3;
  latin::substructure::OperatorOptions options{};

  [[nodiscard]] latin::substructure::Laws build() const {
    std::vector<latin::substructure::BodyDescription> bodies;
    std::vector<latin::substructure::InterfaceDescription> interfaces;
    const auto side = [this](Index part, Index node) {
      return latin::substructure::SideDescription{"bar" + std::to_string(part), at(node, nodes),
                                                  Vector::Constant(1, direction), 1.0};
    };
    const Matrix frame = Matrix::Ones(1, 1);
    const Vector area = Vector::Ones(1);
    for (Index part = 0; part < parts; ++part) {
      const std::string name = "bar" + std::to_string(part);
      bodies.push_back(
          {name,
           nodes,
           {{name, shared_bar(nodes), {}, end_load(nodes, part + 1 == parts ? force : 0.0), {}}},
           {}});
      if (part == 0) {
        interfaces.push_back({"wall", "perfect", area, frame, {side(0, 0)}});
      } else {
        interfaces.push_back({"joint" + std::to_string(part),
                              "elastic",
                              area,
                              frame,
                              {side(part - 1, nodes - 1), side(part, 0)}});
      }
    }
    std::vector<latin::substructure::LawParameter> parameters;
    for (Index part = 1; part < parts; ++part) {
      const std::string joint = "joint" + std::to_string(part);
      parameters.push_back({joint, "normal", Matrix::Constant(1, 1, stiffness)});
      parameters.push_back({joint, "jump", Matrix::Constant(1, 1, jump)});
    }
    return latin::substructure::Laws(std::make_shared<const latin::substructure::Structure>(
                                         std::move(bodies), std::move(interfaces), options))
        .with_parameters(parameters);
  }

  /// Displacement of the pulled end: bars and springs in series, plus the imposed jumps.
  [[nodiscard]] double exact() const {
    const auto joints = static_cast<double>(parts - 1);
    return force * (static_cast<double>(parts) + joints / stiffness) + joints * jump;
  }
};

inline latin::iteration::Options options(Index acceleration = 10, double rtol = 1e-10) {
  return {rtol, false, 5000, acceleration, 1.0, 200, 1500, 15, 1};
}

inline double end_displacement(const latin::substructure::Laws& laws,
                               const latin::iteration::State& state) {
  const auto fields = latin::substructure::displacements(laws, state.data, Matrix::Ones(1, 1));
  const Matrix& last = fields.back().second;
  return last(last.rows() - 1, 0);
}

}  // namespace chain
