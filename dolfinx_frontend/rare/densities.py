"""Densities from which the samples of rare events are drawn, in standard normal variables."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.deferred import special, stats
from dolfinx_frontend.rare.design import DesignPoint

__all__ = ["Mixture", "Surface"]

OUTSIDE = 0.15
"""Share of the points of importance sampling that look elsewhere than around the design points."""
SMALLER = 0.3
"""Of the ball outside of which they do than the distance of the nearest design point, deviations."""
BEYOND = 0.6
"""Share of the points that are drawn beyond the tangent planes of the design points."""
MOVED = 0.1
"""Of these planes towards the origin, deviations."""
LOCAL = 3.0
"""Tangential distance of the samples to which a surface is fitted, deviations."""
WIDEST, NARROWEST = 2.0, 0.1
"""Deviations of the tangential coordinates of a surface."""
BETTER = 0.8
"""A surface is used if it puts so many times as many samples on the wrong side as the plane does."""


@dataclass(frozen=True, eq=False)
class Surface:
    """A limit near a design point as a paraboloid: ``height + slope t + sum curved_i t_i^2 / 2`` along alpha.

    Samples beyond it have tangential coordinates t of the spread that the curvature gives the event there
    (what SORM integrates), and along alpha the tail of the normal distribution.
    """

    alpha: Array  # (L,)
    frame: Array  # (L - 1, L) principal directions, orthonormal and normal to alpha
    height: float
    slope: Array  # (L - 1,)
    curved: Array  # (L - 1,)
    middle: Array  # (L - 1,) of the tangential coordinates
    spread: Array  # (L - 1,)

    @classmethod
    def fitted(cls, point: DesignPoint, u: Array, margins: Array) -> Surface | None:
        """Through the conditions (N, k) at samples (N, L); None: there are too few, or a plane does as well.

        The coordinate along alpha is fitted as a function of the tangential ones and of the condition itself,
        with a slope of its own on either side: kinks at the limit do no harm, and no derivative is taken.
        """
        dimension = u.shape[1]
        if dimension < 2:
            return None
        basis, _ = np.linalg.qr(np.column_stack([point.alpha, np.eye(dimension)]))
        frame = basis[:, 1:dimension].T
        along = u @ point.alpha
        t = u @ frame.T
        g = margins[:, list(point.cut)].max(axis=1)
        reach = LOCAL * max(1.0, math.sqrt(dimension / 4.0))
        local = (np.linalg.norm(t, axis=1) < reach) & (np.abs(along - point.beta) < 2.0) & np.isfinite(g)
        if local.sum() < 10:
            return None
        t, along, g = t[local], along[local], g[local]
        g = g / max(float(np.median(np.abs(g))), 1e-300)
        full = dimension * (dimension - 1) // 2 <= len(t) // 3
        rows, columns = np.triu_indices(dimension - 1)
        squares: Array = t[:, rows] * t[:, columns] if full else u[local] ** 2
        sides: list[Array] = [np.maximum(g, 0.0), np.minimum(g, 0.0), g * g]
        table = np.column_stack([np.ones(len(t)), t, squares, *sides])
        if table.shape[1] > len(t) // 2:
            return None
        weights = np.exp(-0.25 * np.minimum(g * g, 50.0))
        found, *_ = np.linalg.lstsq(weights[:, None] * table, weights * along, rcond=1e-8)
        hessian: Array = np.zeros((dimension - 1, dimension - 1))
        if full:
            hessian[rows, columns] = found[dimension : dimension + len(rows)]
            hessian = hessian + hessian.T
            height = float(found[0])
            slope = found[1:dimension]
        else:
            diagonal = found[dimension : 2 * dimension]
            # squares of u = alpha beta + frame t, about the design point
            hessian = 2.0 * frame @ (diagonal[:, None] * frame.T)
            height = float(found[0] + diagonal @ (point.beta * point.alpha) ** 2)
            slope = found[1:dimension] + 2.0 * frame @ (diagonal * point.beta * point.alpha)
        curved, turn = np.linalg.eigh(hessian)
        factor = np.maximum(1.0 + point.beta * curved, 1.0 / WIDEST**2)
        slope = turn.T @ slope
        made = cls(
            point.alpha,
            turn.T @ frame,
            float(np.clip(height, point.beta - 1.0, point.beta + 1.0)),
            slope,
            curved,
            np.clip(-point.beta * slope / factor, -1.5, 1.5),
            np.clip(factor**-0.5, NARROWEST, WIDEST),
        )
        wrong = [
            float(weights @ ((along > level) != (g < 0.0))) for level in (point.beta, made.heights(t @ turn))
        ]
        return made if wrong[1] < BETTER * wrong[0] else None

    def heights(self, t: Array) -> Array:
        """(N,) along alpha, at tangential coordinates (N, L - 1)."""
        raised = self.height + t @ self.slope + 0.5 * (t * t) @ self.curved
        return np.asarray(np.clip(raised, self.height - 3.0, self.height + 6.0))

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        """(count, L)."""
        t = self.middle + self.spread * rng.standard_normal((count, len(self.spread)))
        tail = special.ndtr(MOVED - self.heights(t)) * rng.random(count)
        along = -special.ndtri(np.maximum(tail, 1e-300))
        return np.asarray(t @ self.frame + along[:, None] * self.alpha)

    def ratio(self, u: Array) -> Array:
        """Logarithm of the density over the standard normal one, (N,)."""
        t = u @ self.frame.T
        heights = self.heights(t) - MOVED
        with np.errstate(divide="ignore"):
            inside = np.log((u @ self.alpha > heights).astype(float))
        scaled = (t - self.middle) / self.spread
        tangential = 0.5 * np.sum(t * t - scaled * scaled, axis=1) - float(np.log(self.spread).sum())
        return np.asarray(inside - special.log_ndtr(-heights) + tangential)


@dataclass(frozen=True, eq=False)
class Mixture:
    """Densities around design points, of three kinds.

    Beyond the tangent plane of a design point, moved a little towards the origin, the standard normal
    density itself: where the limit is a plane all weights are the same. Where it is not, the plane may give
    way to a :class:`Surface`. Around the points the normal density
    of unit covariance, for what is curved towards the origin. And the standard normal density outside of a
    ball that is a little smaller than the distance of the nearest design point, in all directions, for what
    nobody has thought of.
    """

    centres: Array  # (n, L)
    normals: Array  # (n, L) of length 1
    offsets: Array  # (n,) of the planes from the origin
    shares: Array  # (2 n + 1,), of sum 1: beyond the planes, around the points, outside of the ball
    radius: float
    surfaces: tuple[Surface | None, ...]  # (n,) instead of the planes

    @classmethod
    def around(cls, points: Sequence[DesignPoint]) -> Mixture:
        chances = special.log_ndtr(-np.array([each.beta for each in points]))
        shares = np.exp(chances - chances.max())
        shares = np.maximum(shares / shares.sum(), 0.2 / len(points))
        shares /= shares.sum()
        centres = np.array([each.u for each in points])
        nearest = min(each.beta for each in points)
        return cls(
            centres,
            np.array([each.alpha for each in points]),
            np.array([each.beta for each in points]) - MOVED,
            np.concatenate([BEYOND * shares, (1.0 - BEYOND - OUTSIDE) * shares, [OUTSIDE]]),
            max(nearest - SMALLER, 0.0),
            (None,) * len(points),
        )

    def curved(self, points: Sequence[DesignPoint], u: Array, margins: Array) -> Mixture | None:
        """With surfaces through the conditions (N, k) at samples (N, L); None: planes do as well."""
        found = tuple(Surface.fitted(each, u, margins) for each in points)
        return replace(self, surfaces=found) if any(found) else None

    def before(self) -> float:
        """Largest share of what is beyond a surface that is before its plane, by 2000 draws."""
        shares = [0.0]
        for surface, offset in zip(self.surfaces, self.offsets, strict=True):
            if surface is not None:
                u = surface.draw(np.random.default_rng(0), 2000)
                weights = special.softmax(-surface.ratio(u))
                shares.append(float(weights @ (u @ surface.alpha < offset)))
        return max(shares)

    def draw(self, rng: np.random.Generator, count: int) -> Array:
        number = len(self.centres)
        which = rng.choice(len(self.shares), size=count, p=self.shares)
        u = rng.standard_normal((count, self.centres.shape[1]))
        beyond = which < number
        normals = self.normals[which[beyond]]
        # the part along the normal: a tail of the normal distribution by its inverse
        tail = special.ndtr(-self.offsets[which[beyond]]) * rng.random(int(beyond.sum()))
        along = -special.ndtri(np.maximum(tail, 1e-300))
        u[beyond] += (along - np.sum(u[beyond] * normals, axis=1))[:, None] * normals
        for k, surface in enumerate(self.surfaces):
            if surface is not None:
                own = which == k
                u[own] = surface.draw(rng, int(own.sum()))
        near = (which >= number) & (which < 2 * number)
        u[near] += self.centres[which[near] - number]
        outside = which == 2 * number
        chance = rng.random(int(outside.sum())) * float(stats.chi2.sf(self.radius**2, u.shape[1]))
        radii = np.sqrt(stats.chi2.isf(np.maximum(chance, 1e-300), u.shape[1]))
        u[outside] *= (radii / np.linalg.norm(u[outside], axis=1))[:, None]
        return u

    def ratio(self, u: Array) -> Array:
        """Logarithm of this density over the standard normal one, (N,)."""
        with np.errstate(divide="ignore"):
            inside = np.log((u @ self.normals.T > self.offsets).astype(float))
        beyond = inside - special.log_ndtr(-self.offsets)
        for k, surface in enumerate(self.surfaces):
            if surface is not None:
                beyond[:, k] = surface.ratio(u)
        near = u @ self.centres.T - 0.5 * np.sum(self.centres**2, axis=1)
        with np.errstate(divide="ignore"):
            far = np.log((np.linalg.norm(u, axis=1) > self.radius).astype(float))
        outside = far - stats.chi2.logsf(self.radius**2, u.shape[1])
        logs = np.column_stack([beyond, near, outside])
        return np.asarray(special.logsumexp(logs, b=self.shares, axis=1))
