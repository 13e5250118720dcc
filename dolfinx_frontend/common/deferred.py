"""Modules of scipy that are loaded when something of them is first used.

They take longer to load than all that is here, and whoever describes a scene uses none of them.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

__all__ = ["interpolate", "linalg", "optimize", "sp", "spatial", "special", "spla", "stats"]


class _Deferred(ModuleType):
    """Stands for the module of its name."""

    def __getattr__(self, name: str) -> Any:
        return getattr(import_module(self.__name__), name)

    def __dir__(self) -> list[str]:
        return dir(import_module(self.__name__))


if TYPE_CHECKING:
    import scipy.sparse as sp
    import scipy.sparse.linalg as spla
    from scipy import interpolate, linalg, optimize, spatial, special, stats
else:
    interpolate = _Deferred("scipy.interpolate")
    linalg = _Deferred("scipy.linalg")
    optimize = _Deferred("scipy.optimize")
    sp = _Deferred("scipy.sparse")
    spatial = _Deferred("scipy.spatial")
    special = _Deferred("scipy.special")
    spla = _Deferred("scipy.sparse.linalg")
    stats = _Deferred("scipy.stats")
