"""A plane contact scene in GetFEM: ``python getfem_mortar.py SCENE ANSWER``.

Its brick for integral contact between meshes that need not match, with multipliers P1 on the first face and
quadratic displacements on the same, curved or straight, triangles. Scene (npz): for body 0 and 1 ``xK``
(cells, nodes, 2) in the order of GetFEM's lattice, ``materialK`` (E, nu), ``faceK`` (nodes, 2) of the
contact,
``held`` rows (body, axis, value of the displacement) with ``heldN`` (nodes, 2), ``load`` (a, b): the pressure
a + b cos 2 theta on the nodes ``loaded`` of body 0. Answer: ``x`` and ``pressure`` at the vertices of the
contact, ``steps``.
"""

from __future__ import annotations

import sys
from typing import Any

import getfem as gf
import numpy as np

DEGREE = 2


def region_of(mesh: Any, number: int, nodes: Any) -> int:
    """A region of the facets whose nodes are all among given ones."""
    wanted = {tuple(row) for row in np.round(nodes, 9) + 0.0}
    pids = [i for i, p in enumerate(np.round(mesh.pts().T, 9) + 0.0) if tuple(p) in wanted]
    mesh.set_region(number, mesh.faces_from_pid(pids))
    return number


def main() -> None:
    """Read, solve, write."""
    gf.util_trace_level(0)
    gf.util_warning_level(0)
    data = np.load(sys.argv[1])
    model = gf.Model("real")
    meshes, rules = [], []
    for k in (0, 1):
        x = data[f"x{k}"]
        order = 1 if x.shape[1] == 3 else 2
        mesh = gf.Mesh("empty", 2)
        mesh.add_convex(gf.GeoTrans(f"GT_PK(2,{order})"), np.asfortranarray(x.transpose(2, 1, 0)))
        fem = gf.MeshFem(mesh, 2)
        fem.set_fem(gf.Fem(f"FEM_PK(2,{DEGREE})"))
        rule = gf.MeshIm(mesh, gf.Integ("IM_TRIANGLE(7)"))
        E, nu = data[f"material{k}"]
        model.add_fem_variable(f"u{k}", fem)
        model.add_initialized_data(f"lambda{k}", [E * nu / ((1 + nu) * (1 - 2 * nu))])
        model.add_initialized_data(f"mu{k}", [E / (2 * (1 + nu))])
        model.add_isotropic_linearized_elasticity_brick(rule, f"u{k}", f"lambda{k}", f"mu{k}")
        region_of(mesh, 1, data[f"face{k}"])
        meshes.append(mesh)
        rules.append(rule)
    for n, (body, axis, value) in enumerate(data["held"]):
        k = int(body)
        region = region_of(meshes[k], 10 + n, data[f"held{n}"])
        matrix = np.zeros((2, 2))
        matrix[int(axis), int(axis)] = 1.0
        model.add_initialized_data(f"value{n}", np.where(np.arange(2) == axis, value, 0.0))
        model.add_initialized_data(f"which{n}", matrix)
        model.add_generalized_Dirichlet_condition_with_penalization(
            rules[k], f"u{k}", 1e9 * float(data[f"material{k}"][0]), region, f"value{n}", f"which{n}"
        )
    if "loaded" in data:
        a, b = data["load"].tolist()
        region = region_of(meshes[0], 2, data["loaded"])
        cosine = "(X(1)*X(1)-X(2)*X(2))/(X(1)*X(1)+X(2)*X(2))"
        model.add_linear_term(rules[0], f"({a!r}+({b!r})*{cosine})*(Normal.Test_u0)", region)
    multiplier = gf.MeshFem(meshes[0], 1)
    multiplier.set_fem(gf.Fem("FEM_PK(2,1)"))
    model.add_filtered_fem_variable("stress", multiplier, 1)
    model.add_initialized_data("r", [float(min(data["material0"][0], data["material1"][0]))])
    model.add_integral_contact_between_nonmatching_meshes_brick(
        rules[0], "u0", "u1", "stress", "r", 1, 1, 2
    )
    steps, converged = model.solve(
        "lsolver", "mumps", "max_iter", 100, "max_res", 1e-10, "lsearch", "simplest", "alpha min", 0.8
    )
    if not converged:
        raise SystemExit(f"GetFEM: not converged after {steps} steps")
    dofs = multiplier.basic_dof_on_region(1)
    found = model.mesh_fem_of_variable("stress")
    values = np.asarray(gf.compute(found, model.variable("stress"), "interpolate on", multiplier)).ravel()
    np.savez(
        sys.argv[2], x=multiplier.basic_dof_nodes()[:, dofs].T, pressure=-values[dofs], steps=int(steps)
    )


if __name__ == "__main__":
    main()
