"""The smallest complete script: two steel blocks, joined by an elastic layer, pulled apart.

The bar is uniform, so the finite element answer is exact on every mesh: the layer opens by t / k, and each
block stretches by t L / E (nu = 0 keeps the state one-dimensional).
"""

import numpy as np

from dolfinx_frontend import Elastic, LinearElastic, Options, Scene, assemble, geometry, solve, sweep

E, k, t, length = 200e3, 50.0, 10.0, 20.0  # MPa, N/mm^3, MPa, mm

scene = Scene()
for name, x0 in (("left", 0.0), ("right", length)):
    block = geometry.box((length, 10.0, 10.0), (3, 2, 2), origin=(x0, 0.0, 0.0), cell="hexahedron")
    scene.substructure(name, block, LinearElastic(E=E, nu=0.0), degree=1)
scene.interface("layer", "left:x1", "right:x0", Elastic(normal=k, tangential=k))
scene.fix("left:x0")
scene.traction("right:x1", (t, 0.0, 0.0))
problem = assemble(scene)
print(problem)

result = solve(problem, method="accelerated", options=Options(rtol=1e-10))
print(result.plan)
opening = result.jump("layer")[:, 0]
end = result.displacement("right").x.array.reshape(-1, 3)[:, 0].max()
exact = t / k + 2.0 * t * length / E
print(f"opening of the layer {opening.mean():.9f} mm, exact {t / k:.9f} mm")
print(f"displacement of the end {end:.9f} mm, exact {exact:.9f} mm, {result.iterations} iterations")
assert np.allclose(opening, t / k, rtol=1e-8) and np.isclose(end, exact, rtol=1e-8)

stiffness = np.geomspace(5.0, 500.0, 7)
surface = sweep(problem, {"layer.normal": stiffness}, options=Options(rtol=1e-10))
openings = surface.jump("layer")[..., 0].mean(axis=-1)
for value, mean, count in zip(stiffness, openings, surface.iterations, strict=True):
    print(f"k = {value:7.2f} N/mm^3   opening {mean:.6f} mm   {count} iterations")
assert np.allclose(openings, t / stiffness, rtol=1e-8)
