"""The assembled problem: all parts and interfaces of a scene."""

from __future__ import annotations

from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from dolfinx_frontend.assembly.held_nodes import Held
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.part_loads import PartLoad
from dolfinx_frontend.assembly.ranks import Distribution, PartSummary, agreement, check_alike, exchanged
from dolfinx_frontend.assembly.spread import Condensed
from dolfinx_frontend.assembly.stretch import Stretch, check_alone, stretch_of, with_cells
from dolfinx_frontend.assembly.substructure import Substructure, summary
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import (
    check_kind,
    check_known,
    check_optional_kind,
    checked_number,
    is_real,
)
from dolfinx_frontend.common.describe import columns, short
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.frozen import OneProcess, ReadOnlyDict, locked
from dolfinx_frontend.common.html import Shown
from dolfinx_frontend.scene.amplitudes import Amplitude, Varying, amplitudes_of
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.loads import LoadTerm, Term
from dolfinx_frontend.scene.values import is_plain, is_random_field, is_uncertain

__all__ = ["Problem", "check_is_problem"]

_COVERED = 0.99
"""Fraction of a face from which on it counts as covered: the rims of round faces are chords."""

T = TypeVar("T")


def _may_hold_less(new: Law, old: Law, dim: int) -> bool:
    """Whether a law may leave a motion free that the other one holds; fields may be 0 at some points."""
    if new is old:
        return False
    holds = zip(new.nominal.holds(dim), old.nominal.holds(dim), strict=True)
    plain = all(is_plain(value) or is_uncertain(value) for value in new.parameters().values())
    return not plain or new.elimination is not old.elimination or any(b and not a for a, b in holds)


@dataclass(frozen=True)
class Problem(Shown, OneProcess):
    """An assembled scene.

    On several ranks `substructures` has those of this rank, and `interfaces` all of the scene, of
    which those that touch no part of this rank have no traces here. `held` is what else holds the nodes of a
    side of an interface. `spread` has the parts whose mesh is on all ranks, see :class:`Condensed`.
    `centres` are those of supports, loads and parts. `loosened`: laws were replaced by others that may hold
    less, so that parts may be free.
    """

    substructures: dict[str, Substructure]
    interfaces: dict[str, Interface]
    distribution: Distribution | None = field(default=None, repr=False)
    loads: dict[str, PartLoad] = field(default_factory=dict)
    held: dict[tuple[str, int], Held] = field(default_factory=dict, repr=False)
    spread: dict[str, Condensed] = field(default_factory=dict, repr=False)
    loosened: bool = field(default=False, repr=False)
    centres: tuple[Array, ...] = field(default=(), repr=False)
    # functions of what stands above, which solving.py makes methods
    export: ClassVar[Callable[..., Path]]
    function: ClassVar[Callable[..., Any]]

    def __post_init__(self) -> None:
        locked(self)

    @property
    def _instead(self) -> str:
        return "its meshes and function spaces live in this process; assemble its scene where it is needed"

    @cached_property
    def parts(self) -> Mapping[str, PartSummary]:
        """What every rank knows of all parts."""
        if self.distribution is not None:
            return self.distribution.parts
        return ReadOnlyDict({name: summary(s) for name, s in self.substructures.items()})

    @cached_property
    def modulus(self) -> float:
        """E of the scene: geometric mean of the moduli of all parts."""
        return float(np.exp(np.mean([np.log(part.modulus) for part in self.parts.values()])))

    @cached_property
    def length(self) -> float:
        """L of the scene: (sum of volumes)^(1/d) of all parts."""
        return float(sum(part.length**self.dim for part in self.parts.values()) ** (1.0 / self.dim))

    @cached_property
    def own(self) -> Problem:
        """What of the problem is on this rank, without the rest."""
        if self.distribution is None:
            return self
        here = {
            name: i
            for name, i in self.interfaces.items()
            if any(side.substructure in self.substructures for side in i.sides)
        }
        return Problem(self.substructures, here, self.distribution, dict(self.loads), spread=self.spread)

    @property
    def comm(self) -> Any:
        """mpi4py communicator of the ranks that share the problem; None: there is one."""
        return None if self.distribution is None else self.distribution.comm

    def speaks_for(self, name: str) -> bool:
        """Whether this rank has the first side of an interface: one rank has."""
        return self.interfaces[name].sides[0].substructure in self.substructures

    @cached_property
    def owner(self) -> Mapping[str, int]:
        """Part -> the rank that it belongs to; 0 where there is one rank."""
        spread = self.distribution
        return ReadOnlyDict({name: 0 if spread is None else spread.owner[name] for name in self.parts})

    @property
    def rank(self) -> int:
        """This rank; 0 where there is one."""
        return 0 if self.distribution is None else self.distribution.rank

    def gather(self, own: Mapping[str, T], parts: bool = False) -> dict[str, T]:
        """What the ranks know of interfaces, or of parts, put together, in the scene's order; collective."""
        known = dict(own)
        if self.comm is not None:
            known = {n: each for found in exchanged(self.comm, known) for n, each in found.items()}
        return {name: known[name] for name in (self.parts if parts else self.interfaces) if name in known}

    def everywhere(self, name: str, read: Callable[[], T]) -> T:
        """What the rank of an interface's first side reads, on all ranks; collective."""
        if self.distribution is None:
            return read()
        comm = self.distribution.comm
        if name not in self.interfaces:
            with agreement(comm, f"interface {name!r}"):
                return read()
        first = self.distribution.owner[self.interfaces[name].sides[0].substructure]
        found: list[T] = []
        with agreement(comm, f"interface {name!r}"):
            if self.rank == first:
                found.append(read())
        shared: list[T] = comm.bcast(found, root=first)
        return shared[0]

    def check_alike(self, call: str, laws: bool = False, **given: object) -> None:
        """Raise SceneError on all ranks unless all make the same call with the same arguments; collective.

        Parameters
        ----------
        laws
            Compare the laws of all interfaces, too.
        """
        with agreement(self.comm):
            self.check_unchanged()
        if self.comm is None:
            return
        of_laws: dict[str, object] = {}
        if laws:
            of_laws = {f"the law of interface {n!r}": i.law for n, i in self.interfaces.items()}
            of_laws |= {f"the values of load {n!r}": each.load.values for n, each in self.loads.items()}
        check_alike(self.comm, call, given | of_laws)

    def check_unchanged(self) -> None:
        """Raise SceneError if somebody has written to a matrix of this rank."""
        for part in self.substructures.values():
            part.check_unchanged()
        for interface in self.interfaces.values():
            interface.check_unchanged()

    def check_here(self, part: str) -> None:
        """Raise SceneError if a part of the scene is on another rank, and say on which."""
        if self.distribution is not None and self.distribution.owner.get(part, self.rank) != self.rank:
            raise SceneError(
                f"substructure {part!r} is on rank {self.distribution.owner[part]}, this is rank "
                f"{self.rank}: ask there"
            )

    def check_sources(self, part: str | None = None) -> None:
        """Raise SceneError if the mesh, the material or a load of a part (None: of any of this rank) was
        changed, see :meth:`Substructure.check_sources`."""
        for each in self.substructures.values() if part is None else [self.substructures[part]]:
            each.check_sources()
        for load in self.loads.values():
            if part in (None, load.load.part):
                load.check_sources()

    def check_mesh(self, part: str | None = None) -> None:
        """As :meth:`check_sources`, of the mesh only."""
        for each in self.substructures.values() if part is None else [self.substructures[part]]:
            each.check_mesh()

    def here(self, name: str) -> Interface:
        """An interface that touches this rank.

        Raises
        ------
        SceneError
            It touches other ranks only.
        """
        interface = self.interfaces[name]
        if self.distribution is not None and name not in self.own.interfaces:
            ranks = self.distribution.ranks([side.substructure for side in interface.sides])
            raise SceneError(
                f"interface {name!r} is on rank {' and '.join(map(str, ranks))}, this is rank "
                f"{self.distribution.rank}: ask there, or all ranks together for gathered(...)"
            )
        return interface

    @cached_property
    def cuts(self) -> tuple[str, ...]:
        """Interfaces whose sides lie on two ranks."""
        if self.distribution is None:
            return ()
        return tuple(
            name
            for name, i in self.interfaces.items()
            if len(self.distribution.ranks([s.substructure for s in i.sides])) == 2
        )

    @property
    def dim(self) -> int:
        """Space dimension d."""
        return next(iter(self.parts.values())).dim

    @property
    def size(self) -> int:
        """Number of unknowns of all substructures."""
        return sum(s.size for s in self.parts.values())

    @cached_property
    def unknowns(self) -> Mapping[str, int]:
        """Part -> number of its unknowns; where its mesh is spread over the ranks also those that are
        eliminated."""
        found = {name: part.size for name, part in self.parts.items()}
        return ReadOnlyDict(found | {name: whole.unknowns for name, whole in self.spread.items()})

    @property
    def load_amplitudes(self) -> tuple[Amplitude, ...]:
        """Amplitudes of all body forces and loads of parts."""
        of_loads = (t.amplitude for t in self.load_terms)
        if self.distribution is not None:
            of_parts = self.distribution.load_amplitudes
        else:
            of_parts = tuple(a for s in self.substructures.values() for a in s.varying_loads)
        return (*of_parts, *(a for a in of_loads if a is not None))

    @cached_property
    def load_terms(self) -> tuple[LoadTerm, ...]:
        """The numbers of all loads of parts with their amplitudes."""
        return tuple(term for each in self.loads.values() for term in each.keys())

    @property
    def has_constant_loads(self) -> bool:
        """Whether a part has loads that are constant in time."""
        of_loads = any(None in each.load.amplitudes for each in self.loads.values())
        return of_loads or any(part.loaded for part in self.parts.values())

    def load_on(
        self, part: str, amplitude: Amplitude | None = None, without: Container[LoadTerm] = ()
    ) -> Array:
        """What one amplitude multiplies of the forces inside a part (n,), random ones at their means.

        Parameters
        ----------
        amplitude
            None: the part that is constant in time.
        without
            Numbers of loads that are left out.
        """
        total = self.substructures[part].load_of(amplitude).copy()
        for each in self.loads.values():
            for term in each.keys():
                nodal = each.on(part, term.parameter)
                if nodal is not None and term.amplitude == amplitude and term not in without:
                    total += each.mean(term.parameter, amplitude) * nodal
        return total

    @cached_property
    def factors(self) -> Mapping[str, Any]:
        """Part -> random number, with the mean 1, that its stiffness is multiplied with."""
        return ReadOnlyDict({n: s.factor for n, s in self.parts.items() if is_uncertain(s.factor)})

    @cached_property
    def fields(self) -> Mapping[str, Any]:
        """Part -> random field, with the mean 1, that its stiffness is multiplied with."""
        found = {n: s.factor for n, s in self.parts.items() if is_random_field(s.factor)}
        check_alone(list(found.items()))
        return ReadOnlyDict(found)

    @cached_property
    def _stretches(self) -> dict[str, Stretch]:
        return {}

    def stretch(self, part: str) -> Stretch:
        """The stiffness of a part cell by cell, made when it is first asked for."""
        if part not in self._stretches:
            self._stretches[part] = stretch_of(self.substructures[part])
        return self._stretches[part]

    def told(self, stretches: Mapping[str, Stretch]) -> None:
        """Keep what another rank has made of its parts for :meth:`stretch`."""
        self._stretches.update(stretches)

    def cells_of(self, part: str) -> tuple[Array, Array, int]:
        """Midpoints and volumes of the cells of a part with a random field, and their dimension."""
        cells = self.parts[part].cells
        if cells is not None:
            return cells
        stretch = self.stretch(part)
        return stretch.points, stretch.weights, stretch.dimension

    def initial_stretch(
        self, part: str, amplitude: Amplitude | None = None, without: Container[LoadTerm] = ()
    ) -> Array:
        """g (rows,) with :meth:`stiffness_load_on` = B^T g, see :class:`Stretch`."""
        stretch = self.stretch(part)
        total: Array = np.zeros(stretch.matrix.shape[0])
        for each in self.loads.values():
            for term in each.keys():
                if term.parameter not in each.stresses or each.load.part != part:
                    continue
                if term.amplitude == amplitude and term not in without:
                    own = stretch.initial(self.substructures[part], each.stresses[term.parameter])
                    total += each.mean(term.parameter, amplitude) * own
        return total

    def stiffness_load_on(
        self, part: str, amplitude: Amplitude | None = None, without: Container[LoadTerm] = ()
    ) -> Array:
        """Of :meth:`load_on` what comes from the stiffness of the part: loads of initial strains."""
        total: Array = np.zeros(self.substructures[part].size)
        for each in self.loads.values():
            for term in each.keys():
                nodal = each.on(part, term.parameter) if term.parameter in each.stresses else None
                if nodal is not None and term.amplitude == amplitude and term not in without:
                    total += each.mean(term.parameter, amplitude) * nodal
        return total

    def initial_stresses(self, part: str) -> list[tuple[str, str, Any]]:
        """Load, its parameter, and the initial stress (UFL) of the number 1, of all that act in a part."""
        return [
            (name, parameter, stress)
            for name, each in self.loads.items()
            if each.load.part == part
            for parameter, stress in each.stresses.items()
        ]

    def numbers_of(self, term: LoadTerm) -> list[Term]:
        """What the amplitude of a term multiplies: summands of its number."""
        every = self.loads[term.load].load.terms(term.parameter)
        return [each for each in every if each.amplitude == term.amplitude]

    @property
    def amplitudes(self) -> tuple[Amplitude, ...]:
        """The different amplitudes of all values that change in time."""
        varying = [v for i in self.interfaces.values() for v in i.law.varying.values()]
        bodies = [Varying(((a, 0.0),)) for a in self.load_amplitudes]
        return tuple(amplitudes_of([*varying, *bodies]))

    def at(self, time: float) -> Problem:
        """The problem at one time of a load history: nothing in it changes any more."""
        checked_number("Problem.at", "time", time)
        if not self.amplitudes:
            return self
        return Problem(
            {
                name: replace(
                    s,
                    load=s.load + sum(a(time) * f for a, f in s.varying_loads.items()),
                    varying_loads={},
                )
                for name, s in self.substructures.items()
            },
            {name: replace(i, law=i.law.at(time)) for name, i in self.interfaces.items()},
            self.distribution,
            {name: each.at(time) for name, each in self.loads.items()},
            spread={name: each.at(time) for name, each in self.spread.items()},
        )

    @property
    def interface_points(self) -> dict[str, Array]:
        """Interface name -> points (m, d)."""
        return {name: i.points for name, i in self.interfaces.items()}

    @property
    def law_parameters(self) -> dict[str, Any]:
        """Parameters of all laws, ``"joint.normal"`` -> value."""
        return {
            f"{name}.{key}": value
            for name, i in self.interfaces.items()
            for key, value in i.law.parameters().items()
        }

    @property
    def part_parameters(self) -> dict[str, Any]:
        """What can be swept of parts: ``"bar.E"``, the nominal modulus, and ``"bar.stiffness"``, a factor."""
        found: dict[str, Any] = {}
        for name, part in self.parts.items():
            if part.E is not None:
                found[f"{name}.E"] = part.E
            found[f"{name}.stiffness"] = 1.0
        return {key: value for key, value in found.items() if key not in self.law_parameters}

    @property
    def load_parameters(self) -> dict[str, Any]:
        """Numbers of all loads of parts, ``"heat.dT"`` -> value."""
        return {
            f"{name}.{key}": value
            for name, each in self.loads.items()
            for key, value in each.load.values.items()
        }

    def laws(
        self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None
    ) -> dict[str, Law]:
        """The laws of all interfaces with some of them replaced.

        Parameters
        ----------
        laws
            Interface name -> law.
        values
            Parameter name -> value, e.g. ``{"joint.normal": 120.0}``.

        Raises
        ------
        SceneError
            Unknown interface or parameter.
        """
        out = {name: i.law for name, i in self.interfaces.items()}
        check_optional_kind("laws", "laws", laws, Mapping, "give {interface: law}")
        check_optional_kind("laws", "values", values, Mapping, "give {'interface.parameter': value}")
        for name, law in (laws or {}).items():
            check_known("interface", name, out)
            check_kind(f"interface {name!r}", "law", law, Law, "give a law, e.g. Perfect()")
            out[name] = law
        for key, value in (values or {}).items():
            known = [f"{name}.{each}" for name, law in out.items() for each in law.parameters()]
            check_known("parameter", key, [*known, *self.load_parameters])
            if key in self.load_parameters:
                raise SceneError(
                    f"{key!r} is of a load, not of a law: problem.with_laws(values=...) takes it"
                )
            name, _, parameter = key.rpartition(".")
            out[name] = out[name].with_(**{parameter: value})
        return out

    def with_laws(self, laws: dict[str, Law] | None = None, values: dict[str, Any] | None = None) -> Problem:
        """The same parts and interfaces with some laws replaced; nothing is assembled again.

        Parameters
        ----------
        laws, values
            As for :meth:`laws`; values of loads of parts, too (``{"heat.dT": 80.0}``), and of their moduli,
            which may be random numbers or fields (``{"bar.E": 190e3}``).
        """
        of_loads = self.load_parameters
        here: dict[str, dict[str, Any]] = {}
        rest = None
        if isinstance(values, Mapping):
            rest = {key: value for key, value in values.items() if key not in of_loads}
            for key in values.keys() & of_loads.keys():
                name, _, parameter = key.rpartition(".")
                here.setdefault(name, {})[parameter] = values[key]
        if rest is not None:
            moduli = {key: rest.pop(key) for key in list(rest) if key in self.part_parameters}
            if moduli:
                return self._with_moduli(moduli).with_laws(laws, {**rest, **_of(values, of_loads)})
        new = self.laws(laws, values if rest is None else rest)
        interfaces = {name: replace(i, law=new[name]) for name, i in self.interfaces.items()}
        loads = {n: each.with_values(here.get(n, {})) for n, each in self.loads.items()}
        loosened = any(_may_hold_less(new[n], i.law, self.dim) for n, i in self.interfaces.items())
        return replace(self, interfaces=interfaces, loads=loads, loosened=self.loosened or loosened)

    def _with_moduli(self, values: Mapping[str, Any]) -> Problem:
        """The same with other moduli of parts: their matrices, and what comes from them, are scaled.

        Collective where a field is new to a part: all ranks are told its cells.
        """
        parts, loads, summaries = dict(self.substructures), dict(self.loads), dict(self.parts)
        whole = dict(self.spread)
        for key, value in values.items():
            name, _, what = key.rpartition(".")
            random = is_uncertain(value) or is_random_field(value)
            mean = value.mean if random else value
            if not random and not is_real(value):
                raise SceneError(
                    f"with_laws: {key} = {short(value)}; give a number, a random number or a field"
                )
            if what == "stiffness" and not (random and abs(mean - 1.0) < 1e-9) and mean != 1.0:
                raise SceneError(
                    f"with_laws: {key} = {short(value)} has the mean {mean:g}; a factor has the mean 1: "
                    f"change {name}.E, or the material"
                )
            if not mean > 0.0:
                raise SceneError(f"with_laws: {key} = {short(value)}; a stiffness is positive")
            known = summaries[name]
            if what == "stiffness":
                summaries[name] = replace(known, factor=value)
                if name in parts:
                    parts[name] = replace(parts[name], factor=value)
                continue
            factor: Any = 1.0
            if random:
                factor = value.relative if is_random_field(value) else value / mean
            assert known.E is not None
            ratio = float(mean) / known.E
            summaries[name] = replace(known, E=float(mean), modulus=ratio * known.modulus, factor=factor)
            loads = {n: each.strained(name, ratio) for n, each in loads.items()}
            if name in whole:
                whole[name] = whole[name].stretched(replace(whole[name].material, E=float(mean)), ratio)
            if name not in parts:
                continue
            part = parts[name]
            matrix = part.stiffness.copy()
            matrix.scale(ratio)
            parts[name] = replace(
                part,
                stiffness=matrix,
                material=replace(part.material, E=float(mean)),
                modulus=ratio * part.modulus,
                factor=factor,
            )
        spread = self.distribution
        if spread is not None:
            spread = replace(spread, parts=with_cells(spread.comm, summaries, parts))
        return replace(self, substructures=parts, loads=loads, distribution=spread, spread=whole)

    def __repr__(self) -> str:
        lines = [
            f"Problem: {self.size} unknowns in {len(self.parts)} substructures, "
            f"{len(self.interfaces)} interfaces, {self.dim}D",
        ]
        rows = [("substructure", "unknowns", "volume", "modulus", "length")]
        for name, s in self.parts.items():
            rows.append((name, str(s.size), f"{s.volume:.4g}", f"{s.modulus:.4g}", f"{s.length:.4g}"))
        lines += [f"  {line}" for line in columns(rows, "<>>>>")]
        rows = [("interface", "law", "points", "area", "sides")]
        for i in self.interfaces.values():
            sides = " | ".join(f"{s.substructure}:{s.face}" for s in i.sides)
            if len(i.sides) == 2:
                meshes = "matching" if i.matching is not None else "non-matching"
                share = "" if i.covered > _COVERED else f", {100 * i.covered:.3g} % of the first covered"
                fit = ", no gap as meshed" if i.law.unilateral and i.fits and i.gap.any() else ""
                sides += f" ({meshes}{share}{fit})"
            rows.append((i.name, i.law.title, str(i.num_points), f"{i.area:.4g}", sides))
        lines += [f"  {line}" for line in columns(rows, "<<>><")]
        if self.loads:
            table = [("load", "part", "values")]
            for name, each in self.loads.items():
                given = ", ".join(f"{k} = {short(v)}" for k, v in each.load.values.items())
                table.append((name, each.load.part, given))
            lines += [f"  {line}" for line in columns(table, "<<<")]
        return "\n".join(lines)


def _of(values: Mapping[str, Any] | None, known: Container[str]) -> dict[str, Any]:
    return {key: value for key, value in (values or {}).items() if key in known}


def check_is_problem(where: str, problem: object) -> None:
    """Refuse what is no problem, for example a scene that was not assembled.

    Raises
    ------
    SceneError
        Where it was given, and what to do.
    """
    check_kind(where, "problem", problem, Problem, "assemble the scene first: problem = assemble(scene)")
    if isinstance(problem, Problem) and problem.comm is None:  # several ranks: with what they compare
        problem.check_unchanged()
