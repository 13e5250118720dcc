#include <pybind11/pybind11.h>

#include "latin/common/communicator.hpp"
#include "latin/common/error.hpp"

void bind_kernel(pybind11::module_& m);
void bind_laws(pybind11::module_& m);
void bind_stochastic(pybind11::module_& m);

PYBIND11_MODULE(_core, m) {
  m.doc() =
      "LATIN kernel: substructures, interfaces, local and global stage, stochastic Galerkin blocks";
  pybind11::register_exception<latin::InputError>(m, "InputError", PyExc_ValueError).doc() =
      "What was given cannot be used; the message names it, its value and the mend.";
  pybind11::register_exception<latin::NumericalError>(m, "NumericalError", PyExc_RuntimeError)
      .doc() = "An operation could not be completed: a factorisation broke down, memory ran out.";
  pybind11::register_exception<latin::RemoteError>(m, "RemoteError", PyExc_RuntimeError).doc() =
      "Another rank failed; it says there what happened.";
  bind_laws(m);
  bind_kernel(m);
  bind_stochastic(m);
}
