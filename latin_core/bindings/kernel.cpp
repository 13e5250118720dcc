#include <pybind11/eigen.h>
#include <pybind11/functional.h>
#include <pybind11/stl.h>

#include <optional>
#include <sstream>
#include <string>
#include <variant>

#include "latin/algebra/factor.hpp"
#include "latin/algebra/handle.hpp"
#include "latin/common/threads.hpp"
#include "latin/iteration/sweep.hpp"
#include "petsc4py_caster.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

/// Put Python's own handler of Ctrl-C back: some extension modules (OpenTURNS) leave theirs installed, which
/// ends the process instead of raising KeyboardInterrupt.
void answer_interrupts() {
  const auto signal = py::module_::import("signal");
  const auto threading = py::module_::import("threading");
  const py::object number = signal.attr("SIGINT");
  const py::object handler = signal.attr("getsignal")(number);
  if (threading.attr("current_thread")().is(threading.attr("main_thread")()) &&
      PyCallable_Check(handler.ptr()) != 0) {
    signal.attr("signal")(number, handler);
  }
}

/// Signals are answered at every iteration, with or without a callback of the user. A callback that raises
/// StopIteration ends the run with what is done so far (as in SciPy's minimize).
latin::iteration::Callback guarded(const py::object& callback) {
  answer_interrupts();
  return [callback](const latin::iteration::Iteration& iteration) {
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) {
      throw py::error_already_set();
    }
    if (callback.is_none()) {
      return;
    }
    try {
      callback(iteration);
    } catch (const py::error_already_set& error) {
      if (error.matches(PyExc_StopIteration)) {
        throw latin::iteration::Interrupted();
      }
      throw;
    }
  };
}

std::string shown(double value) {
  std::ostringstream text;
  text.precision(3);
  text << value;
  return text.str();
}

void bind_descriptions(py::module_& m) {
  py::class_<latin::substructure::Member>(m, "Member", "One substructure of a body: u = Z q + u0")
      .def(py::init([](std::string name, Mat stiffness,
                       std::optional<latin::SparseRows> prolongation, latin::Matrix load,
                       std::optional<latin::Matrix> offset) {
             auto sparse = latin::algebra::view_sparse(stiffness, name);
             return latin::substructure::Member{
                 std::move(name), std::move(sparse),
                 prolongation ? std::move(*prolongation) : latin::SparseRows{}, std::move(load),
                 offset ? std::move(*offset) : latin::Matrix{}};
           }),
           py::kw_only(), "name"_a, "stiffness"_a, "prolongation"_a.none(true), "load"_a,
           "offset"_a.none(true));

  py::class_<latin::substructure::Spring>(m, "Spring",
                                          "A deterministic elastic interface assembled into a body")
      .def(py::init([](std::string name, std::vector<latin::Index> members,
                       const std::vector<py::object>& traces, const latin::Matrix& frames,
                       latin::Vector stiffness, latin::Matrix jump) {
             std::vector<latin::SparseRows> local;
             for (const auto& trace : traces) {
               Mat matrix = latin_bindings::borrow_mat(trace);
               if (matrix == nullptr) {
                 throw py::type_error("spring '" + name + "': traces must be petsc4py matrices");
               }
               local.push_back(latin::interface::to_local_frame(
                   latin::algebra::to_sparse(matrix, name), frames, name));
             }
             return latin::substructure::Spring{std::move(name), std::move(members),
                                                std::move(local), std::move(stiffness),
                                                std::move(jump)};
           }),
           py::kw_only(), "name"_a, "members"_a, "traces"_a, "frames"_a, "stiffness"_a, "jump"_a);

  py::class_<latin::substructure::BodyDescription>(m, "Body", "Substructures glued together")
      .def(py::init([](std::string name, latin::Index size,
                       std::vector<latin::substructure::Member> members,
                       std::vector<latin::substructure::Spring> springs) {
             return latin::substructure::BodyDescription{std::move(name), size, std::move(members),
                                                         std::move(springs)};
           }),
           py::kw_only(), "name"_a, "size"_a, "members"_a, "springs"_a);

  py::class_<latin::substructure::SideDescription>(m, "Side", "One side of an active interface")
      .def(py::init([](std::string member, Mat trace, latin::Vector direction, double scale) {
             latin::SparseRows sparse = latin::algebra::to_sparse(trace, "trace of " + member);
             return latin::substructure::SideDescription{std::move(member), std::move(sparse),
                                                         std::move(direction), scale};
           }),
           py::kw_only(), "member"_a, "trace"_a, "direction"_a, "scale"_a)
      .def(py::init([](std::string member) {
             return latin::substructure::SideDescription{std::move(member), {}, {}, 0.0};
           }),
           py::kw_only(), "member"_a);

  py::class_<latin::substructure::InterfaceDescription>(m, "Interface", "An active interface")
      .def(py::init([](std::string name,
                       std::variant<std::string, std::shared_ptr<latin::interface::Law>> law,
                       latin::Vector weights, latin::Matrix frames,
                       std::vector<latin::substructure::SideDescription> sides,
                       std::optional<latin::Matrix> basis, bool paired) {
             auto source = std::visit(
                 [](auto&& each) { return latin::interface::LawSource(std::move(each)); },
                 std::move(law));
             return latin::substructure::InterfaceDescription{
                 std::move(name),
                 std::move(source),
                 std::move(weights),
                 std::move(frames),
                 std::move(sides),
                 basis ? std::move(*basis) : latin::Matrix{},
                 paired};
           }),
           py::kw_only(), "name"_a, "law"_a, "weights"_a, "frames"_a, "sides"_a,
           "basis"_a.none(true), "paired"_a);
}

void bind_iteration(py::module_& m) {
  py::class_<latin::iteration::Iteration>(m, "Iteration", "One iteration as a callback sees it")
      .def_readonly("number", &latin::iteration::Iteration::number)
      .def_readonly("error", &latin::iteration::Iteration::error)
      .def_readonly("indicator", &latin::iteration::Iteration::indicator)
      .def_readonly("residual", &latin::iteration::Iteration::residual)
      .def_readonly("seconds", &latin::iteration::Iteration::seconds)
      .def("__repr__", [](const latin::iteration::Iteration& i) {
        return "Iteration(" + std::to_string(i.number) + ", error " + shown(i.error) +
               ", indicator " + shown(i.indicator) + ", residual " + shown(i.residual) + ")";
      });

  py::class_<latin::iteration::Summary>(m, "Summary", "How an iteration went")
      .def_property_readonly("status",
                             [](const latin::iteration::Summary& s) { return to_string(s.status); })
      .def_readonly("iterations", &latin::iteration::Summary::iterations)
      .def_readonly("error", &latin::iteration::Summary::error)
      .def_readonly("indicator", &latin::iteration::Summary::indicator)
      .def_readonly("energy", &latin::iteration::Summary::energy)
      .def_readonly("global_s", &latin::iteration::Summary::global_s)
      .def_readonly("local_s", &latin::iteration::Summary::local_s)
      .def_readonly("newton_s", &latin::iteration::Summary::newton_s)
      .def_readonly("newton_steps", &latin::iteration::Summary::newton_steps)
      .def_readonly("other_s", &latin::iteration::Summary::other_s)
      .def_readonly("restarts", &latin::iteration::Summary::restarts)
      .def_readonly("history", &latin::iteration::Summary::history)
      .def("__repr__", [](const latin::iteration::Summary& s) {
        return "Summary(" + to_string(s.status) + ", " + std::to_string(s.iterations) +
               " iterations, estimated error " + shown(s.error) + ")";
      });

  py::class_<latin::iteration::State>(m, "State",
                                      "Interface data s and traces w, (rows, columns) each")
      .def(py::init([](latin::Matrix data, latin::Matrix traces) {
             return latin::iteration::State{std::move(data), std::move(traces)};
           }),
           "data"_a, "traces"_a)
      .def_readonly("data", &latin::iteration::State::data)
      .def_readonly("traces", &latin::iteration::State::traces)
      .def("__repr__", [](const latin::iteration::State& s) {
        return "State(" + std::to_string(s.data.rows()) + " rows, " +
               std::to_string(s.data.cols()) + " columns)";
      });

  py::class_<latin::iteration::SweptParameter>(m, "SweptParameter",
                                               "A law parameter with one value a point")
      .def(py::init([](std::string interface, std::string parameter, latin::Matrix pattern,
                       latin::Matrix values, latin::Index columns) {
             return latin::iteration::SweptParameter{std::move(interface), std::move(parameter),
                                                     std::move(pattern), std::move(values),
                                                     columns};
           }),
           py::kw_only(), "interface"_a, "parameter"_a, "pattern"_a, "values"_a, "columns"_a);

  py::class_<latin::iteration::Options>(m, "Options",
                                        "Settings of the iteration; defaults are in Python")
      .def(py::init([](double rtol, bool stop_on_indicator, latin::Index max_iterations,
                       latin::Index acceleration, double relaxation, latin::Index stagnation_window,
                       latin::Index newton, latin::Index snapshots, latin::Index together,
                       bool single_precision) {
             return latin::iteration::Options{
                 rtol,       stop_on_indicator, max_iterations, acceleration,
                 relaxation, stagnation_window, newton,         snapshots,
                 together,   single_precision};
           }),
           py::kw_only(), "rtol"_a, "stop_on_indicator"_a, "max_iterations"_a, "acceleration"_a,
           "relaxation"_a, "stagnation_window"_a, "newton"_a, "snapshots"_a, "together"_a,
           "single_precision"_a);
}

py::dict cost_of(const latin::substructure::Body& body) {
  const latin::substructure::BodyCost& cost = body.cost();
  return py::dict("body"_a = body.name(), "unknowns"_a = body.size(), "active"_a = body.active(),
                  "rows"_a = body.rows(), "condensed"_a = body.condensed(),
                  "backend"_a = body.backend(), "assemble_s"_a = cost.assemble_s,
                  "factorise_s"_a = cost.factorise_s, "condense_s"_a = cost.condense_s,
                  "factor_numbers"_a = cost.factor_numbers, "dense_numbers"_a = cost.dense_numbers);
}

latin::substructure::OperatorOptions operator_options(const std::string& kind,
                                                      const std::string& backend,
                                                      double memory_limit) {
  latin::substructure::OperatorOptions options;
  options.memory_limit = memory_limit;
  if (kind == "condensed") {
    options.kind = latin::substructure::OperatorKind::condensed;
  } else if (kind == "factored") {
    options.kind = latin::substructure::OperatorKind::factored;
  } else if (kind != "automatic") {
    throw py::value_error("operator '" + kind + "': use 'automatic', 'condensed' or 'factored'");
  }
  if (backend == "cholmod") {
    options.backend = latin::algebra::FactorBackend::cholmod;
  } else if (backend == "mumps") {
    options.backend = latin::algebra::FactorBackend::mumps;
  } else if (backend != "automatic") {
    throw py::value_error("backend '" + backend + "': use 'automatic' or one of " +
                          latin::algebra::available_backends());
  }
  return options;
}

void bind_problem(py::module_& m) {
  py::class_<latin::substructure::Problem>(m, "Problem", "Factorised bodies and active interfaces")
      .def(py::init([](std::vector<latin::substructure::BodyDescription> bodies,
                       std::vector<latin::substructure::InterfaceDescription> interfaces,
                       const std::string& kind, const std::string& backend, double memory_limit,
                       std::optional<int> comm) {
             const auto options = operator_options(kind, backend, memory_limit);
             const auto ranks =
                 comm ? latin::Communicator(MPI_Comm_f2c(*comm)) : latin::Communicator();
             const py::gil_scoped_release release;
             return std::make_unique<latin::substructure::Problem>(
                 std::move(bodies), std::move(interfaces), options, ranks);
           }),
           py::kw_only(), "bodies"_a, "interfaces"_a, "operator"_a, "backend"_a, "memory_limit"_a,
           "comm"_a = py::none())
      .def("__repr__",
           [](const latin::substructure::Problem& p) {
             return "Problem(" + std::to_string(p.bodies().size()) + " bodies with " +
                    std::to_string(p.unknowns()) + " unknowns, " + std::to_string(p.interfaces()) +
                    " active interfaces with " + std::to_string(p.rows()) + " rows)";
           })
      .def_property_readonly("rows", &latin::substructure::Problem::rows)
      .def_property_readonly("total_rows", &latin::substructure::Problem::total_rows)
      .def_property_readonly("loads", &latin::substructure::Problem::loads)
      .def_property_readonly("unknowns", &latin::substructure::Problem::unknowns)
      .def_property_readonly("active_unknowns", &latin::substructure::Problem::active_unknowns)
      .def_property_readonly("macro_size", &latin::substructure::Problem::macro_size)
      .def_property_readonly("weights", &latin::substructure::Problem::weights)
      .def_property_readonly("directions", &latin::substructure::Problem::directions)
      .def_property_readonly("costs",
                             [](const latin::substructure::Problem& p) {
                               py::list costs;
                               for (const auto& body : p.bodies()) {
                                 costs.append(cost_of(body));
                               }
                               return costs;
                             })
      .def("set_parameter", &latin::substructure::Problem::set_parameter, "interface"_a,
           "parameter"_a, "values"_a)
      .def("set_extra_loads", &latin::substructure::Problem::set_extra_loads, "loads"_a)
      .def("set_steps", &latin::substructure::Problem::set_steps, "steps"_a)
      .def("parameter", &latin::substructure::Problem::parameter, "interface"_a, "parameter"_a)
      .def(
          "set_columns",
          [](latin::substructure::Problem& p, const std::string& interface,
             const py::list& groups) {
            std::vector<latin::substructure::LawColumns> columns;
            for (const auto& each : groups) {
              const auto group = py::cast<py::dict>(each);
              latin::substructure::LawColumns entry;
              entry.begin = py::cast<latin::Index>(group["begin"]);
              entry.end = py::cast<latin::Index>(group["end"]);
              entry.forward = py::cast<std::vector<latin::Matrix>>(group["forward"]);
              entry.backward = py::cast<std::vector<latin::Matrix>>(group["backward"]);
              for (const auto& [name, values] : py::cast<py::dict>(group["parameters"])) {
                entry.parameters.emplace_back(
                    py::cast<std::string>(name),
                    latin::interface::ParameterField(py::cast<latin::Matrix>(values)));
              }
              columns.push_back(std::move(entry));
            }
            p.set_columns(interface, std::move(columns));
          },
          "interface"_a, "groups"_a)
      .def(
          "global_stage",
          [](const latin::substructure::Problem& p, const latin::Matrix& data,
             const latin::Matrix& amplitudes) {
            latin::Matrix traces(data.rows(), data.cols());
            p.global_stage(data, amplitudes, traces);
            return traces;
          },
          "data"_a, "amplitudes"_a)
      .def(
          "local_stage",
          [](const latin::substructure::Problem& p, const latin::Matrix& data,
             const latin::Matrix& traces) {
            latin::Matrix residual(data.rows(), data.cols());
            p.local_stage(data, traces, residual);
            return residual;
          },
          "data"_a, "traces"_a)
      .def(
          "local_fields",
          [](const latin::substructure::Problem& p, const std::string& interface,
             const latin::iteration::State& state) {
            auto fields = p.local_fields(p.find_interface(interface), state.data, state.traces);
            return py::make_tuple(std::move(fields.force), std::move(fields.jump));
          },
          "interface"_a, "state"_a)
      .def(
          "resolve_samples",
          [](const latin::substructure::Problem& p, const std::string& interface,
             const latin::Matrix& free_jump,
             const std::vector<std::pair<std::string, latin::Matrix>>& parameters) {
            auto fields = p.resolve_samples(p.find_interface(interface), free_jump, parameters);
            return py::make_tuple(std::move(fields.force), std::move(fields.jump));
          },
          "interface"_a, "free_jump"_a, "parameters"_a)
      .def(
          "first_rows",
          [](const latin::substructure::Problem& p, const std::string& interface) {
            const std::size_t i = p.find_interface(interface);
            std::vector<latin::Index> rows;
            for (std::size_t s = 0; s < p.sides(i); ++s) {
              rows.push_back(p.first_row(i, s));
            }
            return rows;
          },
          "interface"_a)
      .def(
          "flexibility",
          [](const latin::substructure::Problem& p, const std::string& interface) {
            return p.point_flexibility(p.find_interface(interface));
          },
          "interface"_a)
      .def(
          "displacements",
          [](const latin::substructure::Problem& p, const latin::iteration::State& state,
             const latin::Matrix& amplitudes) {
            py::dict fields;
            for (auto& [name, values] : p.displacements(state.data, amplitudes)) {
              fields[py::str(name)] = std::move(values);
            }
            return fields;
          },
          "state"_a, "amplitudes"_a)
      .def(
          "solve",
          [](const latin::substructure::Problem& p, const latin::iteration::Options& options,
             const latin::Matrix& amplitudes,
             const std::vector<const latin::iteration::State*>& start, const py::object& callback) {
            latin::iteration::State state;
            latin::iteration::Summary summary;
            const auto guard = guarded(callback);
            {
              const py::gil_scoped_release release;
              summary = latin::iteration::solve(p, options, amplitudes, state, start, guard);
            }
            return py::make_tuple(std::move(summary), std::move(state));
          },
          py::kw_only(), "options"_a, "amplitudes"_a, "start"_a, "callback"_a)
      .def(
          "sweep",
          [](latin::substructure::Problem& p, const latin::iteration::Options& options,
             const latin::Matrix& amplitudes,
             const std::vector<latin::iteration::SweptParameter>& parameters,
             const std::vector<latin::Index>& order,
             const std::vector<latin::iteration::State>& known,
             const std::vector<latin::Index>& known_points, const py::object& callback,
             const py::object& point_callback) {
            const auto guard = guarded(callback);
            const latin::iteration::PointCallback finished =
                [&point_callback](latin::Index point, const latin::iteration::Summary& summary,
                                  const latin::iteration::State& state) {
                  const py::gil_scoped_acquire gil;
                  point_callback(point, summary, state);
                };
            const py::gil_scoped_release release;
            latin::iteration::sweep(p, options, amplitudes, parameters, order, known, known_points,
                                    guard, finished);
          },
          py::kw_only(), "options"_a, "amplitudes"_a, "parameters"_a, "order"_a, "known"_a,
          "known_points"_a, "callback"_a, "point_callback"_a);
}

}  // namespace

void bind_kernel(py::module_& m) {
  bind_descriptions(m);
  bind_iteration(m);
  bind_problem(m);
  m.def(
      "bound_threads",
      [](int comm) { return latin::bound_threads(latin::Communicator(MPI_Comm_f2c(comm))); },
      "comm"_a);
  m.def("snake_order", &latin::iteration::snake_order, "shape"_a);
  m.def("available_backends", &latin::algebra::available_backends);
}
