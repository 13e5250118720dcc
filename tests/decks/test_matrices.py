"""Matrices as other programs write them are read as they were."""

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.decks.nastran.bulk import bulk_cards

rng = np.random.default_rng(2)
NODES = {7: (0.0, 0.0, 0.0), 3: (10.0, 0.0, 0.0), 12: (0.0, 8.0, 0.0), 5: (0.0, 0.0, 9.0)}


def stiffness(nodes=NODES):
    """A grid of springs (n, n) along all lines between some points, with the digits of a file."""
    x = np.array(list(nodes.values()))
    K = np.zeros((3 * len(x), 3 * len(x)))
    for i in range(len(x)):
        for j in range(i):
            along = (x[i] - x[j]) / np.linalg.norm(x[i] - x[j])
            at = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
            both = np.concatenate([along, -along])
            K[np.ix_(at, at)] += (1e3 + 100.0 * i + j) * np.outer(both, both)
    return K


K = stiffness()
LABELS = [(node, c) for node in NODES for c in (1, 2, 3)]


def mtx(path, every=False):
    """Abaqus: components once; CalculiX: every component is a node of its own."""
    labels = [node for node, _ in LABELS] if every else list(NODES)
    rows = [
        "**",
        "** GENERATION OF SUBSTRUCTURE",
        f"*USER ELEMENT, NODES= {len(labels)}, LINEAR",
        "** ELEMENT NODES",
        "** " + ", ".join(map(str, labels)),
    ]
    if every:
        rows += ["1", *(f"{k + 1}, {c}" for k, (_, c) in enumerate(LABELS) if k)]
    else:
        rows += ["1, 2, 3"]
    rows += ["*MATRIX,TYPE=STIFFNESS"]
    for k in range(len(K)):
        numbers = [f"{v:.13e}" for v in K[k, : k + 1]]
        rows += [" , ".join(numbers[i : i + 4]) + "," for i in range(0, len(numbers), 4)]
    rows += ["*MATRIX,TYPE=MASS", *(["1.,"] * (len(K) * (len(K) + 1) // 2))]
    path.write_text("\n".join(rows) + "\n")
    return path


def small(value):
    """A number in eight characters, without the E of its exponent."""
    text = f"{value:.1e}" if value else "0."
    return text.replace("e", "")


def dmig(path, way="large", half=True, extra=()):
    cards = ["$ a comment", "DMIG    KAAX           0       6       2       0              12"]
    for j, (node, c) in enumerate(LABELS):
        own = [(LABELS[i], K[i, j]) for i in range(j if half else 0, len(K)) if K[i, j]]
        if way == "large":
            cards.append(f"DMIG*   {'KAAX':16}{node:16d}{c:16d}")
            cards += [f"*       {n:16d}{m:16d}{v:16.9E}".replace("E+0", "D+0") for (n, m), v in own]
        elif way == "free":
            rows = [f"{n},{m},{float(v)!r}" for (n, m), v in own]
            cards.append(f"DMIG,KAAX,{node},{c},,{rows[0]}")
            cards += [f",{row},," for row in rows[1:]]
        else:
            (n, m), v = own[0]
            cards.append(f"DMIG    KAAX    {node:8d}{c:8d}        {n:8d}{m:8d}{small(v):>8}")
            cards += [f"        {n:8d}{m:8d}{small(v):>8}" for (n, m), v in own[1:]]
    cards += [f"GRID,{node},,{x},{y},{z}" for node, (x, y, z) in NODES.items()]
    path.write_text("\n".join([*cards, *extra, "ENDDATA"]) + "\n")
    return path


def op4(path, way="dense", name="KAA"):
    n = len(K)
    rows = [f"{n:8d}{-n if way == 'bigmat' else n:8d}{6:8d}{2:8d}{name:8}1P,5E16.9"]
    for j in range(n):
        own = np.flatnonzero(K[:, j])
        if way == "dense":
            pieces = [np.arange(own[0], own[-1] + 1)]
            rows.append(f"{j + 1:8d}{own[0] + 1:8d}{2 * len(pieces[0]):8d}")
        else:
            pieces = np.split(own, np.flatnonzero(np.diff(own) > 1) + 1)
            rows.append(f"{j + 1:8d}{0:8d}{2 * len(own) + 2 * len(pieces):8d}")
        for piece in pieces:
            length = 2 * len(piece) + 1
            if way == "bigmat":
                rows.append(f"{length:8d}{piece[0] + 1:8d}")
            elif way == "sparse":
                rows.append(f"{piece[0] + 1 + 65536 * length:12d}")
            numbers = [f"{v:16.9E}" for v in K[piece, j]]
            rows += ["".join(numbers[i : i + 5]) for i in range(0, len(numbers), 5)]
    rows += [f"{n + 1:8d}{1:8d}{1:8d}", f"{1.0:16.9E}"]
    path.write_text("\n".join(rows) + "\n")
    return path


@pytest.mark.parametrize(
    ("write", "file", "digits"),
    [
        (mtx, "a.mtx", 1e-12),
        (lambda p: mtx(p, every=True), "a.mtx", 1e-12),
        (dmig, "a.pch", 1e-8),
        (lambda p: dmig(p, half=False), "a.bdf", 1e-8),
        (lambda p: dmig(p, "free"), "a.dmig", 1e-15),
        (op4, "a.op4", 1e-8),
        (lambda p: op4(p, "sparse"), "a.op4", 1e-8),
        (lambda p: op4(p, "bigmat"), "a.op4", 1e-8),
    ],
)
@pytest.mark.filterwarnings("ignore:.*rigid motions meet:dolfinx_frontend.SceneWarning")
def test_a_matrix_comes_back(write, file, digits, tmp_path):
    path = write(tmp_path / file)
    by_number = file.endswith((".pch", ".bdf", ".dmig"))
    order = sorted(NODES) if by_number else list(NODES)
    given = None if by_number else np.array(list(NODES.values())) if file.endswith(".op4") else NODES
    faces = {"end": [1, 2]} if file.endswith(".op4") else {"end": [3, 12]}
    matrix = lf.read_matrix(path, given, faces=faces)
    at = np.concatenate([np.arange(3) + 3 * list(NODES).index(node) for node in order])
    off = np.abs(matrix.stiffness.toarray() - K[np.ix_(at, at)])
    assert off.max() < digits * np.abs(K).max()
    assert matrix.points == pytest.approx(np.array([NODES[node] for node in order]))
    assert sorted(order[k] for k in matrix.faces["end"]) == [3, 12]


def test_the_frame_of_a_file_carries(tmp_path):
    """Three points held, a force on the fourth: as the matrix itself says."""
    scene = lf.Scene()
    faces = {"foot": [7, 3, 12], "head": [5]}
    scene.substructure("frame", lf.read_matrix(mtx(tmp_path / "frame.mtx"), NODES, faces=faces))
    scene.fix("frame:foot")
    scene.force("frame:head", (30.0, 20.0, -100.0))
    found = lf.solve(lf.assemble(scene)).displacement("frame")
    assert found.displacements[3] == pytest.approx(np.linalg.solve(K[9:, 9:], [30.0, 20.0, -100.0]), rel=1e-9)


def test_numbers_and_fields_of_bulk_data():
    """Exponents without E, tabs, small fields, continuations."""
    rows = [
        f"{'GRID':8}{1:8d}{'':8}{'1.5+3':>8}{'-2.-1':>8}{'.5':>8}",
        f"{'GRID*':8}{2:16d}{'':16}{'1.25D+1':>16}{'-3.0':>16}",
        f"{'*':8}{'4.0':>16}",
        "CARD\t11\t12",
        "+       3       4",
        "spc1,1,123,4",
    ]
    cards = list(bulk_cards(((("f", k), row) for k, row in enumerate(rows))))
    assert [card.name for card in cards] == ["GRID", "GRID", "CARD", "SPC1"]
    assert [cards[0].real(k, "x") for k in (2, 3, 4)] == [1500.0, -0.2, 0.5]
    assert [cards[1].real(k, "x") for k in (2, 3, 4)] == [12.5, -3.0, 4.0]
    assert cards[2].fields[:2] == ["11", "12"] and cards[2].fields[8:10] == ["3", "4"]


def with_text(path, text):
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("a.txt", None, "an ending '.txt' is not known"),
        ("a.sub", None, "of Ansys .* export it as text"),
        ("a.mtx", ("** 7, 3, 12, 5", "** 7, 3, 12"), "4 nodes, of which 3 are named"),
        ("a.mtx", ("1, 2, 3", "1, 2"), "78 entries, and one half of a matrix with 8 rows has 36"),
        ("a.mtx", ("1, 2, 3", "1, 2, 2"), "a component of a node is there twice"),
        ("a.mtx", ("1, 2, 3", "1, 2, 4"), "node 7 has the components 1, 2, 4; a point has 1, 2, 3"),
        ("a.mtx", ("STIFFNESS", "DAMPING"), "no \\*MATRIX, TYPE=STIFFNESS"),
        ("a.mtx", ("\n", "\nx1, \n", "*MATRIX,TYPE=STIFFNESS"), "a.mtx:8: 'X1' is no number"),
        ("a.pch", ("GRID,12,", "GRID,13,"), "no coordinates of node 12"),
        ("a.pch", ("GRID,12,,", "GRID,12,4,"), "CP = 4: coordinate systems are not read"),
        ("a.pch", ("       6       2", "       6       4"), "a.pch:2: DMIG: KAAX: TIN = 4 is complex"),
        ("a.pch", ("DMIG    KAAX", "DMIG    MAAX"), "KAAX has no header"),
        ("a.pch", (f"{3:16d}{1:16d}", f"{3:16d}{0:16d}"), "that of a scalar point"),
        ("a.op4", ("       6       2", "       6       4"), "a.op4:1: its type is 4, complex"),
        ("a.op4", ("E+03", "E+0x"), "is no number of 16 characters"),
        ("a.op4", ("      12      12", "      11      12"), "this is no header of OUTPUT4"),
    ],
)
def test_what_cannot_be_read_is_said_with_its_line(file, change, said, tmp_path):
    writers = {".mtx": mtx, ".pch": dmig, ".op4": op4, ".txt": mtx, ".sub": mtx}
    path = writers[file[-4:]](tmp_path / file)
    if change is not None:
        text = path.read_text()
        after = text.index(change[2]) if len(change) > 2 else 0
        path.write_text(text[:after] + text[after:].replace(change[0], change[1], 1))
    points = {"mtx": NODES, "op4": np.array(list(NODES.values()))}.get(file[-3:])
    with pytest.raises(lf.SceneError, match=said):
        lf.read_matrix(path, points)


def test_names_choose(tmp_path):
    text = dmig(tmp_path / "a.pch").read_text()
    both = with_text(tmp_path / "b.pch", text + text.replace("KAAX", "K2AX").replace("GRID", "$"))
    both.write_text(text.replace("ENDDATA", "") + text.replace("KAAX", "K2AX").replace("GRID", "$"))
    with pytest.raises(lf.SceneError, match="it has the square matrices KAAX, K2AX; give name="):
        lf.read_matrix(both)
    with pytest.raises(lf.SceneError, match="no square matrix 'MAAX'; it has KAAX, K2AX"):
        lf.read_matrix(both, name="MAAX")
    assert lf.read_matrix(both, name="k2ax").size == 12


def test_a_binary_file_is_refused(tmp_path):
    path = tmp_path / "a.op4"
    path.write_bytes(b"\x18\0\0\0\0\0")
    with pytest.raises(lf.SceneError, match="no text"):
        lf.read_matrix(path, np.zeros((4, 3)))


@pytest.mark.filterwarnings("ignore:.*rigid motions meet:dolfinx_frontend.SceneWarning")
@pytest.mark.parametrize("file", ["a.mtx", "a.pch", "a.op4"])
def test_changed_files_are_refused_or_read(file, tmp_path):
    """A character changed: an error, or a matrix; nothing else is raised."""
    writers = {".mtx": mtx, ".pch": dmig, ".op4": op4}
    text = writers[file[-4:]](tmp_path / file).read_text()
    points = {"mtx": NODES, "op4": np.array(list(NODES.values()))}.get(file[-3:])
    for _ in range(150):
        at = int(rng.integers(len(text)))
        letter = "0-9 .*,\nE$xX"[int(rng.integers(12))]
        (tmp_path / file).write_text(text[:at] + letter + text[at + 1 :])
        try:
            lf.read_matrix(tmp_path / file, points)
        except lf.SceneError:
            pass
