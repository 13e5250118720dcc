#pragma once

#include <limits>
#include <map>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "stochastic/coupling.hpp"
#include "substructure/body.hpp"

namespace latin::substructure {

/// A body whose stiffness has a random field in it, in the modes of a chaos:
///
///     (A + D) q = F + T^T W s,   D = sum B^T (a - 1) B  projected on the modes,
///
/// with A the operator that is factorised, of the means. Conjugate gradients with A as preconditioner; A itself is
/// not applied in them, for it is known on every search direction. They start from the last solution, which is kept: what
/// was solved last is not solved again. Several threads may use it, one after the other.
class FieldBody {
 public:
  using Couplings = std::map<std::string, std::shared_ptr<const stochastic::Coupling>>;
  /// What conjugate gradients leave, relative to the solution in the norm of the energy, unless told otherwise.
  static constexpr double exact = 1e-12;
  /// @param body   must outlive this object
  /// @param extra  (n_body, l) forces added to the load patterns, or empty
  /// @param couplings of a - 1, by member of the body
  FieldBody(const Body& body, Matrix extra, const Couplings& couplings);

  /// w of all sides, (rows, c). @throws NumericalError if the operator is not positive definite
  void apply(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces,
             double accuracy = exact) const;
  /// The same without loads, and as exact as changes have to be.
  void change(ConstMatrixRef data, MatrixRef traces) const;
  /// Parts of the strain energies (c), which have the sum over the modes of every step.
  [[nodiscard]] Vector energies(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                double accuracy = exact) const;
  /// Displacements of each member, (n, c); those of the last solution with these data as exact as they are.
  [[nodiscard]] std::vector<Matrix> displacements(ConstMatrixRef data,
                                                  ConstMatrixRef amplitudes) const;
  [[nodiscard]] Index modes() const { return couplings_.front()->modes(); }

  // where the structure is solved as a whole
  /// D q, added: (n_body, c) both.
  void add_change(const Matrix& unknowns, Matrix& forces) const;
  /// What the last solution leaves of the equations, (n_body, c).
  [[nodiscard]] Matrix left() const;
  /// Change the last solution by a step, (n_body, c).
  void advance(const Matrix& step) const;

 private:
  /// The last solution.
  struct Work {
    Matrix data;
    Matrix amplitudes;
    Matrix forces;    ///< F + T^T W s
    Matrix unknowns;  ///< q
    Matrix of_means;  ///< A q
    double accuracy = std::numeric_limits<double>::infinity();
  };
  /// (a - 1) times stretches (points * components, c).
  [[nodiscard]] Matrix coupled(std::size_t part, const Matrix& stretch) const;
  [[nodiscard]] bool solved(ConstMatrixRef data, ConstMatrixRef amplitudes) const;
  void solve(ConstMatrixRef data, ConstMatrixRef amplitudes, double accuracy) const;
  [[nodiscard]] Matrix forces_of(ConstMatrixRef data, ConstMatrixRef amplitudes) const;
  /// @param forces (n_body, c), replaced by what is left of them
  void iterate(Matrix& forces, Work& work, double accuracy) const;

  const Body* body_;
  Matrix extra_;
  std::vector<const Stretch*> stretches_;
  std::vector<std::shared_ptr<const stochastic::Coupling>> couplings_;
  mutable std::mutex mutex_;
  mutable Work work_;
};

/// A body with a field in the columns of a run: modes of a chaos, or samples.
struct FieldColumns {
  std::shared_ptr<const FieldBody> chaos;  ///< null: samples
  std::vector<Matrix> factors;       ///< of samples, (points, samples) of every stretch of the body
  std::shared_ptr<const Body> body;  ///< of a single sample
  LoadResponse response;             ///< its answer to the load patterns
  Matrix extra;                      ///< (n_body, l) forces added to these

  /// Number of blocks of columns.
  [[nodiscard]] Index blocks() const {
    return chaos != nullptr ? chaos->modes() : factors.front().cols();
  }
  /// The body in one of the samples, factorised.
  [[nodiscard]] std::shared_ptr<const Body> sample(const Body& mean, Index number) const;
  /// Displacements of each member, (n, c), of samples of a body: every one is a factorisation.
  [[nodiscard]] std::vector<Matrix> displacements(const Body& mean, ConstMatrixRef data,
                                                  ConstMatrixRef amplitudes) const;
};

}  // namespace latin::substructure
