"""Assemblies of elastic parts joined by uncertain interfaces, on dolfinx.

Data flows one way: geometry -> scene -> :func:`assemble` -> :func:`make_plan` -> :func:`solve`,
:func:`sweep` or sampling -> results. The iterations are the kernel's (:mod:`latin_core`); nothing iterates
here.
"""

from dolfinx_frontend import _release  # first: refuses a dolfinx that is too old
from dolfinx_frontend import (
    chaos_file,
    discretisation,
    fields,
    geometry,
    lap_joint,
    plotting,
    reference,
    sampling,
    ssfem,
    step,
    tables,
)
from dolfinx_frontend.accuracy import Errors
from dolfinx_frontend.assembly import Problem, Substructure, assemble
from dolfinx_frontend.chaos import (
    ChaosResult,
    IndefiniteError,
    NearlyIndefiniteWarning,
    TruncationError,
    TruncationWarning,
)
from dolfinx_frontend.errors import SceneError, SceneWarning
from dolfinx_frontend.history import Amplitude
from dolfinx_frontend.interest import Resultant
from dolfinx_frontend.laws import (
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
from dolfinx_frontend.materials import LinearElastic, Material, OrthotropicElastic
from dolfinx_frontend.pairing import Interface
from dolfinx_frontend.plan import Direction, Plan, make_plan
from dolfinx_frontend.progress import progress
from dolfinx_frontend.quantities import Estimate, Quantity
from dolfinx_frontend.random import (
    Beta,
    Chaos,
    Correlated,
    FromDistribution,
    FromSamples,
    Gamma,
    LogNormal,
    Normal,
    RandomField,
    TruncatedNormal,
    Uniform,
)
from dolfinx_frontend.sampling import (
    SampleResult,
    monte_carlo,
    quasi_monte_carlo,
    sparse_quadrature,
    tensor_quadrature,
)
from dolfinx_frontend.saved import ResultFileError, SavedResult, load
from dolfinx_frontend.scene import Scene
from dolfinx_frontend.solve import HistoryResult, Result, solve
from dolfinx_frontend.stochastic import RandomLaws
from dolfinx_frontend.sweep import SweepResult, sweep
from dolfinx_frontend.tables import Table
from dolfinx_frontend.uncertain import StochasticResult
from latin_core import Options

__all__ = [
    "Amplitude",
    "Beta",
    "Chaos",
    "ChaosResult",
    "Contact",
    "Correlated",
    "Debonding",
    "Direction",
    "Displacement",
    "Elastic",
    "Errors",
    "Estimate",
    "FromDistribution",
    "FromSamples",
    "Gamma",
    "HistoryResult",
    "IndefiniteError",
    "Interface",
    "Law",
    "LinearElastic",
    "LogNormal",
    "Material",
    "NearlyIndefiniteWarning",
    "Normal",
    "Options",
    "OrthotropicElastic",
    "Perfect",
    "Plan",
    "Preload",
    "Pressure",
    "Problem",
    "Quantity",
    "RandomField",
    "RandomLaws",
    "Result",
    "ResultFileError",
    "Resultant",
    "SampleResult",
    "SavedResult",
    "Scene",
    "SceneError",
    "SceneWarning",
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
    "assemble",
    "chaos_file",
    "discretisation",
    "fields",
    "geometry",
    "lap_joint",
    "load",
    "make_plan",
    "monte_carlo",
    "plotting",
    "progress",
    "quasi_monte_carlo",
    "reference",
    "sampling",
    "solve",
    "sparse_quadrature",
    "ssfem",
    "step",
    "sweep",
    "tables",
    "tensor_quadrature",
]
