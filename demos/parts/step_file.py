"""STEP files with named products, written by gmsh's OpenCASCADE."""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dolfinx_frontend.geometry.session import gmsh_session


def write_step(path: str | Path, build: Callable[[Any], dict[str, int]]) -> Path:
    """Write the solids that a function makes.

    Parameters
    ----------
    path
        File to write; its folder is made.
    build
        Takes ``gmsh.model.occ``, returns name -> tag of a solid; other solids it leaves behind are an error.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    with gmsh_session(target.stem) as gmsh, silent():
        solids = build(gmsh.model.occ)
        # the order of the solids in the file is that of the model
        tags = [tag for _, tag in gmsh.model.occ.getEntities(3)]
        gmsh.model.occ.synchronize()
        gmsh.write(str(target))
    _name(target, [next(n for n, t in solids.items() if t == tag) for tag in tags])
    return target


def _name(path: Path, names: list[str]) -> None:
    """Give the products their names: gmsh numbers them in the order of the solids."""
    text = path.read_text(encoding="latin-1")
    pattern = re.compile(r"PRODUCT\('Open CASCADE STEP translator [\d.]+ \d+\.(\d+)',\s*'[^']*'")
    if len(names) == 1:  # a single product has no number, but the file has
        pattern = re.compile(r"PRODUCT\('Open CASCADE STEP translator [\d.]+ \d+()',\s*'[^']*'")
    named = pattern.sub(lambda m: "PRODUCT('{0}','{0}'".format(names[int(m[1] or 1) - 1]), text)
    # the same file every time
    named = re.sub(r"(FILE_NAME\('[^']*',)'[^']*'", r"\1'2004-07-24T00:00:00'", named)
    named = re.sub(r"(FILE_NAME\()'[^']*'", rf"\1'{path.name}'", named)
    path.write_text(named, encoding="latin-1")


@contextmanager
def silent() -> Iterator[None]:
    """OpenCASCADE's writer prints statistics directly, not through Python."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
