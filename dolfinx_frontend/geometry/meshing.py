"""Meshes of solids: tetrahedra, straightened where a curved one would fold."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.geometry.solids import Loaded


OPTIONS = {
    "General.Verbosity": 0.0,
    "Geometry.OCCImportLabels": 1.0,
    "Geometry.ToleranceBoolean": 0.0,
    "Mesh.MeshSizeFromPoints": 0.0,
    "Mesh.MeshSizeExtendFromBoundary": 0.0,
    "Mesh.Algorithm": 6.0,
    "Mesh.Algorithm3D": 1.0,
    "Mesh.SecondOrderIncomplete": 0.0,
}

_POOR = 0.1
"""Scaled Jacobian below which a mesh of curved cells is optimised."""

_FOLDED = 0.03
"""Scaled Jacobian below which cells are straightened."""

_FLAT = 1e-6
"""Inscribed over circumscribed radius, times 3, below which a cell is flat."""

FLAT = "flat cells"
"""What errors about these say."""

_ROUNDS = 20
"""Largest number of rounds; straightening a cell may fold its neighbours, but straight cells never fold."""

_TETRAHEDRON_10 = 11

_EDGES = np.array([[0, 1], [1, 2], [2, 0], [3, 0], [3, 2], [3, 1]])
"""Number in gmsh of a quadratic tetrahedron, and the ends of the edges that its last six nodes are on."""


def some(names: Sequence[str]) -> str:
    more = f" and {len(names) - 6} more" if len(names) > 6 else ""
    return ", ".join(repr(n) for n in names[:6]) + more


def generate(gmsh: Any, loaded: Loaded, order: int, say: Callable[[str], None]) -> None:
    """Mesh, curve the cells, and make sure that none is folded; `say` is told the next stage."""
    model = gmsh.model
    for dim, what in enumerate(("curves", "faces", "solids"), start=1):
        say(f"meshing the {what}")
        try:
            model.mesh.generate(dim)
        except Exception as failure:  # gmsh raises nothing more specific
            raise SceneError(
                f"gmsh cannot mesh the {what} of {some(list(loaded.volumes))} ({failure}); give "
                "smaller sizes, or fix the geometry"
            ) from failure
    _unflatten(model, loaded)
    if order == 2:
        say("curving the cells")
        model.mesh.setOrder(2)
        if min(_worst(model, loaded).values()) < _POOR:
            model.mesh.optimize("HighOrderElastic")
            _straighten(model)
        folded = {n: q for n, q in _worst(model, loaded).items() if q <= 0.0}
        if folded:
            raise SceneError(
                f"curved cells of {some(list(folded))} are folded (scaled Jacobian "
                f"{min(folded.values()):.2g}); give smaller sizes, more cells per_turn, or order=1"
            )


def _unflatten(model: Any, loaded: Loaded) -> None:
    """Move and swap cells until none is flat: four nodes of one face are no cell."""
    for method in ("", "Relocate3D", None):
        flat = {name: q for name, q in _worst(model, loaded, "gamma").items() if q < _FLAT}
        if not flat:
            return
        if method is not None:
            model.mesh.optimize(method)
    raise SceneError(
        f"{FLAT} in {some(list(flat))} (quality {min(flat.values()):.2g}); give smaller sizes or more cells "
        "per_turn"
    )


def _straighten(model: Any) -> None:
    """Straighten cells that their curvature folds, as in a ring that is thinner than a chord's sagitta."""
    mesh = model.mesh
    cells, nodes = mesh.getElementsByType(_TETRAHEDRON_10)
    nodes = nodes.reshape(-1, 10)
    for _ in range(_ROUNDS):
        quality = np.asarray(mesh.getElementQualities(cells, "minSJ"))
        bad = nodes[quality < _FOLDED]
        if not len(bad):
            return
        tags, x, _ = mesh.getNodes()
        place = np.zeros(int(tags.max()) + 1, dtype=np.int64)
        place[tags.astype(np.int64)] = np.arange(len(tags))
        x = x.reshape(-1, 3)
        ends = bad[:, _EDGES]
        middle = 0.5 * (x[place[ends[:, :, 0]]] + x[place[ends[:, :, 1]]])
        chosen, first = np.unique(bad[:, 4:], return_index=True)
        for tag, at in zip(chosen.tolist(), middle.reshape(-1, 3)[first].tolist(), strict=True):
            mesh.setNode(tag, at, [])


def _worst(model: Any, loaded: Loaded, quality: str = "minSJ") -> dict[str, float]:
    """Part -> smallest scaled Jacobian, or another quality, of its cells."""
    out = {}
    for name, volumes in loaded.volumes.items():
        found = [
            float(model.mesh.getElementQualities(tags, quality).min())
            for volume in volumes
            for tags in model.mesh.getElements(3, volume)[1]
        ]
        if not found:
            raise SceneError(f"gmsh made no cells in {name!r}; give it a smaller size, or fix the geometry")
        out[name] = min(found)
    return out
