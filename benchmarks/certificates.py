"""Do valid certificates pass, and spoiled ones fail? Scenes of the campaign, solved, certified, checked.

Each scene is drawn as in ``./run bench campaign``, static or a history, solved with random settings; its
certificate is checked by ``tools/check_certificate.py``. Then one thing in it is spoiled by ten times the
error that it states (or that rounding allows to see, where that is larger), and it must fail. What a
certificate refuses (laws of the user) and what has no answer is drawn again.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import sys
import tempfile
import threading
from collections import Counter
from pathlib import Path
from time import perf_counter
from types import ModuleType
from typing import Any

import numpy as np

TEN = 10.0
ATTEMPTS = 6
PLACE = 1e-300
QUIET = 1e-6
"""Forces on a part below this share of those on another one are none."""
TRIAL = 1e-3
"""Relative change of a law by which its worth is measured."""
LARGE = 0.1
"""Largest relative change of a law."""


def seed_of(campaign: int, number: int) -> int:
    """Seed of a scene, as that of ``./run bench campaign``."""
    return int(hashlib.sha256(f"{campaign} {number}".encode()).hexdigest()[:14], 16)


def checker() -> ModuleType:
    """``tools/check_certificate.py``."""
    path = Path(__file__).resolve().parent.parent / "tools" / "check_certificate.py"
    found = importlib.util.spec_from_file_location("check_certificate", path)
    assert found is not None and found.loader is not None
    module = importlib.util.module_from_spec(found)
    sys.modules["check_certificate"] = module
    found.loader.exec_module(module)
    return module


class Spoiler:
    """Ways to spoil a certificate, by so many times what it states; each gives other arrays; None: no place.

    Displacements are spoiled in energy, or by their size; forces by what the balance of a part lacks; a law
    by what follows from the change, to first order.

    Parameters
    ----------
    path
        Of a valid one.
    seed
        Of what is drawn: the step, the part, the interface.
    """

    def __init__(self, path: Path, seed: int, times: float = TEN) -> None:
        self.tool = checker()
        with np.load(path, allow_pickle=False) as file:
            self.arrays = {name: file[name] for name in file.files}
        self.head = json.loads(str(self.arrays["certificate"]))
        self.scene = self.tool.Scene(self.head, {k: v for k, v in self.arrays.items() if k != "certificate"})
        found = self.tool.check(str(path))
        self.rng = np.random.default_rng(seed)
        self.true = found.used["error"] * self.tool.FACTOR * found.error
        self.resolution = found.resolution
        self.error = times * max(found.error, found.resolution)
        self.imbalance = times * max(found.imbalance, found.resolution)
        self.t = int(self.rng.integers(len(self.scene.u)))
        self.u, self.times = self.scene.u[self.t], times
        named = [k for k, i in enumerate(self.head["interfaces"]) if i["kind"] not in ("support", "glued")]
        self.joints = list(zip(named, self.scene.joints, strict=True))
        self.step = self._step()
        self.total = self.step.norm(self.u, springs=True)

    def _step(self) -> Any:
        memory = [np.zeros((len(j.w) // j.k, max(j.k - 1, 1))) for j in self.scene.joints]
        for t in range(self.t):
            for n, joint in enumerate(self.scene.joints):
                f = joint.force[t].reshape(-1, joint.k)
                j = (joint.G @ self.scene.u[t]).reshape(-1, joint.k)
                memory[n] = self.tool.Law(joint, t).memory(j, f, memory[n])
        return self.tool.Step(self.scene, self.t, memory)

    def changed(self, name: str, values: Any) -> dict[str, Any]:
        """The arrays with other values of one at the step."""
        new = np.array(self.arrays[name])
        new[self.t] = np.reshape(values, new[self.t].shape)
        return {**self.arrays, name: new}

    def moved(self, v: np.ndarray, size: float) -> dict[str, Any] | None:
        """With a displacement (n,) added."""
        if not np.isfinite(size) or not size > 0.0:
            return None
        out = dict(self.arrays)
        for k, (s, e) in enumerate(zip(self.scene.starts, self.scene.starts[1:], strict=False)):
            out |= {f"part{k}.displacement": self.changed(f"part{k}.displacement", (self.u + size * v)[s:e])[
                f"part{k}.displacement"]}  # fmt: skip
        return out

    # --- displacements -------------------------------------------------------------------------
    def displacement(self) -> dict[str, Any] | None:
        """A random displacement, in energy."""
        v = self.scene.Z @ self.rng.standard_normal(self.scene.Z.shape[1])
        return self.moved(v, self.error * self.total / max(self.step.norm(v), PLACE))

    def larger(self) -> dict[str, Any] | None:
        """All displacements that are free, larger or smaller."""
        v = self.scene.Z @ (self.scene.Z.T @ self.u) * self.rng.choice((-1.0, 1.0))
        return self.moved(v, self.error * self.total / max(self.step.norm(v), PLACE))

    def shifted(self) -> dict[str, Any] | None:
        """A part moved as it is, relative to all displacements."""
        rigid = self.scene.rigid.toarray()
        v = self.scene.Z @ (self.scene.Z.T @ rigid[:, self.rng.integers(rigid.shape[1])])
        size = np.linalg.norm(v)
        if size < 1e-6 * np.sqrt(len(v)):
            return None
        return self.moved(v, self.error * float(np.linalg.norm(self.u)) / size)

    def support(self) -> dict[str, Any] | None:
        """A support that gives way."""
        if not self.scene.rows:
            return None
        nodes, rows, _ = self.scene.rows[self.rng.integers(len(self.scene.rows))]
        v = np.zeros((len(self.u) // self.scene.d, self.scene.d))
        v[nodes] = rows[0]
        return self.moved(v.ravel(), self.error * float(np.abs(self.u).max()))

    # --- forces --------------------------------------------------------------------------------
    def force(self) -> dict[str, Any] | None:
        """The force of an interface, point by point, as much as one of its parts is out of balance."""
        name, joint = self.joints[self.rng.integers(len(self.joints))]
        f = joint.force[self.t].ravel()
        change = np.abs(f).max() * self.rng.uniform(0.5, 1.5, len(f)) * self.rng.choice((-1.0, 1.0))
        unit, terms = 1.0 / np.sqrt(self.scene.K.diagonal()), self.terms()
        rounding = self.tool.ROUNDING * self.tool.EPS * (terms + abs(self.scene.K) @ np.abs(self.u))
        every = (unit * (joint.G.T @ (joint.w * change)), unit * terms, unit * rounding)
        nodal, whole, floor = (np.array([np.linalg.norm(v[s:e]) for s, e in self.spans()]) for v in every)
        floor += self.tool.ROUNDING * self.tool.EPS * whole.max()
        seen = np.maximum(self.imbalance * np.maximum(whole, QUIET * whole.max()), self.times * floor)
        ratio = float((nodal / np.maximum(seen, PLACE)).max())
        return None if ratio == 0.0 else self.changed(f"interface{name}.force", f + change / ratio)

    def spans(self) -> list[tuple[int, int]]:
        """Where the unknowns of every part begin and end."""
        return list(zip(self.scene.starts, self.scene.starts[1:], strict=False))

    def terms(self) -> np.ndarray:
        """Sizes of all forces at the nodes."""
        out = np.abs(self.scene.load[self.t]) + np.abs(self.scene.reaction[self.t])
        return out + sum(abs(j.G).T @ (j.w * np.abs(j.force[self.t].ravel())) for j in self.scene.joints)

    def balance(self) -> dict[str, Any] | None:
        """A part out of balance: a load that nothing carries."""
        k = int(self.rng.integers(len(self.scene.parts)))
        s, e = self.spans()[k]
        d = self.scene.d
        whole = self.terms()[s:e].reshape(-1, d)
        axis = int(np.argmax(whole.sum(axis=0)))
        if not whole[:, axis].sum() > 1e-9 * self.terms().max():
            return None
        load = np.array(self.arrays[f"part{k}.load"][self.t]).reshape(-1, d)
        inner = (abs(self.scene.parts[k].K) @ np.abs(self.u[s:e])).reshape(-1, d)
        of_all = (whole + inner)[:, axis].sum() + self.terms().sum()  # rounding passes from part to part
        rounding = self.tool.ROUNDING * self.tool.EPS * of_all
        size = max(self.imbalance * whole[:, axis].sum(), self.times * rounding)
        load[:, axis] += size / len(load)
        return self.changed(f"part{k}.load", load)

    def sign(self) -> dict[str, Any] | None:
        """A contact that pulls."""
        pressed = self.of_kind("contact", "coulomb")
        if pressed is None:
            return None
        name, joint, f = pressed
        f[np.argmin(f[:, 0]), 0] = self.error * np.abs(f).max()
        return self.changed(f"interface{name}.force", f)

    def of_kind(self, *kinds: str) -> tuple[int, Any, np.ndarray] | None:
        """An interface of some kinds under load: its number, itself and its force (m, k)."""
        for n in self.rng.permutation(len(self.joints)):
            name, joint = self.joints[n]
            f = np.array(joint.force[self.t]).reshape(-1, joint.k)
            if joint.kind in kinds and np.abs(f).max() > 1e-9 * max(np.abs(self.step.f).max(), PLACE):
                return name, joint, f
        return None

    def cone(self) -> dict[str, Any] | None:
        """A friction force beyond its bound."""
        rubbing = self.of_kind("coulomb")
        if rubbing is None:
            return None
        name, joint, f = rubbing
        worst = int(np.argmin(f[:, 0]))
        bound = float(self.tool.Law(joint, self.t).bound(f)[worst, 0])
        if not bound > 0.0 or not f[worst, 0] < 0.0:
            return None
        size = np.linalg.norm(f[worst, 1:])
        along = f[worst, 1:] / size if size > 0.0 else np.eye(joint.k - 1)[0]
        f[worst, 1:] = (bound + self.error * np.abs(f).max()) * along
        return self.changed(f"interface{name}.force", f)

    # --- laws ----------------------------------------------------------------------------------
    def law(self) -> dict[str, Any] | None:
        """A gap, a jump, a stiffness or a given force other than that of the answer."""
        n = int(self.rng.integers(len(self.joints)))
        name, joint = self.joints[n]
        known = {"contact": "gap", "coulomb": "gap", "perfect": "jump", "elastic": "normal", "force": "force"}
        key = f"interface{name}.law.{known.get(joint.kind, 'force')}"
        if key not in self.arrays:
            return None
        values = np.array(self.arrays[key][self.t])
        scale = np.abs(values).max() or np.abs(joint.G @ self.u).max() or 1.0
        trial = TRIAL * scale

        def left(arrays: dict[str, Any]) -> np.ndarray:
            kept = joint.laws
            joint.laws = {p: arrays[f"interface{name}.law.{p}"] for p in kept}
            step = self._step()
            joint.laws = kept
            r, h, lu = step.residuals(self.u, step.f)
            if lu is None:
                return np.zeros(len(self.u))
            return np.asarray(self.scene.Z @ lu.solve(np.concatenate([r, h]))[: len(r)])

        moved = left(self.changed(key, values + trial)) - left(self.arrays)
        worth = max(
            self.step.norm(moved) / max(self.total, PLACE),
            float(np.linalg.norm(moved) / max(np.linalg.norm(self.u), PLACE)),
        )
        if not np.isfinite(worth) or trial * self.error > LARGE * scale * worth:
            return None  # the answer hardly depends on it
        return self.changed(key, values + trial * self.error / worth)

    def stated(self) -> dict[str, Any] | None:
        """An error that is stated too small."""
        if not self.true > 300.0 * self.resolution:
            return None
        head = {**self.head, "error": self.true / self.times}
        return {**self.arrays, "certificate": np.array(json.dumps(head))}

    WAYS = (
        "displacement", "larger", "shifted", "support", "force", "balance", "sign", "cone", "law", "stated"
    )  # fmt: skip

    def spoiled(self) -> tuple[str, dict[str, Any]]:
        """One way that there is a place for, and the arrays."""
        for way in self.rng.permutation(self.WAYS):
            arrays = getattr(self, str(way))()
            if arrays is not None:
                return str(way), arrays
        raise ValueError("nothing can be spoiled")


def one(seed: int, kind: str, folder: Path) -> dict[str, Any]:
    """A scene: how it ended, whether its certificate is valid, and which way of spoiling it was seen."""
    import dolfinx_frontend as lf
    from campaign import scenes
    from campaign.judge import Case

    verdict: dict[str, Any] = {"seed": seed, "kind": kind, "outcome": "inadmissible"}
    for attempt in range(ATTEMPTS):
        verdict.pop("what", None)
        drawn = scenes.scene(seed, attempt, kind, 1)
        case = Case(drawn.source, drawn.kind)
        try:
            result = case.space["run"](case.assemble())
        except lf.SceneError:
            continue
        except (RuntimeError, MemoryError) as error:  # the campaign judges that
            verdict |= {"outcome": "raised", "what": str(error)}
            continue
        if not result.converged:
            verdict["outcome"] = result.status
            continue
        path = folder / "valid.npz"
        try:
            result.certificate(path)
        except lf.SceneError as error:
            verdict |= {"outcome": "refused", "what": str(error)}
            continue
        break
    else:
        return verdict
    tool = checker()
    found = tool.check(str(path))
    verdict |= {"outcome": "failed" if found.failed else "valid", "failed": found.failed, "used": found.used}
    verdict |= {"about": drawn.about, "stated": found.error, "resolution": found.resolution}
    verdict["bytes"] = path.stat().st_size
    if found.failed:
        return verdict
    way, arrays = Spoiler(path, seed % 2**32).spoiled()
    np.savez(folder / "spoiled.npz", **arrays)
    seen = tool.check(str(folder / "spoiled.npz")).failed
    return verdict | {"way": way, "seen": [each.split(",")[0] for each in seen]}


def worker() -> None:
    """One of the pool's processes."""
    import logging
    import warnings

    from campaign.pool import serve

    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    folder = Path(tempfile.mkdtemp())

    def verdict(task: dict[str, Any], phase: Any) -> dict[str, Any]:
        phase("scene")
        return one(task["seed"], task["kind"], folder)

    serve(verdict)


def run(seeds: list[tuple[int, str]], jobs: int, limit: float, until: float) -> list[dict[str, Any]]:
    """Verdicts on scenes, as many as are done until a time."""
    from campaign.pool import Seat, side_by_side

    verdicts: list[dict[str, Any]] = []
    lock = threading.Lock()

    def do(task: tuple[int, str], seat: Seat) -> None:
        if perf_counter() > until:
            return
        verdict = seat.run({"seed": task[0], "kind": task[1]})
        with lock:
            verdicts.append(verdict)
            bad = verdict["outcome"] in ("failed", "crashed") or verdict.get("seen") == []
            if bad:
                unseen = f"spoiled by {verdict.get('way')}: not seen"
                told = verdict.get("failed") or verdict.get("what") or unseen
                head = f"{verdict['outcome']:<10}{verdict['seed']} {verdict['kind']}"
                print(f"{head}: {told}"[:300], flush=True)

    side_by_side(seeds, jobs, lambda: Seat(limit, Path(__file__)), do)
    return verdicts


def main() -> int:
    if sys.argv[1:] == ["--worker"]:
        worker()
        return 0
    parser = argparse.ArgumentParser(
        prog="./run bench certificates",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--scenes", type=int, default=100, help="how many are drawn")
    parser.add_argument("--seed", type=int, default=0, help="of the campaign")
    parser.add_argument("--jobs", type=int, default=1, help="processes side by side")
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds a scene")
    parser.add_argument("--max-seconds", type=float, default=np.inf, help="after which no scene is begun")
    parser.add_argument("--json", type=Path, help="file to write the verdicts to")
    given = parser.parse_args()
    until = perf_counter() + given.max_seconds
    tasks = [
        (seed_of(given.seed, k), "history" if k % 3 == 2 else "static") for k in range(given.scenes)
    ]
    verdicts = run(tasks, given.jobs, given.time_limit, until)
    print(dict(Counter(v["outcome"] for v in verdicts).most_common()))
    checked = [v for v in verdicts if "way" in v]
    for way, count in sorted(Counter(v["way"] for v in checked).items()):
        seen = sum(bool(v["seen"]) for v in checked if v["way"] == way)
        print(f"spoiled by {way}: {seen} of {count} seen")
    valid = sum(v["outcome"] == "valid" for v in verdicts)
    failed = sum(v["outcome"] == "failed" for v in verdicts)
    seen = sum(bool(v["seen"]) for v in checked)
    print(f"valid {valid} of {valid + failed}, spoiled seen {seen} of {len(checked)}")
    if given.json is not None:
        given.json.write_text(json.dumps(verdicts, indent=1) + "\n")
    return int(failed > 0 or any(not v["seen"] for v in checked))


if __name__ == "__main__":
    sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
    sys.exit(main())
