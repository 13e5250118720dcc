#!/usr/bin/env python3
"""Forbid includes and imports against the arrow of the architecture.

C++ kernel: every layer may use those left of it and itself, all may use ``common``::

    algebra | interface | stochastic | substructure | iteration

the bindings may use all, and nothing in the kernel names dolfinx. Python: ``latin_core`` imports
neither dolfinx nor the frontend; in ``dolfinx_frontend`` only ``bridge.py`` imports the compiled
module, and only the few modules of `FACE_USERS` import ``latin_core`` at all.

Usage: ``check_layers.py [ROOT]``. Prints ``file:line: offence`` and exits with 1 if there is any.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

LAYERS = ("algebra", "interface", "stochastic", "substructure", "iteration")
COMMON = "common"
FACE_USERS = (
    "__init__.py",
    "accuracy.py",
    "bridge.py",
    "chaos.py",
    "chaos_file.py",
    "collocation.py",
    "parallel.py",
    "plan.py",
    "quantities.py",
    "random.py",
    "running.py",
    "sampling.py",
    "solve.py",
    "ssfem.py",
    "sweep.py",
)
FRONTEND_WORDS = ("dolfinx", "dolfinx_frontend", "ufl", "basix", "ffcx")

_INCLUDE = re.compile(r'\s*#\s*include\s*(?:"([^"]+)"|<(latin/[^>]+)>)')
_DOLFINX = re.compile("dolfinx", re.IGNORECASE)


class Offence(NamedTuple):
    """One use against the arrow; `line` counts from 1."""

    file: Path
    line: int
    message: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.message}"


def may_use(user: str, used: str) -> bool:
    """Whether layer `user` may include a header of layer `used`."""
    if used == COMMON or user == used:
        return True
    return user != COMMON and LAYERS.index(used) < LAYERS.index(user)


def layer_of(path: Path, kernel: Path) -> str | None:
    """Layer of a kernel file; None for files outside of the layers (bindings, umbrella headers)."""
    for folder in (kernel / "include" / "latin", kernel / "src"):
        if path.is_relative_to(folder):
            parts = path.relative_to(folder).parts
            if len(parts) > 1:
                return parts[0]
    return None


def check_kernel(root: Path) -> Iterator[Offence]:
    """Offences of the C++ files below ``latin_core``."""
    kernel = root / "latin_core"
    known = (COMMON, *LAYERS)
    files = sorted(path for suffix in ("*.hpp", "*.cpp", "*.h") for path in kernel.rglob(suffix))
    for path in files:
        user = layer_of(path, kernel)
        if user is not None and user not in known:
            yield Offence(path, 1, f"folder {user} is no layer; the layers are {', '.join(known)}")
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
            if _DOLFINX.search(line):
                yield Offence(path, number, "the kernel must not mention dolfinx")
            match = _INCLUDE.match(line)
            if match is None or user is None:
                continue
            name = match[1] or match[2]
            from_prefix = kernel / "include" / name
            target = from_prefix if name.startswith("latin/") else (path.parent / name).resolve()
            used = layer_of(target, kernel)
            if used is None:
                if name.startswith("latin/"):
                    yield Offence(path, number, f"{name} belongs to no layer: include what is used")
            elif used not in known:
                yield Offence(path, number, f"{name} belongs to no known layer")
            elif not may_use(user, used):
                yield Offence(path, number, f"layer {user} must not include {name} (layer {used})")


def imports(path: Path) -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything a Python file imports, at any depth of the code.

    ``from a import b`` gives ``a.b``, because b may be a module; relative imports start with dots.
    """
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"), filename=str(path))):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name
        elif isinstance(node, ast.ImportFrom):
            prefix = "." * node.level + (node.module or "")
            joint = "" if prefix.endswith(".") else "."
            for alias in node.names:
                yield node.lineno, f"{prefix}{joint}{alias.name}"


def check_python(root: Path) -> Iterator[Offence]:
    """Offences of ``latin_core/python`` and ``dolfinx_frontend``."""
    for path in sorted((root / "latin_core" / "python").rglob("*.py*")):
        if path.suffix not in (".py", ".pyi"):
            continue
        for line, name in imports(path):
            if name.split(".")[0] in FRONTEND_WORDS:
                yield Offence(path, line, f"the kernel must not import {name}")
    frontend = root / "dolfinx_frontend"
    for path in sorted(frontend.rglob("*.py")):
        module = path.relative_to(frontend).as_posix()
        for line, name in imports(path):
            parts = name.split(".")
            if parts[0] != "latin_core":
                continue
            if parts[1:2] == ["_core"] and module != "bridge.py":
                yield Offence(path, line, "only bridge.py may import latin_core._core")
            elif module not in FACE_USERS:
                allowed = ", ".join(FACE_USERS)
                yield Offence(path, line, f"only {allowed} may import latin_core")


def main(arguments: list[str]) -> int:
    """Print the offences below the given root (default: this project); 1 if there is any."""
    root = Path(arguments[0]).resolve() if arguments else Path(__file__).resolve().parents[1]
    offences = [*check_kernel(root), *check_python(root)]
    for file, line, message in offences:
        print(Offence(file.relative_to(root), line, message))
    return 1 if offences else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
