"""A chaos survives its file and OpenTURNS; no file is trusted."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import re
import urllib.parse
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.formats import chaos_file, hdf5
from dolfinx_frontend.formats.chaos_file import Field, load_chaos, save_chaos
from dolfinx_frontend.formats.hdf5 import ChaosFileError
from dolfinx_frontend.formats.openturns import to_openturns
from dolfinx_frontend.uncertainty.chaos import Chaos
from dolfinx_frontend.uncertainty.correlated import Correlated
from dolfinx_frontend.uncertainty.fields import RandomField
from dolfinx_frontend.uncertainty.parameters import (
    Beta,
    FromDistribution,
    FromSamples,
    Gamma,
    LogNormal,
    Normal,
    TruncatedNormal,
    Uniform,
)
from dolfinx_frontend.uncertainty.space import RandomSpace

pytestmark = pytest.mark.sanitize

ROOT = Path(__file__).resolve().parents[2]


def has(module):
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


HDF5 = pytest.param(".h5", marks=pytest.mark.skipif(not has("h5py"), reason="no h5py"))
FORMATS = pytest.mark.parametrize("suffix", [".json", HDF5])


def random_field(distribution, name="f"):
    field = RandomField(name, 2.0, cov=0.3, length=0.7, modes=2, distribution=distribution)
    return field.on(np.linspace(0.0, 1.0, 12)[:, None], np.full(12, 1.0 / 12.0))


def everything():
    """One of each kind of source, with names that no file format likes."""
    pair = Correlated(
        [LogNormal("K/1", 5.0, cov=0.3), Normal("k%", 100.0, cov=0.2), Gamma("g", 1.0, cov=0.4)],
        [[1.0, 0.5, 0.2], [0.5, 1.0, -0.3], [0.2, -0.3, 1.0]],
    )
    sources = [
        Uniform("u", 1.0, 3.0),
        *pair,
        random_field("normal"),
        LogNormal("jälki", 7.0, cov=0.1),
        random_field("lognormal", "h"),
        Gamma("..", 2.0, cov=0.5),
        Beta("b", 2.5, 1.5, -1.0, 4.0),
        TruncatedNormal("t", 1.0, cov=0.3, within=2.0),
        FromSamples("s", [1.0, 1.5, 4.0]),
        FromDistribution("w", stats.weibull_min(2.0), germ="normal"),
    ]
    space = RandomSpace(sources)
    return space, space.basis(Chaos(order=2)), sources


def fields_of(basis, seed=0):
    rng = np.random.default_rng(seed)
    falling = 0.5 ** basis.indices.table.sum(axis=1)
    return {
        "joint/traction": Field(
            rng.normal(size=(12, len(basis))) * falling, "N/mm^2", (4, 3), "local frame"
        ),
        "u": Field(rng.normal(size=(5, len(basis))) * falling, "mm"),
        "largest": Field(rng.normal(size=(1, len(basis))), shape=()),
    }


def small(path, order=3):
    """A file with two germs; its space, basis and field."""
    space = RandomSpace([Normal("k", 100.0, cov=0.2), Uniform("K", 1.0, 2.0)])
    basis = space.basis(Chaos(order=order))
    field = Field(np.random.default_rng(1).normal(size=(4, len(basis))), "mm")
    save_chaos(path, space, basis, {"w": field})
    return space, basis, field


# -- round trips -----------------------------------------------------------------------------------
@FORMATS
def test_round_trip(tmp_path, suffix):
    space, basis, sources = everything()
    fields = fields_of(basis)
    path = tmp_path / f"chaos{suffix}"
    note = {"scene": "vessel", "words": "x" * 200_000, "list": [1, 2.5, None]}
    save_chaos(path, space, basis, fields, note)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    found = load_chaos(path)
    assert found.meta["scene"] == "vessel" and found.meta["list"] == [1, 2.5, None]
    assert found.meta["order"] == 2 and found.meta["software"].startswith("latin-core")
    assert found.germ_names == space.germ_names
    assert found.groups == space.groups
    assert np.array_equal(found.indices, basis.indices.table)
    assert repr(found).startswith("<ChaosFile ")
    points = space.sample(50, 2)
    for name, field in fields.items():
        stored = found.fields[name]
        assert np.array_equal(stored.coefficients, field.coefficients)
        assert (stored.unit, stored.description) == (field.unit, field.description)
        shape = (len(field.coefficients),) if field.shape is None else field.shape
        ours = basis.evaluate_fields(field.coefficients, points)
        values = found.evaluate(name, points)
        assert values.shape == (50, *shape)
        scale = np.abs(ours).max()
        assert np.abs(values.reshape(50, -1) - ours.T).max() < 1e-12 * scale
        assert np.array_equal(found.mean(name).ravel(), field.coefficients[:, 0])
        deviation = np.sqrt(np.sum(field.coefficients[:, 1:] ** 2, axis=1)).reshape(shape)
        assert found.std(name) == pytest.approx(deviation, rel=1e-14)
        truth = space.sobol(field.coefficients, basis)
        for source, sobol in found.sobol(name).items():
            assert sobol.first.shape == shape
            assert sobol.first.ravel() == pytest.approx(truth[source].first, abs=1e-12)
            assert sobol.total.ravel() == pytest.approx(truth[source].total, abs=1e-12)
    # exact maps to rounding, the tables of g (correlated gamma) and w to their steps
    for source in sources:
        ours = space.values(source, points)
        theirs = found.parameter(source.name, points).T
        assert theirs == pytest.approx(ours, rel=1e-4 if source.name in "gw" else 1e-9)


@FORMATS
def test_parameters_to_germs(tmp_path, suffix):
    space, basis, _ = everything()
    path = tmp_path / f"chaos{suffix}"
    save_chaos(path, space, basis, fields_of(basis))
    found = load_chaos(path)
    values = {"u": [1.2, 2.9], "K/1": [4.0, 6.0], "k%": 80.0, "g": 0.7, "jälki": 6.5, "t": 1.2}
    ours = space.germ_points(values)
    theirs = found.germ_points(values)
    assert theirs == pytest.approx(ours, abs=1e-3)
    exact = [i for i, n in enumerate(space.germ_names) if n in ("u", "jälki", "t", "b", "s")]
    assert theirs[:, exact] == pytest.approx(ours[:, exact], abs=1e-10)
    again = found.germ_points({n: found.parameter(n, theirs) for n in values})
    assert again == pytest.approx(theirs, abs=1e-10)
    with pytest.raises(SceneError, match="unknown parameter 'jalki'.*did you mean 'jälki'"):
        found.germ_points({"jalki": 1.0})
    with pytest.raises(SceneError, match="unknown parameter 'f'"):
        found.germ_points({"f": 1.0})
    with pytest.raises(SceneError, match=r"different lengths: \[2, 3\]"):
        found.germ_points({"u": [1.0, 2.0], "t": [1.0, 1.0, 1.0]})
    with pytest.raises(SceneError, match="'jälki' cannot take"):
        found.germ_points({"jälki": -1.0})
    with pytest.raises(SceneError, match="unknown field 'v'"):
        found.evaluate("v", ours)
    with pytest.raises(SceneError, match="points have 2 coordinates, the chaos has 14 germs"):
        found.evaluate("u", np.zeros((3, 2)))


@pytest.mark.skipif(not has("h5py"), reason="no h5py")
def test_both_formats_have_one_content(tmp_path):
    import h5py

    space, basis, _ = everything()
    for suffix in (".json", ".hdf5"):
        save_chaos(tmp_path / f"a{suffix}", space, basis, fields_of(basis))
    with h5py.File(tmp_path / "a.hdf5") as file:
        assert json.loads((tmp_path / "a.json").read_text())["checksum"] == file.attrs["checksum"]


def test_high_order(tmp_path):
    """The recurrence stays accurate where monomials would not."""
    space = RandomSpace([Normal("k", 1.0, cov=0.1), Gamma("g", 1.0, cov=0.3)])
    basis = space.basis(Chaos(order=25, index_set="hyperbolic", q=0.5))
    line = np.random.default_rng(3).normal(size=(2, len(basis)))
    save_chaos(tmp_path / "a.json", space, basis, {"y": Field(line)})
    points = space.sample(100, 4)
    ours = basis.evaluate_fields(line, points)
    found = load_chaos(tmp_path / "a.json").evaluate("y", points)
    assert np.abs(found.T - ours).max() < 1e-11 * np.abs(ours).max()


@FORMATS
def test_reader_of_the_documentation(tmp_path, suffix):
    """The example of docs/chaos_file.md, which knows nothing of this project."""
    text = (ROOT / "docs" / "chaos_file.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1)
    path = tmp_path / f"chaos{suffix}"
    space, basis, field = small(path)
    names = {}
    if suffix == ".h5":
        import h5py

        code = re.sub(r"    with open.*\n.*load\(file\)\n", "    tree = File(path)\n", code)
        names["File"] = h5py.File
    exec(code, names)
    points = space.sample(20, 5)
    ours = basis.evaluate_fields(field.coefficients, points)
    assert names["evaluate"](path, "w", points).T == pytest.approx(ours, rel=1e-11, abs=1e-11)


def test_checksum_of_the_documentation(tmp_path):
    """As the page describes it, written again."""
    space, basis, _ = everything()
    save_chaos(tmp_path / "a.json", space, basis, fields_of(basis), {"note": "ä"})
    tree = json.loads((tmp_path / "a.json").read_text())
    whole = {"indices", "shape", "germs", *space.groups}  # whole numbers
    lines = []

    def visit(path, node):
        if isinstance(node, dict):
            for key in sorted(node):
                visit([*path, key], node[key])
            return
        place = "".join("/" + urllib.parse.quote(key) for key in path)
        if isinstance(node, str) or (node and isinstance(node[0], str)):
            content = json.dumps(node).encode()
            lines.append(f"{place} {len(content)}\n".encode() + content)
            return
        integer = path[-1] in whole
        array = np.array(node, dtype="<i8" if integer else "<f8")
        kind = "<i8" if integer else "<f8"
        lines.append(f"{place} {kind} {array.shape} {array.nbytes}\n".encode() + array.tobytes())

    visit([], {k: v for k, v in tree.items() if k not in ("format", "version", "checksum")})
    assert hashlib.sha256(b"".join(lines)).hexdigest() == tree["checksum"]


# -- writing ---------------------------------------------------------------------------------------
@FORMATS
def test_a_failed_write_changes_nothing(tmp_path, suffix, monkeypatch):
    path = tmp_path / f"a{suffix}"
    space, basis, field = small(path)
    before = path.read_bytes()

    def full(temporary, *_):
        temporary.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(chaos_file._WRITERS, suffix, full)
    with pytest.raises(ChaosFileError, match="cannot be written .*No space left.*has room"):
        save_chaos(path, space, basis, {"w": field})
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == [path.name]
    monkeypatch.undo()
    save_chaos(path, space, basis, {"v": field})
    assert list(load_chaos(path).fields) == ["v"]


def test_what_cannot_be_written(tmp_path):
    space, basis, field = small(tmp_path / "a.json")
    good = field.coefficients
    cases = [
        ("a.txt", {"w": field}, {}, r"suffix tells the format: .json, .h5, .hdf5; not '.txt'"),
        ("no/a.json", {"w": field}, {}, "cannot be written .*folder that exists"),
        ("b.json", {"w": Field(good[:, 1:])}, {}, r"'w'.*shape \(4, 9\); wanted \(rows, 10\)"),
        ("b.json", {"w": Field(good[:0])}, {}, r"shape \(0, 10\)"),
        ("b.json", {"w": Field(good, shape=(3,))}, {}, r"shape \(3,\) does not have 4 entries"),
        ("b.json", {"w": Field(good * np.nan)}, {}, "'w': some coefficients are not finite"),
        ("b.json", {"": field}, {}, "needs a name"),
        ("b.json", {"w": field}, {"a": object()}, "meta must be made of"),
        ("b.json", {"w": field}, {"a": float("nan")}, "meta must be made of"),
    ]
    for name, fields, note, message in cases:
        with pytest.raises(ChaosFileError, match=message):
            save_chaos(tmp_path / name, space, basis, fields, note)
    other = RandomSpace([Normal("k", 1.0, cov=0.1)])
    with pytest.raises(ChaosFileError, match="the basis has 2 germs, the random space has 1"):
        save_chaos(tmp_path / "b.json", other, basis, {"w": field})
    assert [p.name for p in tmp_path.iterdir()] == ["a.json"]


# -- reading hostile files -------------------------------------------------------------------------
@FORMATS
@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[1]", b"\x89HDF\r\n\x1a\n", b"\x00\xff", b"[" * 100_000, b'{"a": 1']
)
def test_not_a_chaos_file(tmp_path, suffix, content):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    with pytest.raises(ChaosFileError, match=f"a{suffix} (is no chaos file|cannot be read)"):
        load_chaos(path)
    assert path.read_bytes() == content


def test_missing_file(tmp_path):
    with pytest.raises(ChaosFileError, match="a.json does not exist"):
        load_chaos(tmp_path / "a.json")
    with pytest.raises(ChaosFileError, match="suffix tells the format"):
        load_chaos(tmp_path / "a.npz")


@FORMATS
def test_truncated_file(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    small(path)
    whole = path.read_bytes()
    for part in (0.05, 0.3, 0.7, 0.95, 0.9999):
        path.write_bytes(whole[: int(part * len(whole))])
        with pytest.raises(ChaosFileError, match=f"a{suffix}.*(truncated|damaged).*save"):
            load_chaos(path)


@FORMATS
def test_changed_bytes(tmp_path, suffix):
    """Any changed byte is noticed, or the content is the same; nothing else is ever raised."""
    path = tmp_path / f"a{suffix}"
    small(path)
    whole = path.read_bytes()
    truth = load_chaos(path)
    rng = np.random.default_rng(6)
    noticed = 0
    for position in rng.integers(len(whole), size=300):
        broken = bytearray(whole)
        broken[position] ^= int(rng.integers(1, 256))
        path.write_bytes(broken)
        try:
            found = load_chaos(path)
        except ChaosFileError as error:
            assert f"a{suffix}" in str(error)
            noticed += 1
        else:
            stored = found.fields["w"].coefficients
            assert np.array_equal(stored, truth.fields["w"].coefficients)
            assert np.array_equal(found.alpha, truth.alpha)
    assert noticed > 250


def test_altered_content(tmp_path):
    path = tmp_path / "a.json"
    small(path)
    text = path.read_text()
    changes = [
        (lambda t: t.update(version=2), "version 2; this software reads version 1"),
        (lambda t: t.update(version="x"), "cannot be read"),
        (lambda t: t.update(format="other"), "is no chaos file"),
        (lambda t: t.pop("fields"), "fields is missing"),
        (lambda t: t["indices"].pop(), "damaged"),
        (lambda t: t["indices"][0].__setitem__(0, 1), "first mode is not the mean"),
        (lambda t: t["indices"][1].__setitem__(0, 10**9), "alpha: shape"),
        (lambda t: t["indices"][1].__setitem__(0, 0.5), "whole numbers"),
        (lambda t: t["indices"][1].__setitem__(0, -1), "whole numbers"),
        (lambda t: t["germs"]["beta"][0].__setitem__(1, -1.0), "beta: not positive"),
        (lambda t: t["germs"]["alpha"][0].__setitem__(1, 1e999), "not finite"),
        (lambda t: t["germs"]["alpha"][0].__setitem__(1, 10**400), "damaged"),
        (lambda t: t["germs"]["alpha"][0].__setitem__(1, 1e-9), "the checksum is another one"),
        (lambda t: t["germs"].update(names=["a"]), "damaged"),
        (lambda t: t["germs"].update(names="ab"), "wanted a list of words"),
        (lambda t: t["germs"].update(families=[1, 2]), "wanted a list of words"),
        (lambda t: t["groups"].update(k=[2]), "whole numbers from 0 to 1"),
        (lambda t: t["parameters"]["k"].update(map="spline"), "unknown map 'spline'"),
        (
            lambda t: t["parameters"]["k"].update(map="table", argument=[0, 0], value=[0, 1]),
            "does not ascend",
        ),
        (lambda t: t["fields"]["w"].update(shape=[5]), "shape .5,. for 4 rows"),
        (lambda t: t["fields"]["w"].update(unit=None), "wanted a list of words"),
        (lambda t: t.update(fields=3), "damaged"),
        (lambda t: t.update(meta="[1]"), "meta"),
        (lambda t: t.update(checksum=""), "the checksum is another one"),
    ]
    for change, message in changes:
        tree = json.loads(text)
        change(tree)
        path.write_text(json.dumps(tree))
        with pytest.raises(ChaosFileError, match=message):
            load_chaos(path)


@pytest.mark.skipif(not has("h5py"), reason="no h5py")
def test_hdf5_that_reaches_out(tmp_path):
    """Links to other files, storage elsewhere and data much larger than the file are refused."""
    import h5py

    secret = tmp_path / "secret.bin"
    secret.write_bytes(os.urandom(320))

    def soft(field):
        field["coefficients"] = h5py.SoftLink("/indices")

    def link(field):
        field["coefficients"] = h5py.ExternalLink("secret.h5", "/x")

    def storage(field):
        field.create_dataset("coefficients", (4, 10), "f8", external=[(str(secret), 0, 320)])

    def bomb(field):
        field.create_dataset("coefficients", (2**40, 10), "f8", chunks=(1, 10))

    def hollow(field):
        field.create_dataset("coefficients", (2**40, 10), "f8")

    for trick in (soft, link, storage, bomb, hollow):
        path = tmp_path / f"{trick.__name__}.h5"
        small(path)
        with h5py.File(path, "r+") as file:
            del file["fields/w/coefficients"]
            trick(file["fields/w"])
        with pytest.raises(ChaosFileError, match="not the checksum of the rest"):
            load_chaos(path)
        hdf5.seal(path, chaos_file.FORMAT)
        with pytest.raises(ChaosFileError, match="does not belong|in one piece|larger than the f"):
            load_chaos(path)


def test_without_h5py(tmp_path, monkeypatch):
    space, basis, field = small(tmp_path / "a.json")
    (tmp_path / "a.h5").write_bytes(b"x")
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(ChaosFileError, match="need h5py.*use a .json file"):
        save_chaos(tmp_path / "b.h5", space, basis, {"w": field})
    with pytest.raises(ChaosFileError, match="need h5py"):
        load_chaos(tmp_path / "a.h5")


# -- OpenTURNS -------------------------------------------------------------------------------------
OPENTURNS = pytest.mark.skipif(not has("openturns"), reason="no OpenTURNS")


@OPENTURNS
@pytest.mark.parametrize("inputs", ["parameters", "germs"])
def test_openturns_has_our_values_and_indices(inputs):
    import openturns as ot

    space, basis, sources = everything()
    block = fields_of(basis)["u"].coefficients
    names = [f"u{i}" for i in range(5)]
    result = to_openturns(space, basis, block, names, inputs)
    points = space.sample(40, 7)
    ours = basis.evaluate_fields(block, points)
    given = points.copy()
    if inputs == "parameters":
        for source in sources:
            if source.name in space.germ_names:
                given[:, space.germ_names.index(source.name)] = space.values(source, points)
        for position, name in enumerate(("K/1", "k%", "g")):
            column = space.groups["K/1+k%+g"][position]
            given[:, column] = space.values({s.name: s for s in sources}[name], points)
    found = np.array(result.getMetaModel()(given))
    assert np.abs(found.T - ours).max() < 1e-10 * np.abs(ours).max()
    back = np.array(result.getInverseTransformation()(points))
    assert back == pytest.approx(given, rel=1e-12, abs=1e-12)
    indices = ot.FunctionalChaosSobolIndices(result)
    truth = space.sobol(block, basis)
    for name, columns in space.groups.items():
        for row in range(5):
            first = indices.getSobolGroupedIndex(list(columns), row)
            total = indices.getSobolGroupedTotalIndex(list(columns), row)
            assert first == pytest.approx(truth[name].first[row], abs=1e-12)
            assert total == pytest.approx(truth[name].total[row], abs=1e-12)


@OPENTURNS
def test_openturns_distribution():
    """Moments and correlations of the joint law are those of the parameters."""
    space, basis, sources = everything()
    result = to_openturns(space, basis, fields_of(basis)["u"].coefficients)
    joint = result.getDistribution()
    names = list(joint.getDescription())
    assert names[:4] == ["u", "K/1", "k%", "g"]
    for source in sources:
        if source.name in names:
            marginal = joint.getMarginal(names.index(source.name))
            assert marginal.getMean()[0] == pytest.approx(source.mean, rel=1e-6)
            assert marginal.getStandardDeviation()[0] == pytest.approx(source.std, rel=1e-6)
    copula = np.array(joint.getCopula().getParameter())
    assert np.count_nonzero(copula) == 3


@OPENTURNS
def test_openturns_of_linear_maps_and_sampling():
    """Affine laws: no Python in the metamodel; its random vector has our mean and deviation."""
    import openturns as ot

    space = RandomSpace([Normal("k", 100.0, cov=0.2), Beta("b", 2.0, 3.0), Gamma("g", 1.0, cov=0.5)])
    basis = space.basis(Chaos(order=3))
    block = np.random.default_rng(8).normal(size=(2, len(basis)))
    result = to_openturns(space, basis, block)
    assert "Python" not in repr(result.getTransformation())
    ot.RandomGenerator.SetSeed(1)
    draws = np.array(result.getDistribution().getSample(20_000))
    values = np.array(result.getMetaModel()(draws))
    error = 4.0 * values.std(axis=0) / np.sqrt(len(values))
    assert np.all(np.abs(values.mean(axis=0) - block[:, 0]) < error)
    vector = ot.FunctionalChaosRandomVector(result)
    assert np.array(vector.getMean()) == pytest.approx(block[:, 0])
    deviations = np.sqrt(np.diag(np.array(vector.getCovariance())))
    assert deviations == pytest.approx(np.linalg.norm(block[:, 1:], axis=1))


def test_openturns_refuses(monkeypatch):
    space = RandomSpace([Normal("k", 100.0, cov=0.2)])
    basis = space.basis(Chaos(order=2))
    monkeypatch.setitem(__import__("sys").modules, "openturns", None)
    with pytest.raises(SceneError, match="needs OpenTURNS.*pip install openturns"):
        to_openturns(space, basis, np.ones((1, 3)))
    monkeypatch.undo()
    if has("openturns"):
        with pytest.raises(SceneError, match=r"shape \(1, 2\) for 3 modes"):
            to_openturns(space, basis, np.ones((1, 2)))
        with pytest.raises(SceneError, match="2 names for 1 rows"):
            to_openturns(space, basis, np.ones((1, 3)), ["a", "b"])
        with pytest.raises(SceneError, match="unknown inputs 'germ'"):
            to_openturns(space, basis, np.ones((1, 3)), inputs="germ")
