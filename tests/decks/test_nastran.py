"""Bulk data is read as what it says: closed forms of bars of cubes, and refusals with their lines."""

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend.decks import command

E, SIDE, COUNT = 200e3, 10.0, 3


def cubes(first=0, z=0.0, count=COUNT, order=1, pid=1):
    """A bar of cubes along z: GRID and CHEXA cards, and nodes by height."""
    step = 1 if order == 1 else 2
    layers, cards, number = {}, [], {}
    for k in range(step * count + 1):
        for j in range(step + 1):
            for i in range(step + 1):
                if (i % step != 0) + (j % step != 0) + (k % step != 0) > 1:
                    continue
                n = first + len(number) + 1
                number[i, j, k] = n
                layers.setdefault(k / step, []).append(n)
                x = [SIDE * v / step for v in (i, j, k)]
                cards.append(f"GRID,{n},,{x[0]},{x[1]},{x[2] + z}")
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    edges = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (4, 5), (5, 6), (6, 7), (7, 4)]
    for e in range(count):
        at = [tuple(step * np.array(c) + (0, 0, step * e)) for c in corner]
        nodes = [number[c] for c in at]
        if order == 2:
            nodes += [number[tuple((np.array(at[a]) + at[b]) // 2)] for a, b in edges]
        words = ["CHEXA", str(first + e + 1), str(pid), *map(str, nodes)]
        cards.append(",".join(words[:9]))
        cards += [",".join(["+", *words[k : k + 8]]) for k in range(9, len(words), 8)]
    return cards, layers


def deck(path, bulk, case=("SPC = 1", "LOAD = 2"), sol="SOL 101"):
    rows = [sol, "CEND", "TITLE = a bar", "SUBCASE 1", *(f"  {row}" for row in case), "BEGIN BULK", *bulk]
    path.write_text("\n".join([*rows, "ENDDATA"]) + "\n")
    return path


def bar(order=1, nu=0.0, pid=1):
    cards, layers = cubes(order=order, pid=pid)
    cards += [f"PSOLID,{pid},7", f"MAT1,7,{E},,{nu},7.8-9,1.2-5,20."]
    root = layers[0.0]
    # CHEXA of three cells in a row: the root is held along its normal, and against rigid motions
    cards += [f"SPC1,1,3,{','.join(map(str, root[:4]))}"]
    cards += [f"SPC1,1,3,{n}" for n in root[4:]]
    cards += [f"SPC1,1,12,{root[0]}", f"SPC1,1,2,{root[1 if order == 1 else 2]}"]
    return cards, layers


def solved(path, **settings):
    read = lf.read_bdf(path, **settings)
    return read, lf.solve(lf.assemble(read.scene()), times=read.times)


def end(result, part="PSOLID-1"):
    """Displacement along z at the largest height."""
    found = result.displacement(part)
    x = found.function_space.tabulate_dof_coordinates()
    return found.x.array.reshape(-1, 3)[x[:, 2] > x[:, 2].max() - 1e-6, 2]


@pytest.mark.parametrize("order", [1, 2])
def test_pressure_on_a_bar(order, tmp_path):
    cards, layers = bar(order)
    top = layers[float(COUNT)]
    a, c = (top[0], top[3]) if order == 1 else (top[0], top[-1])
    cards += [f"PLOAD4,2,{COUNT},-50.,,,,{a},{c}", "PARAM,POST,-1"]
    read, result = solved(deck(tmp_path / "bar.bdf", cards))
    assert end(result) == pytest.approx(50.0 * COUNT * SIDE / E, rel=1e-9)
    assert "PARAM" in repr(read) and read.parts == ("PSOLID-1",)
    assert read.densities == {"PSOLID-1": pytest.approx(7.8e-9)}


def test_small_and_large_fields_and_a_system(tmp_path):
    """The same bar along x, by a coordinate system; with SPC, and grids in fields of 8 and 16."""
    cards, layers = bar()
    rows = ["CORD2R,5,,0.,0.,0.,1.,0.,0.", "+,0.,0.,1."]
    for card in cards:
        words = card.split(",")
        if words[0] == "GRID":
            n, x = int(words[1]), [float(w) for w in words[3:6]]
            if n % 2:
                rows.append(f"{'GRID':8}{n:8d}{5:8d}{x[0]:8.3f}{x[1]:8.3f}{x[2]:8.3f}")
            else:
                rows.append(f"{'GRID*':8}{n:16d}{5:16d}{x[0]:16.9f}{x[1]:16.9f}")
                rows.append(f"{'*':8}{x[2]:16.9f}")
        elif words[0] != "SPC1":
            rows.append(card)
    root = layers[0.0]
    rows += [f"{'SPC':8}{1:8d}{n:8d}{'1':>8}{'0.':>8}" for n in root]
    rows += [f"SPC,1,{root[0]},23,,{root[1]},2"]
    top = layers[float(COUNT)]
    rows += [f"FORCE,2,{n},5,1.25+3,0.,0.,1." for n in top]
    _, result = solved(deck(tmp_path / "bar.bdf", rows))
    found = result.displacement("PSOLID-1")
    x = found.function_space.tabulate_dof_coordinates()[:, 0]
    assert x.max() == pytest.approx(COUNT * SIDE)
    u = found.x.array.reshape(-1, 3)[x > x.max() - 1e-6, 0]
    assert u.mean() == pytest.approx(50.0 * COUNT * SIDE / E, rel=1e-9)


@pytest.mark.parametrize("kind", ["RBE2", "RBE3"])
def test_a_force_on_a_reference_node(kind, tmp_path):
    cards, layers = bar()
    top = ",".join(map(str, layers[float(COUNT)]))
    cards += [f"GRID,900,,5.,5.,{COUNT * SIDE}"]
    if kind == "RBE2":
        cards += [f"RBE2,50,900,123456,{top}"]
    else:
        first, second, *rest = top.split(",")
        cards += [f"RBE3,50,,900,123456,1.,123,{first},{second}", ",".join(["+", *rest])]
    cards += ["FORCE,2,900,,5000.,0.,0.,1."]
    _, result = solved(deck(tmp_path / "bar.bdf", cards))
    assert end(result) == pytest.approx(50.0 * COUNT * SIDE / E, rel=1e-9)


def test_an_elastic_joint(tmp_path):
    """Two bars and a bush between the rigid ends: three springs in a row."""
    cards, layers = bar()
    more, above = cubes(first=100, z=COUNT * SIDE + 2.0)
    bottom, top = above[0.0], above[float(COUNT)]
    cards += more + [f"GRID,900,,5.,5.,{COUNT * SIDE + 1.0}", f"GRID,901,,5.,5.,{COUNT * SIDE + 1.0}"]
    cards += [f"RBE2,50,900,123456,{','.join(map(str, layers[float(COUNT)]))}"]
    cards += [f"RBE2,51,901,123456,{','.join(map(str, bottom))}"]
    cards += ["CBUSH,60,61,900,901,,,,0", "PBUSH,61,K,4.+5,4.+5,1.+5,1.+8,1.+8,1.+8"]
    cards += [f"PLOAD4,2,{100 + COUNT},-50.,,,,{top[0]},{top[3]}"]
    _, result = solved(deck(tmp_path / "bars.bdf", cards))
    assert result.jump("CBUSH-60.z")[0, 0] == pytest.approx(5000.0 / 1e5, rel=1e-8)
    last = end(result, result.problem.interfaces["CBUSH-60.z"].sides[1].substructure)
    assert last == pytest.approx(2 * 50.0 * COUNT * SIDE / E + 5000.0 / 1e5, rel=1e-8)


def test_temperature_from_tref(tmp_path):
    cards, _ = bar(nu=0.3)
    cards += ["TEMPD,3,120."]
    _, result = solved(deck(tmp_path / "warm.bdf", cards, ("SPC = 1", "TEMP(LOAD) = 3")))
    assert end(result) == pytest.approx(1.2e-5 * 100.0 * COUNT * SIDE, rel=1e-9)


def test_orthotropic(tmp_path):
    """MAT9 of a material whose modulus along z is a half of that along x."""
    cards, layers = bar()
    cards = [card for card in cards if not card.startswith("MAT1")]
    C = np.zeros((6, 6))
    C[:3, :3] = np.diag([E, E, 0.5 * E])
    C[3:, 3:] = 0.4 * E * np.eye(3)
    words = ["MAT9", "7", *(repr(float(v)) for v in C[np.triu_indices(6)])]
    cards += [",".join(words[:9]), *(",".join(["+", *words[k : k + 8]]) for k in range(9, len(words), 8))]
    top = layers[float(COUNT)]
    cards += [f"PLOAD4,2,{COUNT},-50.,,,,{top[0]},{top[3]}"]
    _, result = solved(deck(tmp_path / "bar.bdf", cards))
    assert end(result) == pytest.approx(50.0 * COUNT * SIDE / (0.5 * E), rel=1e-9)


def test_subcases(tmp_path):
    cards, layers = bar()
    top = layers[float(COUNT)]
    cards += [f"PLOAD4,{k},{COUNT},{-50.0 * k},,,,{top[0]},{top[3]}" for k in (2, 3)]
    path = deck(tmp_path / "bar.bdf", cards, ("SPC = 1", "LOAD = 2", "SUBCASE 4", "SPC = 1", "LOAD = 3"))
    with pytest.raises(lf.SceneError, match="it has the subcases 1, 4; give subcase="):
        lf.read_bdf(path)
    _, result = solved(path, subcase=4)
    assert end(result) == pytest.approx(150.0 * COUNT * SIDE / E, rel=1e-9)


def test_tetrahedra(tmp_path):
    """Five tetrahedra of a cube under a pressure on two of their faces."""
    corner = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    cards = [f"GRID,{k + 1},,{10.0 * x},{10.0 * y},{10.0 * z}" for k, (x, y, z) in enumerate(corner)]
    cells = [(1, 2, 4, 5), (2, 3, 4, 7), (5, 7, 6, 2), (5, 8, 7, 4), (2, 4, 5, 7)]
    cards += [f"CTETRA,{k + 1},1,{','.join(map(str, c))}" for k, c in enumerate(cells)]
    cards += ["PSOLID,1,7", f"MAT1,7,{E},,0.", "SPC1,1,3,1,THRU,4", "SPC1,1,12,1", "SPC1,1,2,2"]
    cards += ["PLOAD4,2,3,-50.,,,,5,2", "PLOAD4,2,4,-50.,,,,5,4"]
    _, result = solved(deck(tmp_path / "cube.bdf", cards))
    assert end(result) == pytest.approx(50.0 * 10.0 / E, rel=1e-9)


@pytest.mark.parametrize(
    ("card", "case", "said"),
    [
        ("CQUAD4,99,1,1,2,3,4", None, r"bar.bdf:\d+: CQUAD4 is not read; solids"),
        ("BOLT,5,1", None, "BOLT bolts are not read"),
        ("CPENTA,99,1,1,2,3,4,5,6", None, "CPENTA wedges have no counterpart"),
        ("GRID,77,9,0.,0.,0.", None, "GRID: CP = 9: there is no CORD2R of that number"),
        ("CHEXA,98,1,1,2,3,4,5,6", None, "CHEXA: 6 nodes; give 8 or 20"),
        ("CHEXA,98,2,5,6,8,7,9,10\n+,12,11", None, "CHEXA: there is no PSOLID 2"),
        ("CTETRA,98,1,1,2,3,999", None, "CTETRA: there is no GRID 999"),
        ("MAT1,8,200.,100.,.3", None, "do not belong together"),
        ("PLOAD4,2,1,1.,2.", None, "one pressure of all corners"),
        ("PLOAD4,2,55,1.,,,,1,4", None, "there is no CTETRA or CHEXA 55"),
        ("PLOAD4,2,1,1.,,,,1,2", None, "name no face of its element"),
        ("FORCE,2,5,,1.x,1.,0.,0.", None, "F = '1.x' .* is no finite number"),
        ("CBUSH,60,61,1,5", None, "there is no PBUSH 61"),
        ("CBUSH,60,61,1,5\nPBUSH,61,K,1.,1.,1.", None, "GRID 1 is no reference node"),
        ("RBE2,50,5,12,6,7,8", None, "CM = '12'"),
        ("", ("SPC = 9", "LOAD = 2"), "SPC = 9: there is no SPC or SPC1 of that set"),
        ("", ("SPC = x",), "SPC = 'X' is no number of a set"),
        ("", ("METHOD = 3",), "METHOD has no counterpart"),
    ],
)
def test_what_is_refused_is_named(card, case, said, tmp_path):
    cards, layers = bar()
    top = layers[float(COUNT)]
    cards += [f"PLOAD4,2,{COUNT},-50.,,,,{top[0]},{top[3]}", *card.split("\n")]
    path = deck(tmp_path / "bar.bdf", cards, *([] if case is None else [case]))
    with pytest.raises(lf.SceneError, match=said):
        lf.read_bdf(path).scene()


def test_another_solution_is_refused(tmp_path):
    with pytest.raises(lf.SceneError, match="bar.bdf:1: SOL 103: linear statics"):
        lf.read_bdf(deck(tmp_path / "bar.bdf", bar()[0], sol="SOL 103"))


def test_the_command_runs_it(tmp_path, capsys):
    cards, layers = bar()
    top = layers[float(COUNT)]
    cards += [f"PLOAD4,2,{COUNT},-50.,,,,{top[0]},{top[3]}"]
    path = deck(tmp_path / "bar.dat", cards)
    assert command.main(["check", str(path)]) == 0
    assert command.main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    assert (tmp_path / "out" / "result.json").exists()


def test_changed_decks_are_refused_or_read(tmp_path):
    """A character changed: an error, or a scene; nothing else is raised."""
    rng = np.random.default_rng(3)
    cards, layers = bar()
    top = layers[float(COUNT)]
    cards += [f"PLOAD4,2,{COUNT},-50.,,,,{top[0]},{top[3]}"]
    text = deck(tmp_path / "bar.bdf", cards).read_text()
    for _ in range(150):
        at = int(rng.integers(len(text)))
        letter = "0-9 .*,\nE$xX"[int(rng.integers(12))]
        (tmp_path / "bar.bdf").write_text(text[:at] + letter + text[at + 1 :])
        try:
            lf.read_bdf(tmp_path / "bar.bdf").scene()
        except lf.SceneError:
            pass
