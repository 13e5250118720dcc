#pragma once

// PyPetscMat_Get borrows: the Python object keeps its reference.

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
