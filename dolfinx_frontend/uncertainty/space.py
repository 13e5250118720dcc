"""The space that the random parameters and fields of a scene span."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np
import numpy.typing as npt
from latin_core import stochastic as core
from latin_core.stochastic import ChaosBasis, Germ, MultiIndexSet, Rule

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_known, checked_numbers, checked_seed, checked_whole, is_list
from dolfinx_frontend.common.deferred import linalg, sp, special, stats
from dolfinx_frontend.common.describe import short
from dolfinx_frontend.common.errors import MemoryLimitError, SceneError
from dolfinx_frontend.common.frozen import ReadOnlyDict
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.checks import common_length
from dolfinx_frontend.uncertainty.correlated import CorrelatedParameter
from dolfinx_frontend.uncertainty.expressions import Expression
from dolfinx_frontend.uncertainty.fields import DiscretisedField
from dolfinx_frontend.uncertainty.parameters import RandomParameter

__all__ = ["Expansion", "RandomSpace", "Sobol"]


_MOST_POINTS = 4_000_000
"""Points of such a rule at most."""

_MORE_POINTS = 12
"""Gauss points of a germ beyond the degree on which a function of other parameters is projected."""


class Expansion(NamedTuple):
    """A random quantity in its own chaos."""

    coefficients: Array  # (rows, n): one row, or one per interface point
    indices: MultiIndexSet  # n multi-indices in the germs of the space


def latin_points(dimension: int, count: int, generator: np.random.Generator) -> Array:
    """Points (count, dimension) in the unit cube, one in each of `count` layers in every direction."""
    try:
        engine = stats.qmc.LatinHypercube(dimension, rng=generator)
    except TypeError:  # the name of the argument before scipy 1.15
        engine = stats.qmc.LatinHypercube(dimension, seed=generator)
    return np.asarray(engine.random(count))


def sobol_points(dimension: int, count: int, generator: np.random.Generator) -> Array:
    """Scrambled Sobol points (count, dimension) in the unit cube; count is a power of two.

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C while scipy loaded its tables: it swallows that, and all points would be the same.
    """
    try:
        engine = stats.qmc.Sobol(dimension, scramble=True, rng=generator)
    except TypeError:  # the name of the argument before scipy 1.15
        engine = stats.qmc.Sobol(dimension, scramble=True, seed=generator)
    points: Array = engine.random_base2(count.bit_length() - 1)
    if count > 1 and np.all(points == points[0]):
        raise KeyboardInterrupt
    return points


class Sobol(NamedTuple):
    """Sobol indices of a random source; NaN in rows without variance."""

    first: Array  # (rows,) variance due to it alone
    total: Array  # (rows,) variance in which it takes part


@dataclass(frozen=True)
class _Block:
    """Germs that belong together: an independent parameter, a correlated group, or a field."""

    name: str
    columns: tuple[int, ...]
    members: tuple[RandomParameter, ...]
    field: DiscretisedField | None
    mixing: Array  # (members, germs) lower triangular: normal scores = mixing @ germs


Source: TypeAlias = RandomParameter | DiscretisedField | Expression


def _machine_memory() -> float:
    try:
        return float(os.sysconf("SC_PHYS_PAGES")) * float(os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError):  # not known here: no limit
        return 0.0


class RandomSpace:
    """All random variables (germs) of a scene, in the order in which their parameters first occur.

    Parameters
    ----------
    sources
        Random parameters and discretised fields, repeated as often as they are used. Of a
        correlated group only the members that occur are included; they share their germs.

    Attributes
    ----------
    names
        Names of the parameters and fields.
    germs, germ_names
        (L,) independent variables, and their names.
    groups
        Name of each independent source (``"a+b"`` for a correlated group) -> its germ numbers.

    Raises
    ------
    SceneError
        One name with two definitions.
    """

    def __init__(self, sources: Iterable[Source]) -> None:
        seen: dict[str, RandomParameter | DiscretisedField] = {}
        given = list(sources)
        alone: list[RandomParameter | DiscretisedField] = [
            each for s in given for each in (s.leaves.values() if isinstance(s, Expression) else (s,))
        ]
        for single in alone:
            if not isinstance(single, (RandomParameter, DiscretisedField)):
                raise SceneError(
                    f"{single!r} of type {type(single).__name__} is not a random parameter; a "
                    "RandomField must be put on its points first"
                )
            other = seen.setdefault(single.name, single)
            same = other is single or other == single
            if not same:
                raise SceneError(
                    f"random parameter {single.name!r} has two definitions: {other!r} and "
                    f"{single!r}; give them different names, or use one object in both places"
                )
        self._sources = seen
        self.names = tuple(seen)
        blocks: list[_Block] = []
        germs: list[Germ] = []
        germ_names: list[str] = []

        def add(
            name: str,
            new: Sequence[tuple[Germ, str]],
            members: Sequence[RandomParameter],
            field: DiscretisedField | None,
            mixing: Array,
        ) -> None:
            columns = tuple(range(len(germs), len(germs) + len(new)))
            blocks.append(_Block(name, columns, tuple(members), field, mixing))
            germs.extend(germ for germ, _ in new)
            germ_names.extend(label for _, label in new)

        done: set[Any] = set()
        for name, source in seen.items():
            if isinstance(source, DiscretisedField):
                count = len(source.eigenvalues)
                new = [(Germ.hermite(), f"{name}[{i}]") for i in range(count)]
                add(name, new, (), source, np.eye(count))
            elif isinstance(source, CorrelatedParameter):
                key = source.group._definition
                if key in done:
                    continue
                done.add(key)
                members = [m for m in source.group if seen.get(m.name) == m]
                rows = [m.position for m in members]
                mixing = linalg.cholesky(
                    source.group.normal_correlation[np.ix_(rows, rows)], lower=True
                )
                label = "+".join(m.name for m in members)
                new = [(Germ.hermite(), f"{label}[{i}]") for i in range(len(members))]
                add(label, new, members, None, mixing)
            else:
                add(name, [(source.germ, name)], (source,), None, np.eye(1))
        self._blocks = tuple(blocks)
        self.germs = tuple(germs)
        self.germ_names = tuple(germ_names)
        self.groups = ReadOnlyDict({block.name: block.columns for block in blocks})

    @property
    def continuous(self) -> tuple[bool, ...]:
        """Which germs (L,) take every value in between, and not only those of observed or discrete ones."""
        found = [True] * len(self.germs)
        for block in self._blocks:
            for member in block.members:
                if not (member.continuous or isinstance(member, CorrelatedParameter)):
                    found[block.columns[0]] = False
        return tuple(found)

    def atoms(self, germ: int) -> tuple[Array, Array] | None:
        """Values (n,) of a discrete germ and their probabilities (n,); None: it is continuous."""
        if self.continuous[germ]:
            return None
        return next(block.members[0].atoms for block in self._blocks if germ in block.columns)

    @property
    def dimension(self) -> int:
        """L, the number of germs."""
        return len(self.germs)

    def __repr__(self) -> str:
        return f"<RandomSpace of {', '.join(self.germ_names) or 'nothing random'}>"

    # -- bases ---------------------------------------------------------------------------------
    def basis(
        self, chaos: Chaos, rows: int = 0, memory_limit: float | None = None
    ) -> ChaosBasis:
        """The chaos basis of a request.

        Parameters
        ----------
        chaos
            The request.
        rows
            Numbers that will be stored for each mode.
        memory_limit
            Bytes; None: the memory of the machine; 0: no limit.

        Raises
        ------
        SceneError
            The modes would need more memory than the limit (it is said how much), or the weights do
            not fit the germs.
        """
        limit = _machine_memory() if memory_limit is None else memory_limit
        # a distribution with few atoms has no polynomials of higher degree
        caps = [
            min(germ.capacity - 1 if germ.capacity is not None else 2**30, 2**30)
            for germ in self.germs
        ]
        if chaos.indices is not None:
            return self._own_basis(chaos, caps, rows, limit)
        try:
            indices = MultiIndexSet(
                chaos.index_set,
                self.dimension,
                int(chaos.order),
                q=chaos.q,
                weights=self._weights(chaos),
                interaction=chaos.max_interaction or 0,
                caps=caps if min(caps, default=2**30) < chaos.order else (),
                bytes_per_index=8.0 * rows,
                memory_limit=limit,
            )
            return ChaosBasis(self.germs, indices)
        except (ValueError, RuntimeError) as error:
            raise MemoryLimitError.of(f"{chaos} on {self!r}: {error}", error) from error

    def _own_basis(
        self, chaos: Chaos, caps: Sequence[int], rows: int, limit: float
    ) -> ChaosBasis:
        """The basis of a set of indices."""
        assert chaos.indices is not None
        table = np.array(chaos.indices, dtype=np.int32).reshape(len(chaos.indices), -1)
        if table.shape[1] != self.dimension:
            raise SceneError(
                f"Chaos: indices of {table.shape[1]} germs, there are {self.dimension}: "
                f"{', '.join(self.germ_names)}"
            )
        if np.any(table > caps):
            raise SceneError(f"Chaos: an index beyond the degrees {list(caps)} that the germs have")
        if limit and 8.0 * rows * len(table) > limit:
            raise MemoryLimitError(
                f"{len(table)} modes need {8e-9 * rows * len(table):.3g} GB, more than the limit"
            )
        try:
            return ChaosBasis(self.germs, MultiIndexSet.from_table(table))
        except (ValueError, RuntimeError) as error:
            raise SceneError(f"Chaos: indices: {error}") from error

    def _weights(self, chaos: Chaos) -> list[float]:
        if chaos.weights is None:
            return []
        if not isinstance(chaos.weights, Mapping):
            if len(chaos.weights) != self.dimension:
                raise SceneError(
                    f"Chaos: {len(chaos.weights)} weights for {self.dimension} germs: "
                    f"{', '.join(self.germ_names)}"
                )
            return [float(w) for w in chaos.weights]
        result = [1.0] * self.dimension
        for name, weight in chaos.weights.items():
            check_known("random parameter", name, self.names, "Chaos: weights")
            for column in self._find(self._sources[name])[0].columns:
                result[column] = float(weight)
        return result

    # -- coefficients --------------------------------------------------------------------------
    def columns(self, source: Source) -> tuple[int, ...]:
        """Numbers of the germs that a parameter or field shares in."""
        if isinstance(source, Expression):
            return tuple(sorted({c for each in source.leaves.values() for c in self.columns(each)}))
        return self._find(source)[0].columns

    def _expression_coefficients(self, source: Expression, table: npt.NDArray[np.int32]) -> Array:
        """Projection of a function of other parameters, by a tensor rule on its germs."""
        columns = list(self.columns(source))
        others = np.setdiff1d(np.arange(self.dimension), columns)
        inside = ~np.any(table[:, others] > 0, axis=1)
        own = table[np.ix_(inside, columns)]
        highest = own.max(axis=0, initial=0)
        points, weights = self._rule_of(source, highest)
        psi = np.ones((len(points), len(own)))
        for k, c in enumerate(columns):
            one = self.germs[c].evaluate(np.ascontiguousarray(points[:, c]), int(highest[k]))
            psi *= one[:, own[:, k]]
        result = np.zeros((1, len(table)))
        result[0, inside] = psi.T @ (weights * self.values(source, points))
        return result

    def _rule_of(self, source: Expression, highest: npt.NDArray[np.int32]) -> tuple[Array, Array]:
        """Points (N, L) and weights (N,) on which an expression is projected on modes up to some degrees."""
        columns = list(self.columns(source))
        germs = [self.germs[c] for c in columns]
        counts = [
            min(int(h) + _MORE_POINTS, g.capacity if g.capacity is not None else 2**30)
            for h, g in zip(highest, germs, strict=True)
        ]
        if math.prod(counts) > _MOST_POINTS:
            raise SceneError(
                f"expression {source.name!r} depends on {len(germs)} germs: projecting it takes "
                f"{math.prod(counts):.3g} points, more than {_MOST_POINTS:g}; lower the order, or sample"
            )
        rule = core.tensor_gauss(germs, counts, 0.0)
        points = np.zeros((len(rule.points), self.dimension))
        points[:, columns] = rule.points
        return points, np.asarray(rule.weights)

    def least(self, source: Expression, basis: ChaosBasis) -> tuple[float, str]:
        """Smallest value of an expression where its chaos is made from it, and the parameters there."""
        highest = 2 * basis.indices.table[:, list(self.columns(source))].max(axis=0, initial=0)
        points = self._rule_of(source, highest)[0]
        values = self.values(source, points)
        worst = points[int(np.argmin(values))][None]
        at = (f"{key} = {float(self.values(leaf, worst)[0]):.6g}" for key, leaf in source.leaves.items())
        return float(values.min()), ", ".join(at)

    def _find(self, source: Source) -> tuple[_Block, int]:
        """Block of a source, and its place among the members."""
        for block in self._blocks:
            if block.field is source:
                return block, 0
            for position, member in enumerate(block.members):
                if member == source:
                    return block, position
        raise SceneError(f"{source!r} is not part of {self!r}")

    def coefficients_at(self, source: Source, table: npt.NDArray[np.int32]) -> Array:
        """Chaos coefficients of a parameter or field on multi-indices (n, L): (rows, n)."""
        if isinstance(source, Expression):
            return self._expression_coefficients(source, table)
        block, position = self._find(source)
        columns = list(block.columns)
        others = np.ones(self.dimension, dtype=bool)
        others[columns] = False
        inside = ~np.any(table[:, others] > 0, axis=1)
        own = table[np.ix_(inside, columns)]
        rows = len(block.field.points) if block.field is not None else 1
        result = np.zeros((rows, len(table)))
        if block.field is not None:
            result[:, inside] = block.field.coefficients(own)
            return result
        parameter = block.members[position]
        degrees = own.sum(axis=1)
        line = parameter.coefficients(int(degrees.max(initial=0)))
        factors = np.ones(len(own))
        if isinstance(parameter, CorrelatedParameter):
            # psi_n of a unit combination of normal germs, by the multinomial theorem for Hermite
            factors = np.exp(
                0.5 * (special.gammaln(degrees + 1.0) - special.gammaln(own + 1.0).sum(axis=1))
            )
            factors = factors * np.prod(block.mixing[position] ** own, axis=1)
        result[0, inside] = line[degrees] * factors
        return result

    def coefficients(self, source: Source, basis: ChaosBasis) -> Array:
        """Projection of a parameter or field on the modes of a basis: (1 or m, P + 1)."""
        return self.coefficients_at(source, basis.indices.table)

    def expansion(
        self, source: Source, basis: ChaosBasis, memory_limit: float | None = None
    ) -> Expansion:
        """The parameter with every mode that the products of two modes of `basis` can reach.

        This is what an exact Galerkin matrix needs: degree 1 for an affine parameter, otherwise up
        to twice the degree of the basis.

        Raises
        ------
        SceneError
            There are more modes than memory.
        """
        columns = list(self.columns(source))
        table = basis.indices.table[:, columns]
        highest = 2 * table.max(axis=0, initial=0)
        order = 2 * int(table.sum(axis=1).max(initial=0))
        if source.affine:
            highest, order = np.minimum(highest, 1), min(order, 1)
        caps = np.zeros(self.dimension, dtype=int)
        caps[columns] = highest
        rows = len(source.points) if isinstance(source, DiscretisedField) else 1
        try:
            indices = MultiIndexSet(
                "total",
                self.dimension,
                order,
                caps=[int(c) for c in caps],
                bytes_per_index=8.0 * rows,
                memory_limit=_machine_memory() if memory_limit is None else memory_limit,
            )
        except ValueError as error:
            raise MemoryLimitError.of(f"the chaos of {source.name!r}: {error}", error) from error
        return Expansion(self.coefficients_at(source, indices.table), indices)

    def galerkin_matrix(self, source: Source, basis: ChaosBasis, row: int = 0) -> Any:
        """E[a Psi_j Psi_k] of a parameter, or of a field at its point `row`: (P + 1, P + 1)."""
        return sp.csc_matrix(next(islice(self.galerkin_matrices(source, basis), row, None)))

    @staticmethod
    def multiplies(source: Source) -> bool:
        """Whether a parameter is a product of functions of one germ each."""
        return isinstance(source, DiscretisedField) and not source.affine

    def galerkin_matrices(self, source: Source, basis: ChaosBasis) -> Iterator[Any]:
        """E[a Psi_j Psi_k] of a parameter, (P + 1, P + 1), or of a field at each of its points.

        A lognormal field is a product of functions of one germ each, and so are these: nothing is enumerated,
        whatever the number of germs.
        """
        if self.multiplies(source):
            yield from self._of_factors(cast(DiscretisedField, source), basis)
            return
        coefficients, indices = self.expansion(source, basis)
        for row in coefficients:
            yield core.galerkin_matrix(basis, row, indices)

    def _of_factors(self, source: DiscretisedField, basis: ChaosBasis) -> Iterator[Array]:
        table = basis.indices.table
        columns = list(self.columns(source))
        others = np.setdiff1d(np.arange(self.dimension), columns)
        scale = np.full((len(table), len(table)), source.mean)
        for column in others:
            scale[table[:, column, None] != table[None, :, column]] = 0.0
        tops = [int(table[:, column].max(initial=0)) for column in columns]
        # germs of which no mode has a degree have factor 1
        used = [(k, column, top) for k, (column, top) in enumerate(zip(columns, tops, strict=True)) if top]
        factors = [source.factors(k, top) for k, _, top in used]
        places = [table[:, column, None] * (top + 1) + table[None, :, column] for _, column, top in used]
        for row in range(len(source.points)):
            matrix = scale.copy()
            for factor, place in zip(factors, places, strict=True):
                matrix *= np.take(factor[row], place)
            yield matrix

    # -- points --------------------------------------------------------------------------------
    def checked_points(self, points: npt.ArrayLike, where: str) -> Array:
        """Points (N, L) of the germs, finite; of one point its row may be given.

        Raises
        ------
        SceneError
            They are no finite numbers, or of another number of germs.
        """
        data = checked_numbers(where, "germs", points, "give points of finite numbers, one row each")
        data = np.atleast_2d(data)
        if data.ndim != 2 or data.shape[1] != self.dimension:
            raise SceneError(
                f"{where}: points of shape {data.shape}, the problem has {self.dimension} germs: "
                f"{', '.join(self.germ_names)}"
            )
        return data

    def values(self, source: Source, points: npt.ArrayLike) -> Array:
        """A parameter (N,) or field (m, N) at points (N, L) of the germs; not by its chaos."""
        xi = self.checked_points(points, "values")
        if isinstance(source, Expression):
            return source.check({key: self.values(each, xi) for key, each in source.leaves.items()})
        block, position = self._find(source)
        own = xi[:, list(block.columns)]
        with np.errstate(over="ignore", invalid="ignore"):
            if block.field is not None:
                found: Array = block.field.value(own)
            else:
                found = block.members[position].value(own @ block.mixing[position])
        if not np.all(np.isfinite(found)):
            bad = np.flatnonzero(~np.isfinite(found).all(axis=0) if found.ndim > 1 else ~np.isfinite(found))
            raise SceneError(
                f"{source!r} has no finite value at the germs {short(xi[bad[0]].tolist())}: germs are of "
                "order 1 (standard normal, or within [-1, 1])"
            )
        return found

    def germ_points(self, values: Mapping[str, npt.ArrayLike]) -> Array:
        """Points (N, L) of the germs for given values of parameters, (N,) or one for all points.

        Parameters that are not named stay at their mean.

        Raises
        ------
        SceneError
            An unknown name, a field (it is no one number), different lengths, or a value that the
            distribution of its parameter cannot take.
        """
        given: dict[str, Array] = {}
        for name, value in values.items():
            check_known("random parameter", name, self.names)
            source = self._sources[name]
            if isinstance(source, DiscretisedField):
                raise SceneError(f"random field {name!r} cannot be set by one number per point")
            given[name] = np.atleast_1d(
                checked_numbers(f"random parameter {name!r}", "value", value, "give one number per point")
            )
        count = common_length(given)
        points = np.zeros((count, self.dimension))
        for block in self._blocks:
            if block.field is not None:
                continue
            scores = np.empty((count, len(block.members)))
            for position, member in enumerate(block.members):
                wanted = given.get(member.name, np.array([member.mean]))
                with np.errstate(invalid="ignore", divide="ignore"):
                    scores[:, position] = member.to_germ(wanted)
                lower, upper = member.bounds
                bad = ~np.isfinite(scores[:, position]) | (wanted < lower) | (wanted > upper)
                if np.any(bad):
                    worst = np.broadcast_to(wanted, (count,))[bad][0]
                    raise SceneError(
                        f"{member!r} cannot take the value {worst:g}; it lies between {lower:g} "
                        f"and {upper:g}"
                    )
            points[:, list(block.columns)] = linalg.solve_triangular(
                block.mixing, scores.T, lower=True
            ).T
        return points

    def from_uniform(self, probabilities: npt.ArrayLike) -> Array:
        """Points (N, L) of the germs at probabilities (N, L) in (0, 1)."""
        tiny = 2.0**-54
        u = np.clip(np.asarray(probabilities, dtype=np.float64), tiny, 1.0 - 2.0 * tiny)
        return self.from_normal(special.ndtri(u))

    def from_normal(self, scores: npt.ArrayLike) -> Array:
        """Points (N, L) of the germs at independent standard normal scores (N, L), right into both tails."""
        points = np.array(scores, dtype=np.float64)
        for block in self._blocks:
            for member in block.members:
                if not isinstance(member, CorrelatedParameter):
                    column = block.columns[0]
                    points[:, column] = member.germ_from_normal(points[:, column])
        return points

    def to_normal(self, points: npt.ArrayLike) -> Array:
        """Independent standard normal scores (N, L) of points (N, L) of the germs; of a discrete parameter in
        the middle of those that give its value."""
        scores = np.array(points, dtype=np.float64)
        for block in self._blocks:
            for member in block.members:
                if not isinstance(member, CorrelatedParameter):
                    column = block.columns[0]
                    scores[:, column] = member.to_normal(member.value(scores[:, column]))
        return scores

    def sample(self, count: int, rng: np.random.Generator | int | None = None) -> Array:
        """Monte Carlo: `count` random points (count, L) of the germs."""
        generator = np.random.default_rng(checked_seed("sampling", rng))
        count = checked_whole("sampling", "samples", count, 1)
        return self.from_uniform(generator.random((count, self.dimension)))

    def sample_sobol(self, count: int, rng: np.random.Generator | int | None = None) -> Array:
        """Quasi-Monte Carlo: scrambled Sobol points (count, L); count must be a power of two.

        Raises
        ------
        SceneError
            `count` is not a power of two, or there are no germs.
        """
        count = checked_whole("sampling", "samples", count, 1)
        if count & (count - 1):
            above = 2 ** max(count - 1, 1).bit_length()
            raise SceneError(
                f"{count} Sobol points are not balanced; take a power of two, e.g. {above}"
            )
        if not self.germs:
            raise SceneError("there is nothing random to sample")
        generator = np.random.default_rng(checked_seed("sampling", rng))
        return self.from_uniform(sobol_points(self.dimension, count, generator))

    def tensor_gauss(self, counts: int | Sequence[int], memory_limit: float = 0.0) -> Rule:
        """Tensor Gauss rule with this many points in each germ."""
        if is_list(counts):
            wanted = [checked_whole("tensor quadrature", "points", c, 1) for c in counts]
        else:
            wanted = [checked_whole("tensor quadrature", "points", counts, 1)] * self.dimension
        return core.tensor_gauss(self.germs, wanted, memory_limit)

    def sparse_gauss(self, level: int, memory_limit: float = 0.0) -> Rule:
        """Smolyak rule, exact for total degree 2 level + 1."""
        return core.smolyak(self.germs, checked_whole("sparse quadrature", "level", level, 0), memory_limit)

    # -- answers -------------------------------------------------------------------------------
    def sobol(self, coefficients: npt.ArrayLike, basis: ChaosBasis) -> dict[str, Sobol]:
        """Sobol indices of fields (rows, P + 1) by independent source: the keys of :attr:`groups`.

        The germs of a correlated group or of a random field count together; the shares of
        correlated parameters among each other are not defined.
        """
        block = np.asarray(coefficients, dtype=np.float64)
        result = {}
        for name, columns in self.groups.items():
            rest = [i for i in range(self.dimension) if i not in columns]
            result[name] = Sobol(
                core.sobol_closed(block, basis.indices, columns),
                1.0 - core.sobol_closed(block, basis.indices, rest),
            )
        return result
