"""An assembly over HTTP: the function of a bolted joint as a UM-Bridge model, with the standard library
alone.

UM-Bridge is how programs for uncertainty (MUQ, PyMC, CUQIpy, QMCPy, ...) talk to models: JSON over HTTP, see
https://um-bridge-benchmarks.readthedocs.io. `python um_bridge.py 4242` serves this machine until it ends;
without a port the demo asks itself once, and checks what comes back.
"""

import json
import math
import socket
import sys
import threading
import urllib.error
import urllib.request
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

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


# --- the server ---------------------------------------------------------------------------------------------
f = bolted_joint()
NAME = "forward"
HOSTS = ("localhost", "127.0.0.1")  # a page of the web reaches this machine under another name only
SECONDS = 10.0  # in which a client sends its request, and takes its answer
BYTES = 1 << 20  # of a request: some ten thousand numbers
CLIENTS = 32  # at once
solving = threading.Lock()  # one at a time: others wait, but are heard


def numbers(asked: dict, name: str, count: int) -> np.ndarray:
    """A list of so many finite numbers that was sent."""
    given = asked.get(name)
    if not isinstance(given, list) or len(given) != count:
        raise ValueError(f"{name} = {str(given)[:60]}: a list of {count} numbers is wanted")
    for each in given:
        if type(each) not in (int, float) or not abs(each) < math.inf:
            raise ValueError(f"{name} has {str(each)[:60]}, which is no finite number")
    return np.array([float(each) for each in given])


def output(found: np.ndarray) -> list:
    """What is sent back: JSON has no other numbers than finite ones."""
    if not np.isfinite(found).all():
        raise ValueError(f"the answer is {found.tolist()}, no finite numbers: give other input")
    return found.tolist()


def answer(path: str, asked: dict) -> dict:
    if path == "/Info":
        return {"protocolVersion": 1.0, "models": [NAME]}
    if asked.get("name") != NAME:
        raise ValueError(f"name = {str(asked.get('name'))[:60]!r}: there is one model, {NAME!r}")
    if not isinstance(asked.get("config", {}), dict):
        raise ValueError("config: a table is wanted")
    if path == "/ModelInfo":
        support = {"Evaluate": True, "Gradient": True, "ApplyJacobian": True, "ApplyHessian": False}
        return {"support": support}
    if path == "/InputSizes":
        return {"inputSizes": [len(f.inputs)]}
    if path == "/OutputSizes":
        return {"outputSizes": [len(f.outputs)]}
    if path not in ("/Evaluate", "/Gradient", "/ApplyJacobian"):
        return {"error": {"type": "UnsupportedFeature", "message": f"{path[:60]} is not supported"}}
    blocks = asked.get("input")
    if not isinstance(blocks, list) or len(blocks) != 1:
        raise ValueError("input: a list of one list of numbers is wanted")
    x = numbers({"input[0]": blocks[0]}, "input[0]", len(f.inputs))
    if path == "/Evaluate":
        with solving:
            return {"output": [output(f(x))]}
    for index in ("outWrt", "inWrt"):
        if type(asked.get(index)) is not int or asked[index] != 0:
            raise ValueError(f"{index} = {str(asked.get(index))[:60]}: there is one block of numbers, 0")
    if path == "/Gradient":
        sens = numbers(asked, "sens", len(f.outputs))
        with solving:
            return {"output": output(sens @ f.gradient(x))}
    vec = numbers(asked, "vec", len(f.inputs))
    with solving:
        return {"output": output(f.gradient(x) @ vec)}


class Model(BaseHTTPRequestHandler):
    timeout = SECONDS

    def setup(self) -> None:
        super().setup()
        # however slowly a client sends, after this it is at its end
        self.late = threading.Timer(SECONDS, self.connection.shutdown, (socket.SHUT_RD,))
        self.late.daemon = True
        self.late.start()

    def finish(self) -> None:
        self.late.cancel()
        super().finish()

    def asked(self) -> dict:
        """What the client sent."""
        length = self.headers.get("Content-Length", "0")
        if not (length.isascii() and length.isdigit() and len(length) < 12):
            raise ValueError("Content-Length: the number of bytes is wanted")
        left = int(length)
        while left > BYTES:  # it hears what is wrong when it has sent everything
            piece = self.rfile.read(BYTES)
            left = left - len(piece) if piece else 0
        sent = self.rfile.read(left)
        self.late.cancel()
        if int(length) > BYTES:
            raise ValueError(f"a request of {length} bytes: {BYTES} are the most")
        called = [self.headers.get("Host", "")]
        called += [each.partition("://")[2] for each in self.headers.get_all("Origin", [])]
        if any(each.partition(":")[0] not in HOSTS for each in called):
            raise ValueError(f"Host or Origin: the name of this server is {HOSTS[0]}:{server.server_port}")
        try:
            found = json.loads(sent or "{}")
        except (ValueError, RecursionError):
            raise ValueError("the request is no JSON") from None
        if not isinstance(found, dict):
            raise ValueError("the request is no table of JSON")
        return found

    def do_POST(self) -> None:
        try:
            found = answer(self.path, self.asked())
        except (TimeoutError, ConnectionError):
            self.close_connection = True
            return
        except (ValueError, ArithmeticError, RuntimeError) as error:  # SceneError is one of the first
            found = {"error": {"type": "InvalidInput", "message": str(error)}}
        body = json.dumps(found, allow_nan=False).encode()
        self.send_response(400 if "error" in found else 200)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    do_GET = do_POST

    def log_message(self, *_: object) -> None:
        """Nothing."""


class Server(ThreadingHTTPServer):
    """Every client has a thread: one that is silent keeps nobody waiting."""

    daemon_threads = True
    places = threading.BoundedSemaphore(CLIENTS)

    def process_request(self, request, client_address) -> None:  # noqa: ANN001
        if self.places.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request, client_address) -> None:  # noqa: ANN001
        try:
            super().process_request_thread(request, client_address)
        finally:
            self.places.release()

    def handle_error(self, request, client_address) -> None:  # noqa: ANN001
        """A client that went away: nothing is to be said."""


port = int(sys.argv[1]) if len(sys.argv) > 1 else 0
server = Server(("localhost", port), Model)
print(f"serving {f} at http://localhost:{server.server_port}", flush=True)
if port:
    server.serve_forever()

# --- without a port: a client, as any of these programs would be --------------------------------------------
threading.Thread(target=server.serve_forever, daemon=True).start()


def ask(path: str, **body: object) -> dict:
    data = json.dumps({"name": NAME, "config": {}, **body}).encode()
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
try:
    ask("/Evaluate", input=[[K]])
except urllib.error.HTTPError as error:
    print("refused:", json.load(error)["error"]["message"])
server.shutdown()
