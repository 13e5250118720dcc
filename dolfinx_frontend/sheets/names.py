"""What the answer sheet shows: numbers of bolts and gaskets, by the symbols of VDI 2230 and EN 1591."""

from __future__ import annotations

from collections.abc import Mapping
from fnmatch import fnmatchcase
from typing import Any, NamedTuple

from dolfinx_frontend.common.checks import check_kind
from dolfinx_frontend.common.errors import SceneError, unknown_name

__all__ = ["BOLT", "MARGINS", "SEAL", "Name", "by_pattern", "units_of"]

_LENGTHS, _FORCES = ("m", "cm", "mm", "in", "ft"), ("N", "kN", "MN", "lbf", "kgf")
"""Of which one in the other's place is an error."""


class Name(NamedTuple):
    """One kind of number.

    Attributes
    ----------
    symbol
        What follows ``_`` is an index.
    of
        ``"force"``, ``"stress"`` or ``""`` (a ratio).
    says
        In words.
    """

    symbol: str
    of: str
    says: str


BOLT: Mapping[str, Name] = {
    "margin": Name("m", "", "least margin of the bolt: the smaller of m_K and m_G"),
    "m_K": Name("m_K", "", "margin against opening: F_KR / F_KV; 1 as tightened, 0 open"),
    "m_G": Name("m_G", "", "margin against slip; 1 as tightened without shear, 0 slips as a whole"),
    "F_M": Name("F_M", "force", "assembly preload: when this bolt itself was tightened last"),
    "F_V": Name("F_V", "force", "preload: after the last bolt was tightened"),
    "kept": Name("F_V/F_M", "", "what the tightening of the others left of the assembly preload"),
    "F_S": Name("F_S", "force", "bolt force at the end"),
    "F_S min": Name("F_S min", "force", "lowest bolt force after tightening"),
    "F_S max": Name("F_S max", "force", "highest bolt force after tightening"),
    "F_SA": Name("F_SA", "force", "additional bolt force: the largest change of F_S from F_V, with its sign"),
    "F_A": Name("F_A", "force", "axial load on bolt and joint: what F_S gains and F_K loses, the largest"),
    "Phi": Name("Φ", "", "load factor: the share of F_A that the bolt takes, F_SA / F_A"),
    "F_KV": Name("F_KV", "force", "clamping force of the joint when all is tightened"),
    "F_KR": Name("F_KR", "force", "residual clamping force of the joint: the lowest"),
    "F_Q": Name("F_Q", "force", "shear force of the joint: the largest"),
    "S_G": Name("S_G", "", "safety against slip: friction over shear, the lowest"),
    "open": Name("A_o/A", "", "share of the joint without pressure: the largest"),
    "sigma_a": Name("σ_a", "stress", "stress amplitude, axial: (F_S max - F_S min) / (2 A_S)"),
    "sigma_ab": Name("σ_ab", "stress", "stress amplitude of bending: half the largest change of M_b / W"),
}

SEAL: Mapping[str, Name] = {
    "m_L": Name("m_L", "", "margin of the gasket in service: Q_S / Q_Smin(L) - 1; below 0 it leaks"),
    "m_A": Name("m_A", "", "margin of the gasket at assembly: Q_A / Q_min(L) - 1"),
    "Q_A": Name("Q_A", "stress", "lowest pressure around the ring when all is tightened"),
    "Q_S": Name("Q_S", "stress", "lowest pressure around the ring in service"),
    "Q_S mean": Name("Q_S mean", "stress", "mean pressure in service, at the step where it is lowest"),
    "Q_S max": Name("Q_S max", "stress", "highest pressure around the ring"),
    "F_G": Name("F_G", "force", "lowest force of the gasket"),
}

MARGINS = ("margin", "m_K", "m_G", "m_L", "m_A")
"""Numbers that must not fall to 0."""


def by_pattern(where: str, what: str, given: Any, names: list[str]) -> dict[str, Any]:
    """Values of some of the names: one for all, or by name or pattern (``"stud *"``), the first that fits.

    Raises
    ------
    SceneError
        A name or pattern that fits nothing.
    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        return dict.fromkeys(names, given)
    found: dict[str, Any] = {}
    for pattern, value in given.items():
        check_kind(where, what, pattern, str, "its keys are names or patterns")
        fits = [n for n in names if n == pattern] or [n for n in names if fnmatchcase(n, pattern)]
        if not fits:
            raise unknown_name(f"name or pattern of {what}", pattern, names, where)
        for name in fits:
            found.setdefault(name, value)
    return found


def units_of(units: Any) -> dict[str, str]:
    """Units by kind of number, from those of length and force; None: none are shown."""
    if units is None:
        return {"force": "", "stress": "", "length": "", "": ""}
    named = isinstance(units, (tuple, list)) and len(units) == 2
    if not named or not all(isinstance(u, str) and u.strip() for u in units):
        raise SceneError(f"report: units = {units!r}; give those of length and force, as ('mm', 'N')")
    length, force = (u.strip() for u in units)
    if force in _LENGTHS or length in _FORCES:
        raise SceneError(f"report: units = {units!r}: length comes first, then force, as ('mm', 'N')")
    known = {("mm", "N"): "MPa", ("m", "N"): "Pa", ("m", "kN"): "kPa", ("m", "MN"): "MPa"}
    stress = known.get((length, force), f"{force}/{length}²")
    return {"force": force, "stress": stress, "length": length, "": ""}
