#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "algebra/factor.hpp"
#include "arguments.hpp"
#include "common/outer_lock.hpp"
#include "common/threads.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/error.hpp"
#include "latin/iteration/options.hpp"
#include "substructure/body.hpp"

namespace py = pybind11;
using namespace py::literals;

void bind_laws(py::module_& m);
void bind_descriptions(py::module_& m);
void bind_results(py::module_& m);
void bind_structure(py::module_& m);
void bind_stochastic(py::module_& m);
void bind_mortar(py::module_& m);
void bind_equilibration(py::module_& m);
void bind_elimination(py::module_& m);

namespace {

/// The lock of the interpreter: what Python's other threads hold while they make PETSc objects.
int enter_python() {
  constexpr int gone = -1;  // the interpreter ended before its objects
  return Py_IsInitialized() != 0 ? static_cast<int>(PyGILState_Ensure()) : gone;
}

void leave_python(int entered) {
  if (entered >= 0) {
    PyGILState_Release(static_cast<PyGILState_STATE>(entered));
  }
}

/// What latin_core.Options takes over.
py::dict default_options() {
  const latin::iteration::Options of_runs;
  const latin::substructure::OperatorOptions of_bodies;
  return py::dict("rtol"_a = of_runs.rtol, "max_iterations"_a = of_runs.max_iterations,
                  "max_seconds"_a = of_runs.max_seconds, "acceleration"_a = of_runs.acceleration,
                  "relaxation"_a = of_runs.relaxation,
                  "stagnation_window"_a = of_runs.stagnation_window,
                  "snapshots"_a = of_runs.snapshots, "together"_a = of_runs.together,
                  "scatter"_a = of_runs.scatter, "memory_limit"_a = of_bodies.memory_limit);
}

}  // namespace

PYBIND11_MODULE(_core, m) {
  latin::OuterLock::set({enter_python, leave_python});
  m.doc() =
      "LATIN kernel: substructures, interfaces, local and global stage, stochastic Galerkin blocks";
  py::register_exception<latin::InputError>(m, "InputError", PyExc_ValueError).doc() =
      "What was given cannot be used; the message names it, its value and the remedy.";
  py::register_exception<latin::NumericalError>(m, "NumericalError", PyExc_RuntimeError).doc() =
      "An operation could not be completed: a factorisation broke down, memory ran out.";
  // what is registered last is asked first
  const auto of_memory = [&m](const char* base) {
    return py::make_tuple(m.attr(base), py::handle(PyExc_MemoryError));
  };
  py::register_exception<latin::MemoryLimitError>(m, "MemoryLimitError", of_memory("InputError"))
      .doc() = "What was asked for takes more memory than it may.";
  py::register_exception<latin::OutOfMemoryError>(m, "OutOfMemoryError",
                                                  of_memory("NumericalError"))
      .doc() = "The memory for it could not be had.";
  py::register_exception<latin::RemoteError>(m, "RemoteError", PyExc_RuntimeError).doc() =
      "Another rank failed; it says there what happened.";
  bind_laws(m);
  bind_descriptions(m);
  bind_results(m);
  bind_structure(m);
  bind_stochastic(m);
  py::list statuses;
  for (const latin::iteration::Status each : latin::iteration::statuses()) {
    statuses.append(to_string(each));
  }
  m.attr("STATUSES") = py::tuple(statuses);
  m.def("default_options", &default_options,
        "Settings of the iteration and of the bodies' operators where none are given, by name.");
  bind_mortar(m);
  bind_equilibration(m);
  bind_elimination(m);
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
