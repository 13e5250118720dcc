#pragma once

#include <vector>

#include "latin/common/types.hpp"
#include "latin/iteration/state.hpp"

namespace latin::iteration {

/// The linear part of Newton's method: what forces of the interfaces do to their free jumps.
///
/// A column is changed by forces y (unknowns) and by a motion m of the bodies, which each kind of skeleton counts in its
/// own way. Rows and unknowns are those of all ranks, see Joined; every member is collective.
class Skeleton {
 public:
  /// What a column begins with.
  struct Start {
    Vector answer;  ///< of the bodies, at once
    Vector loads;   ///< that are not carried yet
  };

  Skeleton() = default;
  Skeleton(const Skeleton&) = delete;
  Skeleton(Skeleton&&) = delete;
  Skeleton& operator=(const Skeleton&) = delete;
  Skeleton& operator=(Skeleton&&) = delete;
  virtual ~Skeleton() = default;

  /// Flexibility of the bodies at the points (unknowns), at which laws are asked and to which free jumps belong, and
  /// areas.
  [[nodiscard]] virtual const Vector& own() const = 0;
  [[nodiscard]] virtual const Vector& areas() const = 0;
  /// Numbers of a motion.
  [[nodiscard]] virtual Index motions() const = 0;
  /// Whether something may move that nothing but springs would hold.
  [[nodiscard]] virtual bool moves() const = 0;
  /// From an iterate.
  /// @param unbalanced half of its residual, (rows)
  /// @param jump       w2 - w1 there, into what the answer makes of it
  [[nodiscard]] virtual Start begin(const Vector& unbalanced, Vector& jump) const = 0;
  /// What is not balanced after changes.
  [[nodiscard]] virtual Vector imbalance(const Start& start, const Vector& y,
                                         const Vector& motion) const = 0;
  /// Change of the free jumps.
  [[nodiscard]] virtual Vector moved(const Vector& y, const Vector& motion) const = 0;
  /// A step dy = phi + R moved(dy, dm) that balances, or nearly so.
  /// @param tangent R, as of InterfaceSystem::slopes()
  /// @return whether there is one
  [[nodiscard]] virtual bool step(const Matrix& tangent, const Vector& phi, const Vector& imbalance,
                                  Vector& dy, Vector& dm) = 0;
  /// Steps are to be exact from here on, or as exact as they need be.
  virtual void exactly(bool exact) = 0;
  /// Root of twice the work of forces, and the same of what is not balanced.
  [[nodiscard]] virtual double size_of(const Vector& force) const = 0;
  [[nodiscard]] virtual double size_of_imbalance(const Vector& imbalance) const = 0;
  /// Whether what moves like that hangs on nothing: springs that are none would carry as much as this force.
  [[nodiscard]] virtual bool loose(const Vector& motion, double force) const = 0;
  /// Hold what may move where the column began, by springs relative to the search direction.
  /// @return those that did before
  virtual double hold(double spring) = 0;
  /// What these springs carry, as size_of().
  [[nodiscard]] virtual double held(const Vector& motion) const = 0;
  /// The change of a motion if what hangs on springs alone goes so many times as far; empty: not known apart.
  [[nodiscard]] virtual Vector further(const Vector& motion, double ratio) const = 0;
  /// The data of a column after changes of it.
  /// @param data, traces (rows) where it began  @param force all of it
  [[nodiscard]] virtual Vector data(ConstVectorRef data, ConstVectorRef traces, const Start& start,
                                    const Vector& force, const Vector& y,
                                    const Vector& motion) const = 0;
  /// Factorisations so far.
  [[nodiscard]] virtual Index factorisations() const = 0;
};

/// Slopes (unknowns, most components) times jumps, by point.
/// @param first, count of the components at the point of every unknown
[[nodiscard]] Vector times(const Matrix& slopes, const std::vector<Index>& first,
                           const std::vector<Index>& count, ConstVectorRef jump);

}  // namespace latin::iteration
