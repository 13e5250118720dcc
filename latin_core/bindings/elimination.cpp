#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <memory>
#include <string>
#include <utility>

#include "algebra/elimination.hpp"
#include "algebra/factor.hpp"
#include "arguments.hpp"
#include "latin/common/error.hpp"

namespace py = pybind11;
using namespace py::literals;
using namespace latin_bindings;
using latin::Index;
using latin::Matrix;
using latin::algebra::Elimination;

namespace {

std::unique_ptr<Elimination> make_elimination(py::handle stiffness, py::handle kept,
                                              py::handle name) {
  const std::string title = to_text(name, "name");
  const latin::SparseRows matrix = to_sparse(stiffness, "stiffness");
  const Index count = to_index(kept, "kept");
  if (matrix.rows() != matrix.cols()) {
    throw latin::InputError("'" + title + "': its stiffness is " + std::to_string(matrix.rows()) +
                            " x " + std::to_string(matrix.cols()));
  }
  const py::gil_scoped_release released;
  return std::make_unique<Elimination>(matrix.triangularView<Eigen::Lower>(), count,
                                       latin::algebra::FactorBackend::automatic, title);
}

}  // namespace

void bind_elimination(py::module_& m) {
  py::class_<Elimination>(
      m, "Elimination",
      R"doc(A stiffness of which all but the last unknowns are eliminated: ``S = K_kk - K_ki K_ii^-1 K_ik``.

Only K_ii must be definite, so that a part that nothing holds can be condensed to its faces.

Parameters
----------
stiffness
    K (n, n), scipy.sparse or petsc4py, symmetric, force / length; the lower triangle is read.
kept
    Number of last unknowns that are kept.
name
    Of the part, for messages.

Raises
------
InputError
    On a shape that does not fit, or a number that is not finite.
NumericalError
    If K_ii is not positive definite, or memory runs out.
)doc")
      .def(py::init(&make_elimination), py::kw_only(), "stiffness"_a, "kept"_a, "name"_a)
      .def("__repr__",
           [](const Elimination& self) {
             return "Elimination(" + std::to_string(self.size()) + " unknowns, " +
                    std::to_string(self.kept()) + " kept)";
           })
      .def_property_readonly("kept", &Elimination::kept, "Unknowns that are kept.")
      .def_property_readonly("factor_numbers", &Elimination::nonzeros, "Numbers in the factor.")
      .def("take_schur", &Elimination::take_schur,
           "S (kept, kept), its lower triangle; it is let go, so that it can be taken once.")
      .def(
          "reduce",
          [](const Elimination& self, py::handle forces) {
            const Matrix given = to_finite_matrix(forces, "forces", self.size());
            const py::gil_scoped_release released;
            Matrix partial;
            Matrix reduced = self.reduce(given, partial);
            return std::pair(std::move(reduced), std::move(partial));
          },
          "forces"_a,
          "Forces (n, c) as those on the kept unknowns alone, ``f_k - K_ki K_ii^-1 f_i``, (kept, "
          "c); "
          "and what expand() goes on from, (n, c).")
      .def(
          "expand",
          [](const Elimination& self, py::handle kept, py::handle partial) {
            const Matrix moved = to_finite_matrix(kept, "kept", self.kept());
            Matrix from = to_finite_matrix(partial, "partial", self.size(), moved.cols());
            const py::gil_scoped_release released;
            return self.expand(moved, std::move(from));
          },
          "kept"_a, "partial"_a,
          "Displacements (n, c) under forces that were reduced, where the kept unknowns move by "
          "`kept`, (kept, c).");
}
