"""Demos and examples of the documentation, at the sizes that the tests run them at.

Each is executed as it stands; what the public functions of the library return to it is recorded in order as
``001_solve``, ``002_sweep``, ... (calls inside of these calls are not a script's). ``make_*_step.py`` make
no result; of solid figures only the paths are made, their processes take longer than the solutions.
References (``lf.reference``) are no answers of the library.
"""

from __future__ import annotations

import contextlib
import functools
import inspect
import io
import os
import re
import runpy
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import dolfinx_frontend as lf

from frozen.registry import scene

ROOT = Path(__file__).resolve().parents[2]
DEMOS, DOCS = ROOT / "demos", ROOT / "docs"
ANSWERS = (
    "calibrate",
    "discretisation_error",
    "errors",
    "fit_distribution",
    "load",
    "monte_carlo",
    "quasi_monte_carlo",
    "reliability",
    "sample",
    "screen",
    "solve",
    "sparse_quadrature",
    "sweep",
    "tensor_quadrature",
)
"""Public functions that return a result."""
OF_FUNCTIONS = ("__call__", "evaluate", "gradient")
"""Methods of ``ProblemFunction`` that do."""
DRAWN = ("assembly_figure", "deformed_figure", "interface_figure", "interface_map", "stress_figure")
LONG = 900.0
"""Seconds for the demos that solve for minutes."""

# demo -> arguments that make it short; "{}" is a folder to write to; ``name --option`` for a second run
SHORT = {
    "bolted_lap_joint": "--quick --output {}",
    "bolted_vessel": "--size coarse --quick --no-figures --output {}",
    "bolted_vessel friction": "--contact --size coarse --quick --friction 0.3 --no-figures --output {}",
    "bolted_vessel gasket": "--contact --size coarse --quick --gasket 100 --no-figures --output {}",
    "bonded_lap_joint": "--output {}",
    "bracket_from_step": "--quick --no-figures --output {}",
    "chain_over_ranks": "",
    "first_bolt": "--no-figures --output {}",
    "flange_from_step": "--quick --output {}",
    "hertz": "--quick --output {}",
    "loads_and_scatter": "--output {}",
    "own_law": "--output {}",
    "random_field_joint": "--output {}",
    "raw_dolfinx": "",
    "tradeoff": "--scenes vessel --output {}",
    "two_blocks": "",
    "um_bridge": "",
}
# pages whose blocks are one script; of the others see below
PAGES = (
    "axisymmetry",
    "bolts",
    "contact",
    "laws",
    "loads",
    "parallel",
    "random_stiffness",
    "reliability",
    "report",
    "results",
    "running",
    "scatter",
    "scene",
    "start",
    "step",
    "temperature",
)


LOOSER = {"contact": 1e-7}
"""Below this the solves that check a chaos end as inexact, which it counts as no check; the page makes that
an error."""


class Record:
    """What public functions returned, in order."""

    def __init__(self, rtol: float) -> None:
        self.rtol, self.inside = rtol, False
        self.answers: dict[str, Any] = {}

    def __call__(self, function: Callable[..., Any], name: str) -> Callable[..., Any]:
        takes = inspect.signature(function).parameters

        @functools.wraps(function)
        def called(*args: Any, **kwargs: Any) -> Any:
            if self.inside:
                return function(*args, **kwargs)
            # the accuracy, a plan and a file have tolerances of their own
            if "options" in takes and not {"options", "accuracy", "plan"} & kwargs.keys():
                kwargs["options"] = lf.Options(rtol=self.rtol)
            self.inside = True
            try:
                answer = function(*args, **kwargs)
            finally:
                self.inside = False
            self.answers[f"{len(self.answers) + 1:03d}_{name}"] = answer
            return answer

        return called

    def kernel(self, names: dict[str, Any]) -> None:
        """What a script that uses the kernel alone has at its end."""
        if "summary" in names and "structure" in names:
            summary = names["summary"]
            self.answers["kernel"] = {
                "status": str(summary.status), "error": max(float(summary.error), self.rtol), "u": names["u"],
            }


def _path(*args: Any, **_: Any) -> Path:
    return Path(next(each for each in args if isinstance(each, (str, Path)) and str(each).endswith(".png")))


@contextlib.contextmanager
def recorded(rtol: float) -> Iterator[Record]:
    """Public functions recorded, no figures of solids, in an empty folder, silently."""
    record = Record(rtol)
    here = os.getcwd()
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory(ignore_cleanup_errors=True))
        for name in ANSWERS:
            stack.enter_context(mock.patch.object(lf, name, record(getattr(lf, name), name)))
        for name in OF_FUNCTIONS:
            function = getattr(lf.ProblemFunction, name)
            stack.enter_context(mock.patch.object(lf.ProblemFunction, name,
                                                  record(function, name.strip("_"))))
        for name in DRAWN:
            stack.enter_context(mock.patch.object(lf.figures, name, _path))
        sheet = functools.partial(lf.report, pictures=False)
        stack.enter_context(mock.patch.object(lf, "report", sheet))
        stack.enter_context(mock.patch.object(sys, "path", [folder, str(DEMOS), *sys.path]))
        stack.enter_context(mock.patch.dict(sys.modules))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        stack.enter_context(mock.patch.dict(os.environ, {"MPLBACKEND": "Agg"}))
        stack.enter_context(contextlib.redirect_stdout(io.StringIO()))
        os.chdir(folder)
        stack.callback(os.chdir, here)
        yield record


def demo(title: str, arguments: str) -> Callable[[float], Any]:
    """The scene of a demo."""

    def run(rtol: float) -> dict[str, Any]:
        script = str(DEMOS / f"{title.split()[0]}.py")
        with recorded(rtol) as record:
            given = [script, *arguments.format(os.getcwd()).split()]
            with mock.patch.object(sys, "argv", given):
                try:
                    record.kernel(runpy.run_path(script, run_name="__main__"))
                except SystemExit as end:
                    if end.code:
                        raise RuntimeError(f"{title} ended with {end.code}") from end
        return record.answers

    run.__name__ = title.replace(" ", "_")
    return run


def page(name: str, blocks: Callable[[], list[str]]) -> Callable[[float], Any]:
    """The scene of a page of the documentation."""

    def run(rtol: float) -> dict[str, Any]:
        with recorded(max(rtol, LOOSER.get(name, 0.0))) as record:
            module = ModuleType("docs")  # dataclasses look themselves up in it
            names = module.__dict__
            sys.modules["docs"] = module
            for block in blocks():
                exec(compile(block, name, "exec"), names)
            record.kernel(names)
        return record.answers

    run.__name__ = f"page_{name}"
    return run


def python(file: Path) -> list[str]:
    """The Python blocks of a page."""
    return re.findall(r"^```python\n(.*?)^```", file.read_text(), flags=re.M | re.S)


def standing(file: Path) -> list[str]:
    """The blocks that stand alone: one that reads a result also makes it."""
    blocks = [block for block in python(file) if block.startswith("import ")]
    return [block for block in blocks if "result" not in block or "result = " in block]


def bracket() -> list[str]:
    """The script for a file of one's own, with the file."""
    made = "import make_bracket_step\nmake_bracket_step.make_bracket('bracket.step')\n"
    return [made, *standing(DOCS / "tutorials" / "bracket.md")]


def of_laws() -> list[str]:
    """Without the law that a compiler makes."""
    return [block for block in python(DOCS / "laws.md") if "import pad" not in block]


for _title, _arguments in SHORT.items():
    scene("scripts", limit=LONG)(demo(_title, _arguments))
for _name in PAGES:
    _blocks = of_laws if _name == "laws" else functools.partial(python, DOCS / f"{_name}.md")
    scene("scripts", limit=LONG)(page(_name, _blocks))
for _name in ("accuracy", "kernel"):
    scene("scripts", limit=LONG)(page(_name, functools.partial(standing, DOCS / f"{_name}.md")))
scene("scripts", limit=LONG)(page("tutorial_bracket", bracket))
scene("scripts", limit=LONG)(page("readme", functools.partial(python, ROOT / "README.md")))
