"""Statically admissible stresses in a rectangle, from Airy's function: bounds of energies from above.

Bicubic Hermite elements (Bogner, Fox and Schmit 1965) for phi with sigma_xx = phi,yy, sigma_yy = phi,xx and
sigma_xy = -phi,xy are in equilibrium everywhere, whatever phi is. Of all that balance the loads the true
stress has the least complementary energy (Prager and Synge 1947): with no displacement imposed but zero,

    a(u_h) <= a(u) <= 2 C(sigma),   so   a(u - u_h) = a(u) - a(u_h) <= 2 C(sigma) - a(u_h).

Nothing here knows of displacements, nor of the package.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve

Array = npt.NDArray[np.float64]

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(4)


def _hermite(t: Array, h: float, derivative: int) -> Array:
    """(4, n): values and slopes at both ends of an interval of length h, at t in 0..1."""
    rows = [
        np.polynomial.Polynomial(c)
        for c in ([1, 0, -3, 2], [0, h, -2 * h, h], [0, 0, 3, -2], [0, 0, -h, h])
    ]
    return np.array([(p.deriv(derivative) if derivative else p)(t) / h**derivative for p in rows])


@dataclass(frozen=True)
class Rectangle:
    """A rectangle 0..length x 0..height in plane strain, held in part of y = 0 and free or loaded elsewhere.

    Attributes
    ----------
    held
        Share of y = 0, from x = 0 on, without displacement.
    top
        Downward normal pressure on y = height at its left and its right end, linear between.
    shear
        Traction along x on y = height: 4 shear s (1 - s), s = x / length; it vanishes at the corners, where
        the free sides have no shear stress.
    pull
        Normal traction on x = length.
    seam
        Height of a line of springs; None: there is none. Their stiffnesses are `springs`.
    young
        Below and above the seam.
    """

    length: float
    height: float
    held: float = 1.0
    top: tuple[float, float] = (0.0, 0.0)
    shear: float = 0.0
    pull: float = 0.0
    seam: float | None = None
    springs: tuple[float, float] = (1e3, 1e3)
    young: tuple[float, float] = (1e3, 1e3)
    nu: float = 0.3

    def pressure(self, x: Array) -> Array:
        """Downward pressure on the top at (n,)."""
        return np.asarray(self.top[0] + (self.top[1] - self.top[0]) * x / self.length)

    def traction(self, x: Array) -> Array:
        """Traction along x on the top at (n,)."""
        s = x / self.length
        return np.asarray(4.0 * self.shear * s * (1.0 - s))

    def twice_the_complementary_energy(self, n: int) -> float:
        """Of the best of the stresses of n cells along the height."""
        count = (max(4, 2 * round(0.5 * n * self.length / self.height)), n)
        x, y = (np.linspace(0.0, end, m + 1) for end, m in zip((self.length, self.height), count))
        hx, hy = x[1], y[1]
        t = 0.5 * (POINTS + 1.0)
        bx, by = ([_hermite(t, h, k) for k in range(3)] for h in (hx, hy))
        w = 0.25 * np.outer(WEIGHTS, WEIGHTS).ravel() * hx * hy

        def product(kx: int, ky: int) -> Array:
            """Second derivatives (16, points) of the functions of a cell, by local node x, y."""
            out = np.einsum("ap,bq->abpq", bx[kx], by[ky])
            return out.reshape(16, -1)

        xx, yy, xy = product(0, 2), product(2, 0), -product(1, 1)
        nu = self.nu
        unit = (1 - nu**2) * (
            (xx * w) @ xx.T + (yy * w) @ yy.T - nu / (1 - nu) * ((xx * w) @ yy.T + (yy * w) @ xx.T)
        ) + 2 * (1 + nu) * (xy * w) @ xy.T
        rows, cols, values = [], [], []
        for i in range(count[0]):
            for j in range(count[1]):
                above = self.seam is not None and y[j] > self.seam - 1e-9
                dofs = self._dofs(i, j, len(y))
                rows.append(np.repeat(dofs, 16))
                cols.append(np.tile(dofs, 16))
                values.append((unit / self.young[int(above)]).ravel())
        line = [each * np.sqrt(0.5 * WEIGHTS * hx) for each in bx]
        if self.seam is not None:
            j = round(self.seam / hy)
            assert abs(y[j] - self.seam) < 1e-9
            of_normal = line[2] @ line[2].T / self.springs[0]  # sigma_yy = phi,xx
            of_shear = line[1] @ line[1].T / self.springs[1]  # sigma_xy = -(phi,y),x
            for i in range(count[0]):
                dofs = self._dofs(i, j, len(y)).reshape(4, 4)
                for block, column in ((of_normal, 0), (of_shear, 1)):
                    d = dofs[:, column]
                    rows.append(np.repeat(d, 4))
                    cols.append(np.tile(d, 4))
                    values.append(block.ravel())
        size = 4 * len(x) * len(y)
        flat = [np.concatenate(each) for each in (values, rows, cols)]
        matrix = sp.csr_matrix((flat[0], (flat[1], flat[2])), shape=(size, size))
        known = self._boundary(x, y)
        fixed = np.array(sorted(known), dtype=np.int64)
        phi = np.zeros(size)
        phi[fixed] = [known[k] for k in fixed]
        free = np.setdiff1d(np.arange(size), fixed)
        phi[free] = spsolve(matrix[free][:, free].tocsc(), -(matrix @ phi)[free])
        return float(phi @ (matrix @ phi))

    @staticmethod
    def _dofs(i: int, j: int, rows: int) -> npt.NDArray[np.int64]:
        """(16,) unknowns of a cell: for value and slope along x at both ends the same along y."""
        return np.array(
            [
                4 * ((i + a) * rows + j + b) + 2 * dx + dy
                for a in (0, 1)
                for dx in (0, 1)
                for b in (0, 1)
                for dy in (0, 1)
            ]
        )

    def _boundary(self, x: Array, y: Array) -> dict[int, float]:
        """Unknowns of phi on the edges whose tractions t are given: d phi,y / ds = t_x, d phi,x / ds = -t_y.

        Counterclockwise from the end of what is held; unknowns of a node: phi, phi,y, phi,x, phi,xy.
        """
        known: dict[int, float] = {}
        length, height, rows = self.length, self.height, len(y)

        def put(i: int, j: int, *values: float) -> None:
            known.update({4 * (i * rows + j) + k: v for k, v in enumerate(values)})

        first = round(self.held * (len(x) - 1))
        assert abs(x[first] - self.held * length) < 1e-9
        for i in range(first, len(x)) if self.held < 1.0 else ():  # free: nothing changes
            put(i, 0, 0.0, 0.0, 0.0, 0.0)
        for j, s in enumerate(y):
            put(len(x) - 1, j, 0.5 * self.pull * s**2, self.pull * s, 0.0, 0.0)
        # along the top with r = length - x: t = (traction, -pressure)
        poly = np.polynomial.Polynomial
        at = poly([1.0, -1.0 / length])  # x / length
        t_x, p = 4.0 * self.shear * at * (1.0 - at), self.top[0] + (self.top[1] - self.top[0]) * at
        slope_y, slope_x = t_x.integ() + self.pull * height, p.integ()
        value = (-1.0 * slope_x).integ() + 0.5 * self.pull * height**2  # d phi / dr = -phi,x
        for i, s in enumerate(x):
            r = length - s
            put(i, rows - 1, value(r), slope_y(r), slope_x(r), -t_x(r))
        end = (value(length), slope_y(length), slope_x(length))
        for j, s in enumerate(y):  # down the free left side
            put(0, j, end[0] + (s - height) * end[1], end[1], end[2], 0.0)
        return known


def loads(case: Rectangle) -> Callable[[Array], Array]:
    """Traction (n, 2) on the top at points (n, 2)."""
    return lambda x: np.stack([case.traction(x[:, 0]), -case.pressure(x[:, 0])], axis=1)
