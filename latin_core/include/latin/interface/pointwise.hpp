#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <concepts>
#include <exception>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "latin/interface/law.hpp"

namespace latin::interface {

/// A parameter of a pointwise law: one value a point, zero until it is set.
struct Parameter {
  const char* name;
  double minimum = -std::numeric_limits<double>::infinity();
};

/// The free jump j0 - Delta and the flexibility c > 0 of the unknown components at a point (normal, then
/// tangents), and where the force goes.
using PointValues = std::span<const double>;
using PointForce = std::span<double>;

/// Number of doubles that a law carries from time step to time step at a point: `L::memory`, 0 without it.
template <class L>
inline constexpr std::size_t memory_of = 0;
template <class L>
  requires requires { L::memory; }
inline constexpr std::size_t memory_of<L> = L::memory;

/// A law at one point and one column. A struct with
///
///     static constexpr const char* name = "wire";
///     static constexpr std::array parameters{latin::Parameter{"stiffness", 0.0}, latin::Parameter{"slack"}};
///     static void resolve(PointValues jump, PointValues flexibility, const std::array<double, 2>& p,
///                         PointForce force);
///
/// where resolve() writes the force f = R(jump - flexibility f), see Law; `p` holds the parameters in their
/// order. A law with memory says `static constexpr std::size_t memory = M;` and takes a further argument
/// `std::array<double, M>& state` before the force: zeros in the first step of a history, and in each later
/// one what the step before left in it. `static constexpr bool monotone = true` says that it has one answer for
/// every flexibility, so that a solver may choose that freely. resolve() may throw std::exception: the message is given the
/// interface, the law and the point. It may be called for several interfaces at once.
template <class L>
concept PointwiseLaw =
    std::default_initializable<L> &&
    requires(const L& law, PointValues jump, PointValues flexibility,
             std::array<double, L::parameters.size()> parameters,
             std::array<double, memory_of<L>> state, PointForce force) {
      { L::name } -> std::convertible_to<const char*>;
      { L::parameters[0] } -> std::convertible_to<Parameter>;
      requires(memory_of<L> == 0 && requires {
                law.resolve(jump, flexibility, parameters, force);
              }) || requires { law.resolve(jump, flexibility, parameters, state, force); };
    };

/// The batched Law of a pointwise one. It has the parameters of L and `jump`, the imposed jump Delta (per
/// row, length), which L never sees: f = R(j - Delta).
template <PointwiseLaw L>
class PointwiseLawAdapter final : public Law {
 public:
  static constexpr std::size_t count = L::parameters.size();
  static constexpr std::size_t states = memory_of<L>;
  using State = std::array<double, states>;

  [[nodiscard]] std::string name() const override { return L::name; }
  [[nodiscard]] bool history() const override { return states > 0; }
  [[nodiscard]] Index memory() const override { return static_cast<Index>(states); }
  /// By L::slopes(jump, flexibility, p[, state], slopes), where there is one: as resolve(), but the derivatives
  /// into a span of components x components, row by row, and the state is only read.
  [[nodiscard]] bool slopes(const LocalProblem& problem, Index column,
                            [[maybe_unused]] ConstMatrixRef memory,
                            MatrixRef slopes) const override {
    if constexpr (knows_slopes) {
      const std::size_t size = static_cast<std::size_t>(problem.components);
      std::vector<double> block(size * size);
      State state{};
      Point at(*this, problem);
      for (Index point = 0; point < at.points; ++point) {
        at.read(point, problem.jump, 0, column);
        if constexpr (states > 0) {
          std::copy_n(memory.col(point).data(), states, state.begin());
          L{}.slopes(at.jump(), at.flexibility(), at.values(), std::as_const(state),
                     PointForce(block));
        } else {
          L{}.slopes(at.jump(), at.flexibility(), at.values(), PointForce(block));
        }
        for (std::size_t i = 0; i < block.size(); ++i) {
          slopes(problem.components * point + static_cast<Index>(i / size),
                 static_cast<Index>(i % size)) = block[i];
        }
      }
    }
    return knows_slopes;
  }
  [[nodiscard]] bool prescribes_jumps() const override {
    return requires { L::prescribes_jumps; };
  }
  [[nodiscard]] bool monotone() const override {
    if constexpr (requires { L::monotone; }) {
      return L::monotone;
    }
    return false;
  }
  [[nodiscard]] std::unique_ptr<Law> blank() const override {
    return std::make_unique<PointwiseLawAdapter>();
  }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override {
    std::vector<ParameterInfo> all;
    all.reserve(count + 1);
    for (const Parameter& each : L::parameters) {
      all.push_back({each.name, Shape::per_point, each.minimum});
    }
    all.push_back({"jump", Shape::per_row, -std::numeric_limits<double>::infinity()});
    return all;
  }

  /// @throws NumericalError naming interface, law and point where L throws, or where its answer to finite
  ///         values is not finite; InputError where L throws that
  void resolve(const LocalProblem& problem, MatrixRef force) const override {
    Point at(*this, problem);
    std::vector<State> left(states > 0 ? at.points : 0);
    for (Index column = 0; column < force.cols(); ++column) {
      if (states > 0 && column % problem.steps == 0) {
        std::ranges::fill(left, State{});
      }
      resolve(at, problem, column, column, force.col(column),
              [&left](Index point) { return left.data() + point; });
    }
  }
  [[nodiscard]] bool resolve_column(const LocalProblem& problem, Index column,
                                    [[maybe_unused]] MatrixRef memory,
                                    MatrixRef force) const override {
    Point at(*this, problem);
    State state{};
    std::vector<State> left(states > 0 ? at.points : 0);
    if constexpr (states > 0) {
      for (Index point = 0; point < at.points; ++point) {
        std::copy_n(memory.col(point).data(), states, left[point].begin());
      }
    }
    resolve(at, problem, 0, column, force.col(0),
            [&](Index point) { return states > 0 ? left.data() + point : &state; });
    if constexpr (states > 0) {
      for (Index point = 0; point < at.points; ++point) {
        std::ranges::copy(left[point], memory.col(point).data());
      }
    }
    return true;
  }

 private:
  static constexpr bool knows_slopes = [] {
    if constexpr (states > 0) {
      return requires(const L& law, PointValues v, std::array<double, count> p, const State& s,
                      PointForce f) { law.slopes(v, v, p, s, f); };
    } else {
      return requires(const L& law, PointValues v, std::array<double, count> p, PointForce f) {
        law.slopes(v, v, p, f);
      };
    }
  }();

  /// What the law is given at one point and column: free jump less the imposed one, flexibility and parameters.
  class Point {
   public:
    Point(const PointwiseLawAdapter& law, const LocalProblem& problem)
        : points(problem.jump.rows() / problem.components),
          imposed_(law.get("jump")),
          flexibility_(problem.flexibility),
          jump_(static_cast<std::size_t>(problem.components)) {
      std::ranges::transform(L::parameters, fields_.begin(),
                             [&law](const Parameter& each) { return &law.get(each.name); });
    }
    /// @param from, column where the jump stands in `jumps`, and of which column the parameters are
    void read(Index point, ConstMatrixRef jumps, Index from, Index column) {
      row_ = static_cast<Index>(jump_.size()) * point;
      for (std::size_t a = 0; a < jump_.size(); ++a) {
        const Index at = row_ + static_cast<Index>(a);
        jump_[a] = jumps(at, from) - imposed_(at, column);
      }
      for (std::size_t i = 0; i < count; ++i) {
        values_[i] = (*fields_[i])(point, column);
      }
    }
    [[nodiscard]] const std::vector<double>& jump() const { return jump_; }
    [[nodiscard]] PointValues flexibility() const {
      return {flexibility_.data() + row_, jump_.size()};
    }
    [[nodiscard]] const std::array<double, count>& values() const { return values_; }
    [[nodiscard]] Index row() const { return row_; }

    Index points;

   private:
    const ParameterField& imposed_;
    std::array<const ParameterField*, count> fields_;
    ConstVectorRef flexibility_;
    std::vector<double> jump_;
    std::array<double, count> values_;
    Index row_ = 0;
  };

  /// One column. @param state of a point: where it is
  template <class StateOf>
  void resolve(Point& at, const LocalProblem& problem, Index from, Index column,
               Eigen::Ref<Vector> force, [[maybe_unused]] const StateOf& state) const {
    constexpr auto finite = [](double value) { return std::isfinite(value); };
    [[maybe_unused]] const L law{};
    Index point = 0;
    try {
      for (point = 0; point < at.points; ++point) {
        at.read(point, problem.jump, from, column);
        const PointForce answer(&force(at.row()), at.jump().size());
        if constexpr (states > 0) {
          law.resolve(at.jump(), at.flexibility(), at.values(), *state(point), answer);
        } else {
          law.resolve(at.jump(), at.flexibility(), at.values(), answer);
        }
        // a diverging iteration is the solver's to report
        if (!std::ranges::all_of(answer, finite) && std::ranges::all_of(at.jump(), finite)) {
          throw NumericalError("its force is not finite for a jump of " + text(at.jump()));
        }
      }
    } catch (const InputError& error) {
      throw InputError(where(problem, point, column) + error.what());
    } catch (const std::exception& error) {
      throw NumericalError(where(problem, point, column) + error.what());
    }
  }
  static std::string text(const std::vector<double>& values) {
    std::string shown;
    for (const double value : values) {
      shown += (shown.empty() ? "(" : ", ") + std::to_string(value);
    }
    return shown + ")";
  }
  static std::string where(const LocalProblem& problem, Index point, Index column) {
    return "interface '" + std::string(problem.interface) + "', law '" + L::name + "', point " +
           std::to_string(point) + ", column " + std::to_string(column) + ": ";
  }
};

/// What a module of a user puts into a capsule of the name `law_capsule`. @tparam L a PointwiseLaw, or a
/// Law with a default constructor
template <class L>
  requires PointwiseLaw<L> || (std::derived_from<L, Law> && std::default_initializable<L>)
const LawFactory* law_factory() {
  static const LawFactory factory{law_abi, []() -> std::unique_ptr<Law> {
                                    if constexpr (std::derived_from<L, Law>) {
                                      return std::make_unique<L>();
                                    } else {
                                      return std::make_unique<PointwiseLawAdapter<L>>();
                                    }
                                  }};
  return &factory;
}

/// A pointwise law as that of an interface that is described in C++.
template <PointwiseLaw L>
[[nodiscard]] LawSource law_of() {
  return {std::make_shared<const PointwiseLawAdapter<L>>()};
}

}  // namespace latin::interface
