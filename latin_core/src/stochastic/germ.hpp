#pragma once

#include <functional>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "latin/common/types.hpp"

namespace latin::stochastic {

/// Three-term recurrence of the polynomials psi_k that are orthonormal under a probability measure:
///
///     x psi_k = beta_{k+1} psi_{k+1} + alpha_k psi_k + beta_k psi_{k-1},   psi_0 = 1, psi_{-1} =
//0. /
/// n coefficients describe the degrees 0 .. n-1 and the Gauss rule of n points. beta_0 = 1 is not
/// used; all other beta are positive, so every psi_k has a positive leading coefficient.
/// Source: W. Gautschi, Orthogonal Polynomials, Oxford 2004, section 1.3.
struct Recurrence {
  Vector alpha;  ///< (n)
  Vector beta;   ///< (n)

  [[nodiscard]] Index length() const { return alpha.size(); }
};

/// Quadrature of an expectation: E[g] ~ sum_s weights_s g(points_s).
struct Rule {
  Matrix points;   ///< (q, L), in germ space
  Vector weights;  ///< (q), sum 1; some are negative in a Smolyak rule
};

/// Gauss rule of `count` points, exact for polynomials of degree 2 count - 1. Nodes ascend.
///
/// Golub and Welsch (1969): the nodes are the eigenvalues of the Jacobi matrix, improved by one
/// Newton step; the weights are 1 / sum_k psi_k^2, which keeps the relative accuracy of the small
/// ones.
/// @throws InputError unless 1 <= count <= recurrence.length()
[[nodiscard]] Rule gauss(const Recurrence& recurrence, Index count);

/// psi_0 .. psi_degree at the points: (points, degree + 1).
/// @throws InputError unless 0 <= degree < recurrence.length()
[[nodiscard]] Matrix evaluate(const Recurrence& recurrence, ConstVectorRef points, Index degree);

/// Recurrence of a discrete measure by the Lanczos process with full reorthogonalisation
/// (Gautschi 2004, section 2.2.3).
/// @param nodes (N) distinct; @param weights (N) positive, sum 1
/// @throws InputError if `length` exceeds N, NumericalError if the measure has numerically fewer
/// atoms
[[nodiscard]] Recurrence lanczos(ConstVectorRef nodes, ConstVectorRef weights, Index length);

/// One independent random variable xi, known by its orthonormal polynomials. Immutable, cheap to
/// copy.
class Germ {
 public:
  static constexpr Index unlimited = std::numeric_limits<Index>::max();

  /// A family of the table below by its name.
  ///
  /// | name     | law of xi                        | parameters                    |
  /// |----------|----------------------------------|-------------------------------|
  /// | hermite  | standard normal                  | none                          |
  /// | legendre | uniform on [-1, 1]               | none                          |
  /// | laguerre | gamma on [0, inf), scale 1       | shape > 0                     |
  /// | jacobi   | beta(a, b) stretched to [-1, 1]  | a > 0 (at -1), b > 0 (at +1)  |
  ///
  /// @throws InputError on an unknown name, or parameters of wrong number or sign
  [[nodiscard]] static Germ family(const std::string& name, std::span<const double> parameters);

  /// Names of the families.
  [[nodiscard]] static std::vector<std::string> families();

  /// Measure with atoms: samples, or a fine quadrature of a density. Equal nodes are merged, atoms
  /// of weight 0 dropped, and the weights scaled to the sum 1.
  /// @param nodes (N); @param weights (N) >= 0
  /// @throws InputError on a NaN, a negative weight, different lengths or no atom
  [[nodiscard]] static Germ from_measure(ConstVectorRef nodes, ConstVectorRef weights);

  /// Any other measure by a finite piece of its recurrence.
  /// @throws InputError unless both have one length > 0 and beta_1, beta_2, ... > 0
  [[nodiscard]] static Germ from_recurrence(Recurrence recurrence);

  /// Family and parameters in words.
  [[nodiscard]] const std::string& name() const { return name_; }

  /// Greatest length that recurrence() can give: `unlimited`, or the number of atoms, or what was
  /// given.
  [[nodiscard]] Index capacity() const { return capacity_; }

  /// @throws InputError unless 1 <= length <= capacity()
  [[nodiscard]] Recurrence recurrence(Index length) const;

  /// Gauss rule of `count` points; points are (count, 1).
  [[nodiscard]] Rule gauss(Index count) const;

  /// The smallest Gauss rule that is exact up to `degree` (all atoms, if there are not more of
  /// them).
  [[nodiscard]] Rule gauss_exact(Index degree) const;

  /// psi_0 .. psi_degree at the points (N): (N, degree + 1).
  [[nodiscard]] Matrix evaluate(ConstVectorRef points, Index degree) const;

 private:
  using Maker = std::function<Recurrence(Index)>;
  Germ(std::string name, Maker maker, Index capacity, bool atomic);

  std::string name_;
  Maker maker_;
  Index capacity_;
  bool atomic_;  ///< the rule with capacity_ points is the measure itself
};

}  // namespace latin::stochastic
