#include "arguments.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "algebra/handle.hpp"
#include "latin/common/error.hpp"
#include "petsc4py_mat.hpp"

namespace latin_bindings {
namespace {

using namespace py::literals;

std::string type_of(py::handle value) {
  return py::cast<std::string>(py::type::of(value).attr("__name__"));
}

std::string text_of(Index extent) { return extent == any ? "any" : std::to_string(extent); }

std::string shape_of(const py::array& array) {
  return py::cast<std::string>(py::str(array.attr("shape")));
}

/// Real numbers of any shape.
py::array to_array(py::handle value, const std::string& name) {
  if (py::hasattr(value, "mask") && py::hasattr(value, "filled")) {
    throw py::type_error(name + ": a masked array is given: say with .filled() what stands there");
  }
  const auto array = py::array::ensure(value);
  if (!array) {
    PyErr_Clear();
    throw py::type_error(name + ": an array of real numbers is wanted, got " + type_of(value));
  }
  if (std::string_view("fiub").find(array.dtype().kind()) == std::string_view::npos) {
    throw py::type_error(name + ": an array of real numbers is wanted, got " + type_of(value) +
                         " of dtype " + py::cast<std::string>(py::str(array.dtype())));
  }
  return array;
}

const latin::Matrix& demand_finite(const latin::Matrix& matrix, const std::string& name) {
  for (Index column = 0; column < matrix.cols(); ++column) {
    for (Index row = 0; row < matrix.rows(); ++row) {
      if (!std::isfinite(matrix(row, column))) {
        throw latin::InputError(name + ": finite numbers are wanted, got " +
                                std::to_string(matrix(row, column)) + " at (" +
                                std::to_string(row) + ", " + std::to_string(column) + ")");
      }
    }
  }
  return matrix;
}

py::object attribute(py::handle value, const char* key, const std::string& name,
                     const std::string& wanted) {
  if (!py::hasattr(value, key)) {
    throw py::type_error(name + ": " + wanted + " is wanted, got " + type_of(value));
  }
  return value.attr(key);
}

Mat to_mat(py::handle value, const std::string& name) {
  Mat matrix = borrow_mat(value);
  if (matrix == nullptr) {
    throw py::type_error(name + ": a petsc4py.PETSc.Mat is wanted, got " + type_of(value) +
                         (type_of(value) == "Mat" ? " that does not exist" : ""));
  }
  return matrix;
}

latin::SparseRows from_scipy(py::handle value, const std::string& name) {
  const py::object csr = value.attr("tocsr")();
  const latin::Vector values = to_vector(csr.attr("data"), name);
  const auto starts = py::array_t<long long, py::array::forcecast>::ensure(csr.attr("indptr"));
  const auto columns = py::array_t<long long, py::array::forcecast>::ensure(csr.attr("indices"));
  const auto [rows, cols] = py::cast<std::pair<Index, Index>>(csr.attr("shape"));
  constexpr auto most = static_cast<Index>(std::numeric_limits<int>::max());
  if (rows > most || cols > most || values.size() > most) {
    throw latin::InputError(name + ": a matrix of more than " + std::to_string(most) +
                            " rows, columns or entries");
  }
  const auto broken = [&name]() -> latin::InputError {
    return latin::InputError(name + ": its row starts and column indices are no CSR matrix");
  };
  if (starts.size() != rows + 1 || columns.size() != values.size() || starts.at(0) != 0 ||
      starts.at(rows) != values.size()) {
    throw broken();
  }
  std::vector<Eigen::Triplet<double>> entries;
  entries.reserve(static_cast<std::size_t>(values.size()));
  for (Index row = 0; row < rows; ++row) {
    if (starts.at(row) > starts.at(row + 1) || starts.at(row + 1) > values.size()) {
      throw broken();
    }
    for (long long at = starts.at(row); at < starts.at(row + 1); ++at) {
      if (columns.at(at) < 0 || columns.at(at) >= cols) {
        throw broken();
      }
      entries.emplace_back(static_cast<int>(row), static_cast<int>(columns.at(at)), values(at));
    }
  }
  latin::SparseRows matrix(rows, cols);
  matrix.setFromTriplets(entries.begin(), entries.end());
  return matrix;
}

}  // namespace

latin::Matrix to_matrix(py::handle value, const std::string& name, Index rows, Index cols) {
  const py::array array = to_array(value, name);
  const auto ndim = array.ndim();
  const Index given_rows = ndim > 0 ? array.shape(0) : 1;
  const Index given_cols = ndim > 1 ? array.shape(1) : 1;
  if (ndim > 2 || (rows != any && given_rows != rows) || (cols != any && given_cols != cols)) {
    throw latin::InputError(name + ": shape (" + text_of(rows) + ", " + text_of(cols) +
                            ") is wanted, got " + shape_of(array));
  }
  using Columns = py::array_t<double, py::array::f_style | py::array::forcecast>;
  const Columns numbers = Columns::ensure(array);
  if (!numbers) {
    throw py::error_already_set();
  }
  return Eigen::Map<const latin::Matrix>(numbers.data(), given_rows, given_cols);
}

latin::Matrix to_finite_matrix(py::handle value, const std::string& name, Index rows, Index cols) {
  return demand_finite(to_matrix(value, name, rows, cols), name);
}

latin::Vector to_vector(py::handle value, const std::string& name) {
  return to_finite_matrix(value, name, any, 1).col(0);
}

Index to_index(py::handle value, const std::string& name) {
  // what has __index__ is an integer: NumPy's are, 2.0 is not
  const auto number = py::reinterpret_steal<py::object>(PyNumber_Index(value.ptr()));
  if (!number) {
    PyErr_Clear();
    throw py::type_error(name + ": an integer is wanted, got " +
                         py::cast<std::string>(py::repr(value)));
  }
  const Index index = PyLong_AsSsize_t(number.ptr());
  if (index == -1 && PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    throw latin::InputError(name + ": " + py::cast<std::string>(py::repr(value)) +
                            " is out of the range of integers");
  }
  return index;
}

std::vector<Index> to_indices(py::handle value, const std::string& name) {
  std::vector<Index> indices;
  for (const py::object& item : to_items(value, name)) {
    indices.push_back(to_index(item, name + "[" + std::to_string(indices.size()) + "]"));
  }
  return indices;
}

double to_number(py::handle value, const std::string& name) {
  const double number = PyFloat_AsDouble(value.ptr());
  if (number == -1.0 && PyErr_Occurred() != nullptr) {
    PyErr_Clear();
    throw py::type_error(name + ": a number is wanted, got " +
                         py::cast<std::string>(py::repr(value)));
  }
  return number;
}

std::string to_text(py::handle value, const std::string& name) {
  if (!py::isinstance<py::str>(value)) {
    throw py::type_error(name + ": a text is wanted, got " + type_of(value));
  }
  return py::cast<std::string>(value);
}

std::vector<py::object> to_items(py::handle value, const std::string& name) {
  if (py::isinstance<py::str>(value) || py::isinstance<py::bytes>(value) ||
      py::isinstance<py::dict>(value) || !py::isinstance<py::iterable>(value)) {
    throw py::type_error(name + ": a sequence is wanted, got " + type_of(value));
  }
  std::vector<py::object> items;
  for (const py::handle item : value) {
    items.push_back(py::reinterpret_borrow<py::object>(item));
  }
  return items;
}

std::vector<std::pair<std::string, py::object>> to_entries(py::handle value,
                                                           const std::string& name) {
  if (!py::hasattr(value, "items")) {
    throw py::type_error(name + ": a mapping is wanted, got " + type_of(value));
  }
  std::vector<std::pair<std::string, py::object>> entries;
  for (const py::handle item : value.attr("items")()) {
    const auto pair = py::cast<std::pair<py::object, py::object>>(item);
    entries.emplace_back(to_text(pair.first, "a key of " + name), pair.second);
  }
  return entries;
}

latin::SparseRows to_petsc_copy(py::handle value, const std::string& name) {
  return latin::algebra::to_sparse(to_mat(value, name), name);
}

std::shared_ptr<const latin::SparseView> to_petsc_view(py::handle value, const std::string& name) {
  return latin::algebra::view_sparse(to_mat(value, name), name);
}

latin::SparseRows to_sparse(py::handle value, const std::string& name) {
  if (py::hasattr(value, "tocsr")) {
    return from_scipy(value, name);
  }
  return to_petsc_copy(value, name);
}

latin::Communicator to_communicator(py::handle value) {
  if (value.is_none()) {
    return {};
  }
  const Index handle =
      py::hasattr(value, "py2f") ? to_index(value.attr("py2f")(), "comm") : to_index(value, "comm");
  int initialised = 0;
  latin::check_mpi(MPI_Initialized(&initialised), "MPI_Initialized");
  const MPI_Comm comm =
      initialised != 0 ? MPI_Comm_f2c(static_cast<MPI_Fint>(handle)) : MPI_COMM_NULL;
  if (comm == MPI_COMM_NULL || comm == MPI_Comm{}) {
    throw latin::InputError("comm: " + std::to_string(handle) +
                            " is no communicator: give an mpi4py one, or its py2f()");
  }
  return latin::Communicator(comm);
}

latin::iteration::Options to_options(py::object value) {
  if (value.is_none()) {
    value = py::module_::import("latin_core.options").attr("Options")();
  }
  const auto get = [&value](const char* key) {
    return attribute(value, key, "options", "a latin_core.Options");
  };
  const auto choose = [&get](const char* key, const std::string& first, const std::string& second) {
    const std::string name = "options." + std::string(key);
    const std::string chosen = to_text(get(key), name);
    if (chosen != first && chosen != second) {
      throw latin::InputError(name + " is '" + chosen + "': use '" + first + "' or '" + second +
                              "'");
    }
    return chosen == second;
  };
  const auto integer = [&get](const char* key) {
    return to_index(get(key), "options." + std::string(key));
  };
  latin::iteration::Options options;
  options.rtol = to_number(get("rtol"), "options.rtol");
  options.stop_on_indicator = choose("criterion", "error", "indicator");
  options.max_iterations = integer("max_iterations");
  options.max_seconds = to_number(get("max_seconds"), "options.max_seconds");
  options.acceleration = integer("acceleration");
  options.relaxation = to_number(get("relaxation"), "options.relaxation");
  options.stagnation_window = integer("stagnation_window");
  const py::object newton = get("newton");
  if (!py::isinstance<py::str>(newton) || newton.cast<std::string>() != "automatic") {
    options.newton = to_index(newton, "options.newton");
  }
  options.snapshots = integer("snapshots");
  options.together = integer("together");
  const py::object scatter = get("scatter");
  if (!py::isinstance<py::bool_>(scatter)) {
    throw py::type_error("options.scatter: True or False is wanted, got " +
                         py::cast<std::string>(py::repr(scatter)));
  }
  options.scatter = py::cast<bool>(scatter);
  options.single_precision = choose("precision", "double", "single");
  options.check();
  return options;
}

latin::Matrix to_amplitudes(py::handle value, const latin::substructure::Structure& structure) {
  if (value.is_none()) {
    return latin::Matrix::Ones(structure.loads(), 1);
  }
  latin::Matrix amplitudes = to_finite_matrix(value, "amplitudes", structure.loads());
  if (amplitudes.cols() == 0) {
    throw latin::InputError("amplitudes: at least one column is wanted, got none");
  }
  return amplitudes;
}

void check_callable(py::handle value, const std::string& name) {
  if (!value.is_none() && PyCallable_Check(value.ptr()) == 0) {
    throw py::type_error(name + ": a function or None is wanted, got " + type_of(value));
  }
}

std::vector<latin::iteration::SweptParameter> to_swept(py::handle value) {
  std::vector<latin::iteration::SweptParameter> all;
  for (const py::object& item : to_items(value, "parameters")) {
    const std::string name = "parameters[" + std::to_string(all.size()) + "]";
    const auto get = [&](const char* key) {
      return attribute(item, key, name, "a latin_core.SweptParameter");
    };
    all.push_back({to_text(get("interface"), name + ".interface"),
                   to_text(get("parameter"), name + ".parameter"),
                   to_finite_matrix(get("pattern"), name + ".pattern"),
                   to_finite_matrix(get("values"), name + ".values"),
                   to_index(get("columns"), name + ".columns")});
  }
  return all;
}

std::vector<latin::substructure::LawParameter> to_parameters(py::handle value) {
  std::vector<latin::substructure::LawParameter> all;
  for (const auto& [interface, given] : to_entries(value, "parameters")) {
    const std::string where = "parameters['" + interface + "']";
    for (const auto& [parameter, values] : to_entries(given, where)) {
      all.push_back({interface, parameter, to_matrix(values, where + "['" + parameter + "']")});
    }
  }
  return all;
}

std::vector<latin::substructure::LawColumns> to_columns(py::handle value, const std::string& name) {
  std::vector<latin::substructure::LawColumns> groups;
  for (const py::object& item : to_items(value, name)) {
    const std::string where = name + "[" + std::to_string(groups.size()) + "]";
    latin::substructure::LawColumns& group = groups.emplace_back();
    std::vector<latin::Matrix> forward;
    std::vector<latin::Matrix> backward;
    bool begins = false;
    bool ends = false;
    bool orthogonal = true;  // without 'backward'
    for (const auto& [key, given] : to_entries(item, where)) {
      const std::string of_key = where + "['" + key + "']";
      if (key == "begin") {
        group.begin = to_index(given, of_key);
        begins = true;
      } else if (key == "end") {
        group.end = to_index(given, of_key);
        ends = true;
      } else if (key == "forward" || key == "backward") {
        orthogonal = orthogonal && key == "forward";
        for (const py::object& matrix : to_items(given, of_key)) {
          (key == "forward" ? forward : backward).push_back(to_finite_matrix(matrix, of_key));
        }
      } else if (key == "parameters") {
        for (const auto& [parameter, values] : to_entries(given, of_key)) {
          group.parameters.emplace_back(parameter, latin::interface::ParameterField(to_matrix(
                                                       values, of_key + "['" + parameter + "']")));
        }
      } else {
        throw latin::InputError(where + ": unknown key '" + key +
                                "'; known: begin, end, forward, backward, parameters");
      }
    }
    if (orthogonal) {
      backward.resize(forward.size());
    }
    if (!begins || !ends || forward.size() != backward.size()) {
      throw latin::InputError(where + ": 'begin', 'end', and one 'backward' for each 'forward' " +
                              "are wanted, got " + std::to_string(forward.size()) + " and " +
                              std::to_string(backward.size()) + " matrices");
    }
    for (std::size_t i = 0; i < forward.size(); ++i) {
      group.transforms.push_back({std::move(forward[i]), std::move(backward[i]), {}, {}, {}});
    }
  }
  return groups;
}

}  // namespace latin_bindings
