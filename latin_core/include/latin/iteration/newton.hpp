#pragma once

#include <Eigen/LU>
#include <vector>

#include "latin/common/types.hpp"
#include "latin/iteration/history.hpp"
#include "latin/substructure/global_stage.hpp"
#include "latin/substructure/interface_system.hpp"
#include "latin/substructure/local_stage.hpp"

namespace latin::iteration {

/// Semi-smooth Newton on the interface forces, one column after the other.
///
/// With the bodies eliminated a column is f = R(j0), j0 = b - A f + G a + c f: A the flexibility of the bodies, b
/// the jump that the loads alone would leave, a the amplitudes of modes that nothing else holds, with the
/// equilibrium of those as further equations. The flexibility c at which the laws are asked is free; it is that of
/// the bodies at the point itself, so that nothing here depends on the search direction. Since a law with memory
/// looks back only, the columns of a history are solved in their order, each from the better of two starts:
/// where it is, and the answer of the step before it under its own loads. Some accelerated steps of the two stages,
/// of that column alone, come before Newton's, and more of them wherever those fail.
///
/// A step solves dy = Phi + R' dj0 for the residual Phi = R(j0) - f: a dense system of the size of the zone
/// where R' is not zero.
///
/// In terms of the iteration, with N = 1 - k A_b (A_b: the global stage) and E the map of a force per area onto
/// both sides (+1, -1): forces f + y on the bodies give N ds = F / 2 + E y. N is singular where a body
/// floats; N + mu with a tiny mu is the same body on springs mu k, whose forces the outer iteration takes
/// back. `Flexibility` has the dense matrix of it, once for a problem.
class Newton {
 public:
  /// @param global, local stages of the run; they must outlive this object
  Newton(substructure::GlobalStage& global, substructure::LocalStage& local,
         const Matrix& amplitudes);

  struct Outcome {
    Index solved = 0;     ///< columns solved, from the first; the others stay as they were
    double stages = 0.0;  ///< work in global stages of all columns, the factorisations not counted
    Index steps = 0;      ///< Newton steps of single columns
  };
  /// Solve column after column, until one of them fails.
  /// @param data, traces of the iterate; replaced in the columns that are solved
  /// @param tolerance    on the forces, relative to the largest column of them
  Outcome solve(Matrix& data, Matrix& traces, double tolerance);

 private:
  /// LU of the closed zone of one column, kept as long as its tangent stays what it was.
  struct Zone {
    std::vector<Index> rows;
    Matrix tangent;
    Eigen::PartialPivLU<Matrix> lu;  ///< of the transposed system

    [[nodiscard]] bool fits(const Matrix& now) const;
  };
  /// One column: where it starts, and what Newton changes.
  struct Column {
    Index index;
    Vector half;    ///< N^-1 F / 2
    Vector start;   ///< j0 (at the laws' flexibility) with y = 0
    Vector before;  ///< forces f with y = 0
    Vector loads;   ///< on the modes
    Vector y;       ///< change of the forces
    Vector a;       ///< amplitudes of the modes
    Vector jump;    ///< j0 now
    Vector phi;     ///< R(j0) - f
    double norm = 0.0;
  };
  [[nodiscard]] Column begin(ConstMatrixRef data, ConstMatrixRef traces, Index index);
  [[nodiscard]] bool iterate(Column& column, double tolerance, Index& steps);
  /// `searched`: shorter steps where those make the residual fall and whole ones do not, which is the better way
  /// far from the answer but may end in a local minimum; `tied`: whole steps, the first as if everything were
  /// closed and stuck, for bodies that nothing else holds.
  enum class Way { searched, whole, tied };
  [[nodiscard]] bool attempt(Column& column, double tolerance, Way way, Index& steps);
  void evaluate(Column& column);
  [[nodiscard]] bool step(const Column& column, const Matrix& tangent, Vector& dy, Vector& da);
  void take(Column& column, const Vector& dy, const Vector& da, bool searched);
  void apply(const Matrix& data, Matrix& traces, Index index);
  void relax(Matrix& data, Matrix& traces, Index index, History& history, Index count);
  void factorise(const Matrix& tangent, Zone& zone) const;
  [[nodiscard]] Vector moved(const Vector& y, const Vector& a) const;
  [[nodiscard]] Vector times(const Matrix& tangent, const Vector& p) const;
  [[nodiscard]] double norm(const Vector& force) const;

  substructure::GlobalStage& global_;
  substructure::LocalStage& local_;
  const Matrix& amplitudes_;
  substructure::InterfaceSystem system_;
  const substructure::Flexibility& flexibility_;
  const substructure::InterfaceSystem::Layout& layout_;
  Vector own_;          ///< flexibility at which the laws are asked
  Vector shift_;        ///< own_ + E^T k^-1 E
  Vector metric_;       ///< areas * own_
  Matrix jumps_;        ///< j0 of all columns at the laws' flexibility
  double scale_ = 0.0;  ///< size of the forces
  std::vector<Zone> zones_;
};

}  // namespace latin::iteration
