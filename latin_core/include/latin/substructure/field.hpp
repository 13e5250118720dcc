#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "latin/stochastic/coupling.hpp"
#include "latin/substructure/body.hpp"

namespace latin::substructure {

/// What the equations of a body with a random field are solved from: the solution before, and the operator of the
/// means on it.
struct FieldWork {
  Matrix unknowns;
  Matrix of_means;
};

/// A body whose stiffness has a random field in it, in the modes of a chaos:
///
///     (A + D) q = F + T^T W s,   D = sum B^T (a - 1) B  projected on the modes,
///
/// with A the operator that is factorised, of the means. Conjugate gradients with A as preconditioner; A itself is
/// never applied, for it is known on every search direction. Constant; several threads may use it, each with a
/// FieldWork of its own.
class FieldBody {
 public:
  using Couplings = std::map<std::string, std::shared_ptr<const stochastic::Coupling>>;
  /// @param body   must outlive this object
  /// @param extra  (n_body, l) forces added to the load patterns, or empty
  /// @param couplings of a - 1, by member of the body
  FieldBody(const Body& body, Matrix extra, const Couplings& couplings);

  /// w of all sides, (rows, c). @throws NumericalError if the operator is not positive definite
  void apply(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces,
             FieldWork& work) const;
  /// The same without loads, and as exact as changes have to be.
  void change(ConstMatrixRef data, MatrixRef traces) const;
  /// Parts of the strain energies (c), which have the sum over the modes of every step.
  [[nodiscard]] Vector energies(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                FieldWork& work) const;
  /// Displacements of each member, (n, c).
  [[nodiscard]] std::vector<Matrix> displacements(ConstMatrixRef data, ConstMatrixRef amplitudes,
                                                  FieldWork& work) const;
  [[nodiscard]] Index modes() const { return couplings_.front()->modes(); }

 private:
  /// D q, added.
  void add_change(const Matrix& unknowns, Matrix& forces) const;
  /// (a - 1) times stretches (points * components, c).
  [[nodiscard]] Matrix coupled(std::size_t part, const Matrix& stretch) const;
  void solve(ConstMatrixRef data, ConstMatrixRef amplitudes, FieldWork& work) const;
  /// @param forces (n_body, c), replaced by what is left of them
  void iterate(Matrix& forces, FieldWork& work, double tolerance) const;

  const Body* body_;
  Matrix extra_;
  std::vector<const Stretch*> stretches_;
  std::vector<std::shared_ptr<const stochastic::Coupling>> couplings_;
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
  /// The body of one sample.
  [[nodiscard]] std::shared_ptr<const Body> sample(const Body& mean, Index number) const;
};

}  // namespace latin::substructure
