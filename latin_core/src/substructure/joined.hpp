#pragma once

#include <vector>

#include "latin/common/types.hpp"
#include "substructure/laws.hpp"

namespace latin::substructure {

/// The condensed bodies and the active interfaces of all ranks as one structure, known to each of them: what is
/// solved for the whole at once is solved on every rank alike.
///
/// Rows, active unknowns and interface unknowns are those of the first rank, then those of the second, and so on;
/// an interface between two ranks counts with its first side. On one rank they are those of the structure.
/// Every member that takes or makes a table is collective.
class Joined {
 public:
  struct JoinedBody {
    Index first_row = 0;
    Matrix stiffness;       ///< S on its active unknowns, the lower triangle
    SparseRows traces;      ///< of these, (rows, active)
    double stiffest = 0.0;  ///< see Body::stiffest()
    bool unloaded = true;   ///< see Body::unloaded()
  };
  struct JoinedInterface {
    Index components = 0;
    Index size = 0;  ///< components * points
    Index first_unknown = 0;
    std::vector<Index> rows;  ///< first row of each side
    Vector weights;           ///< (size)
    Vector flexibility;       ///< (size)
  };

  /// @throws NumericalError on all ranks where a body cannot be condensed on one
  explicit Joined(const Structure& structure) : Joined(structure, nullptr) {}
  /// With the factors that laws give to the stiffness of bodies in all their columns; of a chaos, with those of the
  /// means.
  explicit Joined(const Laws& laws) : Joined(laws.structure(), &laws) {}
  /// Rows and interfaces alone, without what the bodies are: their matrices are empty.
  [[nodiscard]] static Joined numbered(const Structure& structure) {
    return {structure, nullptr, false};
  }

  [[nodiscard]] Index rows() const { return weights_.size(); }
  [[nodiscard]] Index active() const { return first_active_.back(); }
  [[nodiscard]] Index unknowns() const { return unknowns_; }
  [[nodiscard]] const std::vector<JoinedBody>& bodies() const { return bodies_; }
  [[nodiscard]] const std::vector<JoinedInterface>& interfaces() const { return interfaces_; }
  /// First active unknown of every body, and one past the last.
  [[nodiscard]] const std::vector<Index>& first_active() const { return first_active_; }
  /// The first of this rank's bodies and rows.
  [[nodiscard]] Index first_body() const { return first_body_; }
  [[nodiscard]] Index first_row() const { return first_row_; }
  /// First unknown here of every interface of this rank.
  [[nodiscard]] const std::vector<Index>& first_unknowns() const { return first_unknowns_; }
  /// Areas W and search directions k, (rows).
  [[nodiscard]] const Vector& weights() const { return weights_; }
  [[nodiscard]] const Vector& directions() const { return directions_; }
  /// What displacements are measured with, (rows), see SideDescription::scale.
  [[nodiscard]] const Vector& scales() const { return scales_; }
  /// See Structure::levers(), (rows).
  [[nodiscard]] const Vector& levers() const { return levers_; }

  /// Tables of this rank's rows, (own rows, c), into that of all, (rows, c).
  [[nodiscard]] Matrix of_rows(ConstMatrixRef own) const;
  /// Tables of the active unknowns of this rank's bodies, (own active, c), into that of all, (active, c).
  [[nodiscard]] Matrix of_active(ConstMatrixRef own) const;
  /// Tables of this rank's interface unknowns (own unknowns, c) into that of all, (unknowns, c).
  [[nodiscard]] Matrix of_unknowns(const Matrix& own) const;
  /// And back: those of this rank, of tables of all. Not collective.
  [[nodiscard]] Matrix own_rows(ConstMatrixRef all) const {
    return all.middleRows(first_row_, structure_.rows());
  }
  [[nodiscard]] Matrix own_unknowns(ConstMatrixRef all) const;
  /// A flexibility (unknowns) as laws may be asked at it: one for all components of a point, and at least a hundredth of
  /// the mean over all points.
  [[nodiscard]] Vector of_points(Vector flexibility) const;
  /// The most components that an interface has.
  [[nodiscard]] Index most_components() const { return most_components_; }

 private:
  Joined(const Structure& structure, const Laws* laws, bool bodies = true);
  void take_own(const Laws* laws, bool matrices);
  void number_interfaces();
  void exchange();
  [[nodiscard]] std::vector<double> packed() const;
  void unpack(const std::vector<std::vector<double>>& of_ranks);

  const Structure& structure_;
  std::vector<JoinedBody> bodies_;
  std::vector<JoinedInterface> interfaces_;
  std::vector<Index> first_active_{0};
  Index first_body_ = 0;
  Index first_row_ = 0;
  Index unknowns_ = 0;
  Index most_components_ = 0;
  Vector weights_;
  Vector directions_;
  Vector scales_;
  Vector levers_;
  /// Interfaces of this rank that it speaks for: with their first side here.
  std::vector<std::size_t> spoken_for_;
  std::vector<Index> first_unknowns_;
  // of every rank
  std::vector<Index> rows_of_ranks_;
  std::vector<Index> active_of_ranks_;
  std::vector<Index> unknowns_of_ranks_;
};

}  // namespace latin::substructure
