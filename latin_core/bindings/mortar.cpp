#include <pybind11/eigen.h>
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <span>
#include <vector>

#include "latin/common/error.hpp"
#include "mortar/blocks.hpp"
#include "mortar/face.hpp"
#include "mortar/overlap.hpp"

namespace py = pybind11;
using namespace py::literals;

namespace {

namespace mortar = latin::mortar;
using latin::Index;

/// An array that owns what a vector held.
template <class T>
py::array_t<T> array(std::vector<T> values, const std::vector<Index>& shape) {
  auto* held = new std::vector<T>(std::move(values));
  const py::capsule owner(held, [](void* p) { delete static_cast<std::vector<T>*>(p); });
  return py::array_t<T>(shape, held->data(), owner);
}

template <class T>
using Dense = py::array_t<T, py::array::c_style | py::array::forcecast>;

template <class T>
std::span<const T> span(const Dense<T>& values) {
  return {values.data(), static_cast<std::size_t>(values.size())};
}

py::dict arrays(mortar::Overlap o, Index n1, Index chi, Index shapes1, Index shapes2) {
  const auto pairs = static_cast<Index>(o.first.size());
  py::dict out;
  out["whole"] = array(std::move(o.whole), {n1});
  out["covered"] = array(std::move(o.covered), {n1});
  out["mean"] = array(std::move(o.mean), {n1, chi});
  out["mass"] = array(std::move(o.mass), {n1, chi, chi});
  out["own"] = array(std::move(o.own), {n1, chi, shapes1});
  const bool plane = o.own_normal.empty();
  out["own_normal"] = array(std::move(o.own_normal), {plane ? 0 : n1, chi, shapes1, 3});
  out["gap"] = array(std::move(o.gap), {n1, chi});
  out["place"] = array(std::move(o.place), {n1, chi, 3});
  out["normal"] = array(std::move(o.normal), {n1, chi, 3});
  out["offset"] = array(std::move(o.offset), {n1, chi, 3});
  out["first"] = array(std::move(o.first), {pairs});
  out["second"] = array(std::move(o.second), {pairs});
  out["area"] = array(std::move(o.area), {pairs});
  out["other"] = array(std::move(o.other), {pairs, chi, shapes2});
  out["other_normal"] = array(std::move(o.other_normal), {plane ? 0 : pairs, chi, shapes2, 3});
  out["distance"] = array(std::move(o.distance), {pairs});
  out["farthest"] = o.farthest;
  return out;
}

}  // namespace

void bind_mortar(py::module_& m) {
  py::module_ s = m.def_submodule("mortar", "Integrals over the overlap of two faces");
  py::class_<mortar::Face>(s, "Face", "Facets of one face, images of one reference facet")
      .def(py::init([](const std::string& shape, int parts, const latin::Matrix& nodes,
                       std::vector<Index> variants, std::vector<double> orientation, int map_degree,
                       std::vector<latin::Matrix> map, int shape_degree,
                       std::vector<latin::Matrix> shapes) {
             return mortar::Face(mortar::facet_shape(shape), parts, nodes, std::move(variants),
                                 std::move(orientation), {map_degree, std::move(map)},
                                 {shape_degree, std::move(shapes)});
           }),
           py::kw_only(), "shape"_a, "parts"_a, "nodes"_a, "variants"_a, "orientation"_a,
           "map_degree"_a, "map"_a, "shape_degree"_a, "shapes"_a);
  s.def(
      "sum_of",
      [](const Dense<double>& values, const Dense<Index>& rows, const Dense<Index>& columns,
         Index row_count, Index column_count) {
        if (values.ndim() != 3) {
          throw latin::InputError("blocks: values (count, height, width) are wanted");
        }
        const mortar::Blocks blocks{values.shape(1), values.shape(2), span(values), span(rows),
                                    span(columns)};
        mortar::CompressedRows sum = mortar::sum_of(blocks, row_count, column_count);
        const auto entries = static_cast<Index>(sum.values.size());
        return py::make_tuple(array(std::move(sum.starts), {row_count + 1}),
                              array(std::move(sum.columns), {entries}),
                              array(std::move(sum.values), {entries}));
      },
      "values"_a, "rows"_a, "columns"_a, "row_count"_a, "column_count"_a);
  s.def(
      "integrate",
      [](const mortar::Face& first, const mortar::Face& second, int degree,
         latin::Matrix multipliers, latin::Matrix points, latin::Vector weights,
         latin::Vector near_first, latin::Vector near_second, double opposed, bool around) {
        const Index chi = multipliers.rows();
        const mortar::Functions functions{degree, {std::move(multipliers)}};
        const mortar::Rule rule{std::move(points), std::move(weights), around};
        const mortar::Nearness near{std::move(near_first), std::move(near_second), opposed};
        mortar::Overlap found;
        {
          const py::gil_scoped_release release;
          found = mortar::integrate(first, second, functions, rule, near);
        }
        return arrays(std::move(found), first.facets(), chi, first.functions(), second.functions());
      },
      "first"_a, "second"_a, py::kw_only(), "degree"_a, "multipliers"_a, "points"_a, "weights"_a,
      "near_first"_a, "near_second"_a, "opposed"_a, "around"_a = false);
}
