"""What all tests share."""

from __future__ import annotations

import os
import signal
import tempfile
from pathlib import Path

# A shell that starts the tests in the background leaves SIGINT ignored, and Python then installs no
# handler: the tests of Ctrl-C need the usual one.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Workers of pytest-xdist start mpirun at the same time, and two of them would clean one folder of sessions.
if worker := os.environ.get("PYTEST_XDIST_WORKER"):
    own = Path(tempfile.gettempdir()) / f"{os.environ['PYTEST_XDIST_TESTRUNUID'][:8]}-{worker}"
    own.mkdir(exist_ok=True)
    os.environ["TMPDIR"] = str(own)
    tempfile.tempdir = None
