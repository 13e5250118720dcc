#pragma once

#include <string>
#include <utility>
#include <vector>

#include "latin/common/workspace.hpp"
#include "latin/substructure/laws.hpp"
#include "latin/substructure/local_stage.hpp"
#include "latin/substructure/size.hpp"

namespace latin::substructure {

/// The global stage of one run: what the bodies answer to interface data and loads.
///
/// It keeps working blocks from one call to the next, so that the iteration allocates none. One object serves
/// one thread.
class GlobalStage {
 public:
  explicit GlobalStage(Laws laws) : laws_(std::move(laws)) {}

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
  /// w of the sides of one body whose stiffness has factors.
  void apply_scaled(std::size_t body, ConstMatrixRef data, ConstMatrixRef amplitudes,
                    MatrixRef traces);
  /// Sizes of this rank's part of the global-stage solution with the given data and traces.
  [[nodiscard]] Sizes sizes(ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef amplitudes);

 private:
  /// Those of the columns of a body.
  void add_sizes(std::size_t body, ConstMatrixRef data, ConstMatrixRef traces,
                 ConstMatrixRef amplitudes, const ColumnGroups& groups, Sizes& sizes);
  [[nodiscard]] Vector pressed_energies(std::size_t body, ConstMatrixRef forces,
                                        ConstMatrixRef amplitudes);

  /// w of the sides of one body whose stiffness has a field.
  void apply_field(std::size_t body, ConstMatrixRef data, ConstMatrixRef amplitudes,
                   MatrixRef traces);
  [[nodiscard]] Vector energies_of_field(std::size_t body, ConstMatrixRef data,
                                         ConstMatrixRef traces, ConstMatrixRef forces,
                                         ConstMatrixRef amplitudes);

  Laws laws_;
  double of_fields_ = FieldBody::exact;
  BodyWork work_;
  Workspace block_;
};

/// Displacements (n, c) of every substructure of this rank, by name.
[[nodiscard]] std::vector<std::pair<std::string, Matrix>> displacements(const Laws& laws,
                                                                        ConstMatrixRef data,
                                                                        ConstMatrixRef amplitudes);

}  // namespace latin::substructure
