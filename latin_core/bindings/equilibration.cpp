#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <string>

#include "equilibration/equilibration.hpp"
#include "signals.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

constexpr const char* description =
    R"(A stress in balance with loads, close to that of a solution on straight simplices; see ``latin::equilibration``.

Parameters
----------
vertices
    (d, vertices), length.
corners
    (cells * (d + 1),) vertices of the cells, ascending in each.
stress
    (components, cells * (d + 1)) of the solution at the corners, force / area: 11, 22, 12 or 11, 22, 33, 23, 13, 12.
force
    (d, cells) per volume.
compliance, material
    (components, components) engineering strain by stress, one for each material; (cells,) its number.
rest, shift
    (components * pieces * terms, cells) of the stress beyond linear in `functions`; (d, nodes * cells) what tractions
    are to make up of each node besides. Empty: nothing.
facets
    (n * d,) vertices, ascending in each, of facets on the boundary with tractions or supports.
moments
    (d * nodes, n) of their tractions with the functions of vertices and edges, force.
held
    (d * d, n) projectors onto the directions in which a support takes any traction.

Raises
------
InputError
    Sizes that do not fit, vertices that are not ascending, a facet of more than two cells.)";

}  // namespace

void bind_equilibration(py::module_& m) {
  using latin::Matrix;
  using latin::equilibration::Equilibration;
  py::class_<Equilibration>(m, "Equilibration", description)
      .def(py::init([](Matrix vertices, std::vector<latin::Index> corners, Matrix stress,
                       Matrix force, std::vector<Matrix> compliance,
                       std::vector<latin::Index> material, Matrix rest, Matrix shift,
                       std::vector<latin::Index> facets, Matrix moments, Matrix held) {
             const py::gil_scoped_release release;
             return Equilibration(
                 {std::move(vertices), std::move(corners), std::move(stress), std::move(force),
                  std::move(compliance), std::move(material), std::move(rest), std::move(shift)},
                 {std::move(facets), std::move(moments), std::move(held)});
           }),
           py::kw_only(), "vertices"_a, "corners"_a, "stress"_a, "force"_a, "compliance"_a,
           "material"_a, "rest"_a, "shift"_a, "facets"_a, "moments"_a, "held"_a)
      .def_property_readonly(
          "defect", &Equilibration::defect,
          "Largest residual of a node's balance, relative to the largest of its terms.")
      .def("__repr__",
           [](const Equilibration& made) {
             return "Equilibration(" + std::to_string(made.cells()) + " cells)";
           })
      .def(
          "relax",
          [](Equilibration& made, int most_sweeps, double enough) {
            const py::gil_scoped_release release;
            return hearing_signals(true,
                                   [&] { return latin::Vector(made.relax(most_sweeps, enough)); });
          },
          "most_sweeps"_a, "enough"_a,
          "Energies (cells,) of the distance to the solution, after sweeps until one takes less "
          "than `enough` of them.")
      .def_static(
          "functions",
          [](int dim, int degree, latin::Index piece, const Matrix& points) {
            return latin::equilibration::ReferenceCell::of(dim, degree).values(piece, points);
          },
          "dim"_a, "degree"_a, "piece"_a, "points"_a,
          "Values (terms, m) of the functions of a piece of the unit simplex, without the vertex "
          "`piece` and with "
          "the centroid instead, at points (d, m).")
      .def("stress", &Equilibration::stress, "cell"_a, "points"_a,
           "The stress in balance (components, m) of a cell at points (d, m) of the unit simplex.");
}
