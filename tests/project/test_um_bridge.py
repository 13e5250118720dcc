"""The server of demos/um_bridge.py: what is sent is answered, or refused in a sentence; others are served."""

from __future__ import annotations

import gzip
import http.client
import json
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

DEMO = Path(__file__).resolve().parents[2] / "demos" / "um_bridge.py"
K, Q = 5e4, 3800.0
GOOD = {"name": "forward", "config": {}, "input": [[K, Q]]}
SLOPE = GOOD | {"outWrt": 0, "inWrt": 0, "sens": [1.0, 0.0], "vec": [0.0, 1.0]}


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        number = int(free.getsockname()[1])
    line = [sys.executable, str(DEMO), str(number)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and "serving" in process.stdout.readline()
        yield number
        assert process.poll() is None
        process.kill()


def ask(port: int, path: str, body: Any, **headers: str) -> tuple[int, Any]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    data = body if isinstance(body, bytes) else json.dumps(body).encode()
    connection.request("POST", path, data, headers)
    reply = connection.getresponse()
    return reply.status, json.loads(reply.read())


def works(port: int) -> None:
    """The force of the bolt in closed form: it bears Q and what the joint bears."""
    status, found = ask(port, "/Evaluate", GOOD)
    joint = 500.0 * 600.0
    bears = joint * (K * 0.2 - Q) / (K + joint)
    assert status == 200 and found["output"][0] == pytest.approx([-bears, bears + Q], rel=1e-8)


@pytest.mark.parametrize(
    ("path", "body", "said"),
    [
        ("/Evaluate", b"no json", "no JSON"),
        ("/Evaluate", b"[" * 100_000, "no JSON"),
        ("/Evaluate", b'{"name": "forward", "input": [[1' + b"0" * 5000 + b", 1]]}", "no JSON"),
        ("/Evaluate", b"\xff\xfe", "no JSON"),
        ("/Evaluate", b"\x89PNG\r\n\x1a\n" + bytes(500), "no JSON"),
        ("/Evaluate", gzip.compress(json.dumps(GOOD).encode(), mtime=0), "no JSON"),
        ("/Evaluate", json.dumps(GOOD).encode()[:-9], "no JSON"),
        ("/Evaluate", bytes(500_000), "no JSON"),
        ("/Evaluate", b'{"name": ' + b"[" * 900 + b"]" * 900 + b"}", "there is one model"),
        ("/Evaluate", GOOD | {"name": "-o 'my \"forward\"';\n\u202e"}, "there is one model, 'forward'"),
        ("/Evaluate", [1], "no table"),
        ("/Evaluate", {}, "name = 'None'"),
        ("/Evaluate", GOOD | {"name": "backward"}, "name = 'backward': there is one model, 'forward'"),
        ("/InputSizes", GOOD | {"name": 3}, "there is one model"),
        ("/Evaluate", GOOD | {"config": 3}, "config: a table"),
        ("/Evaluate", {"name": "forward"}, "input: a list of one list"),
        ("/Evaluate", GOOD | {"input": [[K, Q], [K, Q]]}, "input: a list of one list"),
        ("/Evaluate", GOOD | {"input": [[K]]}, r"input[0] = [50000.0]: a list of 2 numbers"),
        ("/Evaluate", GOOD | {"input": [[K, "a"]]}, "input[0] has a, which is no finite number"),
        ("/Evaluate", GOOD | {"input": [[K, True]]}, "no finite number"),
        ("/Evaluate", GOOD | {"input": [[K, float("nan")]]}, "input[0] has nan"),
        ("/Evaluate", GOOD | {"input": [[K, 10**400]]}, "too large"),
        ("/Evaluate", GOOD | {"input": [[-1.0, Q]]}, "K"),
        ("/Gradient", SLOPE | {"outWrt": 1}, "outWrt = 1: there is one block"),
        ("/Gradient", SLOPE | {"inWrt": -1}, "inWrt = -1: there is one block"),
        ("/Gradient", SLOPE | {"inWrt": False}, "inWrt = False"),
        ("/Gradient", SLOPE | {"sens": None}, "sens = None: a list of 2"),
        ("/ApplyJacobian", SLOPE | {"vec": [1.0]}, "vec = [1.0]: a list of 2 numbers"),
        ("/Evaluate", GOOD | {"input": [[K, 1e308]]}, "the answer is [nan, nan], no finite numbers"),
        ("/ApplyHessian", SLOPE, "/ApplyHessian is not supported"),
        ("/../../etc/passwd", SLOPE, "is not supported"),
        ("/Evaluate", b" " * 3_000_000, "a request of 3000000 bytes"),
    ],
)
def test_what_is_malformed_is_said(port: int, path: str, body: Any, said: str) -> None:
    status, found = ask(port, path, body)
    assert status == 400 and said in found["error"]["message"]


def test_other_names_of_this_machine(port: int) -> None:
    """A page of the web that has its name lead here, or that posts here."""
    evil = "evil.example"
    for headers in ({"Host": evil}, {"Host": f"{evil}:{port}"}, {"Origin": f"http://{evil}"}):
        status, found = ask(port, "/Evaluate", GOOD, **headers)
        assert status == 400 and "Host or Origin" in found["error"]["message"]
    for length in ("-1", "abc", "1e3", "1000000000000", "9" * 30):
        status, found = ask(port, "/Evaluate", b"", **{"Content-Length": length})
        assert status == 400 and "Content-Length" in found["error"]["message"]


def test_silent_clients_and_those_that_go_away(port: int) -> None:
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(5)]
    silent[0].sendall(b"POST /Evaluate HTTP/1.1\r\nHost: localhost:1\r\nContent-Length: 500\r\n\r\n{")
    body = json.dumps(GOOD)
    head = f"POST /Evaluate HTTP/1.1\r\nHost: localhost:{port}\r\nContent-Length: {len(body)}"
    request = f"{head}\r\n\r\n{body}"
    for _ in range(5):
        gone = socket.create_connection(("127.0.0.1", port))
        gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # a reset
        gone.sendall(request.encode())
        gone.close()
    works(port)
    for each in silent:
        each.close()


def test_answers(port: int) -> None:
    works(port)
    ratio = 500.0 * 600.0 / (K + 500.0 * 600.0)
    assert ask(port, "/InputSizes", GOOD) == (200, {"inputSizes": [2]})
    assert ask(port, "/Gradient", SLOPE)[1]["output"][1] == pytest.approx(ratio, rel=1e-7)
    assert ask(port, "/ApplyJacobian", SLOPE)[1]["output"][0] == pytest.approx(ratio, rel=1e-7)
    assert ask(port, "/Info", b"")[1]["models"] == ["forward"]
