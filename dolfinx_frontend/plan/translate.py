"""The law of an interface in the kernel's terms: short names for what the law itself answers."""

from __future__ import annotations

from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.scene.laws import Law
from dolfinx_frontend.scene.laws import Fields as LawFields

__all__ = ["LawFields", "kernel_parameter", "kernel_values", "law_fields"]


def law_fields(
    interface: Interface, law: Law | None = None, time: float | None = None
) -> LawFields:
    """A law (the interface's own by default) for the kernel, see :meth:`Law.fields`."""
    return (law or interface.law).fields(interface, time)


def kernel_parameter(interface: Interface, parameter: str) -> tuple[str, Array]:
    """Kernel name of a law parameter, and the field that the value 1 stands for: :meth:`Law.kernel_unit`."""
    return interface.law.kernel_unit(interface, parameter)


def kernel_values(
    interface: Interface, parameter: str, values: Array
) -> tuple[str, Array, Array]:
    """Kernel name of a law parameter, a field, and its factors: :meth:`Law.kernel_values`."""
    return interface.law.kernel_values(interface, parameter, values)
