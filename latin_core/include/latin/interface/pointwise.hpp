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
  static constexpr std::size_t memory = memory_of<L>;

  [[nodiscard]] std::string name() const override { return L::name; }
  [[nodiscard]] bool history() const override { return memory > 0; }
  /// By L::slopes(jump, flexibility, p[, state], slopes), where there is one: as resolve(), but the derivatives
  /// into a span of components x components, row by row, and the state is only read.
  [[nodiscard]] bool slopes(const LocalProblem& problem, Index column,
                            MatrixRef slopes) const override {
    if constexpr (memory > 0) {
      using State = std::array<double, memory>;
      if constexpr (requires(const L& law, PointValues v, std::array<double, count> p,
                             const State& s, PointForce f) { law.slopes(v, v, p, s, f); }) {
        // what the law remembers
        const Index first = column - column % problem.steps;
        Matrix force(problem.jump.rows(), 1);
        std::vector<State> states(problem.jump.rows() / problem.components);
        for (Index before = first; before < column; ++before) {
          each(problem, before,
               [&](Index point, PointValues jump, PointValues flexibility, const auto& p) {
                 const PointForce answer(&force(problem.components * point, 0), jump.size());
                 L{}.resolve(jump, flexibility, p, states[point], answer);
               });
        }
        each(problem, column,
             [&](Index point, PointValues jump, PointValues flexibility, const auto& p) {
               write(slopes, point, jump.size(), [&](PointForce answer) {
                 L{}.slopes(jump, flexibility, p, states[point], answer);
               });
             });
        return true;
      }
    } else if constexpr (requires(const L& law, PointValues v, std::array<double, count> p,
                                  PointForce f) { law.slopes(v, v, p, f); }) {
      each(problem, column,
           [&](Index point, PointValues jump, PointValues flexibility, const auto& p) {
             write(slopes, point, jump.size(),
                   [&](PointForce answer) { L{}.slopes(jump, flexibility, p, answer); });
           });
      return true;
    }
    return false;
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
    const ParameterField& imposed = get("jump");
    std::array<const ParameterField*, count> fields;
    std::ranges::transform(L::parameters, fields.begin(),
                           [this](const Parameter& each) { return &get(each.name); });
    const Index components = problem.components;
    const Index points = force.rows() / components;
    const auto size = static_cast<std::size_t>(components);
    std::vector<double> jump(size);
    std::array<double, count> values;
    std::vector<std::array<double, memory>> states(memory > 0 ? points : 0);
    [[maybe_unused]] const L law{};
    Index point = 0;
    Index column = 0;
    try {
      for (; column < force.cols(); ++column) {
        if (memory > 0 && column % problem.steps == 0) {
          std::ranges::fill(states, std::array<double, memory>{});
        }
        for (point = 0; point < points; ++point) {
          const Index row = components * point;
          for (std::size_t a = 0; a < size; ++a) {
            const Index at = row + static_cast<Index>(a);
            jump[a] = problem.jump(at, column) - imposed(at, column);
          }
          for (std::size_t i = 0; i < count; ++i) {
            values[i] = (*fields[i])(point, column);
          }
          const PointValues flexibility(problem.flexibility.data() + row, size);
          const PointForce answer(&force(row, column), size);
          if constexpr (memory > 0) {
            law.resolve(jump, flexibility, values, states[point], answer);
          } else {
            law.resolve(jump, flexibility, values, answer);
          }
          constexpr auto finite = [](double value) { return std::isfinite(value); };
          // a diverging iteration is the solver's to report
          if (!std::ranges::all_of(answer, finite) && std::ranges::all_of(jump, finite)) {
            throw NumericalError("its force is not finite for a jump of " + text(jump));
          }
        }
      }
    } catch (const InputError& error) {
      throw InputError(where(problem, point, column) + error.what());
    } catch (const std::exception& error) {
      throw NumericalError(where(problem, point, column) + error.what());
    }
  }

 private:
  /// Call with point, free jump less the imposed one, flexibility and parameters, for all points of a column.
  template <class F>
  void each(const LocalProblem& problem, Index column, const F& call) const {
    const ParameterField& imposed = get("jump");
    std::array<const ParameterField*, count> fields;
    std::ranges::transform(L::parameters, fields.begin(),
                           [this](const Parameter& each) { return &get(each.name); });
    const auto size = static_cast<std::size_t>(problem.components);
    std::vector<double> jump(size);
    std::array<double, count> values;
    for (Index point = 0; point < problem.jump.rows() / problem.components; ++point) {
      const Index row = problem.components * point;
      for (std::size_t a = 0; a < size; ++a) {
        const Index at = row + static_cast<Index>(a);
        jump[a] = problem.jump(at, column) - imposed(at, column);
      }
      for (std::size_t i = 0; i < count; ++i) {
        values[i] = (*fields[i])(point, column);
      }
      call(point, PointValues(jump), PointValues(problem.flexibility.data() + row, size), values);
    }
  }
  template <class F>
  static void write(MatrixRef slopes, Index point, std::size_t size, const F& find) {
    std::vector<double> block(size * size);
    find(PointForce(block));
    for (std::size_t i = 0; i < block.size(); ++i) {
      slopes(static_cast<Index>(size) * point + static_cast<Index>(i / size),
             static_cast<Index>(i % size)) = block[i];
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

}  // namespace latin::interface
