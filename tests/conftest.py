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
    "kernel/test_mpi.py",
    "io/test_edited.py",
    "project/test_demos.py",
    "project/test_install.py",
    "verification/test_campaign_cases.py",  # on two cores: not beside the ranks
    "project/test_docs.py",
    "kernel/test_mpi_points.py",
    "io/test_export.py",
    "extremes/test_faults.py",
    "verification/test_chaos.py",
    "verification/test_campaign.py",
    "project/test_session.py",
    "verification/test_iterations.py",
    "geometry/test_step.py",
    "geometry/test_away.py",
    "geometry/test_stacks.py",
)
BY_TEST = ("project/test_demos.py", "project/test_docs.py")


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
                long = [scope for scope in self.workqueue if place(scope) < len(LONG)]
                for scope in sorted(long, key=place, reverse=True):
                    self.workqueue.move_to_end(scope, last=False)
            super()._assign_work_unit(node)

    def place(scope: str) -> int:
        file = scope.partition("::")[0]
        return next((k for k, each in enumerate(LONG) if file.endswith(each)), len(LONG))

    return LongestFirst(config, log)
