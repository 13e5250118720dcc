"""The private root of `./run`: the user's folders, terminal, signals and variables are as without it.

The host is a folder as well: a chroot with the system's /usr, in which the root is entered.
"""

from __future__ import annotations

import json
import os
import pty
import select
import shutil
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LINKS = {"bin": "usr/bin", "lib": "usr/lib", "lib64": "usr/lib64", "sbin": "usr/sbin"}
PRIVATE = "root/.cache/latin/trixie-0"
USERS = ("home/me", "root", "data", "my data", "mnt", "opt", "srv", "media", "tmp", "var/tmp", "check")


def own_mounts() -> list[str]:
    """The start of a command that runs with mounts of its own; empty if that cannot be had."""
    if os.geteuid() == 0 and shutil.which("unshare"):
        # in a private root, which is no mount, nothing can be said, and nothing has to be
        for kind in ("slave", "unchanged"):
            line = ["unshare", "--mount", "--propagation", kind]
            if subprocess.run([*line, "true"], check=False, capture_output=True).returncode == 0:
                return line
    return []


UNSHARE = own_mounts()
pytestmark = pytest.mark.skipif(not UNSHARE, reason="needs root and the right to mount")


@pytest.fixture
def host(tmp_path: Path) -> Path:
    """A host with a private root in the cache of its user root, as they are on a disk."""
    top = tmp_path / "host"
    for system in (top, top / PRIVATE):
        for name in ("usr", "proc", "sys", "dev", "etc", "run", "home", "root", "tmp", "var/lib", "check"):
            (system / name).mkdir(parents=True, exist_ok=True)
        for name, target in LINKS.items():
            (system / name).symlink_to(target)
    (top / "etc" / "who").write_text("host")
    (top / PRIVATE / "etc" / "who").write_text("root")
    (top / PRIVATE / "root" / "hidden").write_text("")
    for name in USERS:
        (top / name).mkdir(parents=True, exist_ok=True)
        (top / name / "part.step").write_text(name)
    (top / "data" / "big").mkdir()
    (top / "scratch").symlink_to("data/big")
    (top / "home" / "linked").symlink_to("/data/big")
    (top / "project").mkdir()
    (top / "project" / "run").write_text('exec "$@"\n')
    shutil.copytree(ROOT / "tools" / "env", top / "checkout" / "tools" / "env")
    shutil.copy(ROOT / "run", top / "checkout" / "run")
    return top


def command(host: Path, *inside: str, cwd: str = "/data", **variables: str) -> list[str]:
    """The command line that enters the root on this host and runs `inside` there."""
    enter = f"""
set -e
host=$1; shift
mount --rbind "$host" "$host"
for system in "$host" "$host/{PRIVATE}"; do mount --rbind /usr "$system/usr"; done
for name in proc sys dev; do mount --rbind "/$name" "$host/$name"; done
exec chroot "$host" bash -c '
  source /checkout/run
  latin_home=/project
  cd "$1"; shift
  enter_root /{PRIVATE} "$@"' run "$@"
"""
    settings = [f"{name}={value}" for name, value in {"HOME": "/root", **variables}.items()]
    return ["env", *settings, *UNSHARE, "bash", "-c", enter, "enter", str(host), cwd, *inside]


def run(host: Path, *inside: str, text: str = "", cwd: str = "/data", **variables: str) -> str:
    done = subprocess.run(
        command(host, *inside, cwd=cwd, **variables), input=text, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout


def python(text: str) -> tuple[str, ...]:
    # isolated: /usr alone is a whole Python
    return ("/usr/bin/python3", "-ISc", text)


def test_folders_of_the_user_are_there_to_read_and_write(host: Path) -> None:
    script = f"""
import json
for name in {USERS}:
    with open("/" + name + "/part.step") as file, open("/" + name + "/out.json", "w") as out:
        json.dump([file.read()], out)
"""
    run(host, *python(script))
    for name in USERS:
        assert json.loads((host / name / "out.json").read_text()) == [name]


def test_folders_of_the_system_are_those_of_the_root(host: Path) -> None:
    script = "cat /etc/who; ls -d /root/hidden 2>/dev/null; ls /checkout /project; pwd"
    assert run(host, "bash", "-c", script, cwd="/my data").split("\n")[:-1] == (
        ["root/checkout:", "run", "tools", "", "/project:", "run", "/my data"]
    )


@pytest.mark.parametrize(
    ("home", "expected"),
    [
        ("/root", "/root"),
        ("/home/me", "/home/me"),
        ("/home/linked", "/home/linked"),
        ("/scratch", "/scratch"),
        ("/etc", "/root"),
        ("/nowhere", "/root"),
    ],
)
def test_the_home_folder(host: Path, home: str, expected: str) -> None:
    script = "echo $HOME; echo x >~/out.json"
    assert run(host, "bash", "-c", script, HOME=home).strip() == expected
    real = {"/home/linked": "data/big", "/scratch": "data/big"}.get(home, expected.lstrip("/"))
    assert (host / real / "out.json").read_text() == "x\n"


def test_a_folder_of_a_service(host: Path) -> None:
    (host / "var/lib/ci").mkdir()
    script = "pwd; echo x >out; echo y >~/mine"
    assert run(host, "bash", "-c", script, cwd="/var/lib/ci", HOME="/var/lib/ci").strip() == "/var/lib/ci"
    assert (host / "var/lib/ci/out").exists() and (host / "var/lib/ci/mine").exists()


def test_input_output_and_exit_code(host: Path) -> None:
    assert run(host, "cat", text="one\ntwo") == "one\ntwo"
    done = subprocess.run(command(host, "bash", "-c", "exit 7"), check=False)
    assert done.returncode == 7


def test_variables_of_the_user(host: Path) -> None:
    mine = {"MY_DATA": "a b\nc", "LATIN_PROGRESS": "0", "OMP_NUM_THREADS": "2", "TMPDIR": "/data/big"}
    foreign = {"PYTHONPATH": "/x", "LD_LIBRARY_PATH": "/x", "PETSC_DIR": "/x", "CONDA_PREFIX": "/x"}
    script = "import json, os; print(json.dumps(dict(os.environ)))"
    seen = json.loads(run(host, *python(script), **mine, **foreign))
    assert {name: seen[name] for name in mine} == mine
    assert not set(foreign) & set(seen)
    assert seen["LATIN_ENVIRONMENT"] == "trixie-0" and seen["LANG"] == "C.UTF-8"
    assert "TMPDIR" not in json.loads(run(host, *python(script), TMPDIR="/run"))


WAIT = "import time; print('ready', flush=True); time.sleep(60)"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_signals_reach_the_program(host: Path, number: signal.Signals) -> None:
    """The program is the process that was started: nobody is left to hand a signal on, or to survive."""
    with subprocess.Popen(
        command(host, *python(WAIT)), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "ready\n"
        process.send_signal(number)
        assert process.wait(30) == -number
        assert process.stdout.read() == ""  # nobody holds the other end
        assert process.stderr.read().count("KeyboardInterrupt") == (number == signal.SIGINT)


def on_a_terminal(line: Sequence[str], keys: bytes = b"", after: bytes = b"") -> tuple[str, int]:
    """Output and exit code of a session of its own on a terminal, at which `keys` are pressed."""
    terminal, other = pty.openpty()
    # a session with this terminal, without a fork of this process, which may have threads
    process = subprocess.Popen(["setsid", "--ctty", *line], stdin=other, stdout=other, stderr=other)
    os.close(other)
    text, pressed = b"", not keys
    while select.select([terminal], [], [], 60)[0]:
        try:
            piece = os.read(terminal, 4096)
        except OSError:
            break
        text += piece
        if not pressed and after in text:
            pressed = bool(os.write(terminal, keys))
    else:
        process.kill()
    os.close(terminal)
    return text.decode(), process.wait(60)


def test_a_terminal(host: Path) -> None:
    script = "import os; print(os.isatty(0), os.isatty(2), os.tcgetpgrp(0) == os.getpgrp())"
    assert on_a_terminal(command(host, *python(script))) == ("True True True\r\n", 0)


def test_ctrl_c_at_a_terminal_ends_once(host: Path) -> None:
    """Typed, so for all processes of the foreground; 130 is what a shell makes of it."""
    line = ["bash", "-c", 'trap : INT; "$@"; echo code $?', "shell", *command(host, *python(WAIT))]
    text, _ = on_a_terminal(line, b"\x03", b"ready")
    assert text.count("KeyboardInterrupt") == 1 and "code 130" in text


@pytest.mark.parametrize("stream", ["/dev/null", "/dev/tty"])
def test_a_background_job_is_not_stopped(host: Path, stream: str) -> None:
    """Of a shell with job control, where a program that touches the terminal would be stopped."""
    script = "import time; time.sleep(0.2); print('done')"
    shell = f'set -m; "$@" <{stream} & wait $!; echo code $?'
    line = ["bash", "-c", shell, "shell", *command(host, *python(script))]
    text, code = on_a_terminal(line)
    assert code == 0 and "done" in text and "code 0" in text and "topped" not in text


def test_concurrent_runs_share_the_root(host: Path) -> None:
    lines = [command(host, "bash", "-c", f"sleep 0.2; cat /home/me/part.step >/data/{i}") for i in range(4)]
    started = [subprocess.Popen(line) for line in lines]
    assert [process.wait(60) for process in started] == [0] * 4
    assert all((host / "data" / str(i)).read_text() == "home/me" for i in range(4))
    assert not any((host / PRIVATE / "home").iterdir())  # nothing stays mounted, or is written inside


@pytest.mark.parametrize(
    ("folder", "mode", "owner", "said"),
    [
        ("", 0o755, 0, ""),
        ("cache", 0o1777, 0, ""),
        ("cache", 0o777, 0, "can be changed by others"),
        ("cache/latin", 0o775, 0, "can be changed by others"),
        ("cache/latin/trixie-0", 0o757, 0, "can be changed by others"),
        ("cache", 0o755, 1234, "belongs to"),
        ("cache/latin/trixie-0", 0o755, 1234, "belongs to"),
    ],
)
def test_a_root_of_somebody_else(folder: str, mode: int, owner: int, said: str, tmp_path: Path) -> None:
    """What is in it would run as root."""
    if os.geteuid() != 0:
        pytest.skip("needs root")
    root = tmp_path / "cache" / "latin" / "trixie-0"
    root.mkdir(parents=True)
    if folder:
        os.chown(tmp_path / folder, owner, 0)
        os.chmod(tmp_path / folder, mode)
    (tmp_path / "link").symlink_to(root)
    script = 'source "$1"; unset SUDO_UID; is_own "$2"'
    for path in (root, tmp_path / "link"):
        line = ["bash", "-c", script, "is_own", str(ROOT / "tools" / "env" / "bootstrap.sh"), str(path)]
        done = subprocess.run(line, capture_output=True, text=True, check=False)
        assert (done.returncode == 0) == (said == "") and said in done.stderr
