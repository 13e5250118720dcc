"""A row of blocks joined by soft layers, distributed over the MPI ranks.

    ./run mpirun -n 2 python demos/chain_over_ranks.py

runs it on two ranks, ``./run python demos/chain_over_ranks.py`` on one, with the same answer up to rounding.
Every rank runs the whole script: it describes the same scene, but makes only the meshes of its own parts.
"""

import numpy as np
from mpi4py import MPI

from dolfinx_frontend import Contact, Elastic, LinearElastic, Options, Scene, assemble, geometry, solve

PARTS, E, length = 8, 200e3, 10.0  # MPa, mm
pressure = 20.0  # MPa
world = MPI.COMM_WORLD


def block(k):
    """Mesh of block k; called on its own rank, when the scene is assembled."""
    return geometry.box((length, 10.0, 10.0), (3, 3, 3), origin=(k * length, 0, 0), cell="hexahedron")


scene = Scene()
for k in range(PARTS):
    scene.substructure(f"b{k}", lambda k=k: block(k), LinearElastic(E=E, nu=0.0), degree=2)
scene.fix("b0:x0", components=0)
scene.symmetry(["b0:y0", "b0:z0"])
for k in range(1, PARTS):
    law = Contact(friction=0.3) if k == PARTS // 2 else Elastic(normal=1e4, tangential=1e4)
    scene.interface(f"joint{k}", f"b{k - 1}:x1", f"b{k}:x0", law)
scene.pressure(f"b{PARTS - 1}:x1", pressure)

problem = assemble(scene, comm=world)
result = solve(problem, options=Options(rtol=1e-10))
if world.rank == 0:
    print(result.plan)
    print(result)

# a rank has the displacements of its own parts, and the forces of the interfaces that touch them
own = {name: u.reshape(-1, 3)[:, 0].min() for name, u in result.displacements.items()}
print(f"rank {world.rank}: {', '.join(problem.substructures)}")
everywhere = {name: u for each in world.allgather(own) for name, u in each.items()}
force, _ = result.gathered(f"joint{PARTS // 2}")  # the same on all ranks; all must call it

# the row is uniform: every block shortens by p L / E, every spring by p / k
exact = -pressure * (PARTS * length / E + (PARTS - 2) / 1e4)
end = everywhere[f"b{PARTS - 1}"]
if world.rank == 0:
    print(f"displacement of the end {end:.9f} mm, exact {exact:.9f} mm")
total = problem.interfaces[f"joint{PARTS // 2}"].weights @ force[:, 0]
assert np.isclose(end, exact, rtol=1e-8) and np.isclose(total, -pressure * 100.0, rtol=1e-8)
