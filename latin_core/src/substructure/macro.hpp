#pragma once

#include <memory>
#include <string>
#include <vector>

#include "algebra/factor.hpp"
#include "latin/common/communicator.hpp"
#include "substructure/body.hpp"

namespace latin::substructure {

/// An interface in the coarse problem.
struct MacroInterface {
  std::string name;
  std::vector<Index>
      rows;      ///< first row of each of its sides in the stacked blocks; -1: on another rank
  Matrix basis;  ///< Z (rows of a side, moments): displacements that both sides share
};

/// Coarse (macro) problem: makes the forces of the two sides of every interface balance in their resultant and
/// moments.
///
/// The global stage leaves f = s - k w on every side by itself. Here a few displacements Z lambda of the
/// interfaces, the same for both sides, are added to it, so that
///
///     sum over sides  Z^T W f = 0,      f = s + k Z lambda - k w,      w = A (s + k Z lambda) + loads
///
/// (Ladeveze, Nouy 2003: multiscale LATIN). It holds for the answer whatever the law between the sides is,
/// where lambda vanishes. So the answer is the same, but a load reaches all substructures within one iteration
/// instead of one more substructure per iteration. The matrix is that of the structure with every body reduced
/// to its moments and held by the springs k; it is sparse and factorised once.
///
/// On several ranks the moments are those of all interfaces, numbered alike on all ranks, and every rank has the
/// factor: a correction takes one sum over the ranks, of the imbalance.
class Macro {
 public:
  /// Collective.
  /// @param first_rows of the bodies in the stacked blocks
  /// @param interfaces that touch bodies of this rank; one between two ranks is given on both, with the same basis
  /// @throws NumericalError if a coarse motion costs no energy: nothing holds the structure
  Macro(const std::vector<Body>& bodies, const std::vector<Index>& first_rows,
        const std::vector<MacroInterface>& interfaces, const Communicator& communicator = {});

  /// Moments of all ranks.
  [[nodiscard]] Index size() const { return size_; }
  /// What the bodies of this rank add to the imbalance of the moments, (size, c).
  /// @param forces f (rows, c), less what a boundary interface has to carry
  [[nodiscard]] Matrix imbalance(ConstMatrixRef forces) const;
  /// Balance the forces.
  /// @param imbalance of all ranks
  /// @param data   s (rows, c), corrected  @param traces w (rows, c), corrected
  /// @return what was added to the data (rows, c)
  [[nodiscard]] Matrix correct(const Matrix& imbalance, MatrixRef data, MatrixRef traces) const;

 private:
  struct Part {
    Index first_row;
    std::vector<Index> moments;  ///< coarse unknowns that the body sees
    Matrix basis;                ///< W Z (rows of the body, moments)
    Matrix data;                 ///< k Z
    Matrix traces;               ///< A k Z
  };

  [[nodiscard]] std::vector<Index> number(const std::vector<MacroInterface>& interfaces,
                                          const Communicator& communicator);
  void factorise(const std::vector<std::vector<double>>& entries);

  Index size_ = 0;
  std::vector<Part> parts_;
  std::unique_ptr<algebra::Factor> factor_;
};

}  // namespace latin::substructure
