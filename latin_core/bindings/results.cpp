#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <cmath>
#include <sstream>
#include <string>

#include "arguments.hpp"
#include "latin/common/error.hpp"

namespace py = pybind11;
using namespace py::literals;
using namespace latin_bindings;
using latin::iteration::Iteration;
using latin::iteration::State;
using latin::iteration::Status;
using latin::iteration::Summary;

namespace {

constexpr const char* state_doc =
    R"doc(Interface data s and traces w: the whole state of an iteration.

Parameters
----------
data
    s (rows, columns), force / area.
traces
    w (rows, columns), length.
)doc";

std::string shown(double value) {
  if (!std::isfinite(value)) {
    return "not known";
  }
  std::ostringstream text;
  text.precision(3);
  text << value;
  return text.str();
}

State make_state(py::handle data, py::handle traces) {
  latin::Matrix s = to_matrix(data, "data");
  latin::Matrix w = to_matrix(traces, "traces", s.rows(), s.cols());
  return {std::move(s), std::move(w)};
}

py::tuple parts_of(const Iteration& i) {
  return py::make_tuple(i.number, i.error, i.indicator, i.residual, i.seconds);
}

Iteration iteration_of(const py::tuple& parts) {
  return {parts[0].cast<Index>(), parts[1].cast<double>(), parts[2].cast<double>(),
          parts[3].cast<double>(), parts[4].cast<double>()};
}

py::tuple parts_of(const Summary& s) {
  return py::make_tuple(static_cast<int>(s.status), s.iterations, s.error, s.indicator, s.energy,
                        s.global_s, s.local_s, s.newton_s, s.other_s, s.newton_steps, s.restarts,
                        s.history, s.errors, s.scatter, s.flexibility_s, s.falls, s.check_s,
                        s.callback_s);
}

Summary summary_of(const py::tuple& parts) {
  Summary s;
  s.status = static_cast<Status>(parts[0].cast<int>());
  s.iterations = parts[1].cast<Index>();
  s.error = parts[2].cast<double>();
  s.indicator = parts[3].cast<double>();
  s.energy = parts[4].cast<double>();
  s.global_s = parts[5].cast<double>();
  s.local_s = parts[6].cast<double>();
  s.newton_s = parts[7].cast<double>();
  s.other_s = parts[8].cast<double>();
  s.newton_steps = parts[9].cast<Index>();
  s.restarts = parts[10].cast<Index>();
  s.history = parts[11].cast<std::vector<Iteration>>();
  s.errors = parts[12].cast<latin::Matrix>();
  s.scatter = parts[13].cast<double>();
  s.flexibility_s = parts[14].cast<double>();
  s.falls = parts[15].cast<latin::Vector>();
  s.check_s = parts[16].cast<double>();
  s.callback_s = parts[17].cast<double>();
  return s;
}

}  // namespace

void bind_results(py::module_& m) {
  py::class_<Iteration>(m, "Iteration", "One iteration, as a callback sees it.")
      .def_readonly("number", &Iteration::number, "From 0, of this solve.")
      .def_readonly("error", &Iteration::error,
                    "Estimated relative error; infinity while it is unknown.")
      .def_readonly("indicator", &Iteration::indicator,
                    "The paper's indicator; it depends on the search direction.")
      .def_readonly("residual", &Iteration::residual, "Norm of the residual, absolute.")
      .def_readonly("seconds", &Iteration::seconds, "Since the solve began.")
      .def(py::pickle([](const Iteration& i) { return parts_of(i); }, &iteration_of))
      .def("__repr__", [](const Iteration& i) {
        return "Iteration(" + std::to_string(i.number) + ", error " + shown(i.error) +
               ", indicator " + shown(i.indicator) + ", residual " + shown(i.residual) + ")";
      });

  py::class_<Summary>(m, "Summary", "How an iteration went.")
      .def_property_readonly(
          "status", [](const Summary& s) { return to_string(s.status); },
          "One of ``latin_core.STATUSES``.")
      .def_readonly("iterations", &Summary::iterations,
                    "Global stages, and the work of Newton steps in such.")
      .def_readonly("error", &Summary::error, "Last estimate of the relative error.")
      .def_readonly("errors", &Summary::errors,
                    "Estimated relative errors (groups, bodies) of the bodies on this rank, of "
                    "which `error` is "
                    "the largest over all ranks: the groups are the time steps, and where there "
                    "are modes, the "
                    "mean and the fluctuation of each.")
      .def_readonly("scatter", &Summary::scatter,
                    "Of a sample: scatter of the body between the samples so far, relative to its "
                    "size, whose errors are the largest relative to it; 1 where it is not asked "
                    "for or not known.")
      .def_readonly("indicator", &Summary::indicator, "The paper's indicator.")
      .def_readonly("energy", &Summary::energy,
                    "u^T K u of the bodies with the springs assembled into them, all columns.")
      .def_readonly("global_s", &Summary::global_s, "Seconds in global stages.")
      .def_readonly("local_s", &Summary::local_s, "Seconds in local stages.")
      .def_readonly("flexibility_s", &Summary::flexibility_s,
                    "Seconds of the dense flexibility of Newton steps, where it was made.")
      .def_readonly("newton_s", &Summary::newton_s, "Seconds in Newton steps.")
      .def_readonly("newton_steps", &Summary::newton_steps, "Newton steps of single columns.")
      .def_readonly("check_s", &Summary::check_s,
                    "Seconds in checks of estimates, and in what is solved for at once.")
      .def_readonly("callback_s", &Summary::callback_s, "Seconds in the caller's functions.")
      .def_readonly("other_s", &Summary::other_s, "Seconds in acceleration and error measure.")
      .def_readonly(
          "falls", &Summary::falls,
          "(columns,), or empty: by what share of itself the load has to fall where bonds "
          "tear before it reaches that of the column: there a structure snaps.")
      .def_readonly("restarts", &Summary::restarts, "Times that the history was dropped.")
      .def_readonly("history", &Summary::history, "Its iterations.")
      .def(py::pickle([](const Summary& s) { return parts_of(s); }, &summary_of))
      .def("__repr__", [](const Summary& s) {
        return "Summary(" + to_string(s.status) + ", " + std::to_string(s.iterations) +
               " iterations, estimated error " + shown(s.error) + ")";
      });

  py::class_<State>(m, "State", state_doc)
      .def(py::init(&make_state), "data"_a, "traces"_a)
      .def_readonly("data", &State::data, "s (rows, columns), read-only.")
      .def_readonly("traces", &State::traces, "w (rows, columns), read-only.")
      .def(py::pickle([](const State& s) { return py::make_tuple(s.data, s.traces); },
                      [](const py::tuple& parts) { return make_state(parts[0], parts[1]); }))
      .def("__repr__", [](const State& s) {
        return "State(" + std::to_string(s.data.rows()) + " rows, " +
               std::to_string(s.data.cols()) + " columns)";
      });
}
