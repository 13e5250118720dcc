"""Sessions of gmsh: a model of one's own. Without dolfinx: also for the process that reads files."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from time import perf_counter
from typing import Any

__all__ = ["gmsh_session"]

_log = logging.getLogger(__name__)


@contextmanager
def gmsh_session(
    name: str = "assembly", options: Mapping[str, float] | None = None
) -> Iterator[Any]:
    """A gmsh model of its own, without output, removed at the end.

    A session that is already open stays open, with its current model and its options restored.

    Parameters
    ----------
    name
        Name of the model.
    options
        gmsh options, for example ``{"Mesh.Algorithm3D": 1}``.

    Yields
    ------
    The ``gmsh`` module.
    """
    import gmsh

    began = perf_counter()
    ours = not gmsh.isInitialized()
    if ours:
        # no configuration files: the same mesh for everyone; not interruptible: Ctrl-C is Python's
        gmsh.initialize(argv=[], readConfigFiles=False, run=False, interruptible=False)
    previous = "" if ours else gmsh.model.getCurrent()
    wanted = {"General.Terminal": 0.0, "General.NumThreads": 1.0} | dict(options or {})
    before = {key: gmsh.option.getNumber(key) for key in wanted}
    try:
        for key, value in wanted.items():
            gmsh.option.setNumber(key, value)
        gmsh.model.add(name)
        try:
            yield gmsh
        finally:
            gmsh.model.setCurrent(name)
            gmsh.model.remove()
    finally:
        for key, value in before.items():
            gmsh.option.setNumber(key, value)
        if ours:
            gmsh.finalize()
        elif previous in gmsh.model.list():
            gmsh.model.setCurrent(previous)
        _log.info("gmsh: %s, %.2f s", name, perf_counter() - began)
