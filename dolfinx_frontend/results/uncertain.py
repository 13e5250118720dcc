"""What every stochastic answer offers beside what all answers do, however it was computed."""

from __future__ import annotations

from abc import ABC, abstractmethod

from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["StochasticResult"]


class StochasticResult(ABC):
    """A random answer: moments of fields, and quantities of interest sample by sample."""

    @property
    @abstractmethod
    def space(self) -> RandomSpace:
        """The germs."""
