#pragma once

#include <petscksp.h>
#include <petscmat.h>

#include <concepts>
#include <memory>
#include <mutex>
#include <string_view>
#include <utility>

#include "common/outer_lock.hpp"
#include "latin/algebra/view.hpp"

/// Thin, move-only access to PETSc. Nothing here initialises or finalises PETSc: whoever created the
/// objects (petsc4py, a test's main) has done so.
namespace latin::algebra {

static_assert(sizeof(PetscInt) == sizeof(int), "latin needs a PETSc built with 32-bit indices");
static_assert(std::same_as<PetscScalar, double>, "latin needs a real, double precision PETSc");

/// PETSc, and MUMPS behind it, for one thread at a time: held around every use of theirs in the kernel. A
/// thread may hold it several times. Nothing that waits for another thread may be done meanwhile.
/// The outer lock comes first, since the rest of the program makes PETSc objects and MPI calls too.
class PetscLock {
 public:
  PetscLock() : lock_(mutex()) {}

 private:
  static std::recursive_mutex& mutex();
  OuterLock outer_;
  std::scoped_lock<std::recursive_mutex> lock_;
};

/// Whether PETSc takes calls: objects may outlive it, such as those of a script that ends.
[[nodiscard]] bool petsc_is_there();

/// Turns a PETSc error code into a NumericalError that says what was attempted.
void check(PetscErrorCode code, std::string_view doing);

/// Owner of one reference to a PETSc object.
template <typename Object, PetscErrorCode (*destroy)(Object*)>
class Handle {
 public:
  Handle() = default;
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  Handle(Handle&& other) noexcept : object_(std::exchange(other.object_, nullptr)) {}
  Handle& operator=(Handle&& other) noexcept {
    std::swap(object_, other.object_);
    return *this;
  }
  ~Handle() {
    if (object_ != nullptr && petsc_is_there()) {
      const PetscLock lock;
      static_cast<void>(destroy(&object_));  // a destructor must not throw: the code is dropped
    }
  }

  /// Take over the caller's reference.
  static Handle adopt(Object object) {
    Handle handle;
    handle.object_ = object;
    return handle;
  }
  /// Take an additional reference; the caller keeps its own.
  static Handle borrow(Object object) {
    const PetscLock lock;
    // PETSc's macros cast to PetscObject in C style
    check(PetscObjectReference(reinterpret_cast<PetscObject>(object)), "reference an object");
    return adopt(object);
  }

  [[nodiscard]] Object get() const { return object_; }
  /// Where a PETSc creation routine writes its new object.
  [[nodiscard]] Object* out() { return &object_; }

 private:
  Object object_ = nullptr;
};

using MatHandle = Handle<Mat, MatDestroy>;
using KspHandle = Handle<KSP, KSPDestroy>;
using VecHandle = Handle<Vec, VecDestroy>;

}  // namespace latin::algebra
