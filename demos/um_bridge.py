"""An assembly over HTTP: the function of a bolted joint as a UM-Bridge model, with the standard library
alone.

UM-Bridge is how programs for uncertainty (MUQ, PyMC, CUQIpy, QMCPy, ...) talk to models: JSON over HTTP, see
https://um-bridge-benchmarks.readthedocs.io. `python um_bridge.py 4242` serves until it is stopped; without a
port the demo asks itself once, and checks what comes back.
"""

import json
import sys
import threading
import urllib.request
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np

import dolfinx_frontend as lf


def bolted_joint() -> lf.ProblemFunction:
    """Forces of joint and bolt as a function of stiffness and shortening of the bolt, and of the load."""
    scene = lf.Scene()
    for level, name in enumerate(("base", "cover")):
        part = lf.geometry.box((20.0, 30.0, 10.0), (2, 2, 1), (0.0, 0.0, 10.0 * level))
        scene.substructure(name, part, lf.LinearElastic(E=200e3, nu=0.0), degree=1)
    scene.fix("base:z0")
    scene.symmetry(["cover:x0", "cover:y0"])
    scene.interface("joint", "base:z1", "cover:z0", lf.Contact(stiffness=500.0))
    bolt = lf.Elastic(normal=lf.LogNormal("K", 5e4, cov=0.1), jump=-0.2, total=True)
    scene.interface("bolt", "base:z1", "cover:z0", bolt)
    scene.force("cover:z1", (0.0, 0.0, lf.LogNormal("Q", 3800.0, cov=0.15)), name="load")
    return lf.assemble(scene).function(["joint", "bolt"], options=lf.Options(rtol=1e-10))


# --- the server: thirty lines ---------------------------------------------------------------------------
f = bolted_joint()


def answer(path: str, asked: dict) -> dict:
    if path == "/Info":
        return {"protocolVersion": 1.0, "models": ["forward"]}
    if path == "/ModelInfo":
        support = {"Evaluate": True, "Gradient": True, "ApplyJacobian": True, "ApplyHessian": False}
        return {"support": support}
    if path == "/InputSizes":
        return {"inputSizes": [len(f.inputs)]}
    if path == "/OutputSizes":
        return {"outputSizes": [len(f.outputs)]}
    x = np.array(asked["input"][0], dtype=float)
    if path == "/Evaluate":
        return {"output": [f(x).tolist()]}
    if path == "/Gradient":
        return {"output": (np.array(asked["sens"]) @ f.gradient(x)).tolist()}
    if path == "/ApplyJacobian":
        return {"output": (f.gradient(x) @ np.array(asked["vec"])).tolist()}
    return {"error": {"type": "UnsupportedFeature", "message": f"{path} is not supported"}}


class Model(BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))) or "{}")
        try:
            found, status = answer(self.path, asked), 200
        except lf.SceneError as error:
            found, status = {"error": {"type": "InvalidInput", "message": str(error)}}, 400
        self.send_response(status)
        self.end_headers()
        self.wfile.write(json.dumps(found).encode())

    do_GET = do_POST

    def log_message(self, *_: object) -> None:
        """Nothing."""


port = int(sys.argv[1]) if len(sys.argv) > 1 else 0
server = HTTPServer(("localhost", port), Model)
print(f"serving {f} at http://localhost:{server.server_port}")
if port:
    server.serve_forever()

# --- without a port: a client, as any of these programs would be
# ---------------------------------------------
threading.Thread(target=server.serve_forever, daemon=True).start()


def ask(path: str, **body: object) -> dict:
    data = json.dumps({"name": "forward", "config": {}, **body}).encode()
    with urllib.request.urlopen(f"http://localhost:{server.server_port}{path}", data) as reply:
        return json.load(reply)


K, Q, D, joint = 5e4, 3800.0, 0.2, 500.0 * 600.0  # N/mm, N, mm, N/mm
bears = joint * (K * D - Q) / (K + joint)
forces = ask("/Evaluate", input=[[K, Q]])["output"][0]
slopes = ask("/Gradient", outWrt=0, inWrt=0, input=[[K, Q]], sens=[1.0, 0.0])["output"]
print("sizes", ask("/InputSizes")["inputSizes"], ask("/OutputSizes")["outputSizes"])
print(f"joint {forces[0]:.4f} N, exact {-bears:.4f} N; bolt {forces[1]:.4f} N, exact {bears + Q:.4f} N")
print(f"d joint / d Q = {slopes[1]:.8f}, exact {joint / (K + joint):.8f}")
assert np.allclose(forces, [-bears, bears + Q], rtol=1e-8)
assert np.isclose(slopes[1], joint / (K + joint), rtol=1e-7)
server.shutdown()
