"""A contact scene in GetFEM: ``python getfem_contact.py SCENE ANSWER [REPEATS]``.

Its own brick for integral contact between meshes that need not match (augmented Lagrangian of Alart and
Curnier), multipliers P1 on the first face, friction in one step from the state without loads; semi-smooth
Newton with its own solver, each step one factorisation by MUMPS. Prescribed displacements are eliminated.

``setup``: meshes, spaces and bricks; ``solve``: all steps. Beside them, not part of the solve, the seconds of
one ``assembly`` of the tangent and of one ``factorisation`` and solve with the last one.
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter
from typing import Any

import getfem as gf
import numpy as np
from exchange import Answer, Scene, read_scene

DEGREE = 2
SOLVERS = ("mumps", "superlu")
RESIDUAL = 1e-9  # relative to the forces at hand
MOST_STEPS = 100
# versions of the augmentation: with friction the one of the fewest steps here (1: 8, 3: 8, 4: 6 or 7),
# without it the symmetric one
RUBBING, SMOOTH = 4, 2


class Model:
    """The scene as a GetFEM model."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.model = gf.Model("real")
        self.mesh: dict[str, Any] = {}
        self.fem: dict[str, Any] = {}
        self.quadrature: dict[str, Any] = {}
        self.regions: dict[str, int] = {}
        for name, body in scene.bodies.items():
            mesh = gf.Mesh("empty", 3)
            corners = np.ascontiguousarray(body.x[body.cells].transpose(2, 1, 0))
            mesh.add_convex(gf.GeoTrans("GT_PK(3,1)"), np.asfortranarray(corners))
            nodes = mesh.pts()
            for face, facets in body.faces.items():
                region = len(self.regions) + 1
                wanted = {tuple(row) for row in np.round(body.x[np.unique(facets)], 9) + 0.0}
                pids = [i for i, p in enumerate(np.round(nodes.T, 9) + 0.0) if tuple(p) in wanted]
                mesh.set_region(region, mesh.faces_from_pid(pids))
                self.regions[f"{name}:{face}"] = region
            fem = gf.MeshFem(mesh, 3)
            fem.set_fem(gf.Fem(f"FEM_PK(3,{DEGREE})"))
            # exact for the products of gradients in the bodies and of displacements on the faces
            im = gf.MeshIm(mesh, gf.Integ("IM_TETRAHEDRON(5)"))
            self.mesh[name], self.fem[name], self.quadrature[name] = mesh, fem, im
            self.model.add_fem_variable(f"u_{name}", fem)
            mu = body.E / (2.0 * (1.0 + body.nu))
            lame = body.E * body.nu / ((1.0 + body.nu) * (1.0 - 2.0 * body.nu))
            self.model.add_initialized_data(f"lambda_{name}", [lame])
            self.model.add_initialized_data(f"mu_{name}", [mu])
            self.model.add_isotropic_linearized_elasticity_brick(
                im, f"u_{name}", f"lambda_{name}", f"mu_{name}"
            )
        for number, (where, values) in enumerate(scene.given.items()):
            name = where.partition(":")[0]
            self.model.add_initialized_data(f"given{number}", values)
            self.model.add_Dirichlet_condition_with_simplification(
                f"u_{name}", self.regions[where], f"given{number}"
            )
        first, second = (face.partition(":")[0] for face in scene.contact)
        regions = [self.regions[face] for face in scene.contact]
        # of the order of modulus / length; ten times more or less changes the count of steps by one or two
        body = scene.bodies[first]
        corners = body.x[body.faces[scene.contact[0].partition(":")[2]]]
        length = np.ptp(corners, axis=(0, 1)).max()
        augmentation = min(each.E for each in scene.bodies.values()) / length
        self.model.add_initialized_data("r", [augmentation])
        rubs = ["mu_contact"] if scene.friction > 0.0 else []
        if rubs:
            self.model.add_initialized_data("mu_contact", [scene.friction])
        multiplier = gf.MeshFem(self.mesh[first], 3 if rubs else 1)
        multiplier.set_fem(gf.Fem("FEM_PK(3,1)"))
        self.model.add_filtered_fem_variable("stress", multiplier, regions[0])
        self.model.add_integral_contact_between_nonmatching_meshes_brick(
            self.quadrature[first],
            f"u_{first}",
            f"u_{second}",
            "stress",
            "r",
            *rubs,
            *regions,
            RUBBING if rubs else SMOOTH,
        )

    def solve(self) -> int:
        """Newton steps taken."""
        settings = ["max_iter", MOST_STEPS, "max_res", RESIDUAL, "lsearch", "simplest", "alpha min", 0.8]
        for solver in SOLVERS:
            try:
                steps, converged = self.model.solve("lsolver", solver, *settings)
            except RuntimeError as failure:
                print(f"GetFEM without {solver}: {failure}", file=sys.stderr)
                continue
            if not converged:
                raise SystemExit(f"GetFEM: not converged after {steps} steps")
            self.solver = solver
            return int(steps)
        raise SystemExit("GetFEM: no linear solver")

    def answer(self, seconds: dict[str, float], steps: int) -> Answer:
        """Displacements at all nodes, and the reaction of the held faces of the first body."""
        points, u = {}, {}
        for name, fem in self.fem.items():
            points[name] = fem.basic_dof_nodes()[:, ::3].T
            u[name] = self.model.variable(f"u_{name}").reshape(-1, 3)
        first = self.scene.contact[0].partition(":")[0]
        body, fem = self.scene.bodies[first], self.fem[first]
        data = gf.MeshFem(self.mesh[first], 1)
        data.set_classical_fem(0)
        ones = np.ones(data.nbdof())
        lame = body.E * body.nu / ((1.0 + body.nu) * (1.0 - 2.0 * body.nu))
        mu = body.E / (2.0 * (1.0 + body.nu))
        stiffness = gf.asm_linear_elasticity(self.quadrature[first], fem, data, lame * ones, mu * ones)
        inner = stiffness.mult(u[first].ravel())
        force = np.zeros(3)
        for where in self.scene.given:
            if where.startswith(f"{first}:"):
                dofs = np.unique(fem.basic_dof_on_region(self.regions[where]))
                force -= [inner[dofs[dofs % 3 == axis]].sum() for axis in range(3)]
        note = f"integral contact brick, Newton steps on {self.solver}"
        return Answer(points, u, force, seconds, steps, note)


def main() -> None:
    """Read, solve, write."""
    gf.util_trace_level(0)
    gf.util_warning_level(0)
    scene = read_scene(Path(sys.argv[1]))
    best: dict[str, float] = {}
    for _ in range(int(sys.argv[3]) if len(sys.argv) > 3 else 1):
        start = perf_counter()
        model = Model(scene)
        ready = perf_counter()
        steps = model.solve()
        seconds = {"setup": ready - start, "solve": perf_counter() - ready}
        if not best or sum(seconds.values()) < sum(best.values()):
            best = seconds
    start = perf_counter()
    model.model.assembly()
    assembled = perf_counter()
    gf.linsolve(model.solver, model.model.tangent_matrix(), model.model.rhs())
    best |= {"assembly": assembled - start, "factorisation": perf_counter() - assembled}
    model.answer(best, steps).write(Path(sys.argv[2]))


if __name__ == "__main__":
    main()
