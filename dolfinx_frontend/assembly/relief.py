"""Inertia relief: loads of a free assembly, balanced by the forces of its rigid acceleration.

Every load f is replaced by f - M R a with R' (f - M R a) = 0: what is left is in equilibrium by itself, so
that the supports that hold the assembly, as many as it has rigid motions, carry nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import dolfinx.fem as fem
import numpy as np
import ufl

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.part_loads import PartLoad
from dolfinx_frontend.assembly.ranks import PartSummary, exchanged
from dolfinx_frontend.assembly.remote import remote_interface
from dolfinx_frontend.assembly.rigid import rigid_modes
from dolfinx_frontend.assembly.substructure import Substructure, ring
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known
from dolfinx_frontend.common.deferred import linalg
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.scene.laws import Displacement, Elimination
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.scene.specs import Face, InterfaceSpec, Remote

__all__ = ["Relief", "densities_of", "relief_supports", "supports"]


class Relief:
    """The balance of the loads of some parts.

    Parameters
    ----------
    parts
        Parts of the scene on this rank.
    densities
        Part -> mass per volume.
    every
        What is known of all parts.
    comm
        Communicator of the ranks that have them; all make every call. None: there is one.
    """

    def __init__(
        self,
        parts: Mapping[str, Substructure],
        densities: Mapping[str, float],
        every: Mapping[str, PartSummary],
        comm: Any = None,
    ) -> None:
        self.parts, self.comm = parts, comm
        mass = sum(densities[n] * s.volume for n, s in every.items())
        moments = [densities[n] * s.volume * s.centre for n, s in every.items()]
        self.centre: Array = np.sum(moments, axis=0) / mass
        self.length = max(s.length for s in every.values())
        self._motions = {n: self._modes(s) for n, s in parts.items()}
        self._inertia = {n: densities[n] * self._masses(s) for n, s in parts.items()}
        first = next(iter(every.values()))
        motions = 1 if first.around else 3 * (first.dim - 1)
        nothing = np.zeros((motions, motions))
        gram = self._sum(sum((self._motions[n].T @ self._inertia[n] for n in parts), start=nothing))
        self._inverse = np.linalg.inv(gram)

    def _sum(self, own: Array) -> Array:
        """The sum over the ranks; collective."""
        if self.comm is None:
            return own
        every = exchanged(self.comm, own)
        return np.asarray(sum(every[1:], start=every[0]))

    def _modes(self, s: Substructure) -> Array:
        """Rigid motions of a part, (n, r)."""
        modes = rigid_modes(s.dof_coordinates, self.centre, self.length).reshape(s.size, -1)
        return modes[:, [1]] if s.around else modes

    def _masses(self, s: Substructure) -> Array:
        """Nodal forces (n, r) of unit accelerations at density 1."""
        mesh, d = s.part.mesh, s.dim
        v, x = ufl.TestFunction(s.space), ufl.SpatialCoordinate(mesh)
        r = [(x[i] - float(self.centre[i])) / self.length for i in range(d)]
        motions: list[Any] = [v[i] for i in range(d)]
        if d == 2:
            motions.append(-r[1] * v[0] + r[0] * v[1])
        else:
            motions += [r[j] * v[k] - r[k] * v[j] for j, k in ((1, 2), (2, 0), (0, 1))]
        if s.around:
            motions = [ring(mesh) * motions[1]]
        columns = [fem.assemble_vector(fem.form(m * ufl.dx(domain=mesh))).array[: s.size] for m in motions]
        return np.array(columns, dtype=np.float64).T

    def balance(self, forces: Mapping[str, Array]) -> dict[str, Array]:
        """Nodal forces (n,) of all parts: those of some and the inertia that balances them; collective."""
        total = sum((self._motions[n].T @ f for n, f in forces.items()), start=np.zeros(len(self._inverse)))
        acceleration = self._inverse @ self._sum(total)
        out = {}
        for name, s in self.parts.items():
            own = forces.get(name, np.zeros(s.size))
            out[name] = own - self._inertia[name] @ acceleration
        return out

    def parts_balanced(self) -> dict[str, Substructure]:
        """The parts with body forces in balance."""
        own = [a for s in self.parts.values() for a in s.varying_loads]
        ranks = [own] if self.comm is None else exchanged(self.comm, own)
        amplitudes = list(dict.fromkeys(a for each in ranks for a in each))
        loads = self.balance({n: s.load for n, s in self.parts.items()})
        varying = {a: self.balance({n: s.load_of(a) for n, s in self.parts.items()}) for a in amplitudes}
        return {
            n: replace(s, load=loads[n], varying_loads={a: found[n] for a, found in varying.items()})
            for n, s in self.parts.items()
        }

    def load_balanced(self, load: PartLoad) -> PartLoad:
        """A load whose every number is in balance."""
        return replace(load, columns={p: self.balance(f) for p, f in load.columns.items()})


def supports(s: Substructure) -> list[tuple[int, tuple[int, ...]]]:
    """Nodes of a part and global components that hold its rigid motions, and nothing twice."""
    x, d = s.dof_coordinates, s.dim
    first = int(np.argmax(np.linalg.norm(x - x.mean(axis=0), axis=1)))
    second = int(np.argmax(np.linalg.norm(x - x[first], axis=1)))
    along = (x[second] - x[first]) / np.linalg.norm(x[second] - x[first])
    off = (x - x[first]) - ((x - x[first]) @ along)[:, None] * along
    nodes = [first, second, int(np.argmax(np.linalg.norm(off, axis=1)))]
    if s.around:
        return [(first, (1,))]
    modes = rigid_modes(x[nodes], x[nodes].mean(axis=0), s.length)  # (3, d, r)
    rows = modes.reshape(3 * d, -1)
    _, _, order = linalg.qr(rows.T, pivoting=True)
    chosen = sorted(int(k) for k in order[: rows.shape[1]])
    held: dict[int, list[int]] = {}
    for k in chosen:
        held.setdefault(nodes[k // d], []).append(k % d)
    return [(node, tuple(axes)) for node, axes in held.items()]


def densities_of(scene: Scene) -> dict[str, float]:
    """Part -> mass per volume."""
    supports = [
        name
        for name, each in scene.interfaces.items()
        if len(each.faces) == 1 and each.law.elimination is not Elimination.LOAD
    ]
    if supports:
        raise SceneError(
            f"inertia_relief: {', '.join(map(repr, supports))}: nothing may hold an assembly whose loads "
            "inertia balances; take the one or the other away"
        )
    of_matrices = [name for name, spec in scene.substructures.items() if spec.matrix is not None]
    if of_matrices:
        raise SceneError(f"inertia_relief: {of_matrices[0]!r} is a Matrix, whose mass is not known")
    given = scene.densities
    if not isinstance(given, Mapping):
        return dict.fromkeys(scene.substructures, float(given))
    for name in given:
        check_known("substructure", name, scene.substructures, "inertia_relief")
    missing = [name for name in scene.substructures if name not in given]
    if missing:
        raise SceneError(
            f"inertia_relief: no density for {', '.join(map(repr, missing))}; give one for each part"
        )
    return {name: float(value) for name, value in given.items()}


def relief_supports(part: Substructure) -> dict[str, Interface]:
    """What holds an assembly in inertia relief: some nodes of its first part."""
    found = {}
    for number, (node, axes) in enumerate(supports(part)):
        name = "relief" if number == 0 else f"relief#{number + 1}"
        place = tuple(map(float, part.dof_coordinates[node]))
        shown = ", ".join(f"{v:.6g}" for v in place)
        spec = InterfaceSpec(
            name,
            (Face(part.name, f"({shown})"),),
            Displacement(0.0, axes),
            None,
            None,
            "points",
            "full",
            Remote(place),
        )
        found[name] = remote_interface(spec, (part,))
    return found
