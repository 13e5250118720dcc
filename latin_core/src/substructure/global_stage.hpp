#pragma once

#include <string>
#include <utility>
#include <vector>

#include "common/threads.hpp"
#include "common/workspace.hpp"
#include "substructure/laws.hpp"
#include "substructure/local_stage.hpp"
#include "substructure/size.hpp"

namespace latin::substructure {

/// The global stage of one run: what the bodies answer to interface data and loads.
///
/// Bodies are done side by side on several threads where that pays. It keeps working blocks from one call to the next,
/// so that the iteration allocates none: one object serves one caller.
class GlobalStage {
 public:
  explicit GlobalStage(Laws laws);

  [[nodiscard]] const Laws& laws() const { return laws_; }

  /// How exactly bodies with a random field are solved in the modes of a chaos, see FieldBody; infinity: by their
  /// means alone where nothing is known.
  void set_accuracy_of_fields(double accuracy) { of_fields_ = accuracy; }
  /// w of all sides, (rows, c). Bodies are independent: nothing is communicated.
  /// @param amplitudes (l, c) of the load patterns
  void apply(ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces);
  /// Add to the traces what a change of the data (rows, c) adds to them, in single precision.
  void change(ConstMatrixRef change, MatrixRef traces);
  /// What this rank adds to the imbalance of the moments of the interface forces, see Macro; only where the structure
  /// has a coarse problem.
  /// @param local  of the same laws: what the boundary interfaces have to carry
  [[nodiscard]] Matrix imbalance(LocalStage& local, ConstMatrixRef data, ConstMatrixRef traces);
  /// Balance the moments of the interface forces after a global stage.
  /// @param imbalance of all ranks
  /// @param amplitudes (l, c) of the load patterns
  /// @return what was added to the data, (rows, c)
  [[nodiscard]] Matrix balance(const Matrix& imbalance, ConstMatrixRef amplitudes, MatrixRef data,
                               MatrixRef traces);
  /// Sizes of this rank's part of the global-stage solution with the given data and traces.
  [[nodiscard]] Sizes sizes(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef amplitudes);

 private:
  friend std::vector<std::pair<std::string, Matrix>> displacements(const Laws& laws,
                                                                   ConstMatrixRef data,
                                                                   ConstMatrixRef amplitudes);
  friend std::vector<Matrix> displacements_of(const Laws& laws, std::size_t body,
                                              ConstMatrixRef data, ConstMatrixRef amplitudes);
  /// Working blocks of one thread.
  struct Lane {
    BodyWork work;
    Workspace block;
  };
  /// Call `work(body, lane)` of all bodies.
  template <class Work>
  void of_bodies(double numbers, const Work& work);
  /// What a stage reads and calculates with.
  [[nodiscard]] double numbers(Index columns) const {
    // what is in the cache is calculated with some times as fast as it is read
    return (1.0 + 0.2 * static_cast<double>(columns)) * numbers_;
  }
  /// Those of the columns of a body.
  void add_sizes(std::size_t body, ConstMatrixRef data, ConstMatrixRef traces,
                 ConstMatrixRef amplitudes, const ColumnGroups& groups, Sizes& sizes, Lane& own);
  [[nodiscard]] Vector pressed_energies(std::size_t body, ConstMatrixRef forces,
                                        ConstMatrixRef amplitudes, BodyWork& work);
  void change(std::size_t body, ConstMatrixRef change, MatrixRef traces, Lane& own);
  /// w of the sides of one body: with the stiffness that it has, with factors, and with a field.
  void apply(std::size_t body, ConstMatrixRef data, ConstMatrixRef amplitudes, MatrixRef traces,
             BodyWork& work);
  void apply_scaled(std::size_t body, ConstMatrixRef data, ConstMatrixRef amplitudes,
                    MatrixRef traces, BodyWork& work);
  void apply_field(std::size_t body, ConstMatrixRef data, ConstMatrixRef amplitudes,
                   MatrixRef traces, BodyWork& work);
  [[nodiscard]] Vector energies_of_field(std::size_t body, ConstMatrixRef data,
                                         ConstMatrixRef traces, ConstMatrixRef forces,
                                         ConstMatrixRef amplitudes, BodyWork& work);

  /// Displacements of each member of a body, (n, c).
  [[nodiscard]] std::vector<Matrix> displacements(std::size_t body, ConstMatrixRef data,
                                                  ConstMatrixRef amplitudes, Lane& own);

  Laws laws_;
  double of_fields_ = FieldBody::exact;
  std::vector<std::size_t> largest_first_;  ///< bodies
  double numbers_ = 0.0;                    ///< that a stage reads for one column
  PerLane<Lane> lanes_;
};

/// Displacements (n, c) of every substructure of this rank, by name.
[[nodiscard]] std::vector<std::pair<std::string, Matrix>> displacements(const Laws& laws,
                                                                        ConstMatrixRef data,
                                                                        ConstMatrixRef amplitudes);

/// Those of the members of one body, in their order.
[[nodiscard]] std::vector<Matrix> displacements_of(const Laws& laws, std::size_t body,
                                                   ConstMatrixRef data, ConstMatrixRef amplitudes);

}  // namespace latin::substructure
