"""Assemblies of elastic parts joined by uncertain interfaces, on dolfinx.

Data flows one way: geometry -> scene -> :func:`assemble` -> :func:`make_plan` -> :func:`solve`,
:func:`sweep` or sampling -> results. The iterations are the kernel's (:mod:`latin_core`); nothing iterates
here.
"""

from dolfinx_frontend import geometry, reference
from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.assembly.interface import Interface
from dolfinx_frontend.assembly.problem import Problem
from dolfinx_frontend.assembly.substructure import Substructure
from dolfinx_frontend.common import release as _release  # first: refuses a dolfinx that is too old
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.common.progress import progress
from dolfinx_frontend.estimate import mesh_error as discretisation
from dolfinx_frontend.estimate.adaptive import Errors
from dolfinx_frontend.figures import plotting
from dolfinx_frontend.geometry import lap_joint, step
from dolfinx_frontend.io import chaos_file, fields
from dolfinx_frontend.io.saved import ResultFileError, SavedResult, load
from dolfinx_frontend.plan.plan import Direction, Plan, make_plan
from dolfinx_frontend.plan.random_laws import RandomLaws
from dolfinx_frontend.reference import ssfem
from dolfinx_frontend.results import tables
from dolfinx_frontend.results.resultant import Resultant
from dolfinx_frontend.results.tables import Table
from dolfinx_frontend.results.uncertain import StochasticResult
from dolfinx_frontend.scene.amplitudes import Amplitude
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
from dolfinx_frontend.scene.scene import Scene
from dolfinx_frontend.solvers import sampling
from dolfinx_frontend.solvers.chaos import (
    ChaosResult,
    IndefiniteError,
    NearlyIndefiniteWarning,
    TruncationError,
    TruncationWarning,
)
from dolfinx_frontend.solvers.sampling import (
    SampleResult,
    monte_carlo,
    quasi_monte_carlo,
    sparse_quadrature,
    tensor_quadrature,
)
from dolfinx_frontend.solvers.solve import HistoryResult, Result, solve
from dolfinx_frontend.solvers.sweep import SweepResult, sweep
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fields import RandomField
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
