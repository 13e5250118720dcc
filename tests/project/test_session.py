"""What a user meets at the keyboard: Ctrl-C, progress bars, the log."""

from __future__ import annotations

import logging
import os
import pty
import select
import signal
import subprocess
import sys
import termios
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend
from dolfinx_frontend import (
    Contact,
    Elastic,
    LinearElastic,
    LogNormal,
    Options,
    Scene,
    SceneError,
    assemble,
    geometry,
    progress,
    solve,
    sweep,
)
from dolfinx_frontend.common import interrupts
from dolfinx_frontend.solving import sample

MAIN = """
import sys, time, warnings
warnings.filterwarnings("ignore", "beyond the model")
import dolfinx_frontend as lf
from dolfinx_frontend.common.interrupts import TWICE

def problem(random=False):
    scene = lf.Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        block = lf.geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, block, lf.LinearElastic(100.0, 0.3), degree=2)
    k = lf.LogNormal("k", mean=30.0, cov=0.2) if random else 30.0
    scene.interface("layer", "left:x1", "right:x0", lf.Elastic(normal=k, tangential=10.0))
    scene.fix("left:x0")
    scene.traction("right:x1", (1.0, 0.2))
    return lf.assemble(scene)

ENDLESS = lf.Options(rtol=1e-15, max_iterations=10**8, stagnation_window=10**8, acceleration=0)
FAR = 1e6
once = [True]

def ready(iteration):
    if once and iteration.number == 10:
        once.clear()
        print("ready", flush=True)
"""


def start(script: str, *arguments: str, **settings: Any) -> subprocess.Popen[str]:
    """A Python process with the script, in which Ctrl-C is Python's."""
    head = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    command = [sys.executable, "-c", head + MAIN + script, *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **settings
    )


def wait_for(process: subprocess.Popen[str], word: str) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        if line.strip() == word:
            return
    raise AssertionError(process.communicate()[1])


def end(process: subprocess.Popen[str]) -> tuple[str, str]:
    try:
        return process.communicate(timeout=60)
    except subprocess.TimeoutExpired:
        process.kill()
        raise


def test_ctrl_c_returns_what_is_done() -> None:
    """A real SIGINT, from another process: solve ends, the script goes on and can be ended, too."""
    process = start("""
result = lf.solve(problem(), active="all", direction=FAR, options=ENDLESS, callback=ready)
print(result.status, result.converged, result.force("layer").shape)
print(result.table("layer").value("area", "layer"))
time.sleep(TWICE)
for _ in range(2):
    once.append(True)
    lf.solve(problem(), active="all", direction=FAR, options=ENDLESS, callback=ready)
print("not reached")
""")
    for _ in range(2):
        wait_for(process, "ready")
        process.send_signal(signal.SIGINT)
    wait_for(process, "ready")
    process.send_signal(signal.SIGINT)  # soon after: the loop ends
    out, err = end(process)
    assert process.returncode != 0 and "not reached" not in out
    assert "KeyboardInterrupt" in err and "ended as interrupted after" in err


def test_the_answer_of_an_interrupted_solve_is_whole() -> None:
    process = start("""
result = lf.solve(problem(), active="all", direction=FAR, options=ENDLESS, callback=ready)
print(result.status, result.converged, result.force("layer").shape)
print(result)
result.displacement("left")
""")
    wait_for(process, "ready")
    process.send_signal(signal.SIGINT)
    out, err = end(process)
    assert process.returncode == 0, err
    assert out.startswith("interrupted False (") and "Result(interrupted, " in out


@pytest.mark.parametrize("kind", ["sweep", "samples"])
def test_ctrl_c_and_a_checkpoint(kind: str, tmp_path: Path) -> None:
    """Finished points come back, and the same call goes on from the checkpoint."""
    script = """
import numpy as np
seen = []
kind, path = sys.argv[1:]
slow = lf.Options(rtol=1e-13, max_iterations=200, acceleration=0, snapshots=1, stagnation_window=10**8)
values = np.linspace(20.0, 40.0, 200)

def run():
    if kind == "sweep":
        return lf.sweep(problem(), {"layer.normal": values}, options=slow, direction=100.0, checkpoint=path,
                     progress=False)
    return lf.monte_carlo(problem(random=True), 200, options=slow, checkpoint=path, progress=False)

import logging
logging.getLogger("dolfinx_frontend.evaluate.sweep").disabled = True  # of points that do not converge
import threading, pathlib
class Tell(logging.Handler):
    def emit(self, record):
        seen.append(record)
        if len(seen) == 10:
            print("ready", flush=True)
log = logging.getLogger("latin_core.sweep")
log.setLevel(logging.DEBUG); log.addHandler(Tell()); log.propagate = False
result = run()
print(result.status, result.complete, int(result.finished.sum()))
print(result)
force = result.force("layer")
print(np.isfinite(force[result.finished]).all(), np.isnan(force[~result.finished]).all())
first = result.finished.copy()
try:
    print(result.quantity(lambda f: f.force("layer")[:, 0, 0]))
except (lf.SceneError, AttributeError) as error:
    print(type(error).__name__, error)
whole = run()
print(whole.complete, whole.status)
print(np.array_equal(whole.force("layer")[first], force[first]), len(whole.points.order))
"""
    process = start(script, kind, str(tmp_path / "points"))
    wait_for(process, "ready")
    process.send_signal(signal.SIGINT)
    out, err = end(process)
    assert process.returncode == 0, err
    lines = out.splitlines()
    status, complete, count = lines[0].split()
    assert (status, complete) == ("interrupted", "False") and 10 <= int(count) < 200
    assert "INTERRUPTED" in lines[1]
    assert lines[2] == "True True"
    if kind == "samples":
        assert f"SceneError sampling: interrupted after {count} of 200 points" in lines[3]
    assert lines[-2].startswith("True ")
    assert lines[-1] == f"True {200 - int(count)}"
    assert f"interrupted after {count} of 200 points (the checkpoint has them" in err


@pytest.fixture(scope="module")
def problem() -> Any:
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        block = geometry.box((1.0, 1.0), (2, 2), origin=(x0, 0.0))
        scene.substructure(name, block, LinearElastic(100.0, 0.3), degree=2)
    k = LogNormal("k", mean=30.0, cov=0.2)
    scene.interface("layer", "left:x1", "right:x0", Contact(gap=0.0, stiffness=k))
    scene.fix("left:x0")
    scene.fix("right:x1", (-0.01, 0.0))
    return assemble(scene)


def interrupting(monkeypatch: Any, number: int) -> None:
    """SIGINT at an iteration, counted over all points."""
    monkeypatch.setattr(interrupts, "_last_press", -np.inf)
    watch = interrupts.Interrupt.watch
    seen = []

    def watched(self: Any, callback: Any = None) -> Any:
        def press(iteration: Any) -> None:
            seen.append(iteration)
            if len(seen) == number:
                signal.raise_signal(signal.SIGINT)
            if callback is not None:
                callback(iteration)

        return watch(self, press)

    monkeypatch.setattr(interrupts.Interrupt, "watch", watched)


def test_statistics_of_an_interrupted_sampling_are_refused(problem: Any, monkeypatch: Any) -> None:
    germs = np.linspace(-1.0, 1.0, 20)[:, None]
    with monkeypatch.context() as patch:
        interrupting(patch, 12)
        result = sample(problem, germs, keep_states=True)
    assert not result.complete and result.status == "interrupted" and not result.converged
    assert 0 < result.finished.sum() < 20
    for refused in (
        lambda: result.table(),
        lambda: result.moments("layer"),
        lambda: result.moments("left"),
        lambda: result.quantity(lambda f: f.force("layer")[:, 0, 0]),
        lambda: result.save("never.h5"),
    ):
        with pytest.raises(SceneError, match="are neighbours and no fair sample"):
            refused()


def test_points_and_weights_of_a_sampling_are_checked(problem: Any) -> None:
    germs = np.linspace(-1.0, 1.0, 4)[:, None]
    with pytest.raises(SceneError, match=r"weights of shape \(3,\) for 4 points; one each"):
        sample(problem, germs, np.ones(3))
    with pytest.raises(SceneError, match=r"points of shape \(4, 2\), the problem has 1 germs: k"):
        sample(problem, np.tile(germs, 2))
    germs[2] = np.nan
    with pytest.raises(SceneError, match="germs"):
        sample(problem, germs)


def test_an_interrupted_check_of_a_chaos_is_no_check(problem: Any, monkeypatch: Any, caplog: Any) -> None:
    iterations = solve(problem, chaos=2, options=Options(rtol=1e-8)).iterations
    with monkeypatch.context() as patch:
        interrupting(patch, iterations + 5)
        result = solve(problem, chaos=2, options=Options(rtol=1e-8))
    assert result.converged and not result.trusted and result.checked == ()
    assert "sampling: interrupted after" in caplog.text
    assert "not checked" in repr(result)


def test_sweep_ends_when_a_callback_says_so(problem: Any) -> None:
    left = iter(range(25))

    def callback(_: Any) -> None:
        if next(left, None) is None:
            raise StopIteration

    result = sweep(problem, {"layer.stiffness": np.linspace(20, 40, 50)}, callback=callback)
    assert result.status == "interrupted" and 0 < result.finished.sum() < 50
    assert not result.converged[~result.finished].any()


# --- progress bars ---------------------------------------------------------------------------------
BARS = """
import dolfinx_frontend.common.progress
sys.modules["dolfinx_frontend.common.progress"]._DELAY = 0.0
if len(sys.argv) > 1:
    print(lf.progress(False))
p = problem()
lf.solve(p, active="all")
lf.sweep(p, {"layer.normal": [1.0, 2.0, 3.0]})
"""


def on_a_terminal(*arguments: str, size: tuple[int, int] = (0, 0), **environment: str) -> str:
    """What the script writes to its error stream, a terminal of so many rows and columns (0: untold)."""
    master, slave = pty.openpty()
    termios.tcsetwinsize(slave, size)
    process = subprocess.Popen(
        [sys.executable, "-c", MAIN + BARS, *arguments],
        stdout=subprocess.DEVNULL,
        stderr=slave,
        env=os.environ | environment,
    )
    os.close(slave)
    text = b""
    while select.select([master], [], [], 60)[0]:
        try:
            text += os.read(master, 4096)
        except OSError:  # the other end is closed
            break
    os.close(master)
    assert process.wait(60) == 0, text
    return text.decode()


def test_bars_are_drawn_on_a_terminal_only() -> None:
    pytest.importorskip("tqdm")
    text = on_a_terminal(size=(24, 100))
    for what in ("assemble", "solve", "sweep: 100%", "iterations="):
        assert what in text
    piped = subprocess.run([sys.executable, "-c", MAIN + BARS], capture_output=True, text=True, check=True)
    assert piped.stdout == piped.stderr == ""


@pytest.mark.night(guard="test_bars_are_drawn_on_a_terminal_only, test_the_switch_says_how_it_is")
def test_bars_of_a_terminal_without_size_and_none_if_switched_off() -> None:
    pytest.importorskip("tqdm")
    text = on_a_terminal()
    for what in ("assemble", "solve", "sweep: 100%", "iterations="):
        assert what in text
    assert on_a_terminal("off") == ""
    assert on_a_terminal(LATIN_PROGRESS="0") == ""


def test_the_switch_says_how_it_is() -> None:
    before = progress()
    try:
        assert progress(False) is False and progress() is False
        assert progress(True) is True
    finally:
        progress(before)


# --- the log ---------------------------------------------------------------------------------------
def test_phases_are_logged(caplog: Any) -> None:
    caplog.set_level(logging.INFO, logger="dolfinx_frontend")
    scene = Scene()
    block = geometry.box((1.0, 1.0, 1.0), (2, 2, 2))
    scene.substructure("a", block, LinearElastic(100.0, 0.3))
    scene.interface("springs", "a:x0", Elastic(normal=10.0, tangential=10.0))
    scene.traction("a:x1", (1.0, 0.0, 0.0))
    problem = assemble(scene)
    result = solve(problem, active=["springs"])
    sweep(problem, {"springs.normal": [1.0, 2.0]})
    messages = {r.name: r.getMessage() for r in caplog.records}
    assert f"assembled {problem.size} unknowns" in messages["dolfinx_frontend.assembly.assemble"]
    assert "plan: accelerated" in messages["dolfinx_frontend.plan.plan"]
    assert "factorised 1 bodies with" in messages["dolfinx_frontend.kernel.bridge"]
    said = [r.getMessage() for r in caplog.records if r.name.startswith("dolfinx_frontend.kernel")]
    assert said[1].startswith(f"converged after {result.iterations} iterations")
    assert said[-1].startswith("sweep: 2 of 2 points")
    assert all(r.levelno == logging.INFO for r in caplog.records)


def test_nothing_is_printed_by_default(capfd: Any) -> None:
    test_source = geometry.box((1.0, 1.0), (1, 1))
    scene = Scene()
    scene.substructure("a", test_source, LinearElastic(100.0, 0.3))
    scene.fix("a:x0")
    solve(assemble(scene))
    assert capfd.readouterr() == ("", "")
    assert dolfinx_frontend.progress() is True
