"""Materials of a deck: elasticity, expansion, density, axes of orthotropy, thickness in the plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.decks.abaqus.axes import axes_of
from dolfinx_frontend.decks.abaqus.cards import Card, Row
from dolfinx_frontend.decks.abaqus.model import Model
from dolfinx_frontend.decks.abaqus.pieces import Piece
from dolfinx_frontend.scene.materials import LinearElastic, OrthotropicElastic

__all__ = ["expansion_of", "material_of", "number_of", "thickness_of"]


def _cards(model: Model, piece: Piece) -> dict[str, Card]:
    card = piece.section.card
    name = card.need("MATERIAL")
    if name not in model.materials:
        known = ", ".join(model.materials) or "none"
        raise card.error(f"there is no material {name!r} (known: {known}); define it")
    return model.materials[name]


def number_of(model: Model, piece: Piece, keyword: str) -> float | None:
    """A positive number of the material of a piece, as its density; None: it has none."""
    card = _cards(model, piece).get(keyword)
    if card is None:
        return None
    value = card.number(_row(card), 0, keyword.lower())
    if value <= 0.0:
        raise card.error(f"its value is {value:g}; it is > 0", card.rows[0].where)
    return value


def _row(card: Card) -> Row:
    """The only data of a card; several lines are one of its data, or depend on temperature."""
    if not card.rows:
        raise card.error("its numbers are missing; give them in the next line")
    return card.rows[0]


def material_of(model: Model, piece: Piece) -> Any:
    """The material of a piece.

    Raises
    ------
    DeckError
        What is missing, depends on temperature, or is inadmissible.
    """
    cards = _cards(model, piece)
    elastic = cards.get("ELASTIC")
    if elastic is None:
        raise cards["MATERIAL"].error("it has no *ELASTIC; add it")
    kind = elastic.get("TYPE") or "ISOTROPIC"
    scale = thickness_of(piece)
    plane = {"stress": "stress"}.get(piece.kind.plane, "strain")
    row = _row(elastic)
    try:
        if kind in ("ISO", "ISOTROPIC"):
            if len(elastic.rows) > 1:
                model.note("refused", elastic, "constants that depend on temperature")
            E, nu = elastic.number(row, 0, "Young's modulus"), elastic.number(row, 1, "Poisson's ratio")
            return LinearElastic(E * scale, nu, plane=plane)
        return _orthotropic(model, elastic, kind, piece)
    except SceneError as error:
        if str(error).startswith(elastic.where.file):
            raise
        raise elastic.error(str(error), row.where) from error


def _orthotropic(model: Model, card: Card, kind: str, piece: Piece) -> Any:
    words, places = card.stream()
    if piece.kind.dim == 2:
        raise card.error(f"TYPE = {kind} in the plane is not read; give isotropic constants, or a solid")
    values = [card.number(Row(places[k], words), k, "constant") for k in range(len(words))]
    engineering, ortho = kind.replace(" ", "") == "ENGINEERINGCONSTANTS", kind in ("ORTHO", "ORTHOTROPIC")
    if not (engineering or ortho):
        raise card.error(f"TYPE = {kind!r}; give ISOTROPIC, ORTHO or ENGINEERING CONSTANTS")
    if len(values) not in (9, 10):
        raise card.error(f"{kind} has 9 constants, {len(values)} are given; correct them")
    if engineering:
        E, nu, G = values[:3], values[3:6], values[6:9]
    else:
        d11, d12, d22, d13, d23, d33, g12, g13, g23 = values[:9]
        stiffness = np.array([[d11, d12, d13], [d12, d22, d23], [d13, d23, d33]])
        if np.linalg.matrix_rank(stiffness) < 3:
            raise card.error("its stiffness is singular; correct the constants")
        S = np.linalg.inv(stiffness)
        if np.diag(S).min() <= 0.0:
            raise card.error("its stiffness is not positive definite; correct the constants")
        E = [1.0 / float(S[k, k]) for k in range(3)]
        nu = [-float(S[0, 1]) * E[0], -float(S[0, 2]) * E[0], -float(S[1, 2]) * E[1]]
        G = [g12, g13, g23]
    return OrthotropicElastic(tuple(E), tuple(nu), tuple(G), axes=_axes(piece))


def _axes(piece: Piece) -> Any:
    """Rows: the axes 1, 2, 3 of the section's orientation, or a function of points; None: global."""
    card = piece.section.card
    name = card.get("ORIENTATION")
    if name is None:
        return None
    scope = piece.section.scope
    found = scope.orientations.get(name) or scope.model.root.orientations.get(name)
    if found is None:
        raise card.error(f"there is no orientation {name!r}; define it")
    axes = axes_of(found, scope.turn, scope.shift)
    return (lambda x: np.array([axes.at(each) for each in x])) if axes.round else axes.at(axes.origin)


def expansion_of(model: Model, piece: Piece) -> Any:
    """Coefficient of expansion of the material of a piece, or 3; None: it does not expand."""
    card = _cards(model, piece).get("EXPANSION")
    if card is None:
        return None
    kind = card.get("TYPE") or "ISO"
    if len(card.rows) > 1:
        model.note("refused", card, "expansion that depends on temperature")
    row = _row(card)
    if kind == "ISO":
        return card.number(row, 0, "coefficient of expansion")
    if kind == "ORTHO" and piece.section.card.get("ORIENTATION") is None:
        return tuple(card.number(row, k, "coefficient of expansion") for k in range(3))
    model.note("refused", card, f"expansion of TYPE={kind}: ISO, or ORTHO along x, y, z")
    return None


def thickness_of(piece: Piece) -> float:
    """Thickness of a piece in the plane; 1 of others."""
    if piece.kind.plane not in ("stress", "strain") or not piece.section.card.rows:
        return 1.0
    card = piece.section.card
    thickness = card.number(card.rows[0], 0, "thickness", 1.0)
    if thickness <= 0.0:
        raise card.error(f"the thickness {thickness:g} is > 0", card.rows[0].where)
    return thickness
