#pragma once

// One caster for petsc4py matrices: `Mat` is a pointer to the incomplete type `_p_Mat`, which is what
// pybind11 looks a caster up by. PyPetscMat_Get borrows: the Python object keeps its reference.

#include <petsc4py/petsc4py.h>
#include <petscmat.h>
#include <pybind11/pybind11.h>

namespace latin_bindings {

/// The Mat inside a petsc4py object, or nullptr if it is something else.
inline Mat borrow_mat(pybind11::handle source) {
  if (PyPetscMat_Get == nullptr && import_petsc4py() != 0) {
    throw pybind11::error_already_set();
  }
  if (PyObject_TypeCheck(source.ptr(), &PyPetscMat_Type) == 0) {
    return nullptr;
  }
  return PyPetscMat_Get(source.ptr());
}

}  // namespace latin_bindings

namespace pybind11::detail {

template <>
class type_caster<_p_Mat> {
 public:
  static constexpr auto name = const_name("petsc4py.PETSc.Mat");
  template <typename T>
  using cast_op_type = Mat;

  bool load(handle source, bool /*convert*/) {
    value_ = latin_bindings::borrow_mat(source);
    return value_ != nullptr;
  }
  operator Mat() { return value_; }  // NOLINT(google-explicit-constructor): pybind11's protocol

 private:
  Mat value_ = nullptr;
};

}  // namespace pybind11::detail
