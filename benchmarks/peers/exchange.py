"""What the solvers of a comparison hand to each other: one file with the scene, one with an answer.

The scene is elastic bodies of linear tetrahedra, on which every solver puts quadratic displacements
(mid-side nodes in the middle), so that nodes and elements are the same in all. Lengths in mm, forces in N.

Scene (npz): ``bodies`` names; for each NAME ``NAME_x`` (vertices, 3), ``NAME_cells`` (cells, 4),
``NAME_material`` (E, nu) and for each of its faces ``NAME_face_FACE`` (facets, 3) vertices; ``contact`` the
two faces ("upper:bottom", "lower:top"), the first of which is the smaller one; ``friction``; ``given`` the
held faces "body:face", with their displacements ``values`` (rows, 3).

Answer (npz): for each body ``NAME_points`` (nodes, 3) and ``NAME_u`` (nodes, 3); ``force`` (3,) that the
contact exerts on the first body; ``seconds`` of ``setup`` and ``solve``, ``iterations``, ``note``.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Solid:
    """One body: its vertices, cells, material and the vertices of its facets by face."""

    x: Array
    cells: Ints
    E: float
    nu: float
    faces: dict[str, Ints]


@dataclass(frozen=True)
class Scene:
    """Bodies in contact; ``given``: "body:face" -> prescribed displacement (3,)."""

    bodies: dict[str, Solid]
    contact: tuple[str, str]
    friction: float
    given: dict[str, Array]

    def write(self, path: Path) -> None:
        """Write the scene."""
        data = arrays_of(self.bodies) | {
            "contact": list(self.contact),
            "friction": self.friction,
            "given": list(self.given),
            "values": np.array(list(self.given.values())),
        }
        np.savez(path, **data)


def arrays_of(bodies: dict[str, Solid]) -> dict[str, Any]:
    """Bodies as arrays of a file."""
    data: dict[str, Any] = {"bodies": list(bodies)}
    for name, body in bodies.items():
        data |= {f"{name}_x": body.x, f"{name}_cells": body.cells, f"{name}_material": (body.E, body.nu)}
        data |= {f"{name}_face_{face}": facets for face, facets in body.faces.items()}
    return data


def bodies_of(data: Any) -> dict[str, Solid]:
    """The bodies of a file that is open."""
    bodies = {}
    for name in data["bodies"].tolist():
        prefix = f"{name}_face_"
        faces = {key[len(prefix) :]: data[key] for key in data.files if key.startswith(prefix)}
        modulus, nu = data[f"{name}_material"].tolist()
        bodies[name] = Solid(data[f"{name}_x"], data[f"{name}_cells"], modulus, nu, faces)
    return bodies


def read_scene(path: Path) -> Scene:
    """The scene of a file."""
    with np.load(path) as data:
        bodies = bodies_of(data)
        first, second = data["contact"].tolist()
        given = dict(zip(data["given"].tolist(), data["values"], strict=True))
        return Scene(bodies, (first, second), float(data["friction"]), given)


@dataclass(frozen=True)
class Answer:
    """Displacements at the nodes of every body, the force on the first body, and the cost."""

    points: dict[str, Array]
    u: dict[str, Array]
    force: Array
    seconds: dict[str, float]
    iterations: int
    note: str

    def write(self, path: Path) -> None:
        """Write the answer."""
        data: dict[str, Any] = {
            "bodies": list(self.u),
            "force": self.force,
            "phases": list(self.seconds),
            "seconds": list(self.seconds.values()),
            "iterations": self.iterations,
            "note": self.note,
        }
        for name in self.u:
            data |= {f"{name}_points": self.points[name], f"{name}_u": self.u[name]}
        np.savez(path, **data)


def read_answer(path: Path) -> Answer:
    """The answer of a file."""
    with np.load(path) as data:
        names = data["bodies"].tolist()
        return Answer(
            {name: data[f"{name}_points"] for name in names},
            {name: data[f"{name}_u"] for name in names},
            data["force"],
            dict(zip(data["phases"].tolist(), data["seconds"].tolist(), strict=True)),
            int(data["iterations"]),
            str(data["note"]),
        )
