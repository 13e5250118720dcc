#include <pybind11/eigen.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <optional>

#include "petsc4py_mat.hpp"
#include "stochastic/basis.hpp"
#include "stochastic/coupling.hpp"
#include "stochastic/galerkin.hpp"
#include "stochastic/galerkin_operator.hpp"
#include "stochastic/quadrature.hpp"
#include "stochastic/statistics.hpp"
#include "stochastic/transform.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

namespace stochastic = latin::stochastic;
using latin::ConstMatrixRef;
using latin::ConstVectorRef;
using latin::Index;
using stochastic::ChaosBasis;
using stochastic::Germ;
using stochastic::MultiIndexSet;
using Release = py::call_guard<py::gil_scoped_release>;

py::tuple pair(stochastic::Rule rule) {
  return py::make_tuple(std::move(rule.points), std::move(rule.weights));
}

void bind_germ(py::module_& m) {
  py::class_<Germ>(m, "Germ", "One independent random variable and its orthonormal polynomials")
      .def_static(
          "family",
          [](const std::string& name, const std::vector<double>& parameters) {
            return Germ::family(name, parameters);
          },
          "name"_a, "parameters"_a)
      .def_static("families", &Germ::families)
      .def_static("from_measure", &Germ::from_measure, "nodes"_a, "weights"_a)
      .def_static(
          "from_recurrence",
          [](latin::Vector alpha, latin::Vector beta) {
            return Germ::from_recurrence({std::move(alpha), std::move(beta)});
          },
          "alpha"_a, "beta"_a)
      .def_property_readonly("name", &Germ::name)
      .def_property_readonly("capacity",
                             [](const Germ& germ) -> std::optional<Index> {
                               return germ.capacity() == Germ::unlimited
                                          ? std::nullopt
                                          : std::optional(germ.capacity());
                             })
      .def(
          "recurrence",
          [](const Germ& germ, Index length) {
            stochastic::Recurrence r = germ.recurrence(length);
            return py::make_tuple(std::move(r.alpha), std::move(r.beta));
          },
          "length"_a)
      .def(
          "gauss", [](const Germ& germ, Index count) { return pair(germ.gauss(count)); }, "count"_a)
      .def("evaluate", &Germ::evaluate, "points"_a, "degree"_a, Release())
      .def("__repr__", [](const Germ& germ) { return "<Germ " + germ.name() + ">"; });
}

void bind_basis(py::module_& m) {
  py::class_<MultiIndexSet>(m, "MultiIndexSet", "Multi-indices in graded order")
      .def(py::init([](const std::string& shape, Index dimension, Index order, double q,
                       std::vector<double> weights, Index interaction, std::vector<Index> caps,
                       double bytes_per_index, double memory_limit) {
             return MultiIndexSet({stochastic::index_shape(shape), dimension, order, q,
                                   std::move(weights), interaction, std::move(caps),
                                   bytes_per_index, memory_limit});
           }),
           py::kw_only(), "shape"_a, "dimension"_a, "order"_a, "q"_a, "weights"_a, "interaction"_a,
           "caps"_a, "bytes_per_index"_a, "memory_limit"_a)
      .def(py::init<stochastic::IndexTable>(), "rows"_a)
      .def_static(
          "count",
          [](const std::string& shape, Index dimension, Index order, double q,
             std::vector<double> weights, Index interaction, std::vector<Index> caps, double stop) {
            return MultiIndexSet::count(
                {stochastic::index_shape(shape), dimension, order, q, std::move(weights),
                 interaction, std::move(caps), 0.0, 0.0},
                stop);
          },
          py::kw_only(), "shape"_a, "dimension"_a, "order"_a, "q"_a, "weights"_a, "interaction"_a,
          "caps"_a, "stop"_a)
      .def_property_readonly("table", [](const MultiIndexSet& set) { return set.table(); })
      .def_property_readonly("dimension", &MultiIndexSet::dimension)
      .def("__len__", &MultiIndexSet::size)
      .def(
          "find",
          [](const MultiIndexSet& set, const std::vector<int>& index) { return set.find(index); },
          "index"_a);

  py::class_<ChaosBasis>(m, "ChaosBasis", "Orthonormal polynomial chaos")
      .def(py::init<std::vector<Germ>, MultiIndexSet>(), "germs"_a, "indices"_a)
      .def("__len__", &ChaosBasis::size)
      .def_property_readonly("dimension", &ChaosBasis::dimension)
      .def_property_readonly("germs", &ChaosBasis::germs)
      .def_property_readonly("indices", &ChaosBasis::indices)
      .def("evaluate", py::overload_cast<ConstMatrixRef>(&ChaosBasis::evaluate, py::const_),
           "points"_a, Release())
      .def("evaluate_fields",
           py::overload_cast<ConstMatrixRef, ConstMatrixRef>(&ChaosBasis::evaluate, py::const_),
           "coefficients"_a, "points"_a, Release());
}

void bind_galerkin(py::module_& m) {
  m.def("galerkin_matrix", &stochastic::galerkin_matrix, "basis"_a, "coefficients"_a, "property"_a,
        Release());
  m.def("smallest_eigenvalue", &stochastic::smallest_eigenvalue, "matrix"_a, Release());
  m.def("critical_cov", &stochastic::critical_cov, "germ"_a, "order"_a);

  py::class_<stochastic::ColumnTransform>(
      m, "ColumnTransform", "Between chaos modes and columns in which a law is deterministic")
      .def(py::init([](latin::Matrix forward, latin::Matrix backward, latin::Vector values,
                       latin::Matrix points, latin::Vector weights) {
             return stochastic::ColumnTransform{std::move(forward), std::move(backward),
                                                std::move(values), std::move(points),
                                                std::move(weights)};
           }),
           py::kw_only(), "forward"_a, "backward"_a, "values"_a, "points"_a, "weights"_a)
      .def_readonly("forward", &stochastic::ColumnTransform::forward)
      .def_readonly("backward", &stochastic::ColumnTransform::backward)
      .def_readonly("values", &stochastic::ColumnTransform::values)
      .def_readonly("points", &stochastic::ColumnTransform::points)
      .def_readonly("weights", &stochastic::ColumnTransform::weights);
  m.def("galerkin_transform", &stochastic::galerkin_transform, "matrix"_a, Release());
  m.def(
      "galerkin_transforms",
      [](const ChaosBasis& basis, ConstMatrixRef coefficients, const MultiIndexSet& property) {
        std::vector<stochastic::ColumnTransform> transforms;
        {
          const py::gil_scoped_release released;
          transforms = stochastic::galerkin_transforms(basis, coefficients, property);
        }
        py::list forward;
        latin::Matrix values(transforms.size(), basis.size());
        Index point = 0;
        for (stochastic::ColumnTransform& each : transforms) {
          values.row(point++) = each.values.transpose();
          forward.append(py::cast(std::move(each.forward)));
        }
        return py::make_tuple(std::move(forward), std::move(values));
      },
      "basis"_a, "coefficients"_a, "property"_a);
  m.def(
      "quadrature_transform",
      [](const ChaosBasis& basis, latin::Matrix points, latin::Vector weights) {
        return stochastic::quadrature_transform(basis, {std::move(points), std::move(weights)});
      },
      "basis"_a, "points"_a, "weights"_a, Release());
}

/// A matrix of PETSc as an object of petsc4py, which takes a reference of its own.
py::object to_petsc4py(const latin::algebra::MatHandle& matrix) {
  if (PyPetscMat_New == nullptr && import_petsc4py() != 0) {
    throw py::error_already_set();
  }
  return py::reinterpret_steal<py::object>(PyPetscMat_New(matrix.get()));
}

void bind_operator(py::module_& m) {
  using stochastic::Coupling;
  using stochastic::GalerkinOperator;
  using stochastic::ModeRows;
  py::class_<Coupling, std::shared_ptr<Coupling>>(
      m, "Coupling", "The product with a random scalar, projected on the modes")
      .def(py::init<const ChaosBasis&, ConstMatrixRef, const MultiIndexSet&>(), "basis"_a,
           "coefficients"_a, "property"_a, Release())
      .def_property_readonly("points", &Coupling::points)
      .def_property_readonly("modes", &Coupling::modes)
      .def_property_readonly("first", &Coupling::first)
      .def_property_readonly("second", &Coupling::second)
      .def_property_readonly("values", &Coupling::values)
      .def("matrix", &Coupling::matrix, "point"_a)
      .def("bounds", &Coupling::bounds, Release())
      .def("smallest", &Coupling::smallest, Release())
      .def(
          "apply",
          [](const Coupling& coupling, stochastic::ConstModeRowsRef u, Index components) {
            ModeRows v(u.rows(), u.cols());
            coupling.apply(u, components, v);
            return v;
          },
          "fields"_a, "components"_a, Release());

  py::class_<GalerkinOperator, std::shared_ptr<GalerkinOperator>>(
      m, "GalerkinOperator", "Operator of monolithic stochastic finite elements")
      .def(
          py::init([](const latin::SparseRows& fixed, const py::list& terms, Index modes) {
            std::vector<GalerkinOperator::Term> all;
            for (const py::handle each : terms) {
              const auto term = py::cast<py::tuple>(each);
              all.push_back({py::cast<latin::SparseRows>(term[0]), py::cast<latin::Vector>(term[1]),
                             py::cast<std::shared_ptr<Coupling>>(term[2])});
            }
            return std::make_shared<GalerkinOperator>(fixed, std::move(all), modes);
          }),
          "fixed"_a, "terms"_a, "modes"_a)
      .def_property_readonly("size", &GalerkinOperator::size)
      .def_property_readonly("modes", &GalerkinOperator::modes)
      .def(
          "apply",
          [](const GalerkinOperator& applied, stochastic::ConstModeRowsRef u) {
            ModeRows v(u.rows(), u.cols());
            applied.apply(u, v);
            return v;
          },
          "block"_a, Release())
      .def("matrix", [](const std::shared_ptr<GalerkinOperator>& applied) {
        return to_petsc4py(stochastic::shell_matrix(applied));
      });
}

void bind_answers(py::module_& m) {
  m.def(
      "tensor_gauss",
      [](const std::vector<Germ>& germs, const std::vector<Index>& counts, double memory_limit) {
        return pair(stochastic::tensor_gauss(germs, counts, memory_limit));
      },
      "germs"_a, "counts"_a, "memory_limit"_a);
  m.def(
      "smolyak",
      [](const std::vector<Germ>& germs, Index level, double memory_limit) {
        return pair(stochastic::smolyak(germs, level, memory_limit));
      },
      "germs"_a, "level"_a, "memory_limit"_a);
  m.def("variance", &stochastic::variance, "coefficients"_a);
  m.def("sobol_closed", &stochastic::sobol_closed, "coefficients"_a, "indices"_a, "group"_a);
}

}  // namespace

void bind_stochastic(py::module_& m) {
  py::module_ s =
      m.def_submodule("stochastic", "Polynomial chaos: germs, bases, Galerkin matrices");
  bind_germ(s);
  bind_basis(s);
  bind_galerkin(s);
  bind_operator(s);
  bind_answers(s);
}
