#!/usr/bin/env python3
"""Check a certificate of an answer with nothing but NumPy and SciPy: VALID, or the statements that fail.

    python3 check_certificate.py answer.npz ...

The file (docs/certificate.md) has meshes, elasticities, loads, supports, laws, displacements and interface forces.
Stiffnesses are assembled anew; then, at every time step: what is held stays where it is held; forces and moments of
every part balance; so do the forces at the nodes; signs, cones and laws hold at every point; both energies agree;
and the exact solution of the discrete problem, found by Newton's method from the answer, is not farther away than
the error that is stated. Exit codes: 0 VALID, 1 a statement fails, 2 not readable.
"""

from __future__ import annotations

import itertools
import json
import math
import sys
import zipfile
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

EPS = np.finfo(float).eps
ROUNDING = 100.0  # so many rounding errors of the terms of a sum are rounding
SHARP = 1e-9  # what holds but for rounding holds to this
FACTOR = 3.0  # an error is stated within this factor
MISREAD = 10.0  # what is true of the whole is true of a point within this one
FOUND = 1e-8  # a relative step of Newton's method after which there is an answer
STEPS = 40  # of it
SHIFTS = (0.0, 1e-10)  # shares of the diagonal that are added where something is free
HELD = 1e-6  # directions of supports that differ by less are one
TINY = 1e-300
PAIRS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}


class Unreadable(Exception):
    """The file is no certificate."""


def need(good: Any, what: str) -> None:
    if not np.all(good):
        raise Unreadable(what)


# --- elements --------------------------------------------------------------------------------------
def exponents(d: int, p: int, simplex: bool) -> np.ndarray:
    every = itertools.product(range(p + 1), repeat=d)
    return np.array([e for e in every if not simplex or sum(e) <= p])


def tabulate(nodes: np.ndarray, p: int, simplex: bool, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lagrange functions (points, n) of nodes on the reference cell, and gradients (points, n, d)."""
    e = exponents(x.shape[1], p, simplex)
    need(nodes.shape == e.shape, "the nodes of an element are not as many as its functions")
    inverse = np.linalg.inv(np.prod(nodes[:, None] ** e, axis=2))
    values, slopes = np.prod(x[:, None] ** e, axis=2), []
    for i in range(x.shape[1]):
        lower = e.copy()
        lower[:, i] = np.maximum(e[:, i] - 1, 0)
        slopes.append((e[:, i] * np.prod(x[:, None] ** lower, axis=2)) @ inverse)
    return values @ inverse, np.stack(slopes, axis=2)


class Part:
    """Stiffness (n, n), rigid motions (n, r), volume of a part."""

    def __init__(self, told: dict[str, Any], a: dict[str, np.ndarray]) -> None:
        self.name, p = told["name"], told["degree"]
        self.nodes, x, cells, dofs, C = a["nodes"], a["x"], a["cells"], a["dofs"], a["elasticity"]
        count, d = self.nodes.shape
        simplex = told["cell"] in ("triangle", "tetrahedron")
        points, weights = a["points"], a["weights"]
        e = exponents(d, 2 * (p - simplex), simplex)
        exact = [math.prod(map(math.factorial, k)) / math.factorial(d + sum(k)) if simplex
                 else math.prod(1.0 / (1 + each) for each in k) for k in e.tolist()]  # fmt: skip
        got = weights @ np.prod(points[:, None] ** e, axis=2)
        need(np.abs(got - exact) < SHARP, f"{self.name}: its quadrature is not exact for its degree")
        need(np.abs(C - C.T).max() <= SHARP * C.max() and np.linalg.eigvalsh(C).min() > 0.0,
             f"{self.name}: its elasticity is not symmetric and positive")  # fmt: skip
        if "E" in told:
            need(np.abs(C - isotropic(told, d)).max() <= SHARP * C.max(), f"{self.name}: E and nu give another")
        places = tabulate(a["mapping"], told["order"], simplex, a["reference"])[0] @ x[cells]
        size = np.ptp(x, axis=0).max()
        need(np.abs(places - self.nodes[dofs]).max() <= SHARP * size, f"{self.name}: nodes off their cells")
        need(np.unique(dofs).size == count, f"{self.name}: nodes without a cell")
        geometry = tabulate(a["mapping"], told["order"], simplex, points)[1]
        shape, n = tabulate(a["reference"], p, simplex, points)[1], dofs.shape[1]
        pairs, blocks, self.volume, signs = PAIRS[d], np.zeros((len(cells), n * d, n * d)), 0.0, []
        for w, to_x, to_u in zip(weights, geometry, shape, strict=True):
            J = np.einsum("cni,nk->cik", x[cells], to_x)
            det = np.linalg.det(J)
            signs.append(np.sign(det))
            grad = to_u @ np.linalg.inv(J)
            B = np.zeros((len(cells), len(pairs), n, d))
            for row, (i, k) in enumerate(pairs):
                B[:, row, :, i] += grad[:, :, k]
                if i != k:
                    B[:, row, :, k] += grad[:, :, i]
            B = B.reshape(len(cells), len(pairs), n * d)
            blocks += (w * np.abs(det))[:, None, None] * (B.transpose(0, 2, 1) @ (C @ B))
            self.volume += float(w * np.abs(det).sum())
        need(np.abs(np.sum(signs, axis=0)) == len(weights), f"{self.name}: cells inside out")
        rows = (d * dofs[:, :, None] + np.arange(d)).reshape(len(cells), -1)
        at = [np.broadcast_to(r, blocks.shape).ravel() for r in (rows[:, :, None], rows[:, None, :])]
        self.K = sp.csr_matrix((blocks.ravel(), at), shape=(count * d, count * d))
        at_origin = (self.nodes - self.nodes.mean(axis=0)) / size
        turns = [(0, 1)] if d == 2 else [(1, 2), (2, 0), (0, 1)]
        modes = [np.tile(row, (count, 1)) for row in np.eye(d)]
        for i, k in turns:
            modes.append(np.zeros((count, d)))
            modes[-1][:, i], modes[-1][:, k] = -at_origin[:, k], at_origin[:, i]
        self.rigid = np.stack([each.ravel() for each in modes], axis=1)


def isotropic(told: dict[str, Any], d: int) -> np.ndarray:
    E, nu = told["E"], told["nu"]
    plane = d == 2 and told["plane"] == "stress"
    lame, mu = E * nu / ((1 - nu**2) if plane else (1 + nu) * (1 - 2 * nu)), E / (2 + 2 * nu)
    C = np.diag([2 * mu] * d + [mu] * (len(PAIRS[d]) - d))
    C[:d, :d] += lame
    return C


def stiffness(p: dict[str, np.ndarray], k: int) -> np.ndarray:
    """Of springs, (m, k)."""
    return np.concatenate([p["normal"], np.repeat(p["tangential"], k - 1, axis=1)], axis=1)


# --- laws: f = R(z) with z = j + c f, for any c > 0 (m, 1) -------------------------------------------
def resolve(kind: str, p: dict[str, np.ndarray], z: np.ndarray, c: np.ndarray, before: np.ndarray) -> np.ndarray:
    """Forces (m, k) of free jumps (m, k); `before`: slips, or the length or damage of the step before."""
    f, z = np.zeros_like(z), z - p.get("jump", np.zeros_like(z))
    if kind == "perfect":
        return z / c
    if kind == "force":
        return p["force"] + 0.0 * z
    if kind == "elastic":
        kappa = stiffness(p, z.shape[1])
        return kappa * z / (1.0 + c * kappa)
    if kind == "preload":
        locked, soft = p["locked"] > 0.0, c + p.get("compliance", 0.0)
        given = np.where(p["locked"] < 0.0, 0.0, p["force"])
        fixed = (z[:, :1] - before[:, :1] - p.get("slack", 0.0)) / soft
        return np.concatenate([np.where(locked, fixed, given), z[:, 1:] / c], axis=1)
    if kind == "debonding":  # a function of the jump: c is 0
        largest, first, last = bond(p, z, before)
        lost = np.clip(last * (largest - first) / np.maximum(largest * (last - first), 1e-300), 0.0, 1.0)
        f[:, :1] = p["normal"] * np.where(z[:, :1] > 0.0, 1.0 - lost, 1.0) * z[:, :1]
        f[:, 1:] = (1.0 - lost) * p["tangential"] * z[:, 1:]
        return f
    f[:, :1] = np.minimum(0.0, (z[:, :1] + p["gap"]) / (c + p["compliance"]))
    if kind == "coulomb":
        trial = (z[:, 1:] - before) / (c + p.get("tangential_compliance", 0.0))
        length = np.linalg.norm(trial, axis=1, keepdims=True)
        bound = np.where(f[:, :1] < 0.0, p["threshold"] - p["friction"] * f[:, :1], 0.0)
        f[:, 1:] = trial * np.where(length > bound, bound / np.maximum(length, 1e-300), 1.0)
    return f


def bond(p: dict[str, np.ndarray], j: np.ndarray, before: np.ndarray) -> tuple[np.ndarray, ...]:
    """The largest opening so far, and those at which damage begins and ends."""
    first = p["strength"] / p["normal"]
    last = p.get("opening", 0.0) + 2.0 * p.get("energy", 0.0) / p["strength"]
    square = np.maximum(j[:, :1], 0.0) ** 2 + p["tangential"] / p["normal"] * (j[:, 1:] ** 2).sum(axis=1, keepdims=True)
    return np.maximum.reduce([np.sqrt(square), before[:, :1], first]), first, last


def remember(kind: str, p: dict[str, np.ndarray], j: np.ndarray, f: np.ndarray, before: np.ndarray) -> np.ndarray:
    if kind == "debonding":
        return bond(p, j - p["jump"], before)[0]
    if kind == "coulomb":
        return j[:, 1:] - p.get("jump", np.zeros_like(j))[:, 1:] - p.get("tangential_compliance", 0.0) * f[:, 1:]
    if kind == "preload":
        own = j[:, :1] - p.get("compliance", 0.0) * f[:, :1]
        return np.where(p["locked"] > 0.0, before, own)
    return before


def density(kind: str, p: dict[str, np.ndarray], j: np.ndarray, f: np.ndarray, before: np.ndarray) -> np.ndarray:
    """phi(j) + phi*(f) - j f >= 0 (m,) of laws with an energy phi, with j moved to where that is finite."""
    out, j = np.zeros(len(f)), j - p.get("jump", np.zeros_like(j))
    if kind == "elastic":
        kappa = stiffness(p, j.shape[1])
        out = ((f - kappa * j) ** 2 / (2.0 * np.where(kappa > 0.0, kappa, np.inf))).sum(axis=1)
    if kind in ("contact", "coulomb"):
        x, soft = j[:, 0] + p["gap"][:, 0], p["compliance"][:, 0]
        deep = np.where(soft > 0.0, np.minimum(x, 0.0) / np.where(soft > 0.0, soft, 1.0), f[:, 0])
        out = 0.5 * soft * (f[:, 0] - np.where(x < 0.0, deep, 0.0)) ** 2 - f[:, 0] * np.maximum(x, 0.0)
    if kind == "coulomb":
        slip = j[:, 1:] - p.get("tangential_compliance", 0.0) * f[:, 1:] - before
        bound = np.where(f[:, :1] < 0.0, p["threshold"] - p["friction"] * f[:, :1], 0.0)[:, 0]
        out = out + bound * np.linalg.norm(slip, axis=1) - (f[:, 1:] * slip).sum(axis=1)
    return out


def broken_cone(kind: str, p: dict[str, np.ndarray], f: np.ndarray) -> float:
    """How far forces leave the set that the law allows, over the largest; 0: they do not."""
    if kind not in ("contact", "coulomb"):
        return 0.0
    out = f[:, 0].max()
    if kind == "coulomb":
        bound = np.where(f[:, :1] < 0.0, p["threshold"] - p["friction"] * f[:, :1], 0.0)
        out = max(out, float((np.linalg.norm(f[:, 1:], axis=1) - bound[:, 0]).max()))
    return max(0.0, float(out)) / max(float(np.abs(f).max()), 1e-300)


class Joint:
    """An interface with forces at points: G (k m, all unknowns) makes the jump."""

    def __init__(self, told: dict[str, Any], a: dict[str, np.ndarray], parts: list[Part], starts: np.ndarray) -> None:
        self.name, self.kind, self.force = told["name"], told["kind"], a["force"]
        need(self.kind in ("perfect", "elastic", "force", "contact", "coulomb", "preload", "debonding"), f"law {self.kind!r}")
        rows = a["directions"]
        m, self.k, d = rows.shape
        need(a["weights"] > 0.0, f"{self.name}: weights that are not positive")
        self.w = np.repeat(a["weights"], self.k)
        turn = sp.bsr_matrix((rows, np.arange(m), np.arange(m + 1)), shape=(m * self.k, m * d)).tocsr()
        self.G = sp.csr_matrix((m * self.k, starts[-1]))
        for s, part in enumerate(told["sides"]):
            T = sp.csr_matrix(tuple(a[f"trace{s}.{x}"] for x in ("data", "indices", "indptr")),
                              shape=(m * d, parts[part].rigid.shape[0]))  # fmt: skip
            moved = (T @ parts[part].rigid[:, :d]).reshape(m, d, d)
            need(told["rigid"] or np.abs(moved - np.eye(d)).max() < 1e-6, f"{self.name}: a trace of side {s} loses motions")
            place = sp.csr_matrix((np.ones(T.shape[1]), (np.arange(T.shape[1]), starts[part] + np.arange(T.shape[1]))),
                                  shape=(T.shape[1], starts[-1]))  # fmt: skip
            self.G = self.G + (2.0 * s - 1.0) * (turn @ T @ place)
        self.laws = {name: a[f"law.{name}"] for name in told["parameters"]}

    def law(self, step: int) -> dict[str, np.ndarray]:
        m = len(self.w) // self.k
        return {name: v[step].reshape(m, -1) for name, v in self.laws.items()}


# --- the whole -------------------------------------------------------------------------------------
class Scene:
    """All parts as one: stiffness K (n, n), u = Z y + what is prescribed."""

    def __init__(self, head: dict[str, Any], a: dict[str, np.ndarray]) -> None:
        of = lambda key: {k[len(key) :]: v for k, v in a.items() if k.startswith(key)}  # noqa: E731
        own = [of(f"part{k}.") for k in range(len(head["parts"]))]
        self.parts = [Part(told, each) for told, each in zip(head["parts"], own, strict=True)]
        self.starts = np.cumsum([0, *(len(part.rigid) for part in self.parts)])
        self.d = self.parts[0].nodes.shape[1]
        self.K = sp.block_diag([part.K for part in self.parts], format="csr")
        self.rigid = sp.block_diag([part.rigid for part in self.parts], format="csr")
        names = ("load", "displacement", "reaction")
        self.load, self.u, self.reaction = (np.hstack([each[name] for each in own]) for name in names)
        finite = [np.isfinite(v).all() for v in a.values() if v.dtype.kind == "f"]
        need(finite + [self.u.shape[1] == self.starts[-1]], "numbers that are not finite, or too few")
        given = [(told, of(f"interface{k}.")) for k, told in enumerate(head["interfaces"])]
        nodal = [each for each in given if each[0]["kind"] in ("support", "glued")]
        self.joints = [Joint(*each, self.parts, self.starts) for each in given if each not in nodal]
        self.hold(nodal)

    def hold(self, given: list[tuple[dict[str, Any], dict[str, np.ndarray]]]) -> None:
        """Z with orthonormal columns: the motions of nodes that supports and glue leave free."""
        d, count = self.d, self.starts[-1] // self.d
        ties, self.rows = [np.zeros((0, 2), dtype=int)], []
        for told, i in given:
            first = self.starts[told["sides"]] // d
            if told["kind"] == "glued":
                ties.append(i["pairs"] + first)
            else:
                self.rows.append((i["nodes"] + first[0], i["directions"], i["values"]))
        self.ties = np.concatenate(ties)
        graph = sp.coo_matrix((np.ones(len(self.ties)), self.ties.T), shape=(count, count))
        clusters, of_node = connected_components(graph, directed=False)
        directions: dict[int, list[np.ndarray]] = {}
        for nodes, rows, _ in self.rows:
            for c in of_node[nodes]:
                directions.setdefault(int(c), []).append(rows)
        free = np.broadcast_to(np.eye(d), (clusters, d, d)).copy()
        for c, several in directions.items():
            _, s, v = np.linalg.svd(np.concatenate(several))
            free[c] = np.where(np.arange(d) < np.sum(s > HELD), 0.0, v.T)
        blocks = free[of_node] / np.sqrt(np.bincount(of_node))[of_node, None, None]
        Z = sp.bsr_matrix((blocks, of_node, np.arange(count + 1)), shape=(count * d, clusters * d)).tocsc()
        self.Z = Z[:, np.asarray(abs(Z).sum(axis=0)).ravel() > 0.0].tocsr()


class Step:
    """The equations of one time step, r = 0 at the nodes and h = c (f - R(j + c f)) = 0 at the points."""

    def __init__(self, scene: Scene, t: int, memory: list[np.ndarray]) -> None:
        self.scene, self.memory, self.joints = scene, memory, scene.joints
        Z, n = scene.Z, scene.starts[-1]
        self.laws = [joint.law(t) for joint in self.joints]
        self.G = sp.vstack([sp.csr_matrix((0, n)), *(joint.G for joint in self.joints)], format="csr")
        self.w = np.concatenate([np.zeros(0), *(joint.w for joint in self.joints)])
        self.f = np.concatenate([np.zeros(0), *(joint.force[t].ravel() for joint in self.joints)])
        ends = np.cumsum([0, *(len(joint.w) for joint in self.joints)])
        self.own = [slice(*each) for each in itertools.pairwise(ends)]
        soft = self.G.multiply(self.G) @ (1.0 / scene.K.diagonal()) * self.w
        self.c = [float(soft[own].mean()) for own in self.own]
        self.fixed = scene.u[t] - Z @ (Z.T @ scene.u[t])
        self.load = scene.load[t]
        kappa = np.zeros(len(self.w))
        for own, joint, p in zip(self.own, self.joints, self.laws, strict=True):
            if joint.kind == "elastic":
                kappa[own] = stiffness(p, joint.k).ravel()
        self.A = scene.K + self.G.T @ sp.diags(self.w * kappa) @ self.G
        self.reduced, self.B = Z.T @ scene.K @ Z, (self.G @ Z).tocsr()

    def norm(self, u: np.ndarray) -> float:
        """Energy norm, with that of the springs."""
        return float(np.sqrt(max(0.0, u @ (self.A @ u))))

    def residuals(self, u: np.ndarray, f: np.ndarray) -> tuple[np.ndarray, np.ndarray, Any]:
        """r, h, and the factors of their derivatives by y and f."""
        Z, j = self.scene.Z, self.G @ u
        h, by_j, by_f = np.zeros(len(f)), [sp.csr_matrix((0, 0))], [sp.csr_matrix((0, 0))]
        for own, joint, p, c, memory in zip(self.own, self.joints, self.laws, self.c, self.memory, strict=True):
            k, inside = joint.k, 0.0 if joint.kind == "debonding" else c
            z = (j[own] + inside * f[own]).reshape(-1, k)
            unit = 1e-7 * max(np.abs(z).max(), c * np.abs(f[own]).max(), TINY)
            both = [[resolve(joint.kind, p, z + s * unit * e, inside, memory) for s in (1, -1)] for e in np.eye(k)]
            slopes = np.stack([(up - down) / (2.0 * unit) for up, down in both], axis=2)
            R = sp.bsr_matrix((c * slopes, np.arange(len(z)), np.arange(len(z) + 1)), shape=(z.size, z.size))
            h[own] = c * (f[own] - resolve(joint.kind, p, z, inside, memory).ravel())
            by_j.append(-R)
            by_f.append(c * sp.identity(z.size) - inside * R)
        r = Z.T @ (self.scene.K @ u - self.load + self.G.T @ (self.w * f))
        D, E = sp.block_diag(by_j), sp.block_diag(by_f)
        for shift in SHIFTS:
            A = self.reduced + shift * sp.diags(self.reduced.diagonal())
            try:
                return r, h, splu(sp.bmat([[A, self.B.T @ sp.diags(self.w)], [D @ self.B, E]], format="csc"))
            except RuntimeError:  # a part that nothing holds where it is
                continue
        return r, h, None

    def newton(self, u: np.ndarray) -> tuple[np.ndarray, float]:
        """The exact displacements, from an answer, and the last relative change; infinite: not found."""
        f, best, Z = self.f, np.inf, self.scene.Z
        for _ in range(STEPS):
            r, h, lu = self.residuals(u, f)
            step = np.full(len(r) + len(h), np.nan) if lu is None else lu.solve(-np.concatenate([r, h]))
            if not np.isfinite(step).all():
                break
            u, f = u + Z @ step[: len(r)], f + step[len(r) :]
            last = self.norm(Z @ step[: len(r)]) / max(self.norm(u), TINY)
            if last <= FOUND and last >= 0.5 * best or last < EPS:
                return u, last
            best = min(best, last)
        return u, np.inf


class Check:
    """The statements, at all steps, and how much of what is allowed was found of each."""

    def __init__(self, scene: Scene, head: dict[str, Any]) -> None:
        self.scene, self.error, self.imbalance = scene, float(head["error"]), float(head["imbalance"])
        self.failed: list[str] = []
        self.used: dict[str, float] = {}
        self.resolution = self.true = 0.0
        self.memory = [np.zeros((len(j.w) // j.k, max(j.k - 1, 1))) for j in scene.joints]

    def say(self, what: str, size: float, allowed: float, where: str) -> None:
        self.used[what] = max(self.used.get(what, 0.0), float(size) / max(float(allowed), TINY))
        if not size <= allowed:
            self.failed.append(f"{what}, {where}: {size:.2e}, at most {allowed:.2e}")

    def step(self, t: int) -> None:
        scene, at, u, f = self.scene, f"step {t}", self.scene.u[t], None
        step = Step(scene, t, self.memory)
        f, v, size = step.f, u.reshape(-1, scene.d), np.abs(u).max()
        off = [np.abs(v[scene.ties[:, 0]] - v[scene.ties[:, 1]]).max(initial=0.0)]
        off += [np.abs(v[n] @ rows.T - values[t]).max(initial=0.0) for n, rows, values in scene.rows]
        self.say("held", max(off), ROUNDING * EPS * size, at)
        q = scene.reaction[t]
        terms = np.abs(scene.load[t]) + np.abs(q) + abs(step.G).T @ (step.w * np.abs(f))
        rounding = ROUNDING * EPS * (terms + abs(scene.K) @ np.abs(u))
        total = step.norm(u)
        allowed = FACTOR * self.error
        # nodes and points, in the energy that they are worth
        r, h, lu = step.residuals(u, f)
        sharp = ROUNDING * EPS * (abs(step.G) @ np.abs(u) + self.per_point(step, step.c) * np.abs(f))
        if lu is None:
            return self.say("error", np.inf, 0.0, f"{at}, something is free")
        rng = np.random.default_rng(0)

        def response(r: np.ndarray, h: np.ndarray) -> np.ndarray:
            return scene.Z @ lu.solve(np.concatenate([r, h]))[: len(r)]

        def worth(r: np.ndarray, h: np.ndarray) -> float:
            return step.norm(response(r, h))

        random = response(scene.Z.T @ (rounding * rng.choice((-1.0, 1.0), len(u))), sharp * rng.choice((-1.0, 1.0), len(h)))
        noise, spread = step.norm(random), np.linalg.norm(random)
        self.resolution = max(self.resolution, noise / max(total, TINY))
        lack = worth(r, 0.0 * h)
        self.say("law", worth(0.0 * r, h), allowed * total + noise, at)
        self.balance(u, scene.load[t] + q - step.G.T @ (step.w * f), terms, rounding, at)
        self.say("reactions", worth(scene.Z.T @ q, 0.0 * h), allowed * total + noise, at)
        gap = 0.5 * lack**2
        for n, (own, joint, p) in enumerate(zip(step.own, step.joints, step.laws, strict=True)):
            fn, j = f[own].reshape(-1, joint.k), (joint.G @ u).reshape(-1, joint.k)
            self.say("cone", broken_cone(joint.kind, p, fn), ROUNDING * EPS, f"{joint.name}, {at}")
            hn, reach = np.abs(h[own]), max(step.c[n] * np.abs(fn).max(), (abs(joint.G) @ np.abs(u)).max())
            self.say("law at every point", hn.max(), MISREAD * self.error * reach + sharp.max(), f"{joint.name}, {at}")
            gap += float(joint.w[:: joint.k] @ density(joint.kind, p, j, fn, self.memory[n]))
            self.memory[n] = remember(joint.kind, p, j, fn, self.memory[n])
        self.say("gap", gap, (allowed * total + noise) * total, at)
        exact, last = step.newton(u)
        if last > FOUND:
            return self.failed.append(f"error, {at}: Newton's method finds no exact solution from the answer")
        self.true = max(self.true, step.norm(u - exact) / max(total, TINY))
        self.say("error", step.norm(u - exact), allowed * total + noise, at)
        self.say("displacement", np.linalg.norm(u - exact), allowed * np.linalg.norm(exact) + spread, at)

    @staticmethod
    def per_point(step: Step, values: list[float]) -> np.ndarray:
        return np.concatenate([np.zeros(0), *(np.full(len(j.w), v) for j, v in zip(step.joints, values, strict=True))])

    def balance(self, u: np.ndarray, acting: np.ndarray, terms: np.ndarray, rounding: np.ndarray, at: str) -> None:
        """Forces and moments of every part, and forces at its nodes, relative to all that acts on it."""
        scene, d, unit = self.scene, self.scene.d, 1.0 / np.sqrt(self.scene.K.diagonal())
        of = (acting, terms, rounding)
        rigid = [abs(scene.rigid.T @ acting), *(abs(scene.rigid).T @ each for each in of[1:])]
        rows = [each.reshape(len(scene.parts), -1) for each in rigid]
        nodes = [np.array([np.linalg.norm(each[s:e]) for s, e in itertools.pairwise(scene.starts)])
                 for each in (unit * (scene.K @ u - acting), unit * terms, unit * rounding)]  # fmt: skip
        for what, (left, whole, floor) in (
            ("force", [each[:, :d].max(axis=1) for each in rows]),
            ("moment", [each[:, d:].max(axis=1) for each in rows]),
            ("equilibrium", nodes),
        ):
            allowed = FACTOR * self.imbalance * whole + floor + ROUNDING * EPS * whole.max()
            for part, *each in zip(scene.parts, left, allowed, strict=True):
                self.say(what, *each, f"{part.name}, {at}")


def check(path: str) -> Check:
    """All statements of a file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            a = {name: file[name] for name in file.files}
        head = json.loads(str(a.pop("certificate")))
        need((head["format"], head["version"]) == ("latin-certificate", 1), "another format or version")
        found = Check(Scene(head, a), head)
        for t in range(len(found.scene.u)):
            found.step(t)
    except (OSError, KeyError, IndexError, TypeError, ValueError, np.linalg.LinAlgError, zipfile.BadZipFile) as error:
        raise Unreadable(f"{type(error).__name__}: {error}") from error
    return found


def main() -> int:
    worst = 0
    for path in [p for p in sys.argv[1:] if p!='-v'] or ["(no file is named)"]:
        try:
            found = check(path)
        except Unreadable as error:
            print(f"{path}: NOT READABLE: {error}")
            worst = 2
            continue
        if "-v" in sys.argv: print(found.resolution, {k: f"{v:.2g}" for k, v in found.used.items()})
        if not found.failed:
            print(f"{path}: VALID, error {found.error:.2e} (rounding here {found.resolution:.1e})")
            continue
        worst = max(worst, 1)
        print(f"{path}: NOT VALID", *found.failed, sep="\n  ")
    return worst


if __name__ == "__main__":
    sys.exit(main())
