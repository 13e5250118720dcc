"""Reading a bulk data file: its cards as those of a model, its scene."""

from __future__ import annotations

from pathlib import Path

from dolfinx_frontend.common.checks import checked_path, checked_whole
from dolfinx_frontend.decks.abaqus.deck import InpDeck, refuse
from dolfinx_frontend.decks.abaqus.model import Model
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.nastran.bulk import bulk_cards, text_lines
from dolfinx_frontend.decks.nastran.case import cases
from dolfinx_frontend.decks.nastran.translated import Bush, translated
from dolfinx_frontend.scene.scene import Scene

__all__ = ["BdfDeck", "read_bdf"]


class BdfDeck(InpDeck):
    """A subcase of a Nastran file; made by :func:`read_bdf`. Its attributes are those of :class:`InpDeck`."""

    def __init__(self, name: str, model: Model, bushes: list[Bush]) -> None:
        super().__init__(name, model)
        self._bushes = bushes

    def scene(self) -> Scene:
        """The subcase as a scene, to be assembled and solved; a new one every time.

        Raises
        ------
        DeckError
            Cells that make no mesh, elastic joints of other nodes than those of RBE2 and RBE3, and what a
            scene refuses.
        """
        scene = super().scene()
        for bush in self._bushes:
            ends = [self._face_of(bush, node) for node in (bush.first, bush.second) if node is not None]
            root = self._model.root
            x = [self._model.x[root.nodes[n]] for n in (bush.first, bush.second) if n is not None]
            middle = [sum(values) / len(x) for values in zip(*x, strict=True)]
            second = ends[1] if len(ends) == 2 else None
            name = f"CBUSH-{bush.card.text(0)}"
            scene.springs(ends[0], name, middle, second, **bush.stiffness)
        return scene

    def _face_of(self, bush: Bush, node: int) -> str:
        """The face whose mean motion a node has; a rigid body is as one of its faces."""
        row = self._model.root.nodes[node]
        for body in self._joints.bodies:
            if body.reference == row:
                piece, name, _ = self._faces.named(body.faces)[0]
                return self._faces.text(piece, name)
        raise bush.card.error(
            f"GRID {node} is no reference node of an RBE2 or RBE3: connect it to a face of a solid by one"
        )

    def __repr__(self) -> str:
        return super().__repr__().replace("InpDeck", "BdfDeck", 1).replace("*", "")


def read_bdf(path: str | Path, subcase: int | None = None) -> BdfDeck:
    """A Nastran file (``.bdf``, ``.dat``, ``.nas``): linear statics of solids.

    Parameters
    ----------
    path
        The file, in small, large or free fields.
    subcase
        Its number; None: the only one.

    Returns
    -------
    BdfDeck
        With ``scene()``, ``notes``, ``steps`` and ``times``.

    Raises
    ------
    SceneError
        With file, line and card: what cannot be read, and all cards that are refused at once.
    """
    file = Path(checked_path("read_bdf", path))
    if subcase is not None:
        checked_whole("read_bdf", "subcase", subcase, 0)
    lines = list(text_lines(file))
    starts = (k for k, (_, line) in enumerate(lines) if line.strip().upper().startswith("BEGIN"))
    begin = next(starts, -1)
    found = cases(lines[: max(begin, 0)])
    chosen = [case for case in found if subcase in (None, case.number)]
    if len(chosen) != 1:
        known = ", ".join(str(case.number) for case in found)
        raise DeckError(f"{file.name}: it has the subcases {known}; give subcase= with one of them")
    made = translated(bulk_cards(lines[begin + 1 :]), chosen[0])
    model = Model()
    try:
        model.read(made.cards)
        model.notes += made.notes
        return BdfDeck(file.name, model, made.bushes)
    except DeckError:
        refuse(file.name, model)
        raise
