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

# What takes longest begins first, so that no worker is left with it at the end; pages and demos one by one.
LONG = (
    "project/test_install.py",
    "kernel/test_mpi.py",
    "project/test_demos.py",
    "project/test_docs.py",
    "kernel/test_mpi_points.py",
    "geometry/test_step.py",
    "verification/test_iterations.py",
    "geometry/test_away.py",
    "extremes/test_hostile.py",
    "io/test_export.py",
)
BY_TEST = ("project/test_demos.py", "project/test_docs.py")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    """Files go to workers as a whole, see `./run test`, in an order that keeps all of them busy."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class LongestFirst(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return nodeid if file.endswith(BY_TEST) else file

        def schedule(self) -> None:
            begins = self.collection is None
            super().schedule()
            if begins:
                rank = {scope: place(scope) for scope in self.workqueue}
                for scope in sorted(rank, key=lambda scope: -rank[scope]):
                    self.workqueue.move_to_end(scope, last=False)

    def place(scope: str) -> int:
        file = scope.partition("::")[0]
        return next((k for k, each in enumerate(LONG) if file.endswith(each)), len(LONG))

    return LongestFirst(config, log)
