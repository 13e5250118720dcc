"""An answer as a file that a stranger can check: ``docs/certificate.md``, ``tools/check_certificate.py``.

The file has what was solved and what came out by value, and nothing that was derived on the way: a stiffness
matrix, a factor or a status of a point would have to be believed.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import basix
import numpy as np

from dolfinx_frontend.assembly.elements import csr, quadrature
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.matrix_part import frames_of
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_path, is_real
from dolfinx_frontend.common.deferred import sp
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import FileError, replaced
from dolfinx_frontend.formats.chaos_file import software
from dolfinx_frontend.formats.meshes import part_arrays
from dolfinx_frontend.results.answer import stepped
from dolfinx_frontend.results.balance import (
    directions_of,
    eliminated,
    force_of,
    held_by_nodes,
    nodal_forces,
)
from dolfinx_frontend.scene.laws import Elimination, Law
from dolfinx_frontend.scene.materials import LinearElastic

__all__ = ["FORMAT", "KINDS", "VERSION", "write_certificate"]

FORMAT = "latin-certificate"
VERSION = 1
KINDS = ("perfect", "elastic", "force", "contact", "coulomb", "preload", "debonding")
"""Laws of the kernel that the checker knows."""
STATEMENT = (
    "The displacements and the interface forces are an answer of the discrete problem: every part is in "
    "balance, the law holds at every point, and the relative error is at most `error`."
)

_NOTHING, _TINY = 1e-13, 1e-300
"""A part on which less acts than this share of what acts on another one has rounding only."""

Arrays = dict[str, Any]


def write_certificate(answer: Any, path: str | Path) -> None:
    """Write what proves an answer, see :meth:`dolfinx_frontend.results.result.Result.certificate`."""
    target = checked_path("certificate", path, new=True)
    if target.suffix.lower() != ".npz":
        raise FileError(f"{target}: a certificate is an .npz file, not {target.suffix!r}")
    problem = answer.problem
    if answer.kind not in ("deterministic", "history"):
        raise _refused(f"the answer is a {answer.kind}: solve it with numbers, at a point of interest")
    if problem.comm is not None:
        raise _refused("its parts are on several ranks: solve it on one")
    if not np.isfinite(answer.error):
        raise _refused(f"its error is not known, it ended as {answer.status!r}")
    problem.check_unchanged()
    problem.check_sources()
    arrays = _content(answer)
    with replaced(target) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def _refused(why: str) -> SceneError:
    return SceneError(f"certificate: {why}")


def _content(answer: Any) -> Arrays:
    problem: Problem = answer.problem
    times: list[float | None] = [None] if answer.times is None else [float(t) for t in answer.times]
    arrays: Arrays = {}
    parts = [_part(arrays, f"part{k}.", part) for k, part in enumerate(problem.substructures.values())]
    interfaces = [
        _interface(arrays, f"interface{k}.", answer, name, times) for k, name in enumerate(problem.interfaces)
    ]
    moments = [problem if t is None else problem.at(t) for t in times]
    for k, name in enumerate(problem.substructures):
        u = stepped(answer.unknowns(name), answer.times)
        load = np.stack([each.load_on(name) for each in moments])
        arrays |= {f"part{k}.load": load, f"part{k}.displacement": u}
        arrays[f"part{k}.reaction"] = _reaction(answer, name, u, load)
    head = {
        "format": FORMAT,
        "version": VERSION,
        "software": software(),
        "statement": STATEMENT,
        "status": answer.status,
        "error": float(answer.error),
        "imbalance": max(float(answer.error), _imbalance(answer, arrays)),
        "rtol": float(answer.plan.options.rtol),
        "times": None if answer.times is None else times,
        "parts": parts,
        "interfaces": interfaces,
    }
    return arrays | {"certificate": np.array(json.dumps(head))}


# --- parts -----------------------------------------------------------------------------------------
def _part(arrays: Arrays, key: str, part: Substructure) -> Arrays:
    """Mesh, element and elasticity into the arrays; what is known of it in words."""
    where = f"substructure {part.name!r}"
    if frames_of(part) is not None:
        raise _refused(f"{where} is a matrix, whose stiffness would have to be believed")
    if part.around:
        raise _refused(f"{where} is the section of a body of revolution")
    if not is_real(part.factor):
        raise _refused(f"{where} has the stiffness {part.factor!r}, which is random")
    mesh = part_arrays(part.part, part.V, part.material)
    if "elasticity" not in mesh:
        raise _refused(f"{where}: its material is no elasticity with the same numbers everywhere")
    element = part.V.element.basix_element
    cell = basix.CellType[mesh["cell"]]
    order, degree = mesh["order"], mesh["degree"]
    simplex = mesh["cell"] in ("triangle", "tetrahedron")
    # the rule of the part's own stiffness: another one is another discretisation on curved cells
    points, weights = quadrature(cell, 2 * (degree - simplex) + 2 * (order - 1))
    geometry = basix.create_element(basix.ElementFamily.P, cell, order, basix.LagrangeVariant.equispaced)
    arrays |= {key + name: mesh[name] for name in ("x", "cells", "dofs", "elasticity")}
    arrays |= {
        key + "nodes": part.dof_coordinates,
        key + "reference": np.asarray(element.points),
        key + "mapping": np.asarray(geometry.points),
        key + "points": points,
        key + "weights": weights,
    }
    told: Arrays = {"name": part.name, "cell": mesh["cell"], "order": order, "degree": degree}
    if isinstance(part.material, LinearElastic):
        material = part.material
        told |= {"E": float(material.E), "nu": float(material.nu), "plane": material.plane}
    return told


def _reaction(answer: Any, name: str, u: Array, load: Array) -> Array:
    """Forces (T, n) at the nodes of a part that supports and glued neighbours exert: what its balance lacks
    there."""
    problem: Problem = answer.problem
    part = problem.substructures[name]
    left = (part.matrix @ u.T).T - load
    held = np.zeros(part.size, dtype=bool)
    for interface in problem.interfaces.values():
        for number, side in enumerate(interface.sides):
            if side.substructure != name:
                continue
            if held_by_nodes(answer, interface):
                held.reshape(-1, part.dim)[side.nodes] = True
                continue
            left -= nodal_forces(answer, interface, number)
    return np.where(held, left, 0.0)


def _imbalance(answer: Any, arrays: Arrays) -> float:
    """What the balance of a part lacks, relative to all that acts on it: in force, in moment, at its nodes.

    The largest of all parts and steps.
    """
    problem: Problem = answer.problem
    found = []
    for k, (name, part) in enumerate(problem.substructures.items()):
        u, *given = (arrays[f"part{k}.{what}"] for what in ("displacement", "load", "reaction"))
        for interface in problem.interfaces.values():
            for number, side in enumerate(interface.sides):
                if side.substructure == name and not held_by_nodes(answer, interface):
                    given.append(nodal_forces(answer, interface, number))
        acting, terms = np.sum(given, axis=0), np.sum(np.abs(given), axis=0)
        modes, kinds = part.rigid_modes, np.cumsum([0, part.dim])
        of_motions = abs(acting @ modes), terms @ abs(modes)
        rigid = [np.maximum.reduceat(each, kinds, axis=1) for each in of_motions]
        unit = np.sqrt(part.diagonal)
        nodes = [np.linalg.norm(each / unit, axis=1) for each in ((part.matrix @ u.T).T - acting, terms)]
        found.append([np.column_stack(each) for each in zip(rigid, nodes, strict=True)])
    left, whole = np.array(found).transpose(1, 2, 0, 3)  # (T, parts, 3)
    return float((left / np.maximum(whole, _NOTHING * whole.max(axis=1, keepdims=True) + _TINY)).max())


# --- interfaces ------------------------------------------------------------------------------------
def _interface(arrays: Arrays, key: str, answer: Any, name: str, times: list[float | None]) -> Arrays:
    problem: Problem = answer.problem
    interface = problem.interfaces[name]
    order = list(problem.substructures)
    laws: list[Law] = [interface.law if t is None else interface.law.at(t) for t in times]
    sides = [order.index(side.substructure) for side in interface.sides]
    faces = [f"{side.substructure}:{side.face}" for side in interface.sides]
    told: Arrays = {"name": name, "law": interface.law.title, "sides": sides, "faces": faces}
    if interface.law.functions is not None:
        raise _refused(f"interface {name!r}: its law {interface.law.title} is the user's own")
    if not held_by_nodes(answer, interface):
        return told | _points(arrays, key, answer, interface, laws, times)
    how = eliminated(answer, interface)
    if how is Elimination.GLUED and interface.matching is not None:
        arrays[key + "pairs"] = interface.matching.astype(np.int64)
        return told | {"kind": "glued"}
    if how is not Elimination.REMOVED:
        raise _refused(f"interface {name!r}: its law {interface.law.title} ties nodes to rigid motions")
    side = interface.sides[0]
    nodes = problem.substructures[side.substructure].dof_coordinates[side.nodes]
    held = [law.constraint(name, side, nodes) for law in laws]
    arrays |= {
        key + "nodes": side.nodes.astype(np.int64),
        key + "directions": held[0][0],
        key + "values": np.stack([values for _, values in held]),
    }
    return told | {"kind": "support"}


def _points(
    arrays: Arrays,
    key: str,
    answer: Any,
    interface: Interface,
    laws: list[Law],
    times: list[float | None],
) -> Arrays:
    """Points, traces, forces, and the law at every point."""
    fields = [law.fields(interface, t) for law, t in zip(laws, times, strict=True)]
    kind = fields[0].kind
    if kind not in KINDS:
        raise _refused(f"interface {interface.name!r}: the law {kind!r} is none of {', '.join(KINDS)}")
    rows = directions_of(interface)
    m, k, d = rows.shape
    turned = sp.bsr_matrix((rows, np.arange(m), np.arange(m + 1)), shape=(m * k, m * d)).tocsr()
    for number, side in enumerate(interface.sides):
        trace = sp.csr_matrix(turned @ csr(side.trace))
        arrays |= {f"{key}trace{number}.{a}": getattr(trace, a) for a in ("data", "indices", "indptr")}
    arrays |= {
        key + "points": interface.points,
        key + "weights": interface.weights,
        key + "directions": rows,
        key + "force": force_of(answer, interface),
    }
    for parameter in fields[0].parameters:
        values = np.stack([each.parameters[parameter][:, 0] for each in fields])
        arrays[f"{key}law.{parameter}"] = values if interface.wrench is None else values[:, :1]
    return {"kind": kind, "parameters": list(fields[0].parameters), "rigid": interface.wrench is not None}
