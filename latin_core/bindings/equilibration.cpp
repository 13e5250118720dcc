#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "latin/equilibration/equilibration.hpp"

namespace py = pybind11;
using namespace py::literals;

void bind_equilibration(py::module_& m) {
  using latin::Matrix;
  using latin::equilibration::Equilibration;
  py::class_<Equilibration>(m, "Equilibration", "A stress in balance, close to that of a solution")
      .def(py::init([](Matrix vertices, std::vector<latin::Index> corners, Matrix stress,
                       Matrix force, std::vector<Matrix> compliance,
                       std::vector<latin::Index> material, std::vector<latin::Index> cells,
                       std::vector<latin::Index> facets, Matrix moments, Matrix held) {
             const py::gil_scoped_release release;
             return Equilibration(
                 {std::move(vertices), std::move(corners), std::move(stress), std::move(force),
                  std::move(compliance), std::move(material)},
                 {std::move(cells), std::move(facets), std::move(moments), std::move(held)});
           }),
           py::kw_only(), "vertices"_a, "corners"_a, "stress"_a, "force"_a, "compliance"_a,
           "material"_a, "cells"_a, "facets"_a, "moments"_a, "held"_a)
      .def_property_readonly("defect", &Equilibration::defect)
      .def("relax", &Equilibration::relax, "most_sweeps"_a, "enough"_a,
           py::call_guard<py::gil_scoped_release>())
      .def("stress", &Equilibration::stress, "cell"_a, "points"_a);
}
