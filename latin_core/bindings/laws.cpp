#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <string_view>

#include "interface/root.hpp"
#include "latin/interface/law.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

using latin::Index;
using latin::Matrix;

/// A reference to a Python object that may be copied and dropped without the interpreter's lock.
std::shared_ptr<PyObject> shared_reference(py::object object) {
  return {object.release().ptr(), [](PyObject* held) {
            if (Py_IsInitialized() != 0) {  // else the interpreter ended before its objects
              const py::gil_scoped_acquire gil;
              Py_DECREF(held);
            }
          }};
}

/// A batched law written in Python.
class PythonLaw final : public latin::interface::Law {
 public:
  PythonLaw(std::string name, std::vector<ParameterInfo> parameters, bool history,
            std::shared_ptr<PyObject> function)
      : name_(std::move(name)),
        parameters_(std::move(parameters)),
        history_(history),
        function_(std::move(function)) {}

  [[nodiscard]] std::string name() const override { return name_; }
  [[nodiscard]] std::vector<ParameterInfo> parameters() const override {
    auto all = parameters_;
    all.push_back({"jump", Shape::per_row, -std::numeric_limits<double>::infinity()});
    return all;
  }
  [[nodiscard]] bool history() const override { return history_; }
  [[nodiscard]] std::unique_ptr<latin::interface::Law> blank() const override {
    return std::make_unique<PythonLaw>(name_, parameters_, history_, function_);
  }

  void resolve(const latin::interface::LocalProblem& problem,
               latin::MatrixRef force) const override {
    if (!problem.jump.allFinite()) {  // a diverging iteration is the solver's to report
      force.setConstant(std::numeric_limits<double>::quiet_NaN());
      return;
    }
    const py::gil_scoped_acquire gil;
    const Index components = problem.components;
    const Index points = force.rows() / components;
    const Index columns = force.cols();
    const latin::interface::ParameterField& imposed = get("jump");
    py::array_t<double> jump({points, components, columns});
    auto jumps = jump.mutable_unchecked<3>();
    py::array_t<double> flexibility({points, components, Index{1}});
    auto flexibilities = flexibility.mutable_unchecked<3>();
    for (Index point = 0; point < points; ++point) {
      for (Index a = 0; a < components; ++a) {
        const Index row = components * point + a;
        flexibilities(point, a, 0) = problem.flexibility(row);
        for (Index column = 0; column < columns; ++column) {
          jumps(point, a, column) = problem.jump(row, column) - imposed(row, column);
        }
      }
    }
    py::dict values;
    for (const ParameterInfo& each : parameters_) {
      const latin::interface::ParameterField& field = get(each.name);
      py::array_t<double> array({points, columns});
      auto entries = array.mutable_unchecked<2>();
      for (Index point = 0; point < points; ++point) {
        for (Index column = 0; column < columns; ++column) {
          entries(point, column) = field(point, column);
        }
      }
      values[py::str(each.name)] = array;
    }
    const py::object given = py::reinterpret_borrow<py::object>(function_.get())(
        jump, flexibility, values, problem.steps);
    const auto raw = py::array::ensure(given);
    const bool real =
        raw && std::string_view("fiub").find(raw.dtype().kind()) != std::string_view::npos;
    const auto answer = real ? py::array_t<double, py::array::forcecast>::ensure(raw)
                             : py::array_t<double, py::array::forcecast>();
    const std::string who =
        "interface '" + std::string(problem.interface) + "', law '" + name_ + "': ";
    if (!real || !answer) {
      PyErr_Clear();
      throw latin::InputError(who + "its function did not return an array of numbers");
    }
    if (answer.ndim() != 3 || answer.shape(0) != points || answer.shape(1) != components ||
        answer.shape(2) != columns) {
      throw latin::InputError(who + "its function returned shape " +
                              py::cast<std::string>(py::str(answer.attr("shape"))) +
                              ", expected (points, components, columns) = (" +
                              std::to_string(points) + ", " + std::to_string(components) + ", " +
                              std::to_string(columns) + ")");
    }
    const auto forces = answer.unchecked<3>();
    for (Index column = 0; column < columns; ++column) {
      for (Index row = 0; row < force.rows(); ++row) {
        force(row, column) = forces(row / components, row % components, column);
        if (!std::isfinite(force(row, column))) {
          throw latin::InputError(who + "its function returned " +
                                  std::to_string(force(row, column)) + " at point " +
                                  std::to_string(row / components));
        }
      }
    }
  }

 private:
  std::string name_;
  std::vector<ParameterInfo> parameters_;
  bool history_;
  std::shared_ptr<PyObject> function_;
};

/// What a function of the user returns, in the shape that was asked for.
latin::interface::PointRows to_rows(const py::object& given, Index rows, Index cols) {
  auto found = py::cast<latin::interface::PointRows>(given);
  if (found.rows() != rows || found.cols() != cols) {
    throw latin::InputError("find_roots: a function returned shape (" +
                            std::to_string(found.rows()) + ", " + std::to_string(found.cols()) +
                            "), (" + std::to_string(rows) + ", " + std::to_string(cols) +
                            ") is wanted");
  }
  return found;
}

py::tuple roots_of(const py::function& force, const py::object& tangent,
                   const latin::interface::PointRows& free_jump,
                   const latin::interface::PointRows& flexibility) {
  using latin::interface::ForceFunction;
  using latin::interface::PointRows;
  if (free_jump.rows() != flexibility.rows() || free_jump.cols() != flexibility.cols() ||
      free_jump.cols() < 1 || free_jump.cols() > 3) {
    throw latin::InputError("find_roots: jump and flexibility have one shape (rows, 1 to 3)");
  }
  const Index rows = free_jump.rows();
  const Index n = free_jump.cols();
  ForceFunction law;
  law.force = [&](const PointRows& jump, ForceFunction::Far allowed) {
    return to_rows(force(jump, static_cast<int>(allowed)), rows, n);
  };
  if (!tangent.is_none()) {
    law.tangent = [&](const PointRows& jump) { return to_rows(tangent(jump), rows, n * n); };
  }
  latin::interface::Roots found = latin::interface::find_roots(law, free_jump, flexibility);
  return py::make_tuple(std::move(found.force), std::move(found.bad), std::move(found.off));
}

constexpr const char* find_roots_doc =
    R"doc(Forces f = R(j) with j = j0 - c f of a continuous, monotone law.

Parameters
----------
force
    Called with jumps (rows, n) and what is allowed (0: infinite forces, 1: anything, 2: finite ones only); returns
    R (rows, n).
tangent
    Called with jumps; returns dR_a / dj_b as (rows, n n), b fastest. None: by differences.
free_jump, flexibility
    j0 and c > 0, (rows, n), n at most 3.

Returns
-------
force, bad, off
    (rows, n); (rows,) where no jump was found that its force holds; (rows, n) by how much it misses there.
)doc";

constexpr const char* python_law_doc =
    R"doc(A law written in Python: a batch of points and columns at a time.

Parameters
----------
name
    For messages.
parameters
    (name, smallest admissible value) of each parameter, one value a point. Besides them it has ``jump``, the
    imposed jump, which the function never sees.
history
    Whether a column depends on those before it in its history.
resolve
    Called with the free jump less the imposed one (points, components, columns), the flexibility c (points,
    components, 1), the parameters {name: (points, columns)} and the number of steps of a history; returns the force
    (points, components, columns) of which f = R(jump - c f) holds.
)doc";

}  // namespace

void bind_laws(py::module_& m) {
  using latin::interface::Law;
  py::class_<Law, std::shared_ptr<Law>>(m, "Law", "A law of your own, for ``Interface(law=...)``.")
      .def("__repr__",
           [](const Law& law) {
             return "Law(" + law.name() + (law.history() ? ", with history)" : ")");
           })
      .def_property_readonly("name", &Law::name, "For messages.")
      .def_property_readonly("history", &Law::history,
                             "Whether a column depends on those before it in its history.")
      .def_property_readonly(
          "parameters",
          [](const Law& law) {
            std::vector<std::string> names;
            for (const auto& each : law.parameters()) {
              names.push_back(each.name);
            }
            return names;
          },
          "Names of its parameters.");
  m.def(
      "python_law",
      [](std::string name, const std::vector<std::pair<std::string, double>>& parameters,
         bool history, py::object resolve) -> std::shared_ptr<Law> {
        if (PyCallable_Check(resolve.ptr()) == 0) {
          throw py::type_error("law '" + name + "': resolve must be a function");
        }
        std::vector<Law::ParameterInfo> all;
        for (const auto& [each, minimum] : parameters) {
          if (each == "jump" || std::ranges::count(all, each, &Law::ParameterInfo::name) > 0) {
            throw latin::InputError("law '" + name + "': there are two parameters '" + each + "'");
          }
          all.push_back({each, Law::Shape::per_point, minimum});
        }
        return std::make_shared<PythonLaw>(std::move(name), std::move(all), history,
                                           shared_reference(std::move(resolve)));
      },
      py::kw_only(), "name"_a, "parameters"_a = py::tuple(), "history"_a = false, "resolve"_a,
      python_law_doc);
  m.def("find_roots", &roots_of, "force"_a, "tangent"_a, "free_jump"_a, "flexibility"_a,
        find_roots_doc);
  m.def(
      "compiled_law",
      [](const py::capsule& capsule) -> std::shared_ptr<Law> {
        if (capsule.name() == nullptr ||
            std::string(capsule.name()) != latin::interface::law_capsule) {
          throw latin::InputError("a compiled law comes in a capsule of the name '" +
                                  std::string(latin::interface::law_capsule) + "'");
        }
        return latin::interface::make_law(
            *capsule.get_pointer<const latin::interface::LawFactory>());
      },
      "capsule"_a,
      "A law compiled by the user, from the capsule of its module (see ``docs/laws.md``).");
}
