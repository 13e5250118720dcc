"""The command: what it prints and writes, its exit codes, and decks that are damaged."""

from __future__ import annotations

import json
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import latin_core
import numpy as np
import pytest
from scipy.stats import norm

import dolfinx_frontend as lf
from dolfinx_frontend.common.errors import BalanceError, MemoryLimitError
from dolfinx_frontend.decks.command import main
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.running import code_of, code_of_error
from tests.decks.decks import STEEL, Brick

ROOT = Path(__file__).resolve().parents[2]
DEMO = ROOT / "demos" / "first_bolt.toml"

SMALL = """\
units = ["mm", "N"]

[run]
rtol = 1e-9

[[quantity]]
of = "layer.pressure_max"

[substructure.left]
box = { lengths = [1, 1], divisions = [2, 2] }
material = "LinearElastic"
E = 100.0
nu = 0.0

[substructure.right]
box = { lengths = [1, 1], divisions = [2, 2], origin = [1, 0] }
material = "LinearElastic"
E = 100.0
nu = 0.0

[interface.layer]
first = "left:x1"
second = "right:x0"
law = "Contact"
gap = 0.0
friction = 0.15

[[fix]]
faces = "left:x0"

[[traction]]
faces = "right:x1"
t = [-2.0, 0.1]
"""


@pytest.fixture
def deck(tmp_path: Path) -> Path:
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def changed(deck: Path, old: str, new: str) -> Path:
    text = deck.read_text()
    assert old in text
    deck.write_text(text.replace(old, new, 1))
    return deck


def test_an_abaqus_deck_runs_as_it_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Equilibrium of a block under pressure; what was changed is listed with its line, before and after."""
    block = Brick("C3D8", "BLOCK", (1.0, 2.0, 3.0), (1, 1, 1))
    step = "*BOUNDARY\nBLOCK_Z0, 1, 3\n*STEP, NLGEOM\n*STATIC\n*DSLOAD\nSBLOCK_Z1, P, 10.\n*END STEP\n"
    path = tmp_path / "block.inp"
    path.write_text(block.text() + STEEL + step)
    said = f"block.inp:{path.read_text().split(chr(10)).index('*STEP, NLGEOM') + 1}: *STEP changed"
    assert main(["check", str(path)]) == 0
    assert said in capsys.readouterr().out
    assert main(["run", str(path), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["notes"][0].startswith(said)
    deck = lf.read_deck(path)
    result = lf.solve(lf.assemble(deck.scene), **deck.run)
    assert result.table("BLOCK_Z0")["force_z"] == pytest.approx([20.0], rel=1e-9)


def test_a_run_is_the_same_as_python(deck: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(deck)]) == 0
    record = json.loads((deck.with_suffix("") / "result.json").read_text())
    assert record["status"] == "converged" and record["exit_code"] == 0
    assert record["statuses"] == ["converged"]
    assert record["units"] == {"length": "mm", "force": "N", "stress": "MPa"}
    result = lf.solve(lf.assemble(lf.read_deck(deck).scene), options=lf.Options(rtol=1e-9))
    (quantity,) = record["quantities"]
    assert quantity["value"] == result.quantity("layer.pressure_max").values[0]
    assert record["errors"]["reached"] and record["errors"]["algebraic"] < 1e-8
    table = record["tables"]["interfaces"]["columns"]
    row = table["interface"].index("layer")
    assert table["normal"][row] == pytest.approx(-2.0, rel=1e-7)
    printed = capsys.readouterr()
    assert "layer" in printed.out and "solution" in printed.err
    assert main(["show", str(deck.with_suffix(""))]) == 0
    assert capsys.readouterr().out == printed.out
    assert np.allclose(lf.load(deck.with_suffix("") / "result.h5").force("layer"), result.force("layer"))


def test_the_demo_has_its_closed_form(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(DEMO), "-o", str(tmp_path / "out"), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record == json.loads((tmp_path / "out" / "result.json").read_text())
    bolt = lf.BoltStiffness.vdi2230(d=12.0, pitch=1.75, shank=25.0, thread=15.0, E=205e3)
    share = bolt.axial / (bolt.axial + 200e3 * 900.0 / 40.0)
    exact = norm.cdf(((1.0 - share) * 16e3 - 20e3) / 3e3)
    (quantity,) = record["quantities"]
    assert abs(quantity["P(above 0)"]["value"] - exact) < 2.0 / 256
    began = time.monotonic()
    assert main(["run", str(DEMO), "-o", str(tmp_path / "out"), "--json"]) == 0  # all points are there
    again = json.loads(capsys.readouterr().out)
    assert again["quantities"] == record["quantities"] and time.monotonic() > began


def test_check_solves_nothing_and_says_what_will_be_done(
    deck: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(deck)]) == 0
    printed = capsys.readouterr().out
    held = "held by contact and friction only: right"
    for word in ("gap of layer", held, "price:", "unknowns", "stress MPa"):
        assert word in printed
    assert not deck.with_suffix("").exists()


@pytest.mark.parametrize(
    ("statuses", "reached", "late", "code"),
    [
        (["converged"] * 3, True, False, 0),
        (["converged", "undetermined"], True, False, 0),
        (["converged", "inexact"], True, False, 4),
        (["max_iterations"], True, False, 4),
        (["undecided"], True, False, 3),
        (["slides", "converged"], True, False, 3),
        (["time_limit"], True, False, 5),
        (["converged"], False, False, 4),
        (["converged", "no_equilibrium", "inexact"], True, False, 3),
        (["interrupted"], True, False, 130),
        (["interrupted"], True, True, 5),
    ],
)
def test_exit_codes_follow_from_statuses(statuses: list[str], reached: bool, late: bool, code: int) -> None:
    assert code_of(statuses, reached, late) == code


def test_a_number_that_there_is_not_is_wrong_input(deck: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", str(changed(deck, "layer.pressure_max", "layer.presure_max"))]) == 2
    assert "presure_max" in capsys.readouterr().err.splitlines()[-1]


def test_exit_codes_by_faults(deck: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = deck.read_text()
    faults = {
        2: ("friction = 0.15", "friction = -0.15"),
        3: ("t = [-2.0, 0.1]", "t = [-2.0, 1.0]"),
        4: ("rtol = 1e-9", "rtol = 1e-9\nmax_iterations = 1\nnewton = 0"),
        5: ("rtol = 1e-9", "rtol = 1e-9\nmax_seconds = 1e-9"),
    }
    for code, (old, new) in faults.items():
        deck.write_text(text)
        assert main(["run", str(changed(deck, old, new))]) == code, code
        error = capsys.readouterr().err.splitlines()[-1]
        assert error.startswith("latin: ") and "Traceback" not in error
        record = json.loads((deck.with_suffix("") / "result.json").read_text())
        assert record["exit_code"] == code and record["message"]


def test_exit_codes_of_errors() -> None:
    codes = {
        lf.SceneError("x"): 2, lf.io.FileError("x"): 2, OSError("x"): 2, latin_core.InputError("x"): 2,
        BalanceError("x"): 3, latin_core.NumericalError("x"): 4, AttributeError("x"): 4,
        MemoryError(): 5, MemoryLimitError("x"): 5, KeyboardInterrupt(): 130,
    }
    assert {str(type(error)): code_of_error(error) for error in codes} == {
        str(type(error)): code for error, code in codes.items()
    }


@pytest.mark.parametrize("change", [None, ("rtol = 1e-9", "rtol = 1e-9\nchaos = 60")])
def test_what_takes_too_much_memory(
    change: Any, deck: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A plan whose factors have no room, and a chaos whose modes have none."""
    if change is None:
        monkeypatch.setattr("dolfinx_frontend.plan.plan.available_memory", lambda: 1e3)
    else:
        random_numbers = "".join(f"g{k} = {{ normal = {{ mean = 1.0, cov = 0.1 }} }}\n" for k in range(20))
        terms = " + ".join(f"g{k}" for k in range(20))
        changed(changed(deck, *change), "gap = 0.0", f'gap = 0.0\nstiffness = "10 * ({terms})"')
        deck.write_text(deck.read_text() + f"\n[random]\n{random_numbers}")
    assert main(["run", str(deck)]) == 5
    record = json.loads((deck.with_suffix("") / "result.json").read_text())
    assert record["exit_code"] == 5 and "B" in record["message"]
    assert record["message"] in capsys.readouterr().err


def test_a_defect_is_one_sentence(
    deck: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(*_: Any, **__: Any) -> None:
        raise AttributeError("nothing")

    monkeypatch.setattr("dolfinx_frontend.decks.running.solve", broken)
    assert main(["run", str(deck)]) == 4
    record = json.loads((deck.with_suffix("") / "result.json").read_text())
    assert record["exit_code"] == 4 and "AttributeError: nothing; this is a defect" in record["message"]
    assert "this is a defect" in capsys.readouterr().err.splitlines()[-1]


WRONG = {
    ("friction = 0.15", "frction = 0.15"): r"small.toml:26: unknown key 'frction' in \[inter.*'friction'",
    ('law = "Contact"', 'law = "contact"'): (
        r"small.toml:24: law = 'contact': unknown law; did you mean 'Contact'"
    ),
    ('units = ["mm", "N"]', 'units = ["mm", "n"]'): r"small.toml:1: .*unknown unit 'n'; did you mean 'N'",
    ('"left:x1"', '"lft:x1"'): r"small.toml:22: .*'lft'.*did you mean 'left'",
    ('"left:x1"', '"left:x9"'): r"small.toml:22: .*'x9'",
    ("[interface.layer]", "[interfaces.layer]"): (
        r"small.toml:21: unknown key 'interfaces'; did you mean 'interface'"
    ),
    ("[[fix]]", "[fix]"): r"small.toml:28: fix is a list of tables: write \[\[fix\]\]",
    ("nu = 0.0", "nu = 0.5"): r"small.toml:\d+: .*nu = 0.5",
    ("divisions = [2, 2]", "divisions = 2"): r"small.toml:\d+: divisions = 2: give an array",
    ("E = 100.0\n", ""): r"small.toml:\d+: \[substructure.left\] has no 'E'",
    ("gap = 0.0", "gap = nan"): r"small.toml:25: .*gap",
    ("gap = 0.0", 'gap = "g"'): r"small.toml:25: gap = 'g'.*random number 'g'",
    ("gap = 0.0", "gap = 2020-01-01"): r"small.toml:25: gap = 2020-01-01",
    ("gap = 0.0", "gap = { lognrmal = { mean = 1, cov = 0.1 } }"): (
        r"small.toml:25: .*did you mean 'lognormal'"
    ),
    ("gap = 0.0", "gap = { normal = { men = 1, cov = 0.1 } }"): r"small.toml:25: unknown key 'men'.*'mean'",
    ("gap = 0.0", 'gap = { amplitude = "later" }'): r"small.toml:25: .*unknown amplitude",
    ("rtol = 1e-9", 'accuracy = "1 percent"'): r"small.toml:4: accuracy = '1 percent': give a number",
    ("rtol = 1e-9", "rtol = 3.0"): r"small.toml:4: .*rtol",
    ('"layer.pressure_max"', '"layr.pressure_max"'): r"small.toml:7: .*did you mean 'layer'",
    ("gap = 0.0", "gap = 0.0\ngap = 1.0"): r"small.toml:2[567]: this is no TOML",
    ("[interface.layer]", "[[interface]]"): r"small.toml:21: .*no list.*write \[interface.NAME\]",
    ("[sub", "[material.m]\nmaterial = 'LinearElastic'\nE = 1\nnu = 0\nrho = 1\n[sub"): (
        r"small.toml:13: unknown key 'rho' in \[material.m\]; known: 'material', 'E', 'nu', 'plane', 'alpha'"
    ),
}


@pytest.mark.parametrize("change", WRONG, ids=lambda c: re.sub(r"\s+", " ", c[1])[:30])
def test_messages_have_the_line_the_value_and_the_nearest_word(change: Any, deck: Path) -> None:
    with pytest.raises(DeckError) as error:
        lf.read_deck(changed(deck, *change))
    assert re.search(WRONG[change], str(error.value)), str(error.value)


def test_files_that_are_no_decks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "empty.toml").write_text("")
    (tmp_path / "binary.toml").write_bytes(b"a = 1\nb = \"\xff\xfe\"\n")
    (tmp_path / "deep.toml").write_text("a = " + "[" * 5000)
    (tmp_path / "other.txt").write_text("a")
    words = {"folder": "folder.toml", "empty": "no parts", "binary": "binary.toml:2", "deep": "deep.toml",
             "missing": "missing.toml"}
    for name, word in words.items():
        for verb in ("check", "run"):
            assert main([verb, str(tmp_path / f"{name}.toml")]) == 2
            (line,) = [each for each in capsys.readouterr().err.splitlines() if " s  " not in each]
            assert word in line
    assert main(["check", str(tmp_path / "other.txt")]) == 2
    assert main(["show", str(tmp_path)]) == 2


def mutated(text: str, draw: random.Random) -> str:
    """A deck with one or two faults."""
    rows = text.splitlines()
    for _ in range(draw.randint(1, 2)):
        k = draw.randrange(len(rows))
        row = rows[k]
        numbers = list(re.finditer(r"-?\d+(\.\d+)?(e-?\d+)?", row))
        kind = draw.randrange(7)
        if kind == 0:
            del rows[k]
        elif kind == 1:
            rows.insert(draw.randrange(len(rows)), row)
        elif kind == 2 and len(row) > 2:
            j = draw.randrange(len(row))
            rows[k] = row[:j] + draw.choice("abz0.\"[]{}=,:-#\\'") + row[j + 1 :]
        elif kind == 3 and numbers:
            each = draw.choice(numbers)
            words = ["nan", "inf", "-1", "0", "1e308", "9" * 40, "true", '"x"', "[]", "{}", "1e-320"]
            new = draw.choice(words)
            rows[k] = row[: each.start()] + new + row[each.end() :]
        elif kind == 4 and len(row) > 3:
            j = draw.randrange(len(row) - 1)
            rows[k] = row[:j] + row[j + 1] + row[j] + row[j + 2 :]
        elif kind == 5 and "=" in row:
            value = draw.choice(['"left:x1"', "[1, [2]]", "{a = 1}", '""', "0"])
            rows[k] = row.partition("=")[0] + "= " + value
        else:
            rows[k] = draw.choice(["[run]", "[[fix]]", "[step]", "x", "[a.b", "name = 'q'"])
    return "\n".join(rows)


def test_mutated_decks_are_refused_in_a_sentence_or_are_decks(tmp_path: Path) -> None:
    draw, refused, read = random.Random(5), 0, 0
    for number in range(250):
        path = tmp_path / "m.toml"
        path.write_text(mutated(SMALL if number % 2 else DEMO.read_text(), draw))
        try:
            deck = lf.read_deck(path)
        except DeckError as error:
            assert re.match(r"m\.toml(:\d+)?: ", str(error)), str(error)
            refused += 1
            continue
        read += 1
        deck.scene.to_deck(tmp_path / "again.toml")
        assert list(lf.read_deck(tmp_path / "again.toml").scene.interfaces) == list(deck.scene.interfaces)
    assert refused > 100 and read > 20


def test_a_foreign_deck_becomes_one_to_edit(tmp_path: Path) -> None:
    """From .inp to .toml: two steps of two blocks in contact, the mesh beside it, the same answer."""
    inp, toml = tmp_path / "two.inp", tmp_path / "two.toml"
    low = Brick("C3D8", "LOW", (1, 1, 1), (2, 2, 1))
    high = Brick("C3D8", "HIGH", (1, 1, 1), (2, 2, 1), (0, 0, 1), 101)
    inp.write_text(low.text() + high.text() + STEEL + """\
*SURFACE INTERACTION, NAME=DRY
*FRICTION
.2
*CONTACT PAIR, INTERACTION=DRY, TYPE=SURFACE TO SURFACE
SHIGH_Z0, SLOW_Z1
*BOUNDARY
LOW_Z0, 1, 3
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 2
HIGH_Z1, 3, 3, -.001
*END STEP
*STEP
*STATIC
*BOUNDARY
HIGH_Z1, 1, 1, .0005
*END STEP
""")
    assert main(["convert", str(inp), str(toml)]) == 0
    deck, other = lf.read_inp(inp), lf.read_deck(toml)
    assert other.run["times"] == list(deck.times)
    scenes = deck.scene(), other.scene
    answers = [lf.solve(lf.assemble(each), times=deck.times, progress=False) for each in scenes]
    assert answers[0].known == answers[1].known
    for name in answers[0].known:
        forces = [answer.force(name).sum(axis=1) for answer in answers]
        assert forces[1] == pytest.approx(forces[0], abs=1e-6 * np.abs(forces[0]).max()), name


def test_convert_and_schema(deck: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other.toml"
    assert main(["convert", str(deck), str(other)]) == 0
    one, two = (lf.read_deck(each) for each in (deck, other))
    assert (one.run, one.asked, one.units) == (two.run, two.asked, two.units)
    assert main(["convert", str(deck), str(tmp_path / "study")]) == 0
    assert (tmp_path / "study").is_dir()
    text = deck.read_text()
    capsys.readouterr()
    assert main(["convert", str(deck), str(deck.parent / "." / deck.name)]) == 2  # not over itself
    assert "is the deck itself" in capsys.readouterr().err and deck.read_text() == text
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    table = schema["properties"]["interface"]["additionalProperties"]
    laws = table["properties"]["law"]["enum"]
    assert {"Contact", "Preload", "Debonding"} <= set(laws)
    for word in ("friction", "mu >= 0", "tangential_stiffness"):
        assert word in json.dumps(table)


WALKS = f"points/{'[0-9a-f]' * 16}"
"""Without the journals beside them, which come and go."""


def ended_after_some_points(command: list[str], folder: Path, number: int) -> tuple[int, str]:
    """Exit code and words of a run that got a signal when some points were in the folder."""
    run = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while run.poll() is None and not any(p.stat().st_size > 20000 for p in folder.glob(WALKS)):
        time.sleep(0.05)
    run.send_signal(number)
    _, said = run.communicate(timeout=200)
    return run.returncode, said


@pytest.mark.parametrize("way", [["--samples", "512"], ["--accuracy", "1%"]])
def test_killed_runs_go_on(tmp_path: Path, way: list[str]) -> None:
    """The same walks over points are made, and begin with the points that are there."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "dolfinx_frontend.decks.command", "run", str(DEMO), *way]
    command += ["-o", str(out), "--json"]
    assert ended_after_some_points(command, out, signal.SIGKILL)[0] == -signal.SIGKILL
    assert json.loads((out / "result.json").read_text())["status"] == "running"
    begun = {each.name: each.stat().st_size for each in out.glob(WALKS)}
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=200)
    assert done.returncode in (0, 4), done.stderr  # 4: one per cent is more than the kink of the joint allows
    assert all((out / "points" / name).stat().st_size > size for name, size in begun.items())
    assert set(json.loads(done.stdout)["statuses"]) == {"converged"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_run_that_is_ended_says_so(tmp_path: Path, number: int) -> None:
    """The samples so far are kept, and the record says how it ended."""
    out = tmp_path / "out"
    command = [sys.executable, "-m", "dolfinx_frontend.decks.command", "run", str(DEMO)]
    code, said = ended_after_some_points([*command, "--samples", "65536", "-o", str(out)], out, number)
    record = json.loads((out / "result.json").read_text())
    assert code == 130 == record["exit_code"], said
    assert record["status"] == "interrupted" and record["message"] and "Traceback" not in said


def test_a_step_file_becomes_a_deck(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with lf.geometry.gmsh_session("two") as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 10, 10, 5)
        gmsh.model.occ.addBox(0, 0, 5, 10, 10, 5)
        gmsh.model.occ.synchronize()
        gmsh.write(str(tmp_path / "two.step"))
    deck = tmp_path / "two.toml"
    assert main(["new", str(tmp_path / "two.step")]) == 0
    assert main(["new", str(tmp_path / "two.step"), "-o", str(deck)]) == 2
    assert "--force" in capsys.readouterr().err
    text = deck.read_text()
    assert "no bolt clamps these two: tied" in text
    assert "law = \"Perfect\"" in text and "# [[step.face]]" in text
    start = text.index("# [[step.face]]")
    proposal = "\n".join(row.removeprefix("# ") for row in text[start:].splitlines())
    _, high, *_ = (row for row in text.splitlines() if re.match(r'pattern = "[^|*]+"$', row))
    top = high.partition("=")[2].strip().strip('"')
    proposal = proposal.replace('face = "PART:FACE"', f'face = "{top}:top"')
    proposal += f'\n[[step.face]]\nname = "{top}:top"\nnormal = [0, 0, 1]\nat = ["any", "any", 10.0]\n'
    deck.write_text(text[:start] + proposal)
    assert main(["run", str(deck)]) == 0, capsys.readouterr().err
    record = json.loads((tmp_path / "two" / "result.json").read_text())
    table = record["tables"]["interfaces"]["columns"]
    row = [name.startswith("displacement") for name in table["interface"]].index(True)
    assert table["force_z"][row] == pytest.approx(-1000.0, rel=1e-6)
    again = tmp_path / "again.toml"
    assert main(["convert", str(deck), str(again)]) == 0
    assert main(["run", str(again)]) == 0
    same = json.loads((tmp_path / "again" / "result.json").read_text())
    assert same["tables"] == record["tables"]
