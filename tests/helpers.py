"""Small parts for the tests: boxes with any cell, geometry order, mapping and numbering."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt
import pytest
from dolfinx import fem
from dolfinx import mesh as dmesh
from mpi4py import MPI

from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.common.compat import create_mesh
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.parts import Part
from dolfinx_frontend.scene.laws import Displacement, Elastic, Perfect
from dolfinx_frontend.scene.materials import LinearElastic
from dolfinx_frontend.scene.scene import Scene

Array = npt.NDArray[np.float64]
DIMENSION = {"triangle": 2, "quadrilateral": 2, "tetrahedron": 3, "hexahedron": 3}


NO_NUMBERS = {"'a'": "a", "None": None, "True": True, "1j": 1j, "b'1'": b"1", "'2.0'": "2.0", "[1.0]": [1.0]}
"""What is no number, by what a message shows of it."""
NOT_FINITE = {"nan": np.nan, "inf": np.inf, "-inf": -np.inf}
NO_WHOLE_NUMBERS = {"2.5": 2.5, "'a'": "a", "None": None, "True": True, "1j": 1j, "nan": np.nan, "[1]": [1]}
NO_NAMES = {
    "3": 3, "None": None, "''": "", "' '": " ", r"'a\\nb'": "a\nb", r"'a\\x00b'": "a\0b", "['a']": ["a"],
}


def refused(action: Callable[[], object], *words: str, error: type[Exception] = SceneError) -> str:
    """The message of the error that an action raises, which has all of the words."""
    with pytest.raises(error) as caught:
        action()
    text = str(caught.value)
    for word in words:
        assert word in text, text
    return text


def block(
    cell: str,
    divisions: Sequence[int],
    low: Sequence[float] | None = None,
    high: Sequence[float] | None = None,
    mapping: Callable[[Array], Array] | None = None,
    order: int = 1,
    seed: int | None = None,
) -> Part:
    """A box whose nodes went through a mapping and, with a seed, through a random renumbering.

    Faces are x0, x1, y0, y1, z0, z1, those of the box before the mapping.
    """
    d = DIMENSION[cell]
    low = np.zeros(d) if low is None else np.asarray(low, dtype=float)
    high = np.ones(d) if high is None else np.asarray(high, dtype=float)
    build = dmesh.create_rectangle if d == 2 else dmesh.create_box
    flat = build(MPI.COMM_SELF, [low, high], list(divisions), cell_type=dmesh.to_type(cell))
    space = fem.functionspace(flat, ("Lagrange", order))
    box = space.tabulate_dof_coordinates()[:, :d].copy()
    cells = np.asarray(space.dofmap.list).astype(np.int64)
    if seed is not None:
        rng = np.random.default_rng(seed)
        place = rng.permutation(len(box))
        box[place] = box.copy()
        cells = place[cells][rng.permutation(len(cells))]
    x = box if mapping is None else mapping(box)
    mesh = create_mesh(cells, x, cell, order)
    before = box[mesh.geometry.input_global_indices]
    mesh.topology.create_connectivity(d - 1, d)
    mesh.topology.create_connectivity(d - 1, 0)
    exterior = dmesh.exterior_facet_indices(mesh.topology)
    corners = before[dmesh.entities_to_geometry(mesh, d - 1, exterior)]
    tags = np.zeros(len(exterior), dtype=np.int32)
    names = {}
    for axis in range(d):
        for end, value in ((0, low[axis]), (1, high[axis])):
            names[f"{'xyz'[axis]}{end}"] = tag = len(names) + 1
            tags[np.all(np.abs(corners[:, :, axis] - value) < 1e-9, axis=1)] = tag
    assert tags.min() > 0
    return Part(mesh, dmesh.meshtags(mesh, d - 1, exterior, tags), names)


def wavy(amount: float, axis: int) -> Callable[[Array], Array]:
    """A smooth mapping of the unit box that keeps its edges and the planes normal to an axis."""

    def mapping(x: Array) -> Array:
        out = x.copy()
        bump = np.prod([np.sin(np.pi * x[:, k]) for k in range(x.shape[1]) if k != axis], axis=0)
        for k in range(x.shape[1]):
            if k != axis:
                out[:, k] += amount * (1.0 + 0.3 * k) * bump
        return out

    return mapping


def polynomial(degree: int, x: Array, seed: int = 3) -> Array:
    """A vector polynomial with all monomials up to a total degree, (points, d)."""
    d = x.shape[1]
    rng = np.random.default_rng(seed)
    out = np.zeros_like(x)
    for powers in np.ndindex(*(degree + 1,) * d):
        if sum(powers) <= degree:
            monomial = np.prod(x ** np.array(powers), axis=1)
            out += monomial[:, None] * rng.standard_normal(d)
    return out


def lame(
    r: Array | float, a: float, b: float, inside: float, outside: float, E: float, nu: float
) -> Array | float:
    """Radial displacement of a ring under pressures on both arcs, plane strain (Lame)."""
    factor = (1 + nu) / (E * (b**2 - a**2))
    uniform = (1 - 2 * nu) * (inside * a**2 - outside * b**2)
    return factor * (uniform * r + (inside - outside) * a**2 * b**2 / r)


def face_mass(space: fem.FunctionSpace, part: Part, face: str, degree: int) -> Array:
    """Boundary mass matrix of a face as UFL assembles it, dense."""
    import dolfinx.fem.petsc
    import ufl

    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    ds = ufl.Measure(
        "ds",
        domain=part.mesh,
        subdomain_data=part.facet_tags,
        metadata={"quadrature_degree": degree},
    )
    form = fem.form(ufl.inner(u, v) * ds(part.names[face]))
    matrix = dolfinx.fem.petsc.assemble_matrix(form)
    matrix.assemble()
    matrix.convert("dense")
    return matrix.getDenseArray().copy()


def small_assembly(**laws):
    """Two glued plates: fixed side, oblique symmetry, prescribed end."""
    scene = Scene()
    c, s = np.cos(0.3), np.sin(0.3)

    def turned(x):
        return x @ np.array([[c, s], [-s, c]])

    lower = block("quadrilateral", [2, 2], mapping=turned)
    upper = block("quadrilateral", [2, 1], (0, 1), (1, 2), mapping=turned, seed=3)
    scene.substructure("a", lower, LinearElastic(1.0, 0.3), degree=2, body_force=(0.1, 0.2))
    scene.substructure("b", upper, LinearElastic(3.0, 0.2), degree=2)
    scene.interface("glue", "a:y1", "b:y0", laws.get("glue", Perfect()))
    scene.symmetry("a:x0", "oblique")
    scene.interface("end", "b:y1", Displacement(lambda x: 0.1 + 0.2 * x))
    scene.interface("spring", "a:y0", Elastic(normal=2.0, tangential=1.0, jump=(0.1, 0.0)))
    return assemble(scene)


_NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def _alike(printed: str, shown: str, rtol: float) -> bool:
    """Whether two lines have the same words, and numbers within a tolerance or two of their last digits."""
    if _NUMBER.sub("#", printed).split() != _NUMBER.sub("#", shown).split():
        return False
    for one, other in zip(_NUMBER.findall(printed), _NUMBER.findall(shown), strict=True):
        mantissa, _, power = other.partition("e")
        last = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
        if abs(float(one) - float(other)) > max(2.0 * last, rtol * abs(float(other))):
            return False
    return True


def printed_as_shown(printed: str, shown: str, rtol: float = 2e-3) -> None:
    """Every line that a page shows was printed, in this order; numbers within `rtol`, "..." stands for lines
    that are left out."""
    lines = iter([line.rstrip() for line in printed.splitlines()])
    for line in shown.splitlines():
        if line.strip() and line.strip() != "...":
            assert any(_alike(each, line, rtol) for each in lines), f"not printed: {line!r} in\n{printed}"


def shown_blocks(page: str) -> list[str]:
    """The blocks of a page that show output: fences without a language that hold no command."""
    blocks, language, lines = [], None, list[str]()
    for line in page.splitlines():
        if not line.startswith("```"):
            lines.append(line)
        elif language is None:
            language, lines = line[3:], []
        else:
            if language == "" and not any(each.startswith("./run") for each in lines):
                blocks.append("\n".join(lines))
            language = None
    return blocks
