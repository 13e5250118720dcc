"""How much memory this process may still take."""

from __future__ import annotations

import re
import resource
from pathlib import Path

__all__ = ["available_memory"]

_MEMINFO, _STATUS = Path("/proc/meminfo"), Path("/proc/self/status")


def _kilobytes(file: Path, key: str) -> float | None:
    """What a file of Linux says of a key; None: there is no such file or key."""
    try:
        found = re.search(rf"^{key}:\s*(\d+) kB", file.read_text(encoding="ascii"), re.MULTILINE)
    except OSError:
        return None
    return None if found is None else 1024.0 * float(found[1])


def available_memory() -> float:
    """Bytes: what is free on the machine, or left of the limit of the process (``ulimit -v``); inf: not
    known."""
    free = _kilobytes(_MEMINFO, "MemAvailable")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    left = float("inf")
    if limit != resource.RLIM_INFINITY:
        left = max(float(limit) - (_kilobytes(_STATUS, "VmSize") or 0.0), 0.0)
    return min(left, float("inf") if free is None else free)
