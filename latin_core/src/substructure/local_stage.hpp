#pragma once

#include <string>
#include <utility>
#include <vector>

#include "common/exchange.hpp"
#include "common/threads.hpp"
#include "common/workspace.hpp"
#include "latin/common/communicator.hpp"
#include "substructure/laws.hpp"

namespace latin::substructure {

/// What a side on this rank adds to (side 2: takes from) the free jump of its interface: s / k - 2 w, (rows, c).
void share_of_jump(const Structure& structure, const ActiveInterface& interface, std::size_t side,
                   ConstMatrixRef data, ConstMatrixRef traces, MatrixRef share);

/// f^ of one interface on its first side and the jump w^2 - w^1, both (components * points, c), as the
/// local stage leaves them: the law holds exactly between them.
struct LocalFields {
  Matrix force;
  Matrix jump;
};

/// The local stage of one run: the laws, point by point, for blocks of a fixed number of columns.
///
/// Interfaces with laws of the library are done side by side on several threads where that pays, laws of others by the
/// caller. It keeps working blocks from one call to the next, so that the iteration allocates none: one object serves
/// one caller.
class LocalStage {
 public:
  /// @throws InputError naming the interface if the laws do not fit this many columns
  LocalStage(Laws laws, Index columns);

  [[nodiscard]] const Laws& laws() const { return laws_; }
  [[nodiscard]] Index columns() const { return columns_; }

  /// r = f^ + k w^ - s, (rows, c). Collective among neighbours.
  void apply(ConstMatrixRef data, ConstMatrixRef traces, MatrixRef residual);
  /// Collective among the interface's ranks.
  [[nodiscard]] LocalFields fields(std::size_t interface, ConstMatrixRef data,
                                   ConstMatrixRef traces);
  /// Force f^ of an interface whose sides are on this rank; valid until the next call.
  [[nodiscard]] Eigen::Map<Matrix> force(std::size_t interface, ConstMatrixRef data,
                                         ConstMatrixRef traces);
  /// Forces of all interfaces (unknowns, c), on one rank, for free jumps (unknowns, c) that belong to a flexibility of
  /// nothing: what rigid laws answer is not finite.
  /// @param asked which interfaces are asked, by their number; empty: all. Forces of the others are left as they are
  void forces_of_jumps(ConstMatrixRef jumps, MatrixRef forces, const std::vector<bool>& asked = {});

 private:
  using Block = Eigen::Map<Matrix>;
  /// Working blocks of one thread.
  struct Lane {
    Workspace jump;
    Workspace share;
    Workspace force;
    Workspace samples;
    Workspace sample_forces;
    Workspace back;
  };
  [[nodiscard]] Block free_jump(const ActiveInterface& interface, ConstMatrixRef data,
                                ConstMatrixRef traces, ConstMatrixRef away, Lane& own) const;
  [[nodiscard]] Block resolve(std::size_t interface, const Block& free_jump,
                              const Vector& flexibility, Lane& own) const;
  [[nodiscard]] Block ask(const ActiveInterface& interface, const interface::Law& law,
                          const Block& jump, const Vector& flexibility, Workspace& work) const;
  void apply(std::size_t interface, ConstMatrixRef data, ConstMatrixRef traces, ConstMatrixRef away,
             MatrixRef residual, Lane& own) const;
  [[nodiscard]] Lane& caller() { return lanes_[0]; }

  Laws laws_;
  Index columns_;
  Exchange exchange_;
  std::vector<std::size_t> slots_;  ///< in the exchange, of the shared interfaces in their order
  std::vector<std::size_t> by_caller_;  ///< interfaces inside this rank with laws of others
  std::vector<std::size_t> in_lanes_;   ///< interfaces inside this rank, the largest first
  double numbers_ = 0.0;                ///< that the latter calculate with
  PerLane<Lane> lanes_;
};

/// The law of one interface, column by column and without transforms, for a given free jump j0
/// (components * points, c): what a chaos is evaluated with sample by sample.
/// @param parameters replace those of the law, c columns or one each
/// @throws InputError naming the interface on a wrong name, shape or value
[[nodiscard]] LocalFields resolve_samples(
    const Laws& laws, std::size_t interface, ConstMatrixRef free_jump,
    const std::vector<std::pair<std::string, Matrix>>& parameters);

}  // namespace latin::substructure
