#!/usr/bin/env python3
"""Check certificates of answers with nothing but NumPy and SciPy: VALID, or the statements that fail.

    python3 check_certificate.py answer.npz ...

The file (docs/certificate.md) has meshes, elasticities, loads, supports, laws, displacements and forces.
Stiffnesses are assembled anew; then, at every time step: what is held stays where it is held; forces and
moments of every part balance, and so do the forces at its nodes; signs, cones and laws hold at every point;
both energies agree; and the exact solution of the discrete problem, found by Newton's method from the answer,
is not farther away than the error that is stated. Exit codes: 0 VALID, 1 a statement fails, 2 not readable.
"""

import itertools
import json
import sys

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu
from scipy.special import factorial

Array = np.ndarray
EPS = np.finfo(float).eps
ROUNDING = 100.0  # so many rounding errors of the terms of a sum are rounding
SHARP = 1e-9  # what holds but for rounding holds to this
FACTOR = 3.0  # an error is stated within this factor
MISREAD = 10.0  # what is true of the whole is true of a point within this one
STEPS = 40  # of Newton's method
SMALL, TINY = 1e-7, 1e-300
PAIRS = {2: ((0, 0), (1, 1), (0, 1)), 3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))}
KINDS = ("perfect", "elastic", "force", "contact", "coulomb", "preload", "debonding")


def need(good: object, what: str) -> None:
    if not np.all(good):
        raise ValueError(what)


# --- parts -----------------------------------------------------------------------------------------
def exponents(d: int, p: int, simplex: bool) -> Array:
    every = itertools.product(range(p + 1), repeat=d)
    return np.array([e for e in every if not simplex or sum(e) <= p])


def tabulate(nodes: Array, p: int, simplex: bool, x: Array) -> tuple[Array, Array]:
    """Lagrange functions (points, n) of nodes on the reference cell, and gradients (points, n, d)."""
    e = exponents(x.shape[1], p, simplex)
    inverse = np.linalg.inv(np.prod(nodes[:, None] ** e, axis=2))
    lower = np.maximum(e - np.eye(x.shape[1], dtype=int)[:, None], 0)
    slopes = e.T[:, None] * np.prod(x[:, None] ** lower[:, None], axis=3)
    return np.prod(x[:, None] ** e, axis=2) @ inverse, (slopes @ inverse).transpose(1, 2, 0)


class Part:
    """Stiffness K (n, n) and rigid motions (n, r) of a part."""

    def __init__(self, told: dict, a: dict[str, Array]) -> None:
        self.name, p, order = told["name"], told["degree"], told["order"]
        nodes, x, cells, dofs, C = (a[name] for name in ("nodes", "x", "cells", "dofs", "elasticity"))
        (count, d), simplex = nodes.shape, told["cell"] in ("triangle", "tetrahedron")
        e = exponents(d, 2 * (p - simplex), simplex)
        exact = np.prod(factorial(e), 1) / factorial(d + e.sum(1)) if simplex else 1.0 / np.prod(1 + e, 1)
        rule = a["weights"] @ np.prod(a["points"][:, None] ** e, axis=2)
        need(abs(rule - exact) < SHARP, f"{self.name}: its quadrature is not exact for its degree")
        good = [np.linalg.eigvalsh(C + C.T).min() > 0.0, abs(C - C.T).max() <= SHARP * C.max()]
        need(good, f"{self.name}: its elasticity is not symmetric and positive")
        if "E" in told:
            E, nu, plane = told["E"], told["nu"], d == 2 and told["plane"] == "stress"
            own = np.diag([2.0] * d + [1.0] * (len(C) - d)) * E / (2.0 + 2.0 * nu)
            own[:d, :d] += E * nu / ((1.0 - nu**2) if plane else (1.0 + nu) * (1.0 - 2.0 * nu))
            need(abs(C - own) <= SHARP * C.max(), f"{self.name}: E and nu give another elasticity")
        size = np.ptp(x, axis=0).max()
        places = tabulate(a["mapping"], order, simplex, a["reference"])[0] @ x[cells]
        good = [abs(places - nodes[dofs]).max() <= SHARP * size, np.unique(dofs).size == count]
        need(good, f"{self.name}: nodes that are not in their cells")
        to_x = tabulate(a["mapping"], order, simplex, a["points"])[1]
        to_u, n = tabulate(a["reference"], p, simplex, a["points"])[1], dofs.shape[1]
        blocks, signs, strain = np.zeros((len(cells), n * d, n * d)), 0.0, np.zeros((len(C), d, d))
        for row, (i, k) in enumerate(PAIRS[d]):
            strain[row, i, k] = strain[row, k, i] = 1.0
        for w, geometry, shape in zip(a["weights"], to_x, to_u, strict=True):
            J = np.einsum("cni,nk->cik", x[cells], geometry)
            det, grad = np.linalg.det(J), shape @ np.linalg.inv(J)
            signs = signs + np.sign(det)
            B = np.einsum("rik,cnk->crni", strain, grad).reshape(len(cells), -1, n * d)
            blocks += (w * abs(det))[:, None, None] * (B.transpose(0, 2, 1) @ (C @ B))
        need(abs(signs) == len(to_x), f"{self.name}: cells inside out")
        rows = (d * dofs[:, :, None] + np.arange(d)).reshape(len(cells), -1)
        at = [np.broadcast_to(r, blocks.shape).ravel() for r in (rows[:, :, None], rows[:, None, :])]
        self.K = sp.csr_matrix((blocks.ravel(), at), shape=(count * d, count * d))
        y, unit = (nodes - nodes.mean(axis=0)) / size, np.eye(d)
        turns = [np.outer(unit[i], unit[k]) for i, k in itertools.combinations(range(d), 2)]
        modes = [np.tile(row, (count, 1)) for row in unit] + [y @ (turn - turn.T) for turn in turns]
        self.rigid = np.stack([each.ravel() for each in modes], axis=1)


# --- laws ------------------------------------------------------------------------------------------
class Joint:
    """An interface with forces (m, k) at points: G (k m, all unknowns) makes the jump, w2 - w1."""

    def __init__(self, told: dict, a: dict[str, Array], parts: list[Part], starts: Array) -> None:
        self.name, self.kind, self.force = told["name"], told["kind"], a["force"]
        need(a["weights"] > 0.0, f"{self.name}: weights that are not positive")
        self.k, self.w = self.force.shape[2], np.repeat(a["weights"], self.force.shape[2])
        self.G, every = sp.csr_matrix((len(self.w), starts[-1])), sp.identity(starts[-1], format="csr")
        for s, k in enumerate(told["sides"]):
            arrays = tuple(a[f"trace{s}.{name}"] for name in ("data", "indices", "indptr"))
            T = sp.csr_matrix(arrays, shape=(len(self.w), len(parts[k].rigid)))
            self.G = self.G + (2.0 * s - 1.0) * (T @ every[starts[k] : starts[k + 1]])
        self.laws = {name: a[f"law.{name}"] for name in told["parameters"]}


class Law:
    """f = R(z) with z = j + c f, for any c > 0; forces and jumps are (m, k), parameters (m, 1) or (m, k)."""

    def __init__(self, joint: Joint, t: int) -> None:
        self.kind, (m, self.k) = joint.kind, joint.force[t].shape
        self.p = p = {name: v[t].reshape(m, -1) for name, v in joint.laws.items()}
        self.jump, self.kappa = p.get("jump", np.zeros((m, self.k))), np.zeros((m, self.k))
        self.soft, self.soft_t = p.get("compliance", 0.0), p.get("tangential_compliance", 0.0)
        self.steep = p["normal"].max() if self.kind == "debonding" else 0.0
        if self.kind == "elastic":
            self.kappa[:] = np.hstack([p["normal"], np.repeat(p["tangential"], self.k - 1, axis=1)])

    def bound(self, f: Array) -> Array:
        """Of friction, (m, 1)."""
        rough = self.p.get("threshold", 0.0) - self.p.get("friction", 0.0) * f[:, :1]
        return np.where(f[:, :1] < 0.0, rough, 0.0)

    def opening(self, j: Array, before: Array) -> tuple[Array, Array, Array]:
        """Of a bond: the largest so far, and those at which damage begins and ends."""
        p, first = self.p, self.p["strength"] / self.p["normal"]
        last = p.get("opening", 0.0) + 2.0 * p.get("energy", 0.0) / p["strength"]
        slid = p["tangential"] / p["normal"] * (j[:, 1:] ** 2).sum(axis=1, keepdims=True)
        now = np.sqrt(np.maximum(j[:, :1], 0.0) ** 2 + slid)
        return np.maximum(np.maximum(now, before[:, :1]), first), first, last

    def force(self, z: Array, c: float, before: Array) -> Array:
        p, z, f = self.p, z - self.jump, np.zeros_like(z)
        if self.kind == "perfect":
            return z / c
        if self.kind == "force":
            return p["force"] + f
        if self.kind == "elastic":
            return self.kappa * z / (1.0 + c * self.kappa)
        if self.kind == "preload":
            fixed = (z[:, :1] - before[:, :1] - p.get("slack", 0.0)) / (c + self.soft)
            given = np.where(p["locked"] < 0.0, 0.0, p["force"])
            return np.hstack([np.where(p["locked"] > 0.0, fixed, given), z[:, 1:] / c])
        if self.kind == "debonding":  # a function of the jump: c is 0
            largest, first, last = self.opening(z, before)
            left = 1.0 - np.clip(last * (largest - first) / (largest * (last - first)), 0.0, 1.0)
            f[:, :1] = p["normal"] * np.where(z[:, :1] > 0.0, left, 1.0) * z[:, :1]
            f[:, 1:] = left * p["tangential"] * z[:, 1:]
            return f
        f[:, :1] = np.minimum(0.0, (z[:, :1] + p["gap"]) / (c + self.soft))
        trial = (z[:, 1:] - before) / (c + self.soft_t)
        size = np.maximum(np.linalg.norm(trial, axis=1, keepdims=True), TINY)
        f[:, 1:] = trial * np.minimum(1.0, self.bound(f) / size)
        return f

    def memory(self, j: Array, f: Array, before: Array) -> Array:
        """Slips, the length of a bolt where it was tightened, or the largest opening of a bond."""
        j = j - self.jump
        if self.kind == "preload":
            return np.where(self.p["locked"] > 0.0, before[:, :1], j[:, :1] - self.soft * f[:, :1])
        return self.opening(j, before)[0] if self.kind == "debonding" else j[:, 1:] - self.soft_t * f[:, 1:]

    def beyond(self, f: Array) -> float:
        """How far forces leave the set that the law allows, over the largest; 0: they do not."""
        slid = np.linalg.norm(f[:, 1:], axis=1) - self.bound(f)[:, 0]
        out = max(0.0, f[:, 0].max(), slid.max()) if self.kind in ("contact", "coulomb") else 0.0
        return float(out / max(abs(f).max(), TINY))

    def gap(self, j: Array, f: Array, before: Array) -> Array:
        """phi(j) + phi*(f) - j f >= 0 (m,) of an energy phi, with j moved to where that is finite."""
        j, fn, some = j - self.jump, f[:, 0], self.kappa > 0.0
        if self.kind not in ("contact", "coulomb"):
            return ((f - self.kappa * j) ** 2 / (2.0 * np.where(some, self.kappa, np.inf))).sum(axis=1)
        x, soft = j[:, 0] + self.p["gap"][:, 0], self.p["compliance"][:, 0]
        pressed = np.where(soft > 0.0, np.minimum(x, 0.0) / np.where(soft > 0.0, soft, 1.0), fn)
        slip = j[:, 1:] - self.soft_t * f[:, 1:] - before
        rubbed = self.bound(f)[:, 0] * np.linalg.norm(slip, axis=1) - (f[:, 1:] * slip).sum(axis=1)
        closed = 0.5 * soft * (fn - np.where(x < 0.0, pressed, 0.0)) ** 2
        return closed - fn * np.maximum(x, 0.0) + rubbed


# --- the whole -------------------------------------------------------------------------------------
class Scene:
    """All parts as one: stiffness K (n, n), u = Z y + what is prescribed."""

    def __init__(self, head: dict, a: dict[str, Array]) -> None:
        of = lambda key: {k[len(key) :]: v for k, v in a.items() if k.startswith(key)}  # noqa: E731
        need([np.isfinite(v).all() for v in a.values() if v.dtype.kind == "f"], "numbers that are not finite")
        own = [of(f"part{k}.") for k in range(len(head["parts"]))]
        self.parts = [Part(*each) for each in zip(head["parts"], own, strict=True)]
        self.starts, self.d = np.cumsum([0, *(len(part.rigid) for part in self.parts)]), own[0]["x"].shape[1]
        self.K = sp.block_diag([part.K for part in self.parts], format="csr")
        self.rigid = sp.block_diag([part.rigid for part in self.parts], format="csr")
        names = ("load", "displacement", "reaction")
        self.load, self.u, self.reaction = (np.hstack([each[name] for each in own]) for name in names)
        given = [(told, of(f"interface{k}.")) for k, told in enumerate(head["interfaces"])]
        self.joints = [Joint(t, i, self.parts, self.starts) for t, i in given if t["kind"] in KINDS]
        self.hold([(t, i) for t, i in given if t["kind"] not in KINDS])

    def hold(self, given: list[tuple[dict, dict[str, Array]]]) -> None:
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
        held = np.zeros((clusters, d, d))
        for nodes, rows, _ in self.rows:
            np.add.at(held, of_node[nodes], rows.T @ rows)
        size, axes = np.linalg.eigh(held)
        free = np.where(size[:, None] < SHARP, axes, 0.0)
        blocks = free[of_node] / np.sqrt(np.bincount(of_node))[of_node, None, None]
        Z = sp.bsr_matrix((blocks, of_node, np.arange(count + 1)), shape=(count * d, clusters * d)).tocsc()
        self.Z = Z[:, np.asarray(abs(Z).sum(axis=0)).ravel() > 0.0].tocsr()


class Step:
    """The equations of one time step, r = 0 at the nodes and h = c (f - R(j + c f)) = 0 at the points."""

    def __init__(self, scene: Scene, t: int, memory: list[Array]) -> None:
        self.scene, self.memory, self.joints, Z = scene, memory, scene.joints, scene.Z
        self.laws, self.u, self.load = [Law(joint, t) for joint in self.joints], scene.u[t], scene.load[t]
        nothing, counts = sp.csr_matrix((0, scene.starts[-1])), [len(joint.w) for joint in self.joints]
        self.G = sp.vstack([nothing, *(joint.G for joint in self.joints)], format="csr")
        self.w = np.hstack([np.zeros(0), *(joint.w for joint in self.joints)])
        self.f = np.hstack([np.zeros(0), *(joint.force[t].ravel() for joint in self.joints)])
        self.own = [slice(*each) for each in itertools.pairwise(np.cumsum([0, *counts]))]
        soft = self.G.multiply(self.G) @ (1.0 / scene.K.diagonal()) * self.w
        both = zip(self.own, self.laws, strict=True)
        self.c = [float(1.0 / (1.0 / soft[own].mean() + law.steep)) for own, law in both]
        self.softness = np.repeat(np.array(self.c), np.array(counts, dtype=int))
        kappa = np.hstack([np.zeros(0), *(law.kappa.ravel() for law in self.laws)])
        self.A = scene.K + self.G.T @ sp.diags(self.w * kappa) @ self.G
        self.reduced, self.B = Z.T @ scene.K @ Z, (self.G @ Z).tocsr()

    def norm(self, u: Array, springs: bool = False) -> float:
        """Energy norm of the parts, or with that of the springs."""
        return float(np.sqrt(np.maximum(0.0, u @ ((self.A if springs else self.scene.K) @ u))))

    def residuals(self, u: Array, f: Array) -> tuple:
        """r, h, and the factors of their derivatives by y and f."""
        Z, j, h, none = self.scene.Z, self.G @ u, np.zeros(len(f)), sp.csr_matrix((0, 0))
        by_j, by_f = [none], [none]
        for own, law, c, before in zip(self.own, self.laws, self.c, self.memory, strict=True):
            k, inside = law.k, 0.0 if law.kind == "debonding" else c
            z = (j[own] + inside * f[own]).reshape(-1, k)
            unit = SMALL * max(abs(z).max(), c * abs(f[own]).max(), TINY)
            both = [[law.force(z + s * unit * e, inside, before) for s in (1, -1)] for e in np.eye(k)]
            slopes = c * np.stack([(up - down) / (2.0 * unit) for up, down in both], axis=2)
            R = sp.bsr_matrix((slopes, np.arange(len(z)), np.arange(len(z) + 1)), shape=(z.size, z.size))
            h[own] = c * (f[own] - law.force(z, inside, before).ravel())
            by_j.append(-R)
            by_f.append((1.0 + SMALL) * c * sp.identity(z.size) - inside * R)  # forces need not be unique
        r = Z.T @ (self.scene.K @ u - self.load + self.G.T @ (self.w * f))
        D, E = sp.block_diag(by_j) @ self.B, sp.block_diag(by_f)
        return r, h, splu(sp.bmat([[self.reduced, self.B.T @ sp.diags(self.w)], [D, E]], format="csc"))

    def newton(self, inexact: float) -> tuple[Array, Array]:
        """The exact answer, from that which is stated: steps fall no more, and are below a share; or NaN."""
        u, f, best, Z = self.u, self.f, np.inf, self.scene.Z
        for _ in range(STEPS):
            r, h, lu = self.residuals(u, f)
            step = lu.solve(-np.concatenate([r, h]))
            moved = Z @ step[: len(r)]
            u, f = u + moved, f + step[len(r) :]
            last = self.norm(moved) / max(self.norm(u, springs=True), TINY)
            if max(SHARP, inexact) >= last >= 0.5 * best or last < EPS:
                return u, f
            best = min(best, last)
        return np.full(len(u), np.nan), f


class Check:
    """The statements, at all steps, and how much of what is allowed was found of each."""

    def __init__(self, scene: Scene, head: dict) -> None:
        self.scene, self.error, self.imbalance = scene, float(head["error"]), float(head["imbalance"])
        self.failed, self.used = list[str](), dict[str, float]()
        self.resolution = 0.0
        start = [np.zeros((j.force[0].shape[0], max(j.k - 1, 1))) for j in scene.joints]
        self.memory, self.exact = list(start), list(start)  # of the answer, and of the exact one
        for t in range(len(scene.u)):
            try:
                self.step(t, f"step {t}")
            except RuntimeError:  # the factorisation is singular
                self.failed.append(f"error, step {t}: a part is free")

    def say(self, what: str, size: float, allowed: float, where: str) -> None:
        self.used[what] = max(self.used.get(what, 0.0), float(size) / max(float(allowed), TINY))
        if not size <= allowed:
            self.failed.append(f"{what}, {where}: {size:.2e}, at most {allowed:.2e}")

    def step(self, t: int, at: str) -> None:
        scene, step, q = self.scene, Step(self.scene, t, self.memory), self.scene.reaction[t]
        u, f, v = step.u, step.f, step.u.reshape(-1, scene.d)
        off = [abs(v[scene.ties[:, 0]] - v[scene.ties[:, 1]]).max(initial=0.0)]
        off += [abs(v[n] @ rows.T - values[t]).max(initial=0.0) for n, rows, values in scene.rows]
        self.say("held", max(off), ROUNDING * EPS * abs(u).max(), at)
        terms = abs(step.load) + abs(q) + abs(step.G).T @ (step.w * abs(f))
        rounding = ROUNDING * EPS * (terms + abs(scene.K) @ abs(u))
        self.balance(u, step.load + q - step.G.T @ (step.w * f), terms, rounding, at)
        r, h, lu = step.residuals(u, f)

        def response(r: Array, h: Array) -> Array:
            return scene.Z @ lu.solve(np.concatenate([r, h]))[: len(r)]

        moved = abs(step.G) @ abs(u)
        sharp, work = ROUNDING * EPS * (moved + step.softness * abs(f)), step.w @ (abs(f) * moved)
        signs = np.random.default_rng(0).choice((-1.0, 1.0), len(u) + len(h))
        random = response(scene.Z.T @ (rounding * signs[: len(u)]), sharp * signs[len(u) :])
        noise, total, allowed = step.norm(random), step.norm(u, springs=True), FACTOR * self.error
        most, spread, size = allowed * total + noise, np.linalg.norm(random), np.linalg.norm(u)
        self.resolution = max(self.resolution, noise / max(total, TINY), spread / max(size, TINY))
        aside, balanced = step.norm(response(scene.Z.T @ q, 0.0 * h)), FACTOR * self.imbalance * total + noise
        self.say("reactions", aside, balanced, at)
        gap, step.memory = 0.5 * step.norm(response(r, 0.0 * h)) ** 2, self.exact
        exact, forces = step.newton(max(noise / max(total, TINY), self.error / MISREAD))
        self.say("error", step.norm(u - exact), most, at)
        self.say("displacement", np.linalg.norm(u - exact), allowed * size + spread, at)
        for n, (own, joint, law) in enumerate(zip(step.own, step.joints, step.laws, strict=True)):
            every = (step.G @ u, f, step.G @ exact, forces)
            j, fn, *its = (each[own].reshape(-1, law.k) for each in every)
            self.say("cone", law.beyond(fn), ROUNDING * EPS, f"{joint.name}, {at}")
            reach = MISREAD * self.error * max(step.c[n] * abs(fn).max(), moved[own].max())
            self.say("law at every point", abs(h[own]).max(), reach + sharp.max(), f"{joint.name}, {at}")
            gap += float(joint.w[:: joint.k] @ law.gap(j, fn, self.memory[n]))
            self.memory[n], self.exact[n] = law.memory(j, fn, self.memory[n]), law.memory(*its, self.exact[n])
        self.say("gap", gap, most * total + MISREAD * self.error * work, at)

    def balance(self, u: Array, acting: Array, terms: Array, rounding: Array, at: str) -> None:
        """Forces and moments of every part, and forces at its nodes, relative to all that acts on it."""
        scene, R, unit = self.scene, self.scene.rigid.T, 1.0 / np.sqrt(self.scene.K.diagonal())
        rows = [v.reshape(len(scene.parts), -1) for v in (abs(R @ acting), abs(R) @ terms, abs(R) @ rounding)]
        of = (unit * (scene.K @ u - acting), unit * terms, unit * rounding)
        nodes = [np.sqrt(np.add.reduceat(each**2, scene.starts[:-1])) for each in of]
        forces, moments = zip(*([e.max(axis=1) for e in np.split(v, [scene.d], axis=1)] for v in rows))
        for what, (left, whole, floor) in (("force", forces), ("moment", moments), ("equilibrium", nodes)):
            allowed = FACTOR * self.imbalance * whole + floor + ROUNDING * EPS * whole.max()
            for part, size, most in zip(scene.parts, left, allowed, strict=True):
                self.say(what, size, most, f"{part.name}, {at}")


def check(path: str) -> Check:
    """All statements of a file."""
    with np.load(path, allow_pickle=False) as file:
        a = {name: file[name] for name in file.files}
    head = json.loads(str(a.pop("certificate")))
    need((head["format"], head["version"]) == ("latin-certificate", 1), "another format or version")
    return Check(Scene(head, a), head)


def main() -> int:
    worst = 0 if sys.argv[1:] else 2
    for path in sys.argv[1:]:
        try:
            found = check(path)
            told = f"error {found.error:.2e}, balance {found.imbalance:.2e}, rounding {found.resolution:.1e}"
            print(f"{path}: {'NOT ' if found.failed else ''}VALID, {told}", *found.failed, sep="\n  ")
            worst = max(worst, int(bool(found.failed)))
        except Exception as error:  # whatever is wrong with a file
            print(f"{path}: NOT READABLE: {type(error).__name__}: {error}")
            worst = 2
    return worst


if __name__ == "__main__":
    sys.exit(main())
