"""Assemblies of elastic parts joined by uncertain interfaces, on dolfinx.

Data flows one way: geometry -> scene -> :func:`assemble` -> :func:`make_plan` -> :func:`solve`,
:func:`sweep` or sampling -> results. The iterations are the kernel's (:mod:`latin_core`); nothing iterates
here. ``dolfinx_frontend.__version__`` is the installed version.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING

from dolfinx_frontend.common import release as _release  # first: before MPI has threads
from dolfinx_frontend import geometry, io, reference
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.common.interrupts import keep_broken_pipes as _keep_broken_pipes
from dolfinx_frontend.common.progress import progress
from dolfinx_frontend.common.tracebacks import debug
from dolfinx_frontend.common.tracebacks import install as _install_tracebacks
from dolfinx_frontend.decks.writing import to_deck as _to_deck  # noqa: F401  a method of Scene
from dolfinx_frontend.estimate.mesh_error import discretisation_error
from dolfinx_frontend.evaluate.events import Event, Response
from dolfinx_frontend.evaluate.function import Evaluation, KinkWarning, ProblemFunction
from dolfinx_frontend.inference.calibration import Fit, Posterior, calibrate
from dolfinx_frontend.inference.screening import Screening, screen
from dolfinx_frontend.geometry.solids import Cut
from dolfinx_frontend.geometry.step import StepAssembly, read_step
from dolfinx_frontend.plan.plan import Direction, Plan, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.plan.ways import PricedWay, Ways, compare_ways
from dolfinx_frontend.inference.reliability import Reliability, reliability
from dolfinx_frontend.results.chaos import ChaosResult, TruncationError
from dolfinx_frontend.results.errors import EnergyBound, Errors
from dolfinx_frontend.results.probes import AtPoint
from dolfinx_frontend.results.result import HistoryResult, Result
from dolfinx_frontend.results.resultant import Measure, Quantile, Resultant
from dolfinx_frontend.results.samples import SampleResult
from dolfinx_frontend.results.saved import SavedResult, load
from dolfinx_frontend.results.sweep import SweepResult
from dolfinx_frontend.results.tables import Table
from dolfinx_frontend.results.uncertain import StochasticResult
from dolfinx_frontend.results.writing import ResultFileError
from dolfinx_frontend.scene.amplitudes import Amplitude
from dolfinx_frontend.scene.bolts import BoltStiffness
from dolfinx_frontend.scene.laws import (
    Contact,
    Debonding,
    Displacement,
    Elastic,
    Law,
    Perfect,
    Preload,
    Pressure,
    Symmetry,
    Traction,
    UserLaw,
)
from dolfinx_frontend.scene.materials import LinearElastic, Material, OrthotropicElastic
from dolfinx_frontend.scene.matrix import Matrix
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers.galerkin import IndefiniteError, NearlyIndefiniteWarning, TruncationWarning
from dolfinx_frontend.solving import (
    errors,
    export,
    monte_carlo,
    quasi_monte_carlo,
    sample,
    solve,
    sparse_quadrature,
    sweep,
    tensor_quadrature,
)
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.expressions import Expression, expression
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.fitting import DistributionFit, fit_distribution
from dolfinx_frontend.uncertainty.parameters import (
    Beta,
    FromDistribution,
    FromSamples,
    Gamma,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
)
from dolfinx_frontend.uncertainty.quantities import Estimate, Quantity
from latin_core import Options
from latin_core import __version__ as __version__

_keep_broken_pipes()
_install_tracebacks()

_DEFERRED = {
    "figures": "figures",
    "sheets": "sheets",
    "Report": "sheets.report",
    "report": "sheets.report",
    "InpDeck": "decks.abaqus.deck",
    "BdfDeck": "decks.nastran.deck",
    "read_bdf": "decks.nastran.deck",
    "read_deck": "decks.reading",
    "read_inp": "decks.abaqus.deck",
    "read_matrix": "decks.matrices",
    "write_inp": "decks.abaqus.writing",
}
"""Name -> module that is loaded when it is asked for: who solves draws nothing, and reads no deck."""

if _TYPE_CHECKING:
    from dolfinx_frontend import figures
    from dolfinx_frontend.decks.abaqus.deck import InpDeck, read_inp
    from dolfinx_frontend.decks.abaqus.writing import write_inp
    from dolfinx_frontend.decks.matrices import read_matrix
    from dolfinx_frontend.decks.nastran.deck import BdfDeck, read_bdf
    from dolfinx_frontend.decks.reading import read_deck
    from dolfinx_frontend.sheets.report import Report, report
else:

    def __getattr__(name: str) -> object:
        if name not in _DEFERRED:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module = _import_module(f"{__name__}.{_DEFERRED[name]}")
        return getattr(module, name, module)

    def __dir__() -> list[str]:
        return sorted({*globals(), *_DEFERRED})


__all__ = [
    "Amplitude",
    "AtPoint",
    "BdfDeck",
    "Beta",
    "BoltStiffness",
    "Chaos",
    "ChaosResult",
    "Contact",
    "Correlated",
    "Cut",
    "Debonding",
    "Direction",
    "Displacement",
    "DistributionFit",
    "Elastic",
    "EnergyBound",
    "Errors",
    "Estimate",
    "Evaluation",
    "Event",
    "Expression",
    "Fit",
    "FromDistribution",
    "FromSamples",
    "Gamma",
    "HistoryResult",
    "IndefiniteError",
    "InpDeck",
    "Interface",
    "KinkWarning",
    "Law",
    "LinearElastic",
    "LogNormal",
    "Material",
    "Matrix",
    "Measure",
    "NearlyIndefiniteWarning",
    "Normal",
    "Options",
    "OrthotropicElastic",
    "Perfect",
    "Plan",
    "Posterior",
    "Preload",
    "Pressure",
    "PricedWay",
    "Problem",
    "ProblemFunction",
    "Quantile",
    "Quantity",
    "RandomField",
    "RandomLaws",
    "Reliability",
    "Report",
    "Response",
    "Result",
    "ResultFileError",
    "Resultant",
    "SampleResult",
    "SavedResult",
    "Scene",
    "SceneError",
    "SceneWarning",
    "Screening",
    "StochasticResult",
    "Substructure",
    "SweepResult",
    "Symmetry",
    "Table",
    "Traction",
    "TruncatedNormal",
    "TruncationError",
    "TruncationWarning",
    "Uniform",
    "UserLaw",
    "Ways",
    "assemble",
    "calibrate",
    "compare_ways",
    "debug",
    "discretisation_error",
    "errors",
    "export",
    "expression",
    "figures",
    "fit_distribution",
    "geometry",
    "io",
    "load",
    "make_plan",
    "monte_carlo",
    "progress",
    "quasi_monte_carlo",
    "read_bdf",
    "read_deck",
    "read_inp",
    "read_matrix",
    "read_step",
    "reference",
    "reliability",
    "report",
    "sample",
    "screen",
    "solve",
    "sparse_quadrature",
    "sweep",
    "tensor_quadrature",
    "write_inp",
]
