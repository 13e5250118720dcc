"""The process of one state: ``python worker.py DEMOS`` in the environment of its commit.

Reads one JSON object a line (``{"do": "prepare" | "run" | "outcome" | "names", "name"}``), answers
with one a line, and ends with its input. What libraries print goes to the standard error.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import sys
import traceback
from time import perf_counter, process_time
from typing import Any

sys.path.insert(0, sys.argv[1])  # the demos of the same commit, whose geometry scenes use

import scenes  # noqa: E402

import dolfinx_frontend  # noqa: E402


def processor_seconds() -> float:
    """Of this process, all its threads, and of those that it started and that have ended."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


class Worker:
    """One scene at a time is kept in memory, prepared and run once before it is measured."""

    prepared: scenes.Prepared | None = None
    answer: Any = None

    def prepare(self, name: str) -> dict[str, Any]:
        self.prepared = self.answer = None
        gc.collect()
        self.prepared = scenes.BENCHES[name].function()
        self.answer = self.prepared.run()  # libraries are loaded, forms compiled, memory is at hand
        self.answer = None
        return self.run()

    def run(self) -> dict[str, Any]:
        assert self.prepared is not None
        self.answer = None
        gc.collect()
        cpu, wall = processor_seconds(), perf_counter()
        self.answer = self.prepared.run()
        return {"cpu_s": processor_seconds() - cpu, "wall_s": perf_counter() - wall}

    def outcome(self) -> dict[str, Any]:
        assert self.prepared is not None
        return self.prepared.read(self.answer)

    def obey(self, command: dict[str, Any]) -> dict[str, Any]:
        if command["do"] == "prepare":
            return self.prepare(command["name"])
        if command["do"] == "run":
            return self.run()
        if command["do"] == "outcome":
            return self.outcome()
        return {"library": dolfinx_frontend.__file__, "names": list(scenes.BENCHES)}


def main() -> None:
    """Obey until the input ends."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    worker = Worker()
    for line in sys.stdin:
        try:
            found = worker.obey(json.loads(line))
        except Exception:
            found = {"failed": traceback.format_exc()}
        print(json.dumps(found, default=float), file=answers, flush=True)


if __name__ == "__main__":
    main()
