"""Files are read in a process of its own: what ends it, or is damaged, is one error that names the file."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import gmsh
import numpy as np
import pytest

from dolfinx_frontend import LinearElastic, Perfect, Scene, assemble, geometry, read_step
from dolfinx_frontend.common.errors import SceneError, SceneWarning
from dolfinx_frontend.geometry import away as away_module
from dolfinx_frontend.geometry import gmsh_session, read_msh
from dolfinx_frontend.geometry.exchange import Exchange

from . import fuzz


def write(path: Path, build: Any) -> Path:
    """A file of what `build(occ)` makes."""
    with gmsh_session("made"):
        build(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


@pytest.fixture
def two(tmp_path: Path) -> Path:
    """Two blocks that touch."""

    def build(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 10, 10)
        occ.addBox(10, 0, 0, 10, 10, 10)

    return write(tmp_path / "two.step", build)


# -- the other process -------------------------------------------------------------------------


def other_program(monkeypatch: pytest.MonkeyPatch, folder: Path, text: str) -> None:
    """Put another program in the place of the one that reads."""
    program = folder / "program.py"
    program.write_text(
        "import os, pickle, signal, sys, time\n"
        "def send(*message):\n"
        "    sys.stdout.buffer.write(pickle.dumps(message)); sys.stdout.flush()\n" + text
    )
    monkeypatch.setattr(away_module, "_PROGRAM", program)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("os.kill(os.getpid(), signal.SIGSEGV)", "gmsh ended with a segmentation fault, while reading"),
        ("os.abort()", "gmsh ended with an abort, while reading the file"),
        ("sys.exit(3)", "gmsh ended with exit code 3, while reading the file"),
        ("print('nonsense', flush=True)", "gmsh ended with exit code 0"),
        ("send('failed', 'no such curve')", "while reading the file: no such curve; export it again"),
        ("send('refused', \"'two.step' holds no solid\")", "^'two.step' holds no solid$"),
    ],
)
def test_what_ends_the_process_is_an_error(
    two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str, message: str
) -> None:
    other_program(monkeypatch, tmp_path, f"send('next', 'reading the file')\n{text}\n")
    with pytest.raises(SceneError, match=message) as error:
        read_step(two)
    assert "'two.step'" in str(error.value)


def test_a_process_that_does_not_start_is_no_fault_of_the_file(
    two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other_program(monkeypatch, tmp_path, "import nothing_of_this_name\n")
    with pytest.raises(RuntimeError, match=r"did not start \(exit code 1\)(.|\n)*nothing_of_this_name"):
        read_step(two)
    other_program(monkeypatch, tmp_path, "send('next', 'reading the file')\nsend('broken', 'a traceback')\n")
    with pytest.raises(RuntimeError, match=r"no fault of the file:\na traceback"):
        read_step(two)


def test_a_process_that_does_not_end(two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other_program(monkeypatch, tmp_path, "send('next', 'reading the file')\ntime.sleep(1000)\n")
    message = r"'two.step' cannot be read as STEP: gmsh was still .* after timeout = 0.5 s"
    with pytest.raises(SceneError, match=message):
        read_step(two, timeout=0.5)
    for timeout in (0.0, -1.0, np.nan, "1"):
        with pytest.raises(SceneError, match="timeout = .* must be positive seconds, or None"):
            read_step(two, timeout=timeout)  # type: ignore[arg-type]


SLOW = """
import sys
from pathlib import Path
from dolfinx_frontend import read_step
from dolfinx_frontend.geometry import away
away._PROGRAM = Path(sys.argv[2])
print("ready", flush=True)
read_step(sys.argv[1])
"""


def is_running(number: int) -> bool:
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_the_process_ends_with_the_one_that_asked(two: Path, tmp_path: Path, number: signal.Signals) -> None:
    """After Ctrl-C, which is an exception here and nothing there, and after a kill."""
    # the real program, kept busy by a task that sleeps
    program = tmp_path / "busy.py"
    program.write_text(
        "import os, runpy, sys, time\n"
        f"open({str(tmp_path / 'number')!r}, 'w').write(str(os.getpid()))\n"
        f"worker = runpy.run_path({away_module._PROGRAM.as_posix()!r})\n"
        "import threading\n"
        "threading.Thread(target=worker['end_with_input'], daemon=True).start()\n"
        "time.sleep(1000)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", SLOW, str(two), str(program)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.readline() == "ready\n"
        for _ in range(600):
            if (tmp_path / "number").is_file() and (tmp_path / "number").read_text():
                break
            time.sleep(0.05)
        child = int((tmp_path / "number").read_text())
        assert is_running(child)
        process.send_signal(number)
        assert process.wait(60) != 0
        assert process.stderr.read().count("KeyboardInterrupt") == (number == signal.SIGINT)
    for _ in range(600):
        if not is_running(child):
            break
        time.sleep(0.05)
    assert not is_running(child)


def test_the_process_starts_no_mpi() -> None:
    """It would do so under the number of the rank that asked."""
    program = away_module._PROGRAM
    text = (
        f"import sys, runpy; runpy.run_path({str(program)!r})['light_package']()\n"
        "import dolfinx_frontend.geometry.reading\n"
        "heavy = ('mpi4py', 'petsc4py', 'dolfinx', 'latin_core')\n"
        "print([m for m in sys.modules if m.split('.')[0] in heavy])"
    )
    done = subprocess.run([sys.executable, "-P", "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.mpi
def test_ranks_read_at_the_same_time(two: Path) -> None:
    text = (
        "import sys; from mpi4py import MPI; from dolfinx_frontend import read_step\n"
        "print(len(read_step(sys.argv[1]).touches), flush=True)"
    )
    line = ["mpirun", "-n", "2", sys.executable, "-c", text, str(two)]
    done = subprocess.run(line, capture_output=True, text=True, check=True, stdin=subprocess.DEVNULL)
    assert done.stdout.split() == ["1", "1"]


def test_folders_with_odd_names(two: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative paths are those of this process."""
    folder = tmp_path / "a folder \u00fc"
    folder.mkdir()
    two.rename(folder / "my part.step")
    monkeypatch.chdir(folder)
    step = read_step("my part.step")
    os.chdir(tmp_path)
    assert set(step.mesh(order=1).parts) == {"part 1", "part 2"}


# -- damaged STEP files ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("pattern", "new"),
    [
        (r"MANIFOLD_SOLID_BREP\('',#\d+\)", "MANIFOLD_SOLID_BREP('',#999999)"),  # its shell is not there
        (r"MANIFOLD_SOLID_BREP\('',#\d+\)", "MANIFOLD_SOLID_BREP#999999)"),
        (r"MANIFOLD_SOLID_BREP\(", "MANIFOLD_S0LID_BREP("),
        (r"#\d+ = MANIFOLD_SOLID_BREP\('',#\d+\);\n", ""),
    ],
)
def test_a_solid_that_cannot_be_read_is_named(two: Path, pattern: str, new: str) -> None:
    text = two.read_text()
    second = re.findall(r"#(\d+) = MANIFOLD_SOLID_BREP", text)[1]
    places = [m.span() for m in re.finditer(pattern, text)]
    start, end = places[1]
    two.write_text(text[:start] + new + text[end:])
    with pytest.raises(SceneError, match=rf"'two.step': solids that cannot be read.*#{second}\b"):
        read_step(two)
    with pytest.warns(SceneWarning, match=rf"'two.step': solids that cannot be read.*#{second}\b"):
        step = read_step(two, partial=True)
    assert [round(s.volume) for s in step.solids.values()] == [1000]


def test_a_solid_without_one_of_its_faces_is_named(two: Path) -> None:
    text = two.read_text()
    second = re.findall(r"#(\d+) = MANIFOLD_SOLID_BREP", text)[1]
    shells = list(re.finditer(r"CLOSED_SHELL\('',\(#\d+,", text))
    two.write_text(text[: shells[1].start()] + "CLOSED_SHELL('',(" + text[shells[1].end() :])
    with pytest.raises(SceneError, match="'two.step': solids that cannot be read.*#" + second):
        read_step(two)


def test_a_byte_order_mark(two: Path) -> None:
    two.write_bytes(b"\xef\xbb\xbf" + two.read_bytes())
    with pytest.raises(SceneError, match="'two.step' cannot be read as STEP.* byte order mark.*; save it as"):
        read_step(two)


@pytest.mark.parametrize("read", [read_step, read_msh])
def test_links_without_an_end(read: Any, tmp_path: Path) -> None:
    (tmp_path / "a.step").symlink_to(tmp_path / "b.step")
    (tmp_path / "b.step").symlink_to(tmp_path / "a.step")
    for path in (tmp_path / "a.step", tmp_path / ("x" * 300)):
        with pytest.raises(SceneError, match="(a.step|xx) cannot be read .*: give the name of a file"):
            read(path)


def test_a_file_that_is_cut_off(two: Path) -> None:
    data = two.read_bytes()
    two.write_bytes(data[: len(data) // 2])
    with pytest.raises(SceneError, match="'two.step' cannot be read as STEP: it does not end with END-ISO"):
        read_step(two)


def test_assemblies_repeat_their_solids(tmp_path: Path) -> None:
    """A product that is used three times is three solids; one used nowhere, or in a circle, is one."""
    text = "#1=PRODUCT('bolt','',$,());#2=PRODUCT_DEFINITION_FORMATION('','',#1);"
    text += "#3=PRODUCT_DEFINITION('','',#2,$);"
    text += "#4=PRODUCT_DEFINITION_SHAPE('','',#3);#5=SHAPE_DEFINITION_REPRESENTATION(#4,#6);"
    text += "#6=ADVANCED_BREP_SHAPE_REPRESENTATION('a;b',(#7),$);#7=MANIFOLD_SOLID_BREP('it''s #99',#8);"
    text += "#8=CLOSED_SHELL();"
    text += "#13=PRODUCT_DEFINITION('','',#2,$);#23=PRODUCT_DEFINITION('','',#2,$);"
    once = "#30=NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',#13,#3,$);"
    uses = once + once.replace("#30", "#31") + once.replace("#13", "#23").replace("#30", "#32")
    circle = once + once.replace("#30", "#31").replace("#13,#3", "#3,#13")
    file = tmp_path / "a.step"
    for more, count in (("", 1), (once, 1), (uses, 3), (circle, 1)):
        file.write_text(f"{text}\n{more}\nEND-ISO-10303-21;")
        exchange = Exchange.of(file)
        assert exchange.solids == {7: ("bolt", count)}
        assert exchange.lost(["bolt"] * count) == []
        several = [f"{count} of these {count}: 'bolt' (#7)"]
        assert exchange.lost([]) == (["'bolt' (#7)"] if count == 1 else several)


def test_assemblies_are_counted_once_a_product(tmp_path: Path) -> None:
    """Each of 40 levels is used twice: a million million bolts."""
    text = "#1=PRODUCT('bolt','',$,());#2=PRODUCT_DEFINITION_FORMATION('','',#1);"
    for level in range(41):
        text += f"#{100 + level}=PRODUCT_DEFINITION('','',#2,$);"
        if level:
            use = f"NEXT_ASSEMBLY_USAGE_OCCURRENCE('1','','',#{100 + level},#{99 + level},$);"
            text += f"#{200 + level}={use}#{300 + level}={use}"
    file = tmp_path / "a.step"
    file.write_text(f"ISO-10303-21;DATA;{text}ENDSEC;END-ISO-10303-21;")
    with pytest.raises(SceneError, match="'a.step': a product is in 131072 places of the assembly; export"):
        read_step(file)


CHAIN = range(1, 20_000)
LONG = {
    "numbers": "#1=" * 100_000,
    "blanks": "ENDSEC;DATA;" + " " * 100_000 + "x;",
    "comments": "/*" * 100_000,
    "sections": "DATA(" * 50_000,
    "blanks of a section": "DATA" + " " * 100_000,
    "quotes": "#1=A('" + "''" * 100_000,
    "brackets": "#1=A(" + ")" * 50_000 + " " * 50_000 + "x;",
    "a chain": "".join(f"#{k}=MANIFOLD_SOLID_BREP('',#{k + 1});" for k in CHAIN)
    + f"#30000=ADVANCED_BREP_SHAPE_REPRESENTATION('',({','.join(f'#{k}' for k in CHAIN)}),$);",
}


@pytest.mark.parametrize("kind", LONG)
def test_damaged_texts_are_read_in_linear_time(kind: str, tmp_path: Path) -> None:
    """Quadratic, each would take minutes; of the chain all solids lack its last link."""
    file = tmp_path / "a.step"
    file.write_text(f"ISO-10303-21;DATA;{LONG[kind]}\nENDSEC;END-ISO-10303-21;")
    if kind == "comments":
        with pytest.raises(SceneError, match="'a.step' .*does not end with END-ISO"):
            Exchange.of(file)
        return
    assert Exchange.of(file).lost([])


def test_other_files_are_not_opened(two: Path, tmp_path: Path) -> None:
    """OpenCASCADE opens what a document is called, and waits for ever for a pipe."""
    text = two.read_text()
    product = re.findall(r"#(\d+)\s*=\s*PRODUCT_DEFINITION\('", text)[0]
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    long = ("DOCUMENT_FILE", "APPLIED_EXTERNAL_IDENTIFICATION_ASSIGNMENT", "EXTERNAL_SOURCE")
    for document, assignment, source in (long, ("DCMFL", "AEIA", "EXTSRC")):
        for names in ((pipe, "", ""), ("", pipe, ""), ("", "", pipe)):
            more = (
                f"#900001={document}('{names[0]}','','',#900002,'','');/* it's */\n"
                "#900002=DOCUMENT_TYPE('configuration controlled document version');\n"
                f"#900003={assignment}('{names[1]}',#900004,#900005,(#900001));\n"
                "#900004=IDENTIFICATION_ROLE('external document id and location',$);\n"
                f"#900005={source}(IDENTIFIER('{names[2]}'));\n"
                f"#900006=APPLIED_DOCUMENT_REFERENCE(#900001,'',(#{product}));\n"
                "#900007=DOCUMENT_REPRESENTATION_TYPE('digital',#900001);\n"
                f"#900008=PRODUCT_DEFINITION_WITH_ASSOCIATED_DOCUMENTS('','',#{product},#{product},"
                "(#900001));\n"
            )
            two.write_text(text.replace("ENDSEC;\nEND-ISO", f"{more}ENDSEC;\nEND-ISO"))
            with pytest.warns(SceneWarning, match=rf"'two.step' refers to other files.*'{pipe}'.*as one f"):
                assert len(read_step(two, timeout=60.0).solids) == 2


# -- spheres, and other places where parts hardly touch ------------------------------------------


def test_a_sphere_that_touches_in_a_point(tmp_path: Path) -> None:
    def build(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 10, 10)
        occ.addSphere(5, 5, 15, 5)

    path = write(tmp_path / "sphere.step", build)
    with pytest.raises(SceneError, match="'part 2' are 0 apart, in a point or along a line only"):
        read_step(path)
    # with a gap that the sphere leaves there is a face: a cap, of radius sqrt(2 R gap) about
    (touch,) = read_step(path, gap=0.5).touches.values()
    assert touch.kind == "near" and touch.area < 2 * np.pi * 5.0 * 0.6


def test_a_strip_no_wider_than_rounding(tmp_path: Path) -> None:
    def build(occ: Any) -> None:
        occ.addBox(0, 0, 0, 10, 10, 10)
        occ.addBox(10 - 1e-6, 0, 10, 10, 10, 10)

    path = write(tmp_path / "strip.step", build)
    with pytest.raises(SceneError, match="'part 2' touch in a strip that is 1e-06 wide and 10 long"):
        read_step(path)


# -- meshes ------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return {file.stem: file for file in fuzz.make("msh", tmp_path_factory.mktemp("msh"))}


def test_sound_meshes(meshes: dict[str, Path]) -> None:
    for file in meshes.values():
        assembly = read_msh(file)
        assert list(assembly.parts) == ["left", "right"]
        for part in assembly.parts.values():
            assert part.volume() == pytest.approx(1.0, rel=1e-12) and "joint" in part.faces


@pytest.mark.parametrize(
    ("pattern", "new"),
    [
        (r"(\$Elements\n(?:.*\n){50})(.|\n)*", r"\1"),
        (r"(?<=\$Nodes\n)\d+", "999999999"),
        (r"\n1 (\d+) (\d+) (\d+) \n", r"\n1 \1 \1 \3 \n"),
        (r"left", ""),
        (r"1 0 0\n", "nan 0 0\n"),
    ],
)
def test_a_damaged_mesh(meshes: dict[str, Path], tmp_path: Path, pattern: str, new: str) -> None:
    text = meshes["mesh3_1_4.1_0"].read_text()
    file = tmp_path / "damaged.msh"
    file.write_text(re.sub(pattern, new, text, count=1))
    assert file.read_text() != text
    with pytest.raises(SceneError, match="'damaged.msh'"):
        read_msh(file)


def test_facets_of_three_cells(tmp_path: Path) -> None:
    """dolfinx would end the process."""
    file = tmp_path / "three.msh"
    nodes = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 -1\n1 1 1\n".splitlines()
    cells = ["1 2 3 4", "1 2 3 5", "1 2 3 6"]
    file.write_text(
        '$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n3 1 "part"\n$EndPhysicalNames\n'
        + f"$Nodes\n{len(nodes)}\n"
        + "".join(f"{i} {node}\n" for i, node in enumerate(nodes, 1))
        + f"$EndNodes\n$Elements\n{len(cells)}\n"
        + "".join(f"{i} 4 2 1 1 {cell}\n" for i, cell in enumerate(cells, 1))
        + "$EndElements\n"
    )
    with pytest.raises(SceneError, match="'three.msh': the part 'part': 1 facets belong to more than two"):
        read_msh(file)


# -- rounding ----------------------------------------------------------------------------------


def block(height: float, origin: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Scene:
    scene = Scene()
    part = geometry.box((1.0, 1.0, height), (1, 1, 1))
    part.mesh.geometry.x[:] += origin  # what box() would refuse
    scene.substructure("film", part, LinearElastic(1.0, 0.3), degree=1)
    scene.fix("film:z0")
    return scene


def test_flat_cells_are_named() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assemble(block(1e-3))
    with pytest.warns(SceneWarning, match=r"'film': \d+ cells are nearly flat \(height / length") as said:
        assemble(block(1e-6))
    assert said[0].filename == __file__
    with pytest.raises(SceneError, match="'film': .* nearly flat .* leaves nothing of their stiffness"):
        assemble(block(1e-9))
    assemble(block(1.0, (1e10, 0.0, 0.0)))
    with pytest.raises(SceneError, match=r"'film': cells are .* high, and coordinates of 1e\+14 are rounded"):
        assemble(block(1.0, (1e14, 0.0, 0.0)))


@pytest.mark.parametrize("space", ["points", "facets"])
def test_interfaces_below_the_rounding_are_named(space: Any) -> None:
    """Cells that are long enough across, with a face that is not."""
    scene = Scene()
    for name, x0 in (("left", 0.0), ("right", 1.0)):
        part = geometry.box((1.0, 1.0), (1, 1), origin=(x0, 0.0), cell="quadrilateral")
        x = part.mesh.geometry.x
        x[:, 1] *= np.where(np.isclose(x[:, 0], 1.0), 1e-12, 1.0)  # both narrow to nothing where they meet
        x[:, 0] += 1e3
        scene.substructure(name, part, LinearElastic(1.0, 0.3), degree=1)
    scene.interface("neck", "left:x1", "right:x0", Perfect(), space=space)
    scene.fix("left:x0")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        with pytest.raises(SceneError, match="'neck': facets of .* wide, and coordinates of 1e.03 are"):
            assemble(scene)


# -- fuzzing -----------------------------------------------------------------------------------


NIGHT = pytest.mark.night(guard="the same test with two files")


@pytest.mark.parametrize(
    ("kind", "count"),
    [("step", 2), ("msh", 2), *(pytest.param(*each, marks=NIGHT) for each in (("step", 5), ("msh", 8)))],
)
def test_damaged_files(kind: str, count: int, tmp_path: Path) -> None:
    """A few of those of ``./run bench fuzz_geometry``."""
    sound = fuzz.make(kind, tmp_path)
    contents = [fuzz.content(kind, file) for file in sound]
    for number in range(count):
        which = number % len(sound)
        file = tmp_path / f"damaged{sound[which].suffix}"
        file.write_bytes(fuzz.damaged(sound[which].read_bytes(), np.random.default_rng([0, number])))
        verdict, message = fuzz.judge(kind, file, contents[which])
        assert verdict not in fuzz.DEFECTS, (number, verdict, message)
