"""What all tests share."""

from __future__ import annotations

import os
import signal
import tempfile
from pathlib import Path
from typing import Any

import pytest

# A shell that starts the tests in the background leaves SIGINT ignored, and Python then installs no
# handler: the tests of Ctrl-C need the usual one.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Workers of pytest-xdist start mpirun at the same time, and two of them would clean one folder of sessions.
if worker := os.environ.get("PYTEST_XDIST_WORKER"):
    own = Path(tempfile.gettempdir()) / f"{os.environ['PYTEST_XDIST_TESTRUNUID'][:8]}-{worker}"
    own.mkdir(exist_ok=True)
    os.environ["TMPDIR"] = str(own)
    tempfile.tempdir = None

SECONDS = Path(__file__).with_name("seconds.txt")
"""Seconds of tests that take one or more, of a function the longest case; see ``--record-seconds``."""
LEAST = 1.0

BY_TEST = ("project/test_demos.py", "project/test_docs.py")
"""Files whose tests are given to workers one by one: pages and demos."""


def function_of(nodeid: str) -> str:
    """A test without its parameters."""
    return nodeid.partition("[")[0]


def recorded() -> dict[str, float]:
    """Function -> seconds."""
    lines = SECONDS.read_text().splitlines() if SECONDS.exists() else []
    return {name: float(seconds) for seconds, name in map(str.split, lines)}


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--fast", action="store_true", help="only tests below a second, on one rank")
    parser.addoption("--night", action="store_true", help="those too that are marked so")
    parser.addoption("--ranks", choices=("only", "none"), help="those that start mpirun, or all others")
    parser.addoption("--record-seconds", action="store_true", help=f"write {SECONDS.name}")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    night, ranks = config.getoption("--night"), config.getoption("--ranks")
    if night or ranks:
        words = {"only": ["mpi"], "none": ["not mpi"]}.get(ranks, [])
        config.option.markexpr = " and ".join(words if night else [*words, "not night"])


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """For the tests with ranks no file is imported that has none."""
    if config.getoption("--ranks") != "only" or collection_path.suffix != ".py":
        return None
    return None if "mpi" in collection_path.read_text(encoding="utf-8") else True


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--fast"):
        long = recorded()
        left = [
            item
            for item in items
            if function_of(item.nodeid) in long or any(map(item.get_closest_marker, ("slow", "mpi")))
        ]
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if item not in set(left)]


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Writes what tests took that ran now; what others took stays."""
    if not terminalreporter.config.getoption("--record-seconds"):
        return
    took: dict[str, float] = {}
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                took[report.nodeid] = took.get(report.nodeid, 0.0) + report.duration
    found = recorded()
    for name in {function_of(nodeid) for nodeid in took}:
        found[name] = max(each for nodeid, each in took.items() if function_of(nodeid) == name)
    lines = [f"{seconds:.1f} {name}" for name, seconds in sorted(found.items()) if seconds >= LEAST]
    SECONDS.write_text("\n".join(lines) + "\n")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    """Files go to workers as a whole, see `./run test`, in an order that keeps all of them busy."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class LongestFirst(LoadFileScheduling):
        ordered = False

        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return nodeid if file.endswith(BY_TEST) else file

        def _assign_work_unit(self, node: Any) -> None:
            if not self.ordered:  # all files are in the queue, and none is given out yet
                self.ordered = True
                for scope in sorted(self.workqueue, key=seconds):
                    self.workqueue.move_to_end(scope, last=False)
            super()._assign_work_unit(node)

    known = recorded()

    def seconds(scope: str) -> float:
        return sum(each for name, each in known.items() if name.startswith(scope.partition("[")[0]))

    return LongestFirst(config, log)
