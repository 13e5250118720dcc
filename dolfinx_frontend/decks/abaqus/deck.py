"""Reading a deck: its cards, its model, its scene."""

from __future__ import annotations

import os
from pathlib import Path

from dolfinx_frontend.common.checks import checked_path
from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.cards import Note, read_cards
from dolfinx_frontend.decks.abaqus.faces import Faces
from dolfinx_frontend.decks.abaqus.history import History, Step
from dolfinx_frontend.decks.abaqus.interfaces import Joints, cuts_of, references_of
from dolfinx_frontend.decks.abaqus.links import Links
from dolfinx_frontend.decks.abaqus.loads import Loads
from dolfinx_frontend.decks.abaqus.materials import expansion_of, material_of, number_of
from dolfinx_frontend.decks.abaqus.model import Model
from dolfinx_frontend.decks.abaqus.pieces import Mesh
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.scene.scene import Scene

__all__ = ["InpDeck", "read_inp"]


def refuse(name: str, model: Model) -> None:
    """Raise what is refused, all of it at once."""
    refused = tuple(dict.fromkeys(note for note in model.notes if note.kind == "refused"))
    if refused:
        lines = [f"{n.file}:{n.line}: *{n.keyword}: {n.text}" for n in refused]
        error = DeckError(
            f"{name}: {len(refused)} card(s) are refused; take them out or replace them:\n  "
            + "\n  ".join(lines)
        )
        error.notes = refused
        raise error


class InpDeck:
    """An Abaqus or CalculiX deck; made by :func:`read_inp`.

    Attributes
    ----------
    notes
        What was changed or ignored, in the order of the deck: records (kind, keyword, file, line, text).
    steps
        Its steps: records (number, name, start, end, file, line).
    times
        Total times to solve it at, for ``solve(problem, times=deck.times)``; None: one answer, of a deck with
        one step whose loads grow in proportion.
    densities
        Part -> mass per volume, of those that have one.
    """

    def __init__(self, name: str, model: Model) -> None:
        self.name = name
        self._model = model
        references, bolts = references_of(model)
        self._history = History(model, references=references, bolts=bolts)
        self._history.read()
        cuts = cuts_of(model)
        refuse(name, model)
        self._mesh = Mesh(model)
        self._mesh.build([pairs for _, _, pairs in cuts])
        self._faces = Faces(self._mesh)
        self._links = Links(model, self._mesh, self._history)
        self._links.collect()
        self._joints = Joints(self._mesh, self._history, self._faces, self._links)
        self._joints.collect(cuts)
        self._check_fixed()
        self._links.reduce({node for body in self._joints.bodies for node in body.nodes} | bolts)
        self._loads = Loads(self._mesh, self._history, self._faces, self._links)
        self._loads.ask()
        self._faces.divide()
        self._loads.divide()
        self._materials = {p.name: material_of(model, p) for p in self._mesh.pieces}
        self._alphas = {p.name: expansion_of(model, p) for p in self._mesh.pieces}
        densities = {p.name: number_of(model, p, "DENSITY") for p in self._mesh.pieces}
        self.densities = {name: value for name, value in densities.items() if value is not None}
        refuse(name, model)
        order = {"refused": 0, "changed": 1, "ignored": 2}
        once = dict.fromkeys(sorted(model.notes, key=lambda note: order[note.kind]))
        self.notes: tuple[Note, ...] = tuple(once)
        self.steps: tuple[Step, ...] = tuple(self._history.steps)
        self.times: list[float] | None = None if self._history.static else self._history.times

    def _check_fixed(self) -> None:
        for node, step in self._history.fixed.items():
            held = any(("u", node, k) in self._history.curves for k in (1, 2, 3))
            if node not in self._history.bolts and not held:
                at, name = self._history.steps[step - 1], self._model.node_names[node]
                raise DeckError(
                    f"{at.file}:{at.line}: *BOUNDARY: node {name}, which belongs to no solid or moves a "
                    "body, is FIXED where it has got to; give it a value"
                )

    @property
    def parts(self) -> tuple[str, ...]:
        """Names of the parts: of the sets of their sections."""
        return tuple(piece.name for piece in self._mesh.pieces)

    def scene(self) -> Scene:
        """The deck as a scene, to be assembled and solved; a new one every time.

        Raises
        ------
        DeckError
            Cells that make no mesh, and what a scene refuses.
        """
        pieces = self._mesh.pieces
        parts = self._mesh.parts(self._faces.of_piece)
        scene = Scene(axisymmetric=pieces[0].kind.plane == "axisymmetric")
        try:
            for piece in pieces:
                scene.substructure(
                    piece.name, parts[piece.name], self._materials[piece.name], degree=piece.kind.degree
                )
            self._joints.put(scene)
            self._links.put(scene)
            self._loads.put(scene, self.densities, self._alphas)
        except DeckError:
            raise
        except SceneError as error:
            raise DeckError(f"{self.name}: {error}") from error
        return scene

    def __repr__(self) -> str:
        head = (
            f"InpDeck {self.name}: {len(self._mesh.pieces)} parts, {len(self._model.elements)} elements, "
            f"{len(self.steps)} steps"
        )
        table = columns([(n.kind, f"*{n.keyword}", f"{n.file}:{n.line}", n.text) for n in self.notes], "<<<<")
        return "\n".join([head, *(f"  {line}" for line in table)])


def read_inp(path: str | Path) -> InpDeck:
    """An Abaqus or CalculiX deck (``.inp``).

    Nothing in it is executed; files that it includes are read from its folder and below.

    Parameters
    ----------
    path
        The deck.

    Returns
    -------
    InpDeck
        With ``scene()``, ``notes``, ``steps`` and ``times``.

    Raises
    ------
    SceneError
        With file, line and card: what cannot be read, and all cards that are refused at once.

    Examples
    --------
    >>> deck = read_inp("bracket.inp")
    >>> print(deck)
    >>> result = solve(assemble(deck.scene()), times=deck.times)
    """
    file = checked_path("read_inp", path)
    model, name = Model(), os.path.basename(file)
    cards = read_cards(file)
    try:
        model.read(cards)
        return InpDeck(name, model)
    except DeckError:
        refuse(name, model)  # what is refused may be why something else is missing
        raise
