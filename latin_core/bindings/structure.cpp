#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <map>
#include <memory>
#include <set>
#include <string>

#include "algebra/factor.hpp"
#include "arguments.hpp"
#include "iteration/linearisation.hpp"
#include "iteration/solver.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/error.hpp"
#include "signals.hpp"
#include "substructure/global_stage.hpp"
#include "substructure/local_stage.hpp"

namespace py = pybind11;
using namespace py::literals;
using namespace latin_bindings;
using namespace latin::substructure;
using latin::iteration::Beginning;
using latin::iteration::State;
using latin::iteration::Summary;

namespace {

constexpr const char* structure_doc =
    R"doc(Bodies and active interfaces, factorised: all that stays constant.

What may change between two runs, parameters above all, is a value: :class:`Laws`, made by :meth:`laws`. Several
threads may use one structure at once. Blocks of interface data are (rows, columns): bodies in order, the sides of
a body in the order of their interfaces.

Parameters
----------
bodies, interfaces
    Sequences of :class:`Body` and :class:`Interface`.
operator
    ``"condensed"`` (dense factor of the Schur complement on the active unknowns), ``"factored"`` (sparse solves)
    or ``"automatic"``.
backend
    ``"cholmod"``, ``"mumps"`` or ``"automatic"``.
memory_limit
    Bytes that one condensed block may take before ``"automatic"`` goes sparse; 0: no limit.
comm
    An mpi4py communicator (or its Fortran handle) over which the bodies are spread, each on one rank; None: this
    rank alone.
before
    A structure made before: a body of the same name, members and springs whose sides touch the same unknowns takes
    over its sparse factor, and only the dense one on these unknowns is made anew. Compared bit for bit; `costs` has
    what was ``"kept"``.

Raises
------
InputError
    Shapes that disagree, unknown names, a stiffness that is not symmetric; with the name of the part.
NumericalError
    A body can move rigidly, or its stiffness is not positive definite.
)doc";

constexpr const char* laws_doc =
    R"doc(What may change between two runs on one :class:`Structure`: a value.

Parameters of the laws, transforms of their columns, the number of time steps, extra loads. It never changes;
:meth:`with_` returns a changed copy, which shares the rest. Made by :meth:`Structure.laws`.
)doc";

constexpr const char* make_laws_doc =
    R"doc(Laws of the active interfaces; what is not given is zero.

Parameters
----------
steps
    Columns that are the time steps of one history, in order. With chaos modes beside them the time steps run
    fastest.
parameters
    interface -> name -> values: (points, columns), or (points * components, columns) for ``jump`` and ``force``;
    one row or one column stands for all.
columns
    interface -> groups, each a mapping ``begin``, ``end`` (its components), ``forward`` (none, one, or one a point
    of matrices (c, q)), ``backward`` ((q, c); left out: the transposes, of orthogonal ones), ``parameters`` (name -> values of q columns): how the columns of a
    run become columns in which the law is deterministic, and back. A parameter of points that is given only there
    has its mean (of the first column) outside, which tangents start from.
extra_loads
    substructure -> forces (n, loads) that are added to its load patterns.
stiffness
    substructure -> (values, forward): factors > 0 of its stiffness, for as many blocks of columns of the same
    length, and None or the orthogonal matrix (values, values) that leads from the columns of a run to those of
    the factors. Loads that come from the stiffness are multiplied, too. Those that are not named keep theirs.
modes
    Chaos modes (columns) that a solution has at every time step: errors are then estimated of the mean and of
    the fluctuation of each step. 1: every column is a solution of its own.
in_time
    (patterns, times): columns are load patterns of a history of linear laws, and these are their factors at its
    times; errors are then estimated at the times. Empty or None: columns are what they are.

Raises
------
InputError
    Naming the interface (substructure) and what does not fit.
)doc";

constexpr const char* with_doc = R"doc(A changed copy; None leaves things as they are.

Arguments are those of :meth:`Structure.laws`. A parameter reaches transformed columns, too; one that their groups
give is refused. ``columns={name: []}`` takes transforms away; `extra_loads` replaces all extra loads.
)doc";

constexpr const char* solve_doc = R"doc(Iterate to the answer.

Parameters
----------
laws
    Of this structure.
options
    A :class:`latin_core.Options`; None: its defaults.
amplitudes
    (loads, columns) of the load patterns; None: all of them once, in one column.
start
    States of other parameter sets under the same loads; the run starts from the combination with the smallest
    residual. Empty: from zero.
callback
    Called with an :class:`Iteration` after each; what it raises ends the run, and StopIteration ends it with what
    is done so far.
balanced
    Called with a column of a history in which something flies: whether anything can balance its loads. If not, the
    run ends before that column, as ``"no_equilibrium"``. None: nothing is known.

Returns
-------
(Summary, State)
)doc";

constexpr const char* sweep_doc =
    R"doc(Solve for many parameter sets, each started from its nearest solved neighbours.

Parameters
----------
laws
    Of all points, but for what is swept.
options, amplitudes, callback
    As in :meth:`solve`.
parameters
    Sequence of :class:`SweptParameter`.
order
    Points to solve, in this order.
known, known_points
    States that were found earlier, and their points: start material.
point_callback
    Called with the point, its Laws, its Summary and its State. What it raises ends the sweep; StopIteration ends it
    with the points that are finished.
next_points
    Called after `order` for further points, until it returns none. Each time they start from what was known after
    `order`, whatever was solved since.
beginning
    :class:`Beginning` of these laws, from which points of linear laws are solved. None: from the point in the middle
    of them, which takes as long as a hundred others.

Returns
-------
str
    ``"converged"``: it went through all points; else ``"interrupted"`` or ``"time_limit"``.
)doc";

constexpr const char* local_fields_doc =
    R"doc(Force and jump of an interface as the law leaves them.

Returns
-------
force, jump
    (points * components, columns) each: force / area on the first side, and w2 - w1. Collective among the ranks
    of the interface.
)doc";

constexpr const char* linearised_doc =
    R"doc(The structure with the tangents of its laws at a state, factorised.

Parameters
----------
transposed
    Tangents of every point transposed, for adjoint systems.

Raises
------
NumericalError
    It is not stable with them, or they would cost more than the bodies did.
)doc";

constexpr const char* correct_doc =
    R"doc(Newton's step for a residual.

Parameters
----------
residual
    (rows, columns) of the local stage; columns may be several sets of those of the state.

Returns
-------
step, moved
    (rows, columns) each: on the data, and what that does to the traces. Time steps do not see each other in it.
)doc";

constexpr const char* samples_doc =
    R"doc(The law of one interface, column by column and without transforms.

Parameters
----------
interface
    Name.
free_jump
    (points * components, columns): the jump without any interface force.
parameters
    name -> values that replace those of `laws`, with as many columns or one.

Returns
-------
force, jump
    (points * components, columns) each.
)doc";

std::string shape_of(const latin::Matrix& matrix) {
  return "(" + std::to_string(matrix.rows()) + ", " + std::to_string(matrix.cols()) + ")";
}

OperatorOptions operator_options(const std::string& kind, const std::string& backend,
                                 double memory_limit) {
  OperatorOptions options;
  if (!(memory_limit >= 0.0)) {
    throw latin::InputError("memory_limit is " + std::to_string(memory_limit) +
                            ": it must not be negative");
  }
  options.memory_limit = memory_limit;
  if (kind == "condensed") {
    options.kind = OperatorKind::condensed;
  } else if (kind == "factored") {
    options.kind = OperatorKind::factored;
  } else if (kind != "automatic") {
    throw latin::InputError("operator '" + kind + "': use 'automatic', 'condensed' or 'factored'");
  }
  if (backend == "cholmod") {
    options.backend = latin::algebra::FactorBackend::cholmod;
  } else if (backend == "cholmod64") {
    options.backend = latin::algebra::FactorBackend::cholmod64;
  } else if (backend == "mumps") {
    options.backend = latin::algebra::FactorBackend::mumps;
  } else if (backend != "automatic") {
    throw latin::InputError("backend '" + backend + "': use 'automatic' or one of " +
                            latin::algebra::available_backends());
  }
  return options;
}

std::shared_ptr<Structure> make_structure(py::handle bodies, py::handle interfaces,
                                          const std::string& kind, const std::string& backend,
                                          py::handle memory_limit, py::handle comm,
                                          const std::shared_ptr<Structure>& before) {
  const OperatorOptions options =
      operator_options(kind, backend, to_number(memory_limit, "memory_limit"));
  auto all_bodies = to_values<BodyDescription>(bodies, "bodies", "Body");
  auto all_interfaces = to_values<InterfaceDescription>(interfaces, "interfaces", "Interface");
  const latin::Communicator ranks = to_communicator(comm);
  const bool alone = ranks.alone();
  const py::gil_scoped_release release;
  return hearing_signals(alone, [&] {
    return std::make_shared<Structure>(std::move(all_bodies), std::move(all_interfaces), options,
                                       ranks, before.get());
  });
}

py::dict cost_of(const Body& body) {
  const BodyCost& cost = body.cost();
  return py::dict("body"_a = body.name(), "unknowns"_a = body.size(), "active"_a = body.active(),
                  "rows"_a = body.rows(), "condensed"_a = body.condensed(), "kept"_a = body.kept(),
                  "backend"_a = body.backend(), "assemble_s"_a = cost.assemble_s,
                  "factorise_s"_a = cost.factorise_s, "condense_s"_a = cost.condense_s,
                  "factor_numbers"_a = cost.factor_numbers, "dense_numbers"_a = cost.dense_numbers);
}

/// Changes of laws as Python gives them; None: as it is.
Laws changed(Laws laws, py::handle steps, py::handle modes, py::handle parameters,
             py::handle columns, py::handle extra_loads, py::handle stiffness, py::handle in_time) {
  const Structure& structure = laws.structure();
  std::vector<std::pair<std::string, std::vector<LawColumns>>> groups;
  if (!columns.is_none()) {
    for (const auto& [name, given] : to_entries(columns, "columns")) {
      groups.emplace_back(name, to_columns(given, "columns['" + name + "']"));
    }
  }
  std::vector<LawParameter> values;
  if (!parameters.is_none()) {
    values = to_parameters(parameters);
  }
  std::map<std::string, latin::Matrix> loads;
  if (!extra_loads.is_none()) {
    for (const auto& [name, load] : to_entries(extra_loads, "extra_loads")) {
      loads.emplace(name, to_matrix(load, "extra_loads['" + name + "']", any, structure.loads()));
    }
  }
  std::map<std::string, latin::substructure::StiffnessFactors> factors;
  if (!stiffness.is_none()) {
    for (const auto& [name, given] : to_entries(stiffness, "stiffness")) {
      const std::string where = "stiffness['" + name + "']";
      if (py::hasattr(given, "_native")) {  // as latin_core.stochastic has it
        const py::object native = given.attr("_native");
        factors[name].coupling = py::cast<std::shared_ptr<latin::stochastic::Coupling>>(native);
        continue;
      }
      const std::vector<py::object> both = to_items(given, where);
      if (both.size() != 2) {
        throw latin::InputError(where + ": give (values, forward)");
      }
      auto& own = factors[name];
      own.field = to_matrix(both[0], where + ": values");
      own.values = own.field.reshaped();
      if (!both[1].is_none()) {
        own.forward = to_matrix(both[1], where + ": forward");
      }
    }
  }
  const Index count = steps.is_none() ? laws.steps() : to_index(steps, "steps");
  const Index solutions = modes.is_none() ? laws.modes() : to_index(modes, "modes");
  const bool keeps_loads = extra_loads.is_none();
  const bool keeps_times = in_time.is_none();
  latin::Matrix times = keeps_times ? latin::Matrix() : to_matrix(in_time, "in_time");
  const py::gil_scoped_release release;
  laws = laws.with_steps(count).with_modes(solutions);
  if (!keeps_times) {
    laws = laws.with_times(std::move(times));
  }
  // new groups take the place of old ones, which would hide parameters
  for (const auto& [name, group] : groups) {
    laws = laws.with_columns(name, {});
  }
  laws = laws.with_parameters(values);
  for (auto& [name, group] : groups) {
    laws = laws.with_columns(name, std::move(group));
  }
  return (keeps_loads ? laws : laws.with_extra_loads(loads)).with_stiffness(factors);
}

/// @throws InputError if the laws are those of another structure
const Structure& check_laws(const Structure& structure, const Laws& laws) {
  if (&laws.structure() != &structure) {
    throw latin::InputError("laws: they belong to another structure; make them by its laws()");
  }
  return structure;
}

/// @throws InputError if a state is not one of the structure; columns: any
void check_state(const Structure& structure, const State& state, const std::string& name,
                 Index columns) {
  for (const latin::Matrix* block : {&state.data, &state.traces}) {
    if (block->rows() != structure.rows() || block->cols() != state.data.cols() ||
        (columns != any && block->cols() != columns)) {
      throw latin::InputError(name + " has shape " + shape_of(*block) + ", this problem needs (" +
                              std::to_string(structure.rows()) + ", " +
                              (columns == any ? "any" : std::to_string(columns)) + ")");
    }
  }
}

py::tuple pair_of(LocalFields fields) {
  return py::make_tuple(std::move(fields.force), std::move(fields.jump));
}

latin::Matrix global_stage(const Structure& structure, const Laws& laws, py::handle data,
                           py::handle amplitudes) {
  check_laws(structure, laws);
  const latin::Matrix factors = to_amplitudes(amplitudes, structure);
  const latin::Matrix s = to_matrix(data, "data", structure.rows(), factors.cols());
  latin::Matrix traces(s.rows(), s.cols());
  const py::gil_scoped_release release;
  GlobalStage(laws).apply(s, factors, traces);
  return traces;
}

latin::Matrix local_stage(const Structure& structure, const Laws& laws, py::handle data,
                          py::handle traces) {
  check_laws(structure, laws);
  const latin::Matrix s = to_matrix(data, "data", structure.rows());
  const latin::Matrix w = to_matrix(traces, "traces", structure.rows(), s.cols());
  latin::Matrix residual(s.rows(), s.cols());
  const py::gil_scoped_release release;
  LocalStage(laws, s.cols()).apply(s, w, residual);
  return residual;
}

LocalFields local_fields(const Structure& structure, const Laws& laws, const std::string& interface,
                         const State& state) {
  check_laws(structure, laws);
  check_state(structure, state, "state: it", any);
  const py::gil_scoped_release release;
  return LocalStage(laws, state.data.cols())
      .fields(structure.find_interface(interface), state.data, state.traces);
}

LocalFields samples(const Structure& structure, const Laws& laws, const std::string& interface,
                    py::handle free_jump, py::handle parameters) {
  check_laws(structure, laws);
  const latin::Matrix jump = to_matrix(free_jump, "free_jump");
  std::vector<std::pair<std::string, latin::Matrix>> values;
  if (!parameters.is_none()) {
    for (const auto& [name, given] : to_entries(parameters, "parameters")) {
      values.emplace_back(name, to_matrix(given, "parameters['" + name + "']"));
    }
  }
  const py::gil_scoped_release release;
  return resolve_samples(laws, structure.find_interface(interface), jump, values);
}

/// The structure with the tangents that its laws have at a state. What it was made from lives as long as it does.
class Linearised {
 public:
  Linearised(const Laws& laws, const State& state, bool transposed) : laws_(laws) {
    if (transposed) {
      tangents_.take_transposed(laws_, state);
    } else {
      tangents_.take(laws_, state);
    }
  }
  py::tuple correct(py::handle residual) const {
    latin::Matrix step = to_matrix(residual, "residual", laws_.structure().rows());
    if (step.cols() % columns_ != 0) {
      throw latin::InputError("residual has " + std::to_string(step.cols()) +
                              " columns, whole sets of " + std::to_string(columns_) +
                              " are wanted");
    }
    latin::Matrix moved(step.rows(), step.cols());
    tangents_.correct(step,
                      moved);  // with the interpreter's lock: a factor solves for one at a time
    return py::make_tuple(std::move(step), std::move(moved));
  }
  [[nodiscard]] Index rows() const { return laws_.structure().rows(); }
  Linearised& of_columns(Index columns) {
    columns_ = columns;
    return *this;
  }

 private:
  Laws laws_;
  latin::iteration::Linearisation tangents_;
  Index columns_ = 1;
};

std::shared_ptr<Linearised> linearised(const Structure& structure, const Laws& laws,
                                       const State& state, bool transposed) {
  check_laws(structure, laws);
  check_state(structure, state, "state: it", any);
  if (!Tangent::possible(structure)) {
    throw latin::NumericalError("the tangent of this structure costs more than its bodies");
  }
  const py::gil_scoped_release release;
  auto result = std::make_shared<Linearised>(laws, state, transposed);
  result->of_columns(state.data.cols());
  return result;
}

py::dict displacement_fields(const Structure& structure, const Laws& laws, const State& state,
                             py::handle amplitudes) {
  check_laws(structure, laws);
  const latin::Matrix factors = to_amplitudes(amplitudes, structure);
  check_state(structure, state, "state: it", factors.cols());
  std::vector<std::pair<std::string, latin::Matrix>> fields;
  {
    const py::gil_scoped_release release;
    fields = displacements(laws, state.data, factors);
  }
  py::dict named;
  for (auto& [name, values] : fields) {
    named[py::str(name)] = std::move(values);
  }
  return named;
}

py::dict response_to(const Structure& structure, const py::handle forces) {
  std::map<std::string, latin::Matrix> given;
  Index columns = any;
  for (const auto& [name, block] : to_entries(forces, "forces")) {
    latin::Matrix force = to_matrix(block, "forces['" + name + "']", any, columns);
    columns = force.cols();
    given.emplace(name, std::move(force));
  }
  std::vector<std::pair<std::string, latin::Matrix>> fields;
  {
    const py::gil_scoped_release release;
    for (std::size_t b = 0; b < structure.bodies().size(); ++b) {
      const std::vector<std::string>& members = structure.members()[b];
      std::vector<latin::Matrix> of_body;
      for (const std::string& name : members) {
        const auto found = given.find(name);
        if (found == given.end()) {
          throw latin::InputError("forces: none for substructure '" + name + "'");
        }
        of_body.push_back(found->second);
      }
      std::vector<latin::Matrix> moved = structure.bodies()[b].response_to(of_body);
      for (std::size_t e = 0; e < members.size(); ++e) {
        fields.emplace_back(members[e], std::move(moved[e]));
      }
    }
  }
  py::dict named;
  for (auto& [name, values] : fields) {
    named[py::str(name)] = std::move(values);
  }
  return named;
}

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

/// Run what calls the user's Python; StopIteration ends a run with what is done so far (as in SciPy's minimize).
template <class Call>
void interruptible(Call&& call) {
  try {
    std::forward<Call>(call)();
  } catch (const py::error_already_set& error) {
    if (error.matches(PyExc_StopIteration)) {
      throw latin::Interrupted();
    }
    throw;
  }
}

/// Signals are answered at every iteration, with or without a callback of the user, which must outlive it.
latin::iteration::Callback guarded(const py::object& callback) {
  check_callable(callback, "callback");
  answer_interrupts();
  return [&callback](const latin::iteration::Iteration& iteration) {
    const py::gil_scoped_acquire gil;
    if (PyErr_CheckSignals() != 0) {
      throw py::error_already_set();
    }
    if (!callback.is_none()) {
      interruptible([&] { callback(iteration); });
    }
  };
}

py::tuple solve(const Structure& structure, const Laws& laws, const py::object& options,
                py::handle amplitudes, py::handle start, const py::object& callback,
                const py::object& balanced) {
  check_laws(structure, laws);
  const latin::iteration::Options settings = to_options(options);
  const latin::Matrix factors = to_amplitudes(amplitudes, structure);
  const std::vector<py::object> held = to_items(start, "start");
  std::vector<const State*> snapshots;
  for (std::size_t i = 0; i < held.size(); ++i) {
    snapshots.push_back(&to_object<State>(held, i, "start", "State"));
    check_state(structure, *snapshots.back(), "start[" + std::to_string(i) + "]: a start state",
                factors.cols());
  }
  const auto guard = guarded(callback);
  check_callable(balanced, "balanced");
  latin::iteration::Balanced can_balance;
  if (!balanced.is_none()) {
    can_balance = [&balanced](Index column) {
      const py::gil_scoped_acquire gil;
      return balanced(column).cast<bool>();
    };
  }
  State state;
  Summary summary;
  {
    const py::gil_scoped_release release;
    summary =
        latin::iteration::solve(laws, settings, factors, state, snapshots, guard, {}, can_balance);
  }
  return py::make_tuple(std::move(summary), std::move(state));
}

std::string sweep(const Structure& structure, const Laws& laws, const py::object& options,
                  py::handle amplitudes, py::handle parameters, py::handle order, py::handle known,
                  py::handle known_points, const py::object& callback,
                  const py::object& point_callback, const py::object& next_points,
                  Beginning* beginning) {
  check_laws(structure, laws);
  const latin::iteration::Options settings = to_options(options);
  const latin::Matrix factors = to_amplitudes(amplitudes, structure);
  const auto swept = to_swept(parameters);
  const std::vector<Index> points = to_indices(order, "order");
  auto states = to_values<State>(known, "known", "State");
  auto positions = to_indices(known_points, "known_points");
  check_callable(point_callback, "point_callback");
  check_callable(next_points, "next_points");
  const auto guard = guarded(callback);
  const latin::iteration::PointCallback finished = [&point_callback](
                                                       Index point, const Laws& of_point,
                                                       const Summary& summary, const State& state) {
    const py::gil_scoped_acquire gil;
    if (!point_callback.is_none()) {
      interruptible([&] { point_callback(point, of_point, summary, state); });
    }
  };
  latin::iteration::NextPoints next;
  if (!next_points.is_none()) {
    next = [&next_points] {
      const py::gil_scoped_acquire gil;
      std::vector<Index> found;
      interruptible([&] { found = to_indices(next_points(), "next_points"); });
      return found;
    };
  }
  const py::gil_scoped_release release;
  return to_string(latin::iteration::sweep(laws, settings, factors, swept, points,
                                           std::move(states), std::move(positions), guard, finished,
                                           next, beginning));
}

/// Pickling refused, with what to do instead.
template <class T>
void refuse_pickle(py::class_<T, std::shared_ptr<T>>& cls, const std::string& why) {
  cls.def("__reduce__", [why](const T&) -> py::object { throw py::type_error(why); });
}

using StructureClass = py::class_<Structure, std::shared_ptr<Structure>>;

void bind_facts(StructureClass& cls) {
  cls.def("__repr__",
          [](const Structure& s) {
            return "Structure(" + std::to_string(s.bodies().size()) + " bodies with " +
                   std::to_string(s.unknowns()) + " unknowns, " +
                   std::to_string(s.interfaces().size()) + " active interfaces with " +
                   std::to_string(s.rows()) + " rows)";
          })
      .def_property_readonly("rows", &Structure::rows, "Rows of a block of interface data.")
      .def_property_readonly("total_rows", &Structure::total_rows, "Rows of all ranks.")
      .def_property_readonly("loads", &Structure::loads, "Number of load patterns.")
      .def_property_readonly("unknowns", &Structure::unknowns, "Unknowns of all bodies.")
      .def_property_readonly("active_unknowns", &Structure::active_unknowns,
                             "Unknowns that a side touches.")
      .def_property_readonly("macro_size", &Structure::macro_size,
                             "Unknowns of the coarse problem; 0: there is none.")
      .def_property_readonly("weights", &Structure::weights, "(rows,) areas, read-only.")
      .def_property_readonly("directions", &Structure::directions,
                             "(rows,) search directions k, force / length^3, read-only.")
      .def_property_readonly(
          "interfaces",
          [](const Structure& s) {
            std::vector<std::string> names;
            for (const ActiveInterface& each : s.interfaces()) {
              names.push_back(each.name());
            }
            return names;
          },
          "Names of the active interfaces of this rank.")
      .def_property_readonly(
          "costs",
          [](const Structure& s) {
            py::list costs;
            for (const Body& body : s.bodies()) {
              costs.append(cost_of(body));
            }
            return costs;
          },
          "What every body took: seconds and numbers, a dictionary each.")
      .def(
          "first_rows",
          [](const Structure& s, const std::string& interface) {
            return s.interface(s.find_interface(interface)).rows;
          },
          "interface"_a,
          "First row of each side of an interface in a block; -1 for a side on another rank.")
      .def(
          "flexibility",
          [](const Structure& s, const std::string& interface) {
            return latin::Vector(s.interface(s.find_interface(interface)).flexibility);
          },
          "interface"_a,
          "(points * components,) 1/k1 (+ 1/k2): how much a unit force closes a jump.")
      .def(
          "laws",
          [](const std::shared_ptr<Structure>& self, py::handle steps, py::handle parameters,
             py::handle columns, py::handle extra_loads, py::handle modes, py::handle stiffness,
             py::handle in_time) {
            return changed(Laws(self), steps, modes, parameters, columns, extra_loads, stiffness,
                           in_time);
          },
          "steps"_a = 1, "parameters"_a = py::none(), "columns"_a = py::none(),
          "extra_loads"_a = py::none(), "modes"_a = 1, "stiffness"_a = py::none(),
          "in_time"_a = py::none(), make_laws_doc);
}

void bind_calls(StructureClass& cls) {
  cls.def("solve", &solve, "laws"_a, py::kw_only(), "options"_a = py::none(),
          "amplitudes"_a = py::none(), "start"_a = py::tuple(), "callback"_a = py::none(),
          "balanced"_a = py::none(), solve_doc)
      .def("sweep", &sweep, "laws"_a, py::kw_only(), "options"_a = py::none(),
           "amplitudes"_a = py::none(), "parameters"_a, "order"_a, "known"_a = py::tuple(),
           "known_points"_a = py::tuple(), "callback"_a = py::none(),
           "point_callback"_a = py::none(), "next_points"_a = py::none(),
           "beginning"_a = py::none(), sweep_doc)
      .def("global_stage", &global_stage, "laws"_a, "data"_a, "amplitudes"_a = py::none(),
           "Traces w (rows, columns) that data s (rows, columns) and loads (loads, columns) leave.")
      .def("local_stage", &local_stage, "laws"_a, "data"_a, "traces"_a,
           "Residual (rows, columns) of the laws: what the next data differ by. Collective among "
           "neighbours.")
      .def(
          "local_fields",
          [](const Structure& s, const Laws& laws, const std::string& interface,
             const State& state) { return pair_of(local_fields(s, laws, interface, state)); },
          "laws"_a, "interface"_a, "state"_a, local_fields_doc)
      .def(
          "resolve_samples",
          [](const Structure& s, const Laws& laws, const std::string& interface,
             py::handle free_jump, py::handle parameters) {
            return pair_of(samples(s, laws, interface, free_jump, parameters));
          },
          "laws"_a, "interface"_a, "free_jump"_a, "parameters"_a = py::none(), samples_doc)
      .def("linearised", &linearised, "laws"_a, "state"_a, "transposed"_a = false, linearised_doc)
      .def("displacements", &displacement_fields, "laws"_a, "state"_a, "amplitudes"_a = py::none(),
           "Displacements (n, columns) of every substructure of this rank, by its name.")
      .def("response_to", &response_to, "forces"_a,
           "Displacements (n, columns) of every substructure of this rank under forces (n, "
           "columns) on all of "
           "them and nothing else, by name.");
}

void bind_one_structure(py::module_& m) {
  StructureClass cls(m, "Structure", structure_doc);
  refuse_pickle(
      cls,
      "a Structure holds factorised matrices and cannot be pickled or copied: keep what it was "
      "built from");
  cls.def(py::init(&make_structure), py::kw_only(), "bodies"_a, "interfaces"_a = py::tuple(),
          "operator"_a = "automatic", "backend"_a = "automatic",
          "memory_limit"_a = OperatorOptions().memory_limit, "comm"_a = py::none(),
          "before"_a = py::none());
  bind_facts(cls);
  bind_calls(cls);
}

void bind_laws_value(py::module_& m) {
  py::class_<Laws, std::shared_ptr<Laws>> cls(m, "Laws", laws_doc);
  refuse_pickle(
      cls, "Laws belong to a Structure, which cannot be pickled: keep what both were made from");
  cls.def("__repr__",
          [](const Laws& laws) {
            return "Laws(" + std::to_string(laws.structure().interfaces().size()) +
                   " interfaces, " + std::to_string(laws.steps()) + " steps" +
                   (laws.transformed() ? ", transformed columns)" : ")");
          })
      .def("__copy__", [](const Laws& laws) { return laws; })
      .def("__deepcopy__", [](const Laws& laws, const py::object&) { return laws; })
      .def_property_readonly("steps", &Laws::steps, "Columns that are the steps of one history.")
      .def_property_readonly(
          "modes", &Laws::modes,
          "Chaos modes that a solution has at every time step; 1: every column is a solution.")
      .def_property_readonly(
          "interfaces",
          [](const Laws& laws) {
            py::dict names;
            for (std::size_t i = 0; i < laws.structure().interfaces().size(); ++i) {
              names[py::str(laws.structure().interface(i).name())] = laws.of(i).law->name();
            }
            return names;
          },
          "Names of the laws by interface.")
      .def(
          "parameter",
          [](const Laws& laws, const std::string& interface, const std::string& name) {
            return latin::Matrix(laws.parameter(interface, name));
          },
          "interface"_a, "name"_a, "A parameter without transforms, as it was set; a copy.")
      .def(
          "with_",
          [](const Laws& laws, py::handle steps, py::handle parameters, py::handle columns,
             py::handle extra_loads, py::handle modes, py::handle stiffness, py::handle in_time) {
            return changed(laws, steps, modes, parameters, columns, extra_loads, stiffness,
                           in_time);
          },
          py::kw_only(), "steps"_a = py::none(), "parameters"_a = py::none(),
          "columns"_a = py::none(), "extra_loads"_a = py::none(), "modes"_a = py::none(),
          "stiffness"_a = py::none(), "in_time"_a = py::none(), with_doc);
}

}  // namespace

void bind_structure(py::module_& m) {
  py::class_<Linearised, std::shared_ptr<Linearised>> cls(m, "Linearised", linearised_doc);
  refuse_pickle(cls, "a Linearised structure holds factorised matrices: make it again");
  cls.def("__repr__",
          [](const Linearised& l) { return "Linearised(" + std::to_string(l.rows()) + " rows)"; });
  cls.def("correct", &Linearised::correct, "residual"_a, correct_doc);
  py::class_<Beginning, std::shared_ptr<Beginning>> beginning(
      m, "Beginning",
      "Tangents of linear laws, kept from one sweep of them to the next: see "
      "Structure.sweep().");
  refuse_pickle(beginning, "it holds factorised matrices: it is made again");
  beginning.def(py::init<>());
  beginning.def("__repr__", [](const Beginning&) { return "Beginning()"; });
  bind_laws_value(m);
  bind_one_structure(m);
}
