#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "arguments.hpp"
#include "latin/algebra/factor.hpp"
#include "latin/common/error.hpp"
#include "latin/common/threads.hpp"
#include "latin/iteration/sweep.hpp"

namespace py = pybind11;
using namespace py::literals;

void bind_laws(py::module_& m);
void bind_descriptions(py::module_& m);
void bind_results(py::module_& m);
void bind_structure(py::module_& m);
void bind_stochastic(py::module_& m);
void bind_mortar(py::module_& m);

PYBIND11_MODULE(_core, m) {
  m.doc() =
      "LATIN kernel: substructures, interfaces, local and global stage, stochastic Galerkin blocks";
  py::register_exception<latin::InputError>(m, "InputError", PyExc_ValueError).doc() =
      "What was given cannot be used; the message names it, its value and the remedy.";
  py::register_exception<latin::NumericalError>(m, "NumericalError", PyExc_RuntimeError).doc() =
      "An operation could not be completed: a factorisation broke down, memory ran out.";
  py::register_exception<latin::RemoteError>(m, "RemoteError", PyExc_RuntimeError).doc() =
      "Another rank failed; it says there what happened.";
  bind_laws(m);
  bind_descriptions(m);
  bind_results(m);
  bind_structure(m);
  bind_stochastic(m);
  bind_mortar(m);
  m.def(
      "bound_threads",
      [](py::handle comm) { return latin::bound_threads(latin_bindings::to_communicator(comm)); },
      "comm"_a,
      "Let the linear algebra of this rank use its share of the cores of its machine. "
      "Collective.\n\n"
      "comm: an mpi4py communicator or its Fortran handle. Returns the threads that a rank may "
      "use.");
  m.def(
      "snake_order",
      [](py::handle shape) {
        return latin::iteration::snake_order(latin_bindings::to_indices(shape, "shape"));
      },
      "shape"_a,
      "Points of a grid of that shape in an order whose neighbours differ in one parameter by one "
      "step, the "
      "last axis fastest.");
  m.def("available_backends", &latin::algebra::available_backends,
        "Libraries that factorise in this build, the default first, as one text.");
}
