#pragma once

#include <functional>
#include <memory>
#include <utility>

#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"
#include "substructure/global_stage.hpp"
#include "substructure/interface_system.hpp"
#include "substructure/joined.hpp"

namespace latin::iteration {

/// The bodies and interfaces of all ranks as Newton's method asks for them: in tables of the rows and unknowns of all, see
/// Joined. On one rank they are those of the structure.
///
/// Bodies and laws are asked on the ranks that have them, and every rank gets all answers. So each may compute the same
/// from them; what decides which way it goes must come from follow_first(). Every member that asks is collective.
class JoinedSystem {
 public:
  using Memory = substructure::InterfaceSystem::Memory;
  using Layout = substructure::InterfaceSystem::Layout;

  /// @param global stage of the run; it must outlive this object
  explicit JoinedSystem(substructure::GlobalStage& global);

  [[nodiscard]] const substructure::Laws& laws() const { return system_.laws(); }
  [[nodiscard]] const substructure::InterfaceSystem& own() const { return system_; }
  [[nodiscard]] const substructure::Joined& joined() const { return *joined_; }
  [[nodiscard]] Index unknowns() const { return joined_->unknowns(); }
  /// Areas and search directions, (rows).
  [[nodiscard]] const Vector& weights() const { return joined_->weights(); }
  [[nodiscard]] const Vector& directions() const { return joined_->directions(); }
  /// 1/k1 + 1/k2, (unknowns)
  [[nodiscard]] const Vector& direct() const { return direct_; }
  [[nodiscard]] const Layout& layout() const { return layout_; }

  /// What a rank computes as all do, as the first does it.
  void follow_first(MatrixRef values) const;
  [[nodiscard]] double follow_first(double value) const;
  [[nodiscard]] bool follow_first(bool value) const;

  /// Solve for a state of all ranks, of which this one has its rows.
  template <typename Solve>
  auto with_all(State& state, Solve&& solve) const {
    if (communicator().alone()) {
      return std::forward<Solve>(solve)(state);
    }
    State all{joined_->of_rows(state.data), joined_->of_rows(state.traces)};
    auto outcome = std::forward<Solve>(solve)(all);
    state = {joined_->own_rows(all.data), joined_->own_rows(all.traces)};
    return outcome;
  }

  /// (unknowns) the largest gap and imposed jump of any column, length.
  [[nodiscard]] Vector lengths() const;
  /// (unknowns) 1 where a law softens and remembers: it is not monotone.
  [[nodiscard]] Vector softening() const;
  /// Whether such laws remember more than they did.
  [[nodiscard]] bool damages(const Memory& before, const Memory& after) const;
  /// See InterfaceSystem; the memory is that of this rank's interfaces.
  [[nodiscard]] Vector law_flexibility(const Vector& wanted) const;
  [[nodiscard]] Matrix free_jumps(ConstMatrixRef data, ConstMatrixRef traces) const;
  /// Displacements of side 2 less those of side 1, (unknowns, c).
  [[nodiscard]] Matrix jumps(ConstMatrixRef traces) const;
  [[nodiscard]] Memory blank() const { return system_.blank(); }
  [[nodiscard]] Vector forces(Index column, const Memory& before, ConstVectorRef jump,
                              ConstVectorRef flexibility) const;
  Vector advance(Index column, Memory& memory, ConstVectorRef jump,
                 ConstVectorRef flexibility) const;
  [[nodiscard]] Matrix slopes(Index column, const Memory& before, ConstVectorRef jump,
                              ConstVectorRef flexibility) const;

  /// r = 2 (f^ - f) of forces (unknowns, c), data and traces (rows, c).
  [[nodiscard]] Matrix residual(const Matrix& forces, ConstMatrixRef data,
                                ConstMatrixRef traces) const;
  /// Traces (rows, c) of data under loads, (l, c).
  [[nodiscard]] Matrix traces(ConstMatrixRef data, ConstMatrixRef amplitudes) const;

 private:
  [[nodiscard]] const Communicator& communicator() const {
    return laws().structure().communicator();
  }
  /// What each rank finds out of its own, (rows or unknowns of it, columns).
  using Own = std::function<Matrix()>;
  [[nodiscard]] Matrix of_unknowns(Index columns, const Own& ask) const;
  [[nodiscard]] Matrix of_rows(Index columns, const Own& ask) const;
  [[nodiscard]] Matrix attempted(Index rows, Index columns, const Own& ask) const;
  [[nodiscard]] Matrix share(const substructure::Joined::JoinedInterface& interface,
                             std::size_t side, ConstMatrixRef data, ConstMatrixRef traces) const;

  substructure::GlobalStage& global_;
  substructure::InterfaceSystem system_;
  std::shared_ptr<const substructure::Joined> joined_;
  Vector direct_;
  Layout layout_;
};

}  // namespace latin::iteration
