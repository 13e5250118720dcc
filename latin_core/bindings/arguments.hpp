#pragma once

// What comes from Python is checked here, once, before anything trusts it: every exception names the
// argument, what was given and what is wanted.

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "iteration/solver.hpp"
#include "iteration/sweep.hpp"
#include "latin/common/communicator.hpp"
#include "latin/common/sparse_view.hpp"
#include "latin/common/types.hpp"
#include "substructure/laws.hpp"

namespace latin_bindings {

namespace py = pybind11;
using latin::Index;

/// Any number of rows or columns.
constexpr Index any = -1;

/// Real numbers as a matrix: (n,) is one column, a number (1, 1).
/// @throws TypeError, or InputError on a shape that is not the wanted one
latin::Matrix to_matrix(py::handle value, const std::string& name, Index rows = any,
                        Index cols = any);
/// The same, all of them finite.
latin::Matrix to_finite_matrix(py::handle value, const std::string& name, Index rows = any,
                               Index cols = any);
/// Finite numbers (n,) or (n, 1).
latin::Vector to_vector(py::handle value, const std::string& name);
Index to_index(py::handle value, const std::string& name);
std::vector<Index> to_indices(py::handle value, const std::string& name);
double to_number(py::handle value, const std::string& name);
std::string to_text(py::handle value, const std::string& name);

/// The items of a sequence that is no text.
std::vector<py::object> to_items(py::handle value, const std::string& name);
/// The entries of a mapping with texts as keys.
std::vector<std::pair<std::string, py::object>> to_entries(py::handle value,
                                                           const std::string& name);
/// One of these items as an object of a bound class, which lives as long as the item.
template <class T>
const T& to_object(const std::vector<py::object>& items, std::size_t i, const std::string& name,
                   const std::string& wanted) {
  if (!py::isinstance<T>(items[i])) {
    throw py::type_error(name + "[" + std::to_string(i) + "]: a " + wanted + " is wanted, got " +
                         py::cast<std::string>(py::type::of(items[i]).attr("__name__")));
  }
  return items[i].cast<const T&>();
}
/// Copies of the items of a sequence, all of a bound class.
template <class T>
std::vector<T> to_values(py::handle value, const std::string& name, const std::string& wanted) {
  const std::vector<py::object> items = to_items(value, name);
  std::vector<T> values;
  values.reserve(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) {
    values.push_back(to_object<T>(items, i, name, wanted));
  }
  return values;
}

/// A petsc4py matrix, a copy.
latin::SparseRows to_petsc_copy(py::handle value, const std::string& name);
/// A petsc4py matrix, where it lies if it is of PETSc's own format.
std::shared_ptr<const latin::SparseView> to_petsc_view(py::handle value, const std::string& name);
/// A scipy.sparse or petsc4py matrix, a copy.
latin::SparseRows to_sparse(py::handle value, const std::string& name);

/// None (this rank alone), an mpi4py communicator, or the Fortran handle of one.
latin::Communicator to_communicator(py::handle value);
/// A latin_core.Options; None: its defaults.
latin::iteration::Options to_options(py::object value);
/// (loads, columns) of finite numbers; None: every load pattern once, in one column.
latin::Matrix to_amplitudes(py::handle value, const latin::substructure::Structure& structure);
/// A callable, or None.
void check_callable(py::handle value, const std::string& name);
std::vector<latin::iteration::SweptParameter> to_swept(py::handle value);
/// {interface: {parameter: array}}
std::vector<latin::substructure::LawParameter> to_parameters(py::handle value);
/// A list of groups, see Structure.laws.
std::vector<latin::substructure::LawColumns> to_columns(py::handle value, const std::string& name);

}  // namespace latin_bindings
