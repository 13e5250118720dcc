"""Pressure of gaskets around their ring."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import checked_number
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.results.answer import Answer, Block, Surface, stepped
from dolfinx_frontend.sheets.clamping import normal_of
from dolfinx_frontend.sheets.names import by_pattern

__all__ = ["Seal", "SealNumbers", "seal_margin_in", "seal_numbers", "seals_of"]

ANGLES = 72
"""Places around a ring."""
SAME = 1e-6
"""Differences of pressures below this, relative to the largest, are rounding."""


@dataclass(frozen=True)
class Seal:
    """A gasket: an interface that has to be pressed.

    Attributes
    ----------
    assembly, service
        Pressure that it needs: Q_min(L) when it is tightened, Q_Smin(L) in service; None: it is not known.
    angles
        (K,), degrees; one place where it is no ring.
    windows
        (K, m), means over the width and an arc around each of them.
    """

    name: str
    assembly: float | None
    service: float | None
    angles: Array
    windows: Array


@dataclass(frozen=True)
class SealNumbers:
    """Numbers of a gasket.

    Attributes
    ----------
    values
        Key of :data:`dolfinx_frontend.sheets.names.SEAL` -> (N,).
    around
        Stage -> (N, K), pressure around the ring.
    where
        Key -> angle in degrees of the lowest pressure, of the mean over the samples.
    """

    values: dict[str, Array]
    around: dict[str, Array]
    where: dict[str, float]


def seals_of(answer: Answer, given: Any, arc: float) -> list[Seal]:
    """The gaskets that are named, with the pressures that they need.

    Raises
    ------
    SceneError
        No such interface, its force is not known, or a pressure that is none.
    """
    if given is None:
        return []
    if isinstance(given, str) or not isinstance(given, Mapping):
        raise SceneError("report: give seals as {interface: pressure that it needs, or None}")
    found = []
    for name, needs in by_pattern("report", "seals", given, list(answer.problem.interfaces)).items():
        where = f"report, seals: {name!r}"
        if name not in answer.known:
            raise SceneError(f"{where}: its pressure is not known: solve with active=[{name!r}]")
        pair = needs if isinstance(needs, (tuple, list)) else (None, needs)
        if len(pair) != 2:
            raise SceneError(f"{where}: give the pressure in service, or those at assembly and in service")
        assembly, service = (
            None if p is None else checked_number(where, "pressure", p, above=0.0) for p in pair
        )
        surface = answer.surface(name)
        if surface.wrench is not None:
            raise SceneError(f"{where}: it joins mean motions of faces and has no pressure")
        found.append(Seal(name, assembly, service, *_windows(surface, arc)))
    return found


def _windows(surface: Surface, arc: float) -> tuple[Array, Array]:
    """Angles (K,) in degrees and means (K, m); the weight falls as 1 + cos to the ends of an arc."""
    points, weights = surface.points, surface.weights
    whole = np.zeros(1), (weights / weights.sum())[None]
    if surface.dim < 3:
        return whole
    normal = normal_of(surface)
    if not normal.any():
        return whole
    first = np.eye(3)[int(np.argmin(np.round(np.abs(normal), 6)))]
    first = first - (first @ normal) * normal
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    if second[np.abs(second).argmax()] < 0.0:
        second = -second
    away = points - surface.centre
    at = np.arctan2(away @ second, away @ first)
    angles = np.linspace(0.0, 2.0 * np.pi, ANGLES, endpoint=False)
    apart = np.abs((angles[:, None] - at + np.pi) % (2.0 * np.pi) - np.pi)
    half = np.pi * arc
    windows = np.where(apart < half, 1.0 + np.cos(np.pi * apart / half), 0.0) * weights
    total = windows.sum(axis=1)
    if total.min() <= 1e-6 * total.max():  # no ring: places without points
        return whole
    return np.degrees(angles), windows / total[:, None]


def around_in(answer: Answer, block: Block, seal: Seal) -> tuple[Array, Array]:
    """Pressure (n, T, K) around the ring, and the force (n, T), in the samples of a block."""
    surface = answer.surface(seal.name)
    force = stepped(block.force(seal.name), answer.times, 1)
    pressure = -np.einsum("ntpd,pd->ntp", surface.vectors(force), surface.normals)
    return np.asarray(pressure @ seal.windows.T), np.asarray(pressure @ surface.weights)


def _first_of_service(steps: int, last: int | None) -> int:
    """The step after the last bolt was tightened; where there is none, the last one."""
    return steps - 1 if last is None or last + 1 == steps else last + 1


def seal_numbers(
    answer: Answer, seal: Seal, last: int | None, samples: int | None, seed: int
) -> SealNumbers:
    """Numbers of a gasket; `last` is the step at which all is tightened, None: there is no history."""
    parts = [around_in(answer, block, seal) for block in answer.blocks(samples, seed)]
    around, force = (np.concatenate([each[k] for each in parts]) for k in (0, 1))
    area = float(answer.surface(seal.name).weights.sum())
    first = _first_of_service(around.shape[1], last)
    served = around[:, first:]
    least = force[:, first:].min(axis=1)
    values = {"Q_S": served.min(axis=(1, 2)), "Q_S mean": least / area}
    values |= {"Q_S max": around[:, last or 0 :].max(axis=(1, 2)), "F_G": least}
    shown = {"now": served[:, -1]}
    where = {"Q_S": _lowest(served, seal)}
    if last is not None:
        tightened = around[:, last]
        values["Q_A"], where["Q_A"] = tightened.min(axis=1), _lowest(tightened[:, None], seal)
        shown = {"tightened": tightened} | ({"at the end": served[:, -1]} if first > last else {})
        if seal.assembly is not None:
            values["m_A"] = values["Q_A"] / seal.assembly - 1.0
    if seal.service is not None:
        values["m_L"] = values["Q_S"] / seal.service - 1.0
    return SealNumbers(values, shown, where)


def _lowest(around: Array, seal: Seal) -> float:
    """Angle of the lowest pressure, of the mean over the samples of (N, T, K); NaN: it is all the same."""
    mean = around.mean(axis=0)
    if np.ptp(mean, axis=1).max() <= SAME * np.abs(mean).max():
        return float("nan")
    return float(seal.angles[np.unravel_index(mean.argmin(), mean.shape)[1]])


def seal_margin_in(answer: Answer, block: Block, seal: Seal, last: int | None) -> Array:
    """The margin in service (n,) in the samples of a block."""
    around, _ = around_in(answer, block, seal)
    assert seal.service is not None
    served = around[:, _first_of_service(around.shape[1], last) :]
    return np.asarray(served.min(axis=(1, 2)) / seal.service - 1.0)
