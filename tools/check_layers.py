#!/usr/bin/env python3
"""Forbid includes and imports against the arrow of the architecture.

C++ kernel: every layer may use those left of it and itself, all may use ``common``::

    algebra | interface | stochastic | mortar | equilibration | substructure | iteration | study

headers above the folders belong to ``study``; what is installed (``include``) uses nothing else, the bindings
may use all, and nothing in the kernel names dolfinx. Python: ``latin_core`` imports neither dolfinx nor the
frontend. In ``dolfinx_frontend`` every module stands in the table `FRONTEND` and imports only what stands
before it: sub-packages in the order of the table, modules in the order of their sub-package. Imports inside
functions and for type checkers count as well. Only ``kernel/bridge.py`` imports the compiled module, only
``evaluate`` walks over points, and the statistics (``moments``, ``rare``, ``fit``) know nothing of meshes.

Usage: ``check_layers.py [ROOT]``. Prints ``file:line: offence`` and exits with 1 if there is any.
"""

from __future__ import annotations

import ast
import functools
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

LAYERS = tuple("algebra interface stochastic mortar equilibration substructure iteration study".split())
COMMON = "common"
FRONTEND: dict[str, tuple[str, ...]] = {
    "common": (
        "arrays",
        "deferred",
        "frozen",
        "statuses",
        "recorded",
        "kept",
        "groups",
        "vectors",
        "html",
        "errors",
        "model_limits",
        "codes",
        "memory",
        "files",
        "alike",
        "arithmetic",
        "threads",
        "describe",
        "checks",
        "tracebacks",
        "progress",
        "interrupts",
        "release",
        "compat",
        "straight",
        "clipping",
    ),
    "scene": (
        "amplitudes",
        "values",
        "laws.base",
        "laws.perfect",
        "laws.elastic",
        "laws.contact",
        "laws.debonding",
        "laws.intervals",
        "laws.preload",
        "laws.user",
        "laws.displacement",
        "laws.symmetry",
        "laws.pressure",
        "laws.rigid",
        "laws.linked",
        "laws.traction",
        "laws.held",
        "laws",
        "bolts",
        "loads",
        "materials",
        "matrix",
        "specs",
        "scene",
    ),
    "uncertainty": (
        "checks",
        "distributions",
        "expressions",
        "parameters",
        "fitting",
        "correlated",
        "fields",
        "chaos",
        "space",
        "statistics",
        "sobol",
        "quantities",
    ),
    "moments": (
        "model",
        "points",
        "fields",
        "kinks",
        "validation",
        "tails",
        "hinges",
        "lines",
        "panels",
        "samples",
        "rules",
        "search",
    ),
    "rare": ("design", "densities", "tails", "doubled", "importance", "chance"),
    "fit": ("posterior", "chains"),
    "geometry": (
        "parts",
        "sizes",
        "finer",
        "primitives",
        "session",
        "meshed",
        "exchange",
        "solids",
        "loading",
        "touching",
        "threads",
        "naming",
        "findings",
        "shapes",
        "recognition",
        "fits",
        "meshing",
        "msh",
        "med",
        "reading",
        "worker",
        "away",
        "gmsh",
        "renaming",
        "cells",
        "listing",
        "places",
        "selecting",
        "step_parts",
        "proposal",
        "step",
    ),
    "assembly": (
        "elements",
        "facet_map",
        "overlap",
        "averages",
        "interface",
        "held_nodes",
        "mortar",
        "pairing",
        "rigid",
        "ranks",
        "substructure",
        "matrix_part",
        "pieces",
        "taken",
        "spread",
        "stretch",
        "vertices",
        "places",
        "part_loads",
        "remote",
        "relief",
        "problem",
        "gathered",
        "held",
        "meeting",
        "assemble",
    ),
    "plan": (
        "random_laws",
        "ties",
        "reduction",
        "prescribed",
        "cost",
        "price",
        "newton",
        "coarse",
        "plan",
        "ways",
    ),
    "kernel": (
        "user_laws",
        "motions",
        "bridge",
        "running",
        "columns",
        "rows",
        "multigrid",
        "subspace",
        "parts_checkpoint",
        "fingerprint",
        "spread",
        "solver",
        "fitting",
        "carry",
    ),
    "reference": ("cholesky", "direct", "multigrid", "galerkin", "energy"),
    "formats": ("hdf5", "layout", "chaos_file", "openturns", "vtk", "meshes"),
    "results": (
        "resultant",
        "errors",
        "contact",
        "moments",
        "answer",
        "accuracy",
        "acting",
        "surfaces",
        "points",
        "reactions",
        "balance",
        "certificate",
        "readings",
        "bridged",
        "tables",
        "stress",
        "deformation",
        "probes",
        "writing",
        "sampled_stress",
        "face",
        "value",
        "uncertain",
        "result",
        "point",
        "sweep",
        "samples",
        "witnessed",
        "chaos",
        "runs",
        "contents",
        "saved",
    ),
    "evaluate": (
        "support",
        "loose",
        "bonds",
        "sliding",
        "model_limits",
        "evaluator",
        "sweep",
        "sampling",
        "model",
        "inputs",
        "points",
        "system",
        "readings",
        "adjoint",
        "gradients",
        "events",
        "journal",
        "reduced",
        "function",
    ),
    "solvers": ("refinement", "collocation", "deterministic", "galerkin", "export"),
    "estimate": (
        "recovery",
        "cells",
        "unseen",
        "zones",
        "pieces",
        "transposed",
        "mesh_error",
        "balanced_cells",
        "balanced_parts",
        "balanced_faces",
        "balanced_laws",
        "equilibrated",
        "errors",
        "adaptive",
        "levels",
        "finer",
        "judged",
        "meshes",
    ),
    "inference": ("limit", "reliability", "calibration", "screening"),
    "solving": (),
    "io": ("facets", "paraview"),
    "figures": ("render", "canvas", "solids", "cuts", "assemblies", "interfaces", "stresses", "curves",
                "joints"),
    "sheets": (
        "names",
        "clamping",
        "numbers",
        "seals",
        "statistics",
        "page",
        "content",
        "turning",
        "pictures",
        "report",
    ),
    "decks": (
        "lines",
        "fields",
        "abaqus.keywords",
        "abaqus.cards",
        "abaqus.axes",
        "abaqus.generated",
        "abaqus.elements",
        "abaqus.model",
        "abaqus.history",
        "abaqus.pieces",
        "abaqus.materials",
        "abaqus.faces",
        "abaqus.facets",
        "abaqus.points",
        "abaqus.links",
        "abaqus.interfaces",
        "abaqus.loads",
        "abaqus.deck",
        "abaqus.meshed",
        "abaqus.writing",
        "abaqus",
        "nastran.bulk",
        "nastran.case",
        "nastran.translated",
        "nastran.deck",
        "nastran",
        "matrices",
        "kinds",
        "words",
        "settings",
        "schema",
        "formulas",
        "values",
        "toml",
        "reading",
        "writing",
        "proposing",
        "running",
        "showing",
        "command",
    ),
}
"""Sub-packages of the frontend, bottom first, and their modules in the same order; no modules: a module."""

LAZY: frozenset[tuple[str, str]] = frozenset()
"""Imports that point upward on purpose, inside a function only."""

PENDING: frozenset[tuple[str, str]] = frozenset()
"""Arrows up that are still there: methods of results that belong to higher layers, and types of results."""

WITHOUT_KERNEL = ("common", "scene", "geometry", "figures")
"""Sub-packages that know nothing of ``latin_core``."""

STATISTICS = ("moments", "rare", "fit")
"""Sub-packages that know of a model what `PointModel`, `Limit` or `Function` has, and nothing of fields."""

FIELDS = ("dolfinx", "ufl", "basix", "ffcx", "petsc4py", "mpi4py", "gmsh")

EVALUATING = ("kernel", "evaluate")
"""Sub-packages that solve at points: others ask `evaluate`."""

FRONTEND_WORDS = ("dolfinx", "dolfinx_frontend", "ufl", "basix", "ffcx")

_INCLUDE = re.compile(r'\s*#\s*include\s*(?:"([^"]+)"|<(latin/[^>]+)>)')
_DOLFINX = re.compile("dolfinx", re.IGNORECASE)


class Offence(NamedTuple):
    """One use against the arrow; `line` counts from 1."""

    file: Path
    line: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.message}"


def may_use(user: str, used: str) -> bool:
    """Whether layer `user` may include a header of layer `used`."""
    if used == COMMON or user == used:
        return True
    return user != COMMON and LAYERS.index(used) < LAYERS.index(user)


def layer_of(path: Path, kernel: Path) -> str | None:
    """Layer of a kernel file; None for files outside of the layers (bindings, program)."""
    for folder in (kernel / "include" / "latin", kernel / "src"):
        if path.is_relative_to(folder):
            parts = path.relative_to(folder).parts
            return parts[0] if len(parts) > 1 else LAYERS[-1]
    return None


def check_kernel(root: Path) -> Iterator[Offence]:
    """Offences of the C++ files below ``latin_core``."""
    kernel = root / "latin_core"
    public = kernel / "include"
    known = (COMMON, *LAYERS)
    files = sorted(path for suffix in ("*.hpp", "*.cpp", "*.h") for path in kernel.rglob(suffix))
    for path in files:
        user = layer_of(path, kernel)
        if user is not None and user not in known:
            yield Offence(path, 1, f"folder {user} is no layer; the layers are {', '.join(known)}")
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if _DOLFINX.search(line):
                yield Offence(path, number, "the kernel must not mention dolfinx")
        for number, name, target in included(path, kernel):
            if user is None:
                continue
            used = layer_of(target, kernel)
            if used is None:
                continue
            if path.is_relative_to(public) and not target.is_relative_to(public):
                yield Offence(path, number, f"{name} is not installed, what include/ holds must not use it")
            elif used not in known:
                yield Offence(path, number, f"{name} belongs to no known layer")
            elif not may_use(user, used):
                yield Offence(path, number, f"layer {user} must not include {name} (layer {used})")


def included(path: Path, kernel: Path) -> Iterator[tuple[int, str, Path]]:
    """Line, name and file of what a file of the kernel includes of it."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if match := _INCLUDE.match(line):
            name = match[1] or match[2]
            above, inside, _ = name.rpartition("/")
            folder = kernel / ("include" if name.startswith("latin/") else "src")
            yield number, name, ((folder if inside and above[0] != "." else path.parent) / name).resolve()


@functools.cache
def imports(path: Path) -> list[tuple[int, str]]:
    """Line and dotted name of everything a Python file imports, at any depth of the code.

    ``from a import b`` gives ``a.b``, because b may be a module; relative imports start with dots.
    """
    found: list[tuple[int, str]] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=str(path))):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            prefix = "." * node.level + (node.module or "")
            joint = "" if prefix.endswith(".") else "."
            found += [(node.lineno, f"{prefix}{joint}{alias.name}") for alias in node.names]
        elif isinstance(node, ast.Call) and _called(node) in ("import_module", "__import__"):
            found += [(node.lineno, str(a.value)) for a in node.args[:1] if isinstance(a, ast.Constant)]
    return found


def _called(node: ast.Call) -> str:
    """Name of what is called, without where it is from."""
    return node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")


def outside_of_functions(path: Path) -> set[int]:
    """Lines of the imports that are carried out when a file is imported."""
    found: set[int] = set()
    pending = list(ast.iter_child_nodes(ast.parse(path.read_text(encoding="utf-8"))))
    while pending:
        node = pending.pop()
        if isinstance(node, ast.Import | ast.ImportFrom):
            found.add(node.lineno)
        elif not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            pending += ast.iter_child_nodes(node)
    return found


def place_of(module: str) -> tuple[int, int] | None:
    """Place of a module, as "assembly.pairing", in the table; None: it is not there.

    A sub-package stands behind its modules, and the frontend itself behind everything.
    """
    package, _, name = module.partition(".")
    if not module:
        return len(FRONTEND), 0
    if package not in FRONTEND:
        return None
    modules = FRONTEND[package]
    if name and name not in modules:
        return None
    return list(FRONTEND).index(package), modules.index(name) if name else len(modules)


def frontend_module(module: str, name: str, frontend: Path) -> str | None:
    """Module of the frontend that a dotted name is in, seen from another one; None: it is none of ours."""
    parts = name.split(".")
    if name.startswith("."):
        up = len(name) - len(name.lstrip("."))
        rest = name.lstrip(".").split(".")
        parts = [*module.split(".")[: -up or None], *(part for part in rest if part)]
    elif parts.pop(0) != "dolfinx_frontend":
        return None
    while parts:
        path = frontend.joinpath(*parts)
        if path.is_dir() or path.with_suffix(".py").is_file() or place_of(".".join(parts)) is not None:
            break
        parts.pop()
    return ".".join(parts)


class Use(NamedTuple):
    """An import of `name` in a module of the frontend; `used` is the module that it is in."""

    module: str
    used: str
    path: Path
    line: int
    name: str


def module_of(path: Path, frontend: Path) -> str:
    """Module of a file, as "assembly.pairing"; "" is the frontend itself."""
    parts = path.relative_to(frontend).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def uses(frontend: Path) -> Iterator[Use]:
    """What the modules of the frontend import of each other."""
    for path in sorted(frontend.rglob("*.py")):
        module = module_of(path, frontend)
        # what relative imports start from
        inside = ".".join(path.relative_to(frontend).with_suffix("").parts)
        for line, name in imports(path):
            if name.split(".")[0] != "latin_core":
                used = frontend_module(inside, name, frontend)
                if used is not None and used != module:
                    yield Use(module, used, path, line, name)


def check_frontend(root: Path) -> Iterator[Offence]:
    """Offences of ``dolfinx_frontend``."""
    frontend = root / "dolfinx_frontend"
    arrows: dict[str, dict[str, tuple[Path, int]]] = {}
    pending: set[tuple[str, str]] = set()
    for path in sorted(frontend.rglob("*.py")):
        module = module_of(path, frontend)
        if place_of(module) is None:
            yield Offence(path, 1, f"{module} is not in the table FRONTEND of tools/check_layers.py")
        for line, name in imports(path):
            if name.split(".")[0] == "latin_core":
                if name.split(".")[1:2] == ["_core"] and module != "kernel.bridge":
                    yield Offence(path, line, "only kernel/bridge.py may import latin_core._core")
                elif module.split(".")[0] in WITHOUT_KERNEL:
                    yield Offence(path, line, f"{module.split('.')[0]} must not import latin_core")
            if name.split(".")[0] in FIELDS and module.split(".")[0] in STATISTICS:
                yield Offence(path, line, f"{module.split('.')[0]} must not import {name}")
    for module, used, path, line, name in uses(frontend):
        place, there = place_of(module), place_of(used)
        if place is None:
            continue
        if name == "dolfinx_frontend.kernel.fitting.walked" and module.split(".")[0] not in EVALUATING:
            yield Offence(path, line, "points are solved in evaluate only")
        if there is None:
            yield Offence(path, line, f"{name} is in no module of the table FRONTEND")
            continue
        if (module, used) in LAZY and line not in outside_of_functions(path):
            continue
        if (module, used) in PENDING:
            pending.add((module, used))
            continue
        arrows.setdefault(module, {}).setdefault(used, (path, line))
        if there >= place:
            above = used or "dolfinx_frontend"
            yield Offence(path, line, f"{module} must not import {above}, which stands above it")
    for module, used in sorted(PENDING - pending):
        path = frontend.joinpath(*module.split(".")).with_suffix(".py")
        if path.is_file():
            yield Offence(path, 1, f"{used} is imported no more: take it out of PENDING")
    for circle in circles({module: set(used) for module, used in arrows.items()}):
        path, line = arrows[circle[0]][circle[1]]
        yield Offence(path, line, f"circle: {' -> '.join(circle)}")


def circles(arrows: dict[str, set[str]]) -> Iterator[list[str]]:
    """Circles of a graph, one for each arrow that closes one in a walk through all of it."""
    finished: set[str] = set()

    def walk(trail: list[str]) -> Iterator[list[str]]:
        for following in sorted(arrows.get(trail[-1], ())):
            if following in trail:
                yield [*trail[trail.index(following) :], following]
            elif following not in finished:
                yield from walk([*trail, following])
        finished.add(trail[-1])

    for start in sorted(arrows):
        if start not in finished:
            yield from walk([start])


def check_python(root: Path) -> Iterator[Offence]:
    """Offences of ``latin_core/python`` and ``dolfinx_frontend``."""
    for path in sorted((root / "latin_core" / "python").rglob("*.py*")):
        if path.suffix not in (".py", ".pyi"):
            continue
        for line, name in imports(path):
            if name.split(".")[0] in FRONTEND_WORDS:
                yield Offence(path, line, f"the kernel must not import {name}")
    yield from check_frontend(root)


def main(arguments: list[str]) -> int:
    """Print the offences below the given root (default: this project); 1 if there is any."""
    root = Path(arguments[0]).resolve() if arguments else Path(__file__).resolve().parents[1]
    offences = [*check_kernel(root), *check_python(root)]
    for file, line, message in offences:
        print(Offence(file.relative_to(root), line, message))
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
