"""What a user sees of a run: lines of the log, refusals in short, notebooks."""

from __future__ import annotations

import logging
import re
import signal
import subprocess
import sys
import time
import traceback
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.common import progress, tracebacks
from dolfinx_frontend.common.progress import Bar

SCRIPT = """import dolfinx_frontend as lf
{}
def of_mine():
    scene = lf.Scene()
    scene.substructure("bar", lf.geometry.box((1.0, 1.0), (1, 1)), lf.LinearElastic(1e3, 0.0))
    scene.fix("baar:x0")

of_mine()
"""


def test_a_phase_without_a_bar_is_told_in_the_log(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "EVERY", 0.02)
    with caplog.at_level(logging.INFO, "dolfinx_frontend"), Bar(3, "sweep") as bar:
        bar.step()
        with Bar(1, "factorise"):
            until = time.monotonic() + 60.0
            while not caplog.messages and time.monotonic() < until:
                time.sleep(0.01)
        count = len(caplog.messages)
        while len(caplog.messages) < count + 2 and time.monotonic() < until:
            time.sleep(0.01)
    assert re.fullmatch(r"factorise: \d+ s", caplog.messages[0])
    assert re.fullmatch(r"sweep: point 1 of 3, \d+ s", caplog.messages[-1])


def test_nothing_is_told_to_who_does_not_ask(caplog: pytest.LogCaptureFixture) -> None:
    with Bar(3, "sweep"):
        pass
    assert progress._teller is None or not caplog.messages


@pytest.mark.parametrize(("setting", "inside"), [("", False), ("lf.debug(True)", True)])
def test_a_refusal_ends_at_the_line_of_the_script(tmp_path: Path, setting: str, inside: bool) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(setting))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    lines = done.stderr.rstrip().splitlines()
    assert done.returncode == 1
    assert lines[-1].startswith("dolfinx_frontend.common.errors.SceneError: ")
    assert "did you mean 'bar'" in lines[-1]
    assert any('scene.fix("baar:x0")' in line for line in lines)
    assert any("dolfinx_frontend/scene" in line for line in lines) == inside


TERMINATED = """
import os, signal, threading, time
import dolfinx_frontend as lf

def caught():
    line = next(line for line in open("/proc/self/status") if line.startswith("SigCgt"))
    return int(line.split()[1], 16) >> signal.SIGTERM - 1 & 1

def terminate():
    signal.pthread_sigmask(signal.SIG_BLOCK, {{signal.SIGTERM}})
    while not caught() and not over:
        pass
    os.kill(os.getpid(), signal.SIGTERM)

scene, over = lf.Scene(), []
cube = lf.geometry.box((1.0, 1.0, 1.0), ({0}, {0}, {0}), cell="hexahedron")
scene.substructure("cube", cube, lf.LinearElastic(1e3, 0.3))
scene.fix("cube:x0")
scene.traction("cube:x1", (1.0, 0.0, 0.0))
scene.interface("spring", "cube:y1", lf.Elastic(normal=1.0, tangential=1.0))
problem = lf.assemble(scene)
threading.Thread(target=terminate, daemon=True).start()
lf.solve(problem, active=["spring"])
over.append(True)
time.sleep(0.2)
print("lost")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_is_not_lost_while_unknowns_are_ordered(tmp_path: Path) -> None:
    """METIS takes it for a failure of its own."""
    script = tmp_path / "script.py"
    script.write_text(TERMINATED.format(6))
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGTERM, done.stdout + done.stderr


@pytest.mark.parametrize("whole", [False, True])
def test_a_shell_is_asked_to_show_what_is_of_the_user(monkeypatch: pytest.MonkeyPatch, whole: bool) -> None:
    """As IPython calls its handlers."""
    shown: list[Any] = []
    handlers: dict[type, Any] = {}
    shell = SimpleNamespace(
        set_custom_exc=lambda kinds, handler: handlers.update(dict.fromkeys(kinds, handler)),
        showtraceback=shown.append,
    )
    monkeypatch.setitem(sys.modules, "IPython", SimpleNamespace(get_ipython=lambda: shell))
    tracebacks.install()
    lf.debug(whole)
    try:
        lf.Scene().fix("baar:x0")
    except lf.SceneError as error:
        handlers[lf.SceneError](shell, type(error), error, error.__traceback__, tb_offset=1)
    finally:
        lf.debug(False)
    [(kind, error, trace)] = shown
    frames = [frame.f_code.co_filename for frame, _ in traceback.walk_tb(trace)]
    assert kind is lf.SceneError and "unknown substructure 'baar'" in str(error)
    assert frames[0] == __file__ and ("dolfinx_frontend" in frames[-1]) == whole


IN_IPYTHON = """
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance(colors="NoColor")
shell.run_cell("import dolfinx_frontend as lf")
shell.run_cell("lf.Scene().fix('baar:x0')")
shell.run_cell("lf.debug(True); lf.Scene().fix('baar:x0')")
"""


def test_ipython_shows_the_cell_and_one_sentence(tmp_path: Path) -> None:
    pytest.importorskip("IPython")
    script = tmp_path / "script.py"
    script.write_text(IN_IPYTHON)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=False)
    short, whole = (done.stdout + done.stderr).split("SceneError  ")[1:]
    assert "unknown substructure 'baar'" in short and "line 1" in short
    assert "run_code" not in short and "scene.py" not in short and "scene.py" in whole


def joined(**settings: Any) -> Any:
    scene = lf.Scene()
    for name, x in (("left", 0.0), ("right", 1.0)):
        block = lf.geometry.box((1.0, 1.0), (2, 2), origin=(x, 0.0))
        scene.substructure(name, block, lf.LinearElastic(1e3, 0.3))
    scene.interface("joint", "left:x1", "right:x0", lf.Contact(friction=0.3))
    scene.fix("left:x0")
    scene.fix("right:x1", (-1e-3, 1e-4))
    return scene, lf.solve(lf.assemble(scene), **settings)


def test_notebooks_show_what_is_printed() -> None:
    scene, result = joined()
    for each in (scene, result, result.problem):
        assert f"<pre>{str(each)[:20].replace('<', '&lt;')}" in each._repr_html_()
    assert "<th" in result.plan._repr_html_() and "because" in result.plan._repr_html_()
    shown = result.table("joint")._repr_html_()
    assert shown.count("<td") == shown.count("<th ") and "joint" in shown


def test_a_run_that_did_not_converge_says_so_wherever_it_is_read(caplog: pytest.LogCaptureFixture) -> None:
    _, result = joined(options=lf.Options(max_iterations=2, rtol=1e-12, newton=0))
    assert not result.converged and result.status in repr(result)
    assert "NOT CONVERGED: " in str(result.table()) and "NOT CONVERGED: " in result.table()._repr_html_()
