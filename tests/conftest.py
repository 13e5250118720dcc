"""What all tests share."""

from __future__ import annotations

import signal

# A shell that starts the tests in the background leaves SIGINT ignored, and Python then installs no
# handler: the tests of Ctrl-C need the usual one.
signal.signal(signal.SIGINT, signal.default_int_handler)
