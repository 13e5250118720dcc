#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <memory>
#include <string>

#include "arguments.hpp"
#include "interface/interface.hpp"
#include "latin/common/error.hpp"

namespace py = pybind11;
using namespace py::literals;
using namespace latin_bindings;
using namespace latin::substructure;

namespace {

constexpr const char* member_doc =
    R"doc(One substructure of a body: ``u = Z q + u0`` with the unknowns q of the body.

Parameters
----------
name
    Of the substructure; sides refer to it.
stiffness
    K (n, n), a sequential petsc4py matrix, symmetric, force / length.
load
    F (n, loads), force, one column a load pattern.
prolongation
    Z (n, unknowns of the body), scipy.sparse or petsc4py; None: the identity.
offset
    u0 (n, loads), length; None: zero.
of_stiffness
    The part of `load` that comes from the stiffness and changes with it (initial strains), (n, loads); None: none.
stretch
    B (points * components, n) with B^T B = K, whose rows at each of `stretch_points` points may have a factor (a
    random field); None: none.
stretch_points
    Their number; 0: none.
initial_stretch
    g (points * components, loads): the part of `load` that comes from the stiffness is B^T g; None: none.
)doc";

constexpr const char* spring_doc =
    R"doc(A deterministic elastic interface that is assembled into a body.

Parameters
----------
name
    For messages.
members
    Position of one member (ground on side 2) or of two in their body.
traces
    (d * points, n) petsc4py matrix of each side, global components.
frames
    (components * points, d) orthonormal rows: normal, then tangents of every point.
stiffness
    (components * points,) stiffness per area times the areas.
jump
    (components * points, loads) imposed jump, length, one column a load pattern.
)doc";

constexpr const char* body_doc = R"doc(Substructures glued together, factorised as one.

Parameters
----------
name
    For messages and costs.
members
    Its substructures.
size
    Number of unknowns q; None: those of its only member, which has no prolongation.
springs
    Elastic interfaces between them, or to the ground.
)doc";

constexpr const char* side_doc = R"doc(One side of an active interface.

Parameters
----------
member
    Substructure that it lies on. Of a side on another rank nothing else is given.
trace
    T (d * points, n), petsc4py, global components: the displacement of the side at the points.
direction
    (components * points,) search direction k > 0, force / length^3.
scale
    Modulus / length of the part: what a displacement is measured with; of a force that is no force per area, the
    stiffness of the place where it acts.
motions
    (components * points, r), rigid motions of the part (or of what it is joined with) that nothing else resists, of
    mean square 1 over it, the same on all of its sides: errors are measured of them, too. None: there are none.
lever
    Trace where displacements of the part are 1 at most: of a rotation 1 / length.
)doc";

constexpr const char* interface_doc = R"doc(An active interface: two sides, or one and the ground.

Parameters
----------
name
    Of the interface; laws and results refer to it.
law
    ``"contact"``, ``"coulomb"``, ``"debonding"``, ``"elastic"``, ``"force"``, ``"held"``, ``"perfect"``, ``"preload"``, or
    a law of your own (:func:`python_law`, :func:`compiled_law`). Its parameters are set in :class:`Laws`.
weights
    (points,) areas > 0.
frames
    (components * points, d) orthonormal rows: normal, then tangents of every point.
sides
    One or two; described alike on both ranks of an interface between two.
basis
    (components * points, moments) of the coarse problem, any unit; None: not in it.
paired
    Whether its residual is solved for with both of its bodies, instead of taken as it is; linear laws only.
)doc";

Spring make_spring(const std::string& name, py::handle members, py::handle traces,
                   py::handle frames, py::handle stiffness, py::handle jump) {
  const std::string who = "spring '" + name + "': ";
  Spring spring;
  spring.name = name;
  spring.members = to_indices(members, who + "members");
  const latin::Matrix frame = to_finite_matrix(frames, who + "frames");
  for (const py::object& trace : to_items(traces, who + "traces")) {
    latin::SparseRows matrix = to_petsc_copy(trace, who + "traces must be petsc4py matrices");
    spring.traces.push_back(latin::interface::to_local_frame(matrix, frame, name));
  }
  spring.stiffness = to_vector(stiffness, who + "stiffness");
  spring.jump = to_finite_matrix(jump, who + "jump");
  return spring;
}

/// Unknowns of a body of one member whose unknowns are those of the body.
Index size_of_only(const std::vector<Member>& members, const std::string& who) {
  if (members.size() != 1 || members.front().prolongation.size() != 0) {
    throw latin::InputError(who +
                            "size: give it, unless there is one member without a prolongation");
  }
  return members.front().stiffness->rows();
}

InterfaceDescription make_interface(const std::string& name, py::handle law, py::handle weights,
                                    py::handle frames, py::handle sides, py::handle basis,
                                    bool paired) {
  const std::string who = "interface '" + name + "': ";
  const auto source = [&]() -> latin::interface::LawSource {
    if (py::isinstance<latin::interface::Law>(law)) {
      return std::shared_ptr<const latin::interface::Law>(
          law.cast<std::shared_ptr<latin::interface::Law>>());
    }
    return to_text(law, who + "law (or a Law)");
  };
  return {name,
          source(),
          to_vector(weights, who + "weights"),
          to_finite_matrix(frames, who + "frames"),
          to_values<SideDescription>(sides, who + "sides", "Side"),
          basis.is_none() ? latin::Matrix() : to_finite_matrix(basis, who + "basis"),
          paired};
}

}  // namespace

void bind_descriptions(py::module_& m) {
  py::class_<Member>(m, "Member", member_doc)
      .def(py::init([](const std::string& name, py::handle stiffness, py::handle load,
                       py::handle prolongation, py::handle offset, py::handle of_stiffness,
                       py::handle stretch, py::handle stretch_points, py::handle initial) {
             const std::string who = "substructure '" + name + "': ";
             return Member{
                 name,
                 to_petsc_view(stiffness, name),
                 prolongation.is_none() ? latin::SparseRows()
                                        : to_sparse(prolongation, who + "prolongation"),
                 to_finite_matrix(load, who + "load"),
                 offset.is_none() ? latin::Matrix() : to_finite_matrix(offset, who + "offset"),
                 of_stiffness.is_none() ? latin::Matrix()
                                        : to_finite_matrix(of_stiffness, who + "of_stiffness"),
                 stretch.is_none() ? latin::SparseRows() : to_sparse(stretch, who + "stretch"),
                 to_index(stretch_points, who + "stretch_points"),
                 initial.is_none() ? latin::Matrix()
                                   : to_finite_matrix(initial, who + "initial_stretch")};
           }),
           py::kw_only(), "name"_a, "stiffness"_a, "load"_a, "prolongation"_a = py::none(),
           "offset"_a = py::none(), "of_stiffness"_a = py::none(), "stretch"_a = py::none(),
           "stretch_points"_a = 0, "initial_stretch"_a = py::none())
      .def("__repr__", [](const Member& m) {
        return "Member(" + m.name + ", " + std::to_string(m.load.rows()) + " unknowns, " +
               std::to_string(m.load.cols()) + " loads)";
      });

  py::class_<Spring>(m, "Spring", spring_doc)
      .def(py::init(&make_spring), py::kw_only(), "name"_a, "members"_a, "traces"_a, "frames"_a,
           "stiffness"_a, "jump"_a)
      .def("__repr__", [](const Spring& s) {
        return "Spring(" + s.name + ", " + std::to_string(s.stiffness.size()) + " rows)";
      });

  py::class_<BodyDescription>(m, "Body", body_doc)
      .def(py::init([](const std::string& name, py::handle members, py::handle size,
                       py::handle springs) {
             const std::string who = "body '" + name + "': ";
             auto all = to_values<Member>(members, who + "members", "Member");
             return BodyDescription{
                 name, size.is_none() ? size_of_only(all, who) : to_index(size, who + "size"),
                 std::move(all), to_values<Spring>(springs, who + "springs", "Spring")};
           }),
           py::kw_only(), "name"_a, "members"_a, "size"_a = py::none(), "springs"_a = py::tuple())
      .def("__repr__", [](const BodyDescription& b) {
        return "Body(" + b.name + ", " + std::to_string(b.size) + " unknowns, " +
               std::to_string(b.members.size()) + " members, " + std::to_string(b.springs.size()) +
               " springs)";
      });

  py::class_<SideDescription>(m, "Side", side_doc)
      .def(py::init([](const std::string& member, py::handle trace, py::handle direction,
                       py::handle scale, py::handle motions, double lever) {
             if (trace.is_none() && direction.is_none() && scale.is_none()) {
               return SideDescription{member, {}, {}, 0.0};
             }
             const std::string who = "side of '" + member + "': ";
             return SideDescription{
                 member,
                 to_petsc_copy(trace, "trace of " + member),
                 to_matrix(direction, who + "direction", any, 1).col(0),
                 to_number(scale, who + "scale"),
                 motions.is_none() ? latin::Matrix() : to_matrix(motions, who + "motions"),
                 lever};
           }),
           py::kw_only(), "member"_a, "trace"_a = py::none(), "direction"_a = py::none(),
           "scale"_a = py::none(), "motions"_a = py::none(), "lever"_a = 1.0)
      .def("__repr__", [](const SideDescription& s) {
        return "Side(" + s.member + ", " +
               (s.direction.size() > 0 ? std::to_string(s.direction.size()) + " rows)"
                                       : std::string("on another rank)"));
      });

  py::class_<InterfaceDescription>(m, "Interface", interface_doc)
      .def(py::init(&make_interface), py::kw_only(), "name"_a, "law"_a, "weights"_a, "frames"_a,
           "sides"_a, "basis"_a = py::none(), "paired"_a = false)
      .def("__repr__", [](const InterfaceDescription& i) {
        return "Interface(" + i.name + ", " + std::to_string(i.weights.size()) + " points, " +
               std::to_string(i.sides.size()) + " sides)";
      });
}
