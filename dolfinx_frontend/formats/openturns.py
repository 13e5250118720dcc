"""A chaos, or a function, as an OpenTURNS object."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from latin_core.stochastic import ChaosBasis

from dolfinx_frontend.common.arrays import Array
from dolfinx_frontend.common.checks import check_kind, check_known, checked_names, checked_reals
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.formats.chaos_file import one_dimensional
from dolfinx_frontend.uncertainty.correlated import CorrelatedParameter
from dolfinx_frontend.uncertainty.fitting import openturns
from dolfinx_frontend.uncertainty.parameters import RandomParameter
from dolfinx_frontend.uncertainty.space import RandomSpace

__all__ = ["function_of", "to_openturns"]

_log = logging.getLogger(__name__)


# ---------------------------------------------------------------------------------------------
# OpenTURNS
# ---------------------------------------------------------------------------------------------
def _continuous(ot: Any, law: Any, shift: float, scale: float) -> Any:
    """The law of (x - shift) / scale as an OpenTURNS distribution."""
    low, high = (float((end - shift) / scale) for end in law.support())
    finite = [math.isfinite(low), math.isfinite(high)]
    ends = [
        low if finite[0] else float((law.ppf(1e-15) - shift) / scale),
        high if finite[1] else float((law.isf(1e-15) - shift) / scale),
    ]

    class Law(ot.PythonDistribution):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(1)

        def getRange(self) -> Any:
            return ot.Interval(ends[:1], ends[1:], finite[:1], finite[1:])

        def computeCDF(self, x: Any) -> float:
            return float(law.cdf(shift + scale * x[0]))

        def computePDF(self, x: Any) -> float:
            return float(law.pdf(shift + scale * x[0])) * scale

        def getMean(self) -> list[float]:
            return [float((law.mean() - shift) / scale)]

        def getStandardDeviation(self) -> list[float]:
            return [float(law.std()) / scale]

    return ot.Distribution(Law())


def _distribution(ot: Any, parameter: RandomParameter, germ: bool) -> Any:
    """The law of a parameter or of its own germ."""
    shift, scale = 0.0, 1.0
    if parameter.affine:
        zero, one = parameter.value(np.array([0.0, 1.0]))
        shift, scale = float(zero), float(one - zero)
    family = str(parameter.germ).partition("(")[0]
    alpha, beta = parameter.germ.recurrence(2)
    native = None
    if family == "hermite":
        native = ot.Normal(0.0, 1.0)
    elif family == "legendre":
        native = ot.Uniform(-1.0, 1.0)
    elif family == "laguerre":
        native = ot.Gamma(alpha[0], 1.0, 0.0)
    elif family == "jacobi":
        # the two exponents from mean and variance
        middle, variance = 0.5 * (1.0 + alpha[0]), 0.25 * beta[1] ** 2
        total = middle * (1.0 - middle) / variance - 1.0
        native = ot.Beta(middle * total, (1.0 - middle) * total, -1.0, 1.0)
    if germ and native is not None:
        return native
    if native is not None and parameter.affine:
        return scale * native + shift
    law: Any = parameter._law
    if hasattr(law, "probabilities"):
        values = law.values if not germ else parameter.to_germ(law.values)
        return ot.UserDefined(np.asarray(values)[:, None], law.probabilities)
    shape = one_dimensional(parameter)
    if shape["map"] == "exponential":
        return ot.LogNormal(float(shape["offset"][0]), float(shape["scale"]), 0.0)
    return _continuous(ot, law, *((shift, scale) if germ else (0.0, 1.0)))


def to_openturns(
    space: RandomSpace,
    basis: ChaosBasis,
    coefficients: npt.ArrayLike,
    names: Sequence[str] = (),
    inputs: Literal["parameters", "germs"] = "parameters",
) -> Any:
    """A chaos as an ``openturns.FunctionalChaosResult``.

    Its metamodel, basis functions and Sobol indices
    (``openturns.FunctionalChaosSobolIndices``) are ours to rounding.  Its training sample is empty
    and its residuals are NaN: the coefficients come from a Galerkin projection, not from a fit.

    Parameters
    ----------
    space, basis
        Germs and modes.
    coefficients
        (rows, P + 1).
    names
        Names of the rows.
    inputs
        ``"parameters"``: input of the metamodel are the physical parameters in the order of the
        germs, with their joint distribution (Gaussian copula where correlated); a random field
        takes part by its germs.  ``"germs"``: the germs themselves.

    Raises
    ------
    SceneError
        OpenTURNS is not installed or too old, or the shapes do not fit.
    """
    check_kind("to_openturns", "space", space, RandomSpace, "give the germs, e.g. result.space")
    check_kind("to_openturns", "basis", basis, ChaosBasis, "give the modes, e.g. result.basis")
    block = checked_reals("to_openturns", "coefficients", coefficients, "give numbers (rows, P + 1)")
    table = basis.indices.table
    if block.ndim != 2 or block.shape[1] != len(table) or table.shape[1] != space.dimension:
        raise SceneError(
            f"to_openturns: coefficients of shape {block.shape} for {len(table)} modes of "
            f"{space.dimension} germs; wanted (rows, {len(table)})"
        )
    rows = checked_names("to_openturns", "names", names) or [f"y{i}" for i in range(len(block))]
    if len(rows) != len(block):
        raise SceneError(f"to_openturns: {len(rows)} names for {len(block)} rows")
    check_known("inputs", inputs, ("parameters", "germs"), "to_openturns")
    ot = openturns()
    inputs_of = _inputs(ot, space, inputs == "germs")
    product = _product_basis(ot, inputs_of.germs)
    enumeration = product.getEnumerateFunction()
    outputs = ot.Sample(0, len(block))
    outputs.setDescription(rows)
    arguments = [
        ot.Sample(0, space.dimension),
        outputs,
        inputs_of.joint,
        inputs_of.to_germs,
        inputs_of.from_germs,
        ot.OrthogonalBasis(product),
        [int(enumeration.inverse([int(d) for d in index])) for index in table],
        ot.Sample(block.T),
        _functions(ot, space, table),
    ]
    result = _chaos_result(ot, arguments, ot.Point(len(block), math.nan))
    result.setIsLeastSquares(False)
    return result


class _Inputs(NamedTuple):
    """Inputs of a metamodel as OpenTURNS knows them."""

    joint: Any  # their distribution
    germs: list[Any]  # distribution of each germ
    to_germs: Any  # function inputs -> germs
    from_germs: Any  # function germs -> inputs


def _inputs(ot: Any, space: RandomSpace, germs: bool) -> _Inputs:
    """The physical parameters as inputs, or the germs themselves."""
    size = space.dimension
    of_germs: list[Any] = [ot.Normal(0.0, 1.0)] * size
    of_inputs = list(of_germs)
    labels = list(space.germ_names)
    copula = np.eye(size)
    sources: dict[int, RandomParameter] = {}
    for part in space._blocks:
        columns = list(part.columns)
        copula[np.ix_(columns, columns)] = part.mixing @ part.mixing.T
        for column, member in zip(columns, part.members, strict=False):
            sources[column] = member
            labels[column] = member.name
            correlated = isinstance(member, CorrelatedParameter)
            marginal = member.marginal if isinstance(member, CorrelatedParameter) else member
            if not correlated:
                of_germs[column] = _distribution(ot, member, germ=True)
            of_inputs[column] = _distribution(ot, marginal, germ=False)
    if germs:
        measure = ot.JointDistribution(of_germs)
        measure.setDescription(space.germ_names)
        return _Inputs(measure, of_germs, ot.IdentityFunction(size), ot.IdentityFunction(size))
    joint = ot.JointDistribution(of_inputs)
    if not np.array_equal(copula, np.eye(size)):
        joint.setCopula(ot.NormalCopula(ot.CorrelationMatrix(copula)))
    joint.setDescription(labels)
    return _Inputs(joint, of_germs, *_transformations(ot, space, sources))


def _product_basis(ot: Any, germs: Sequence[Any]) -> Any:
    """Products of the orthonormal polynomials of germs with these distributions."""
    families = [ot.StandardDistributionPolynomialFactory(law) for law in germs]
    # the plain enumeration does not know that a discrete germ has finitely many polynomials
    if any(law.isDiscrete() for law in germs):
        enumeration = ot.HyperbolicAnisotropicEnumerateFunction(len(germs), 1.0)
    else:
        enumeration = ot.LinearEnumerateFunction(len(germs))
    return ot.OrthogonalProductPolynomialFactory(families, enumeration)


def _functions(ot: Any, space: RandomSpace, table: npt.NDArray[np.int32]) -> list[Any]:
    """The modes, products of our polynomials."""
    polynomials = _polynomials(ot, space, table)
    functions = []
    for index in table:
        factors = ot.PolynomialCollection()
        for germ, degree in enumerate(index):
            factors.add(polynomials[germ][degree])
        functions.append(ot.Function(ot.ProductPolynomialEvaluation(factors)))
    return functions


def _chaos_result(ot: Any, arguments: Sequence[Any], unknown: Any) -> Any:
    """The result; older releases also ask for residuals and relative errors."""
    refused: Exception | None = None
    for errors in ([], [unknown, unknown]):
        try:
            return ot.FunctionalChaosResult(*arguments, *errors)
        except (TypeError, NotImplementedError) as error:
            refused = error
    raise SceneError(
        f"to_openturns: OpenTURNS {ot.__version__} makes a FunctionalChaosResult in another "
        f"way; install OpenTURNS 1.24 to 1.27 ({refused})"
    ) from refused


def _polynomials(ot: Any, space: RandomSpace, table: npt.NDArray[np.int32]) -> list[list[Any]]:
    """Germ -> psi_0, psi_1, ... by our recurrence, as OpenTURNS spells it.

    There psi_k+1 = (a_k x + b_k) psi_k + c_k psi_k-1.
    """
    constant = ot.UniVariatePolynomial([1.0])
    result = []
    for germ, highest in zip(space.germs, table.max(axis=0), strict=True):
        alpha, beta = germ.recurrence(int(highest) + 1)
        steps = [
            [1.0 / beta[k + 1], -alpha[k] / beta[k + 1], -beta[k] / beta[k + 1] if k else 0.0]
            for k in range(int(highest))
        ]
        result.append(
            [
                ot.OrthogonalUniVariatePolynomial(steps[:k]) if k else constant
                for k in range(int(highest) + 1)
            ]
        )
    return result


def _transformations(
    ot: Any, space: RandomSpace, sources: Mapping[int, RandomParameter]
) -> tuple[Any, Any]:
    """Inputs -> germs and germs -> inputs."""
    size = space.dimension
    if all(source.affine for source in sources.values()):
        shift, scale = np.zeros(size), np.ones(size)
        for column, source in sources.items():
            zero, one = source.value(np.array([0.0, 1.0]))
            shift[column], scale[column] = zero, one - zero
        nothing = np.zeros(size)
        return (
            ot.LinearFunction(shift, nothing, ot.Matrix(np.diag(1.0 / scale))),
            ot.LinearFunction(nothing, shift, ot.Matrix(np.diag(scale))),
        )

    def to_germs(inputs: Any) -> Array:
        values = np.array(inputs, dtype=np.float64)
        points = space.germ_points({s.name: values[:, c] for c, s in sources.items()})
        rest = [c for c in range(size) if c not in sources]
        points[:, rest] = values[:, rest]
        return points

    def to_inputs(germs: Any) -> Array:
        points = np.array(germs, dtype=np.float64)
        values = points.copy()
        for column, source in sources.items():
            values[:, column] = space.values(source, points)
        return values

    return (
        ot.PythonFunction(size, size, func_sample=to_germs),
        ot.PythonFunction(size, size, func_sample=to_inputs),
    )


def function_of(
    call: Callable[[Array], Array],
    gradient: Callable[[Array], Array],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> Any:
    """A vectorised function as an ``openturns.Function`` with its gradient.

    Parameters
    ----------
    call
        Points (N, inputs) -> (N, outputs).
    gradient
        A point (inputs,) -> (outputs, inputs).

    Raises
    ------
    SceneError
        OpenTURNS is not installed.
    """
    ot = openturns()

    def told(function: Callable[[Array], Array], points: Array) -> Array:
        try:
            return function(points)
        except Exception as error:
            _log.error("%s", error)  # OpenTURNS raises "Python exception" and drops what was said
            raise

    def at(points: Any) -> Array:
        return told(call, np.array(points, dtype=np.float64).reshape(-1, len(inputs)))

    def slopes(point: Any) -> list[list[float]]:
        found = told(gradient, np.array(point, dtype=np.float64))
        return [[float(each) for each in row] for row in found.T]

    function = ot.PythonFunction(
        len(inputs), len(outputs), func=lambda point: at([point])[0], func_sample=at, gradient=slopes
    )
    function.setInputDescription(list(inputs))
    function.setOutputDescription(list(outputs))
    return function
