"""Types of the compiled kernel. Blocks are float64, (rows, columns), Fortran order preferred; (n,) is one column.

Every function raises ``TypeError`` or ``InputError`` on what cannot be used and ``NumericalError`` where arithmetic
broke down. The docstrings are in the module itself.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, TypeAlias, TypedDict, overload

import numpy as np
import numpy.typing as npt

from latin_core.options import Options
from latin_core.stochastic import Coupling
from latin_core.points import SweptParameter

Array: TypeAlias = npt.NDArray[np.float64]
IndexTable: TypeAlias = npt.NDArray[np.int32]
Mat: TypeAlias = Any  # petsc4py.PETSc.Mat, sequential; petsc4py has no types of its own
Sparse: TypeAlias = Any  # scipy.sparse matrix, float64
Backend: TypeAlias = Literal["automatic", "cholmod", "cholmod64", "mumps"]
Operator: TypeAlias = Literal["automatic", "condensed", "factored"]
Status: TypeAlias = Literal[
    "converged", "inexact", "max_iterations", "undecided", "undetermined", "slides", "no_equilibrium",
    "time_limit", "interrupted"
]

class InputError(ValueError): ...
class NumericalError(RuntimeError): ...
class MemoryLimitError(InputError, MemoryError): ...
class OutOfMemoryError(NumericalError, MemoryError): ...
class RemoteError(RuntimeError): ...

class Law:
    """A law that a user wrote, for ``Interface(law=...)``."""

    @property
    def name(self) -> str: ...
    @property
    def history(self) -> bool: ...
    @property
    def parameters(self) -> list[str]: ...

def python_law(
    *,
    name: str,
    parameters: Sequence[tuple[str, float]] = (),  # name, smallest admissible value
    history: bool = False,
    # (jump (points, components, columns), flexibility (points, components, 1),
    #  parameters {name: (points, columns)}, steps) -> force (points, components, columns)
    resolve: Callable[[Array, Array, dict[str, Array], int], npt.ArrayLike],
) -> Law: ...
def compiled_law(capsule: object) -> Law: ...

class Member:
    def __init__(
        self,
        *,
        name: str,
        stiffness: Mat,  # (n, n), force / length
        load: npt.ArrayLike,  # (n, loads), force
        prolongation: Sparse | None = None,  # (n, unknowns of the body); None: the identity
        offset: npt.ArrayLike | None = None,  # (n, loads), length
        of_stiffness: npt.ArrayLike | None = None,  # (n, loads), force: of `load`, what comes from the stiffness
        stretch: Sparse | None = None,  # B (points * components, n), B^T B = K
        stretch_points: int = 0,
        initial_stretch: npt.ArrayLike | None = None,  # g (points * components, loads)
    ) -> None: ...

class Spring:
    def __init__(
        self,
        *,
        name: str,
        members: Sequence[int],
        traces: Sequence[Mat],  # (d * points, n) each, global components
        frames: npt.ArrayLike,  # (components * points, d)
        stiffness: npt.ArrayLike,  # (components * points,), times the weights
        jump: npt.ArrayLike,  # (components * points, l), length, one column per load pattern
    ) -> None: ...

class Body:
    def __init__(
        self,
        *,
        name: str,
        members: Sequence[Member],
        size: int | None = None,  # None: the unknowns of its only member
        springs: Sequence[Spring] = (),
    ) -> None: ...

class Side:
    def __init__(
        self,
        *,
        member: str,
        # None, all of them: a side on another rank
        trace: Mat | None = None,  # (d * points, n), global components
        direction: npt.ArrayLike | None = None,  # (components * points,), force / length^3
        scale: float | None = None,  # modulus / length
        motions: npt.ArrayLike | None = None,  # (components * points, r)
        lever: float = 1.0,  # of a rotation 1 / length
    ) -> None: ...

class Interface:
    def __init__(
        self,
        *,
        name: str,
        law: str | Law,
        weights: npt.ArrayLike,  # (points,), areas
        frames: npt.ArrayLike,  # (components * points, d)
        sides: Sequence[Side],
        basis: npt.ArrayLike | None = None,  # (components * points, moments) of the coarse problem
        paired: bool = False,  # residual solved for, with both bodies
    ) -> None: ...

class Iteration:
    @property
    def number(self) -> int: ...
    @property
    def error(self) -> float: ...
    @property
    def indicator(self) -> float: ...
    @property
    def residual(self) -> float: ...
    @property
    def seconds(self) -> float: ...

class Summary:
    @property
    def status(self) -> Status: ...
    @property
    def iterations(self) -> int: ...
    @property
    def error(self) -> float: ...
    @property
    def errors(self) -> Array: ...  # (groups, bodies)
    @property
    def scatter(self) -> float: ...
    @property
    def indicator(self) -> float: ...
    @property
    def energy(self) -> float: ...
    @property
    def global_s(self) -> float: ...
    @property
    def local_s(self) -> float: ...
    @property
    def flexibility_s(self) -> float: ...
    @property
    def newton_s(self) -> float: ...
    @property
    def newton_steps(self) -> int: ...
    @property
    def check_s(self) -> float: ...
    @property
    def callback_s(self) -> float: ...
    @property
    def other_s(self) -> float: ...
    @property
    def falls(self) -> Array: ...  # (columns,), or empty
    @property
    def restarts(self) -> int: ...
    @property
    def history(self) -> list[Iteration]: ...

class State:
    def __init__(self, data: npt.ArrayLike, traces: npt.ArrayLike) -> None: ...
    @property
    def data(self) -> Array: ...
    @property
    def traces(self) -> Array: ...

class BodyCost(TypedDict):
    """What a body took; an ordinary dictionary at run time."""

    body: str
    unknowns: int
    active: int
    rows: int
    condensed: bool
    kept: bool  # whether its sparse factor is that of the structure before
    backend: str
    assemble_s: float
    factorise_s: float
    condense_s: float
    factor_numbers: float
    dense_numbers: float

LawColumns: TypeAlias = Mapping[str, Any]
"""begin, end: components; forward: no, one or one per point (c, q); backward: (q, c); parameters."""

Parameters: TypeAlias = Mapping[str, Mapping[str, npt.ArrayLike]]
"""interface -> name -> values."""

class Laws:
    @property
    def steps(self) -> int: ...
    @property
    def modes(self) -> int: ...
    @property
    def interfaces(self) -> dict[str, str]: ...  # interface -> name of its law
    def parameter(self, interface: str, name: str) -> Array: ...
    def with_(
        self,
        *,
        steps: int | None = None,
        parameters: Parameters | None = None,
        columns: Mapping[str, Sequence[LawColumns]] | None = None,
        extra_loads: Mapping[str, npt.ArrayLike] | None = None,
        modes: int | None = None,
        stiffness: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike | None] | Coupling] | None = None,
        in_time: npt.ArrayLike | None = None,
    ) -> Laws: ...

class Beginning:
    def __init__(self) -> None: ...

class Linearised:
    def correct(self, residual: npt.ArrayLike) -> tuple[Array, Array]: ...

class Structure:
    def __init__(
        self,
        *,
        bodies: Sequence[Body],
        interfaces: Sequence[Interface] = (),
        operator: Operator = "automatic",
        backend: Backend = "automatic",
        memory_limit: float = ...,
        comm: Any = None,  # mpi4py communicator or its Fortran handle; None: this rank alone
        before: Structure | None = None,  # whose factors serve again where only sides of a body differ
    ) -> None: ...
    @property
    def rows(self) -> int: ...
    @property
    def total_rows(self) -> int: ...
    @property
    def loads(self) -> int: ...
    @property
    def unknowns(self) -> int: ...
    @property
    def active_unknowns(self) -> int: ...
    @property
    def macro_size(self) -> int: ...
    @property
    def weights(self) -> Array: ...
    @property
    def directions(self) -> Array: ...
    @property
    def interfaces(self) -> list[str]: ...
    @property
    def costs(self) -> list[BodyCost]: ...
    def first_rows(self, interface: str) -> list[int]: ...
    def flexibility(self, interface: str) -> Array: ...
    def laws(
        self,
        steps: int = 1,
        parameters: Parameters | None = None,
        columns: Mapping[str, Sequence[LawColumns]] | None = None,
        extra_loads: Mapping[str, npt.ArrayLike] | None = None,
        modes: int = 1,
        stiffness: Mapping[str, tuple[npt.ArrayLike, npt.ArrayLike | None] | Coupling] | None = None,
        in_time: npt.ArrayLike | None = None,
    ) -> Laws: ...
    def solve(
        self,
        laws: Laws,
        *,
        options: Options | None = None,
        amplitudes: npt.ArrayLike | None = None,
        start: Sequence[State] = (),
        callback: Callable[[Iteration], object] | None = None,
        balanced: Callable[[int], bool] | None = None,
    ) -> tuple[Summary, State]: ...
    def sweep(
        self,
        laws: Laws,
        *,
        options: Options | None = None,
        amplitudes: npt.ArrayLike | None = None,
        parameters: Sequence[SweptParameter],
        order: Sequence[int],
        known: Sequence[State] = (),
        known_points: Sequence[int] = (),
        callback: Callable[[Iteration], object] | None = None,
        point_callback: Callable[[int, Laws, Summary, State], object] | None = None,
        next_points: Callable[[], Sequence[int]] | None = None,
        beginning: Beginning | None = None,
    ) -> str: ...
    def global_stage(
        self, laws: Laws, data: npt.ArrayLike, amplitudes: npt.ArrayLike | None = None
    ) -> Array: ...
    def local_stage(self, laws: Laws, data: npt.ArrayLike, traces: npt.ArrayLike) -> Array: ...
    def linearised(self, laws: Laws, state: State, transposed: bool = False) -> Linearised: ...
    def local_fields(self, laws: Laws, interface: str, state: State) -> tuple[Array, Array]: ...
    def resolve_samples(
        self,
        laws: Laws,
        interface: str,
        free_jump: npt.ArrayLike,
        parameters: Mapping[str, npt.ArrayLike] | None = None,
    ) -> tuple[Array, Array]: ...
    def displacements(
        self, laws: Laws, state: State, amplitudes: npt.ArrayLike | None = None
    ) -> dict[str, Array]: ...
    def response_to(self, forces: Mapping[str, npt.ArrayLike]) -> dict[str, Array]: ...

def bound_threads(comm: Any) -> int: ...  # mpi4py communicator or its Fortran handle
def snake_order(shape: Sequence[int]) -> list[int]: ...
def find_roots(
    force: Callable[[Array, int], Array],
    tangent: Callable[[Array], Array] | None,
    free_jump: Array,
    flexibility: Array,
) -> tuple[Array, list[bool], Array]: ...
def default_options() -> dict[str, Any]: ...

STATUSES: tuple[str, ...]
def available_backends() -> str: ...

class Elimination:
    def __init__(
        self,
        *,
        stiffness: Mat,  # (n, n), scipy.sparse or petsc4py
        kept: int,
        name: str,
    ) -> None: ...
    @property
    def kept(self) -> int: ...
    @property
    def factor_numbers(self) -> float: ...
    def take_schur(self) -> Array: ...
    def reduce(self, forces: npt.ArrayLike) -> tuple[Array, Array]: ...
    def expand(self, kept: npt.ArrayLike, partial: npt.ArrayLike) -> Array: ...

class Equilibration:
    def __init__(
        self,
        *,
        vertices: Array,
        corners: npt.ArrayLike,
        stress: Array,
        force: Array,
        compliance: Sequence[Array],
        material: npt.ArrayLike,
        rest: Array,
        shift: Array,
        facets: npt.ArrayLike,
        moments: Array,
        held: Array,
    ) -> None: ...
    @property
    def defect(self) -> float: ...
    @staticmethod
    def functions(dim: int, degree: int, piece: int, points: Array) -> Array: ...
    def relax(self, most_sweeps: int, enough: float) -> Array: ...
    def stress(self, cell: int, points: Array) -> Array: ...

class mortar:
    """The submodule ``latin_core._core.mortar``."""

    class Face:
        def __init__(
            self,
            *,
            shape: str,
            parts: int,
            nodes: Array,
            variants: Sequence[int],
            orientation: Sequence[float],
            map_degree: int,
            map: Sequence[Array],
            shape_degree: int,
            shapes: Sequence[Array],
        ) -> None: ...

    @staticmethod
    def sum_of(
        values: Array, rows: Any, columns: Any, row_count: int, column_count: int
    ) -> tuple[Any, Any, Array]: ...
    @staticmethod
    def integrate(
        first: mortar.Face,
        second: mortar.Face,
        *,
        degree: int,
        multipliers: Array,
        points: Array,
        weights: Array,
        near_first: Array,
        near_second: Array,
        opposed: float,
        around: bool = False,
    ) -> dict[str, Any]: ...

class stochastic:
    """The submodule ``latin_core._core.stochastic``."""

    class Germ:
        @staticmethod
        def family(name: str, parameters: Sequence[float]) -> stochastic.Germ: ...
        @staticmethod
        def families() -> list[str]: ...
        @staticmethod
        def from_measure(nodes: Array, weights: Array) -> stochastic.Germ: ...
        @staticmethod
        def from_recurrence(alpha: Array, beta: Array) -> stochastic.Germ: ...
        @property
        def name(self) -> str: ...
        @property
        def capacity(self) -> int | None: ...
        def recurrence(self, length: int) -> tuple[Array, Array]: ...
        def gauss(self, count: int) -> tuple[Array, Array]: ...
        def evaluate(self, points: Array, degree: int) -> Array: ...

    class MultiIndexSet:
        @overload
        def __init__(
            self,
            *,
            shape: str,
            dimension: int,
            order: int,
            q: float,
            weights: Sequence[float],
            interaction: int,
            caps: Sequence[int],
            bytes_per_index: float,
            memory_limit: float,
        ) -> None: ...
        @overload
        def __init__(self, rows: IndexTable) -> None: ...
        @staticmethod
        def count(
            *,
            shape: str,
            dimension: int,
            order: int,
            q: float,
            weights: Sequence[float],
            interaction: int,
            caps: Sequence[int],
            stop: float,
        ) -> float: ...
        @property
        def table(self) -> IndexTable: ...
        @property
        def dimension(self) -> int: ...
        def __len__(self) -> int: ...
        def find(self, index: Sequence[int]) -> int | None: ...

    class ChaosBasis:
        def __init__(
            self, germs: Sequence[stochastic.Germ], indices: stochastic.MultiIndexSet
        ) -> None: ...
        def __len__(self) -> int: ...
        @property
        def dimension(self) -> int: ...
        @property
        def germs(self) -> list[stochastic.Germ]: ...
        @property
        def indices(self) -> stochastic.MultiIndexSet: ...
        def evaluate(self, points: Array) -> Array: ...
        def evaluate_fields(self, coefficients: Array, points: Array) -> Array: ...

    class Coupling:
        def __init__(
            self, basis: stochastic.ChaosBasis, coefficients: Array, property: stochastic.MultiIndexSet
        ) -> None: ...
        @property
        def points(self) -> int: ...
        @property
        def modes(self) -> int: ...
        @property
        def first(self) -> list[int]: ...
        @property
        def second(self) -> list[int]: ...
        @property
        def values(self) -> Array: ...
        def matrix(self, point: int) -> Array: ...
        def bounds(self) -> Array: ...
        def smallest(self) -> float: ...
        def apply(self, fields: Array, components: int) -> Array: ...

    class GalerkinOperator:
        def __init__(
            self, fixed: Sparse, terms: list[tuple[Sparse, Array, stochastic.Coupling]], modes: int
        ) -> None: ...
        @property
        def size(self) -> int: ...
        @property
        def modes(self) -> int: ...
        def apply(self, block: Array) -> Array: ...
        def matrix(self) -> Mat: ...

    class ColumnTransform:
        def __init__(
            self, *, forward: Array, backward: Array, values: Array, points: Array, weights: Array
        ) -> None: ...
        @property
        def forward(self) -> Array: ...
        @property
        def backward(self) -> Array: ...
        @property
        def values(self) -> Array: ...
        @property
        def points(self) -> Array: ...
        @property
        def weights(self) -> Array: ...

    @staticmethod
    def galerkin_matrix(
        basis: stochastic.ChaosBasis, coefficients: Array, property: stochastic.MultiIndexSet
    ) -> Sparse: ...
    @staticmethod
    def smallest_eigenvalue(matrix: Sparse) -> float: ...
    @staticmethod
    def critical_cov(germ: stochastic.Germ, order: int) -> float: ...
    @staticmethod
    def galerkin_transform(matrix: Sparse) -> stochastic.ColumnTransform: ...
    @staticmethod
    def galerkin_transforms(
        basis: stochastic.ChaosBasis, coefficients: Array, property: stochastic.MultiIndexSet
    ) -> tuple[list[Array], Array]: ...
    @staticmethod
    def quadrature_transform(
        basis: stochastic.ChaosBasis, points: Array, weights: Array
    ) -> stochastic.ColumnTransform: ...
    @staticmethod
    def tensor_gauss(
        germs: Sequence[stochastic.Germ], counts: Sequence[int], memory_limit: float
    ) -> tuple[Array, Array]: ...
    @staticmethod
    def smolyak(
        germs: Sequence[stochastic.Germ], level: int, memory_limit: float
    ) -> tuple[Array, Array]: ...
    @staticmethod
    def variance(coefficients: Array) -> Array: ...
    @staticmethod
    def sobol_closed(
        coefficients: Array, indices: stochastic.MultiIndexSet, group: Sequence[int]
    ) -> Array: ...
