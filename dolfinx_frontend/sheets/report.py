"""``report(result, "flange.html")``: the answer sheet of an engineer, as HTML and CSV from one call."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path
from typing import Any, Literal

import numpy as np

from dolfinx_frontend.assembly.ranks import agreement, together
from dolfinx_frontend.common.checks import (
    checked_flag,
    checked_name,
    checked_number,
    checked_numbers,
    checked_path,
    checked_word,
)
from dolfinx_frontend.common.describe import columns
from dolfinx_frontend.common.errors import SceneError
from dolfinx_frontend.common.files import Files, writable
from dolfinx_frontend.common.progress import Bar
from dolfinx_frontend.formats.chaos_file import software
from dolfinx_frontend.results.answer import Answer, check_answer
from dolfinx_frontend.results.saved import load
from dolfinx_frontend.results.tables import QUANTILES, Table
from dolfinx_frontend.sheets import page as html
from dolfinx_frontend.sheets import pictures as drawn
from dolfinx_frontend.sheets.clamping import Bolt, bolts_of
from dolfinx_frontend.sheets.content import (
    Content,
    Row,
    Wanted,
    content_of,
    margins_of,
    status_line,
)
from dolfinx_frontend.sheets.names import BOLT, SEAL, by_pattern, units_of
from dolfinx_frontend.sheets.page import Cell, number
from dolfinx_frontend.sheets.pictures import Picture, View
from dolfinx_frontend.sheets.seals import seals_of
from dolfinx_frontend.sheets.statistics import Known, errors_known, label, tightened

__all__ = ["Report", "report"]

RANKED = ("margin", "m_K", "m_G", "F_V", "F_S max", "F_S", "F_KR", "Phi", "sigma_a", "sigma_ab")
"""Columns of the first table; beside the highest bolt force stands the lowest."""
ZERO = 1e-8
"""What is shown as 0, relative to the largest number of its kind."""
MOST_JOINTS = 2
"""Joints and gaskets whose pressure is drawn."""
NO_CHECK = (
    "Symbols follow VDI 2230 (bolts) and EN 1591-1 and EN 13555 (gaskets). This sheet shows numbers of a "
    "finite element model; it is no check by these or other codes."
)


@dataclass(frozen=True, repr=False)
class Report:
    """An answer sheet: ``print`` it, :meth:`save` it, :meth:`value` reads a number.

    Attributes
    ----------
    html, csv
        What is written.
    table
        All numbers, one a line: section, name, key, statistic, value and its errors.
    ranking
        The bolts, the weakest first.
    weakest
        The first of them; None: there are no bolts.
    sentences
        What stands on top.
    left_out
        What cannot be given, and why.
    """

    html: str
    table: Table
    ranking: tuple[str, ...]
    sentences: tuple[str, ...]
    left_out: tuple[str, ...]
    _text: str = field(default="")

    @property
    def weakest(self) -> str | None:
        """The bolt with the least margin, without margins that with the lowest force."""
        return self.ranking[0] if self.ranking else None

    @property
    def csv(self) -> str:
        """All numbers in full."""
        return self.table.to_csv()

    def value(self, name: str, key: str, statistic: str | None = None) -> float:
        """A number of a bolt or a gasket.

        Parameters
        ----------
        key
            As in the CSV file: ``"F_V"``, ``"Phi"``, ``"m_K"``, ``"Q_S"``, ...
        statistic
            ``"mean"``, ``"5 %"``, ``"lowest"``, ...; None: the first that there is.

        Raises
        ------
        SceneError
            No such number.
        """
        table = self.table
        for row in table.rows():
            if (row["name"], row["key"]) == (name, key) and statistic in (None, row["statistic"]):
                return float(row["value"])
        same = [row for row in table.rows() if row["name"] == name]
        known = sorted({f"{row['key']}, {row['statistic']}" for row in same})
        what = f"{name!r}, {key!r}" + ("" if statistic is None else f", {statistic!r}")
        if not same:
            raise SceneError(f"report: no number {what}; there are {sorted(set(table['name']))}")
        raise SceneError(f"report: no number {what}; of {name!r} there are {'; '.join(known)}")

    def save(self, path: str | Path) -> tuple[Path, Path]:
        """Write ``path.html`` and ``path.csv``, both or none; a folder that is not there is made.

        Raises
        ------
        FileError
            They cannot be written, or there is a folder, a pipe or a device of the name `path`.
        """
        page, numbers = _paths(path)
        with Files() as files:
            files.folder(page.parent)
            files.write(page, self.html)
            files.write(numbers, self.csv)
        return page, numbers

    def __str__(self) -> str:
        return self._text

    def __repr__(self) -> str:
        weakest = "no bolts" if self.weakest is None else f"weakest bolt {self.weakest}"
        return f"Report({len(self.table)} numbers, {weakest})"


def _paths(path: str | Path) -> tuple[Path, Path]:
    target = checked_path("report", path, new=True)
    if target.suffix.lower() in (".html", ".htm", ".csv"):
        stem = target.with_suffix("")
    elif target.suffix.lower() in (".pdf", ".docx", ".xlsx", ".txt", ".md", ".png"):
        raise SceneError(f"report: path = {str(target)!r}: it writes .html and .csv; a browser prints PDF")
    else:
        stem = target
    page = target if target.suffix.lower() == ".htm" else stem.with_name(stem.name + ".html")
    numbers = stem.with_name(stem.name + ".csv")
    for each in (target, page, numbers):  # before hours of solving; a device is no name to derive others from
        writable(each)
    return page, numbers


@together("report")
def report(
    result: Answer,
    path: str | Path | None = None,
    *,
    title: str = "Bolts, joints and gaskets",
    units: tuple[str, str] | None = None,
    bolts: Mapping[str, str] | Sequence[str] | str | None = None,
    joints: Mapping[str, Any] | None = None,
    seals: Mapping[str, Any] | None = None,
    friction: Mapping[str, float] | float | None = None,
    stress_area: Mapping[str, float] | float | None = None,
    arc: float = 0.125,
    quantiles: Sequence[float] = QUANTILES,
    errors: Any = True,
    pictures: bool = True,
    renderer: Literal["auto", "vtk", "matplotlib"] = "auto",
    samples: int | None = None,
    seed: int = 0,
) -> Report:
    """The answer sheet of an engineer: bolts, joints and gaskets of any answer, the weakest bolt on top.

    Parameters
    ----------
    result
        What ``solve``, a sweep, a sampling or ``load`` returned. Of a load history the state in which the
        last bolt is tightened is the one that margins and load factors refer to.
    path
        ``.html``; the numbers go to ``.csv`` beside it. None: nothing is written.
    title
        On top.
    units
        Of length and force, as ``("mm", "N")``; None: none are shown.
    bolts
        Interfaces, or interface -> name that is shown; None: those with a preload or an imposed jump, and
        axial forces of beams.
    joints
        Bolt or pattern (``"stud *"``) -> joints that it clamps; None: found from how the parts are joined.
    seals
        Gaskets: interface or pattern -> pressure that it needs in service, or both at assembly and in
        service, or None.
    friction
        Coefficient of joints, for all or by joint, instead of that of their law.
    stress_area
        A_S, length^2, for all or by bolt; None: the section as it is modelled.
    arc
        Part of the circumference over which the pressure of a gasket is averaged.
    quantiles
        Probabilities, where the answer is random.
    errors
        True: the iteration is carried on to a tenth of its error, and the error of the meshes is estimated,
        where that is possible; ``"goal"``: as True, and the error of the meshes of the force of every bolt
        that has a joint for itself by a dual problem, one or two more solves for each; False: neither; or
        the :class:`Errors` of another answer on these meshes.
    pictures, renderer
        Whether there are any, and what draws solids, see :func:`dolfinx_frontend.figures.assembly_figure`;
        ``"auto"`` is matplotlib here, which is at hand at once. The assembly turns, unless it has too many
        triangles.
    samples, seed
        Of a chaos: this many random samples (None: 4096).

    Raises
    ------
    SceneError
        A name that there is not, or a value that makes no sense.
    FileError
        The files cannot be written.

    Notes
    -----
    Collective where the parts are on several ranks: the first one, which is given the answer as :meth:`save`
    writes it, makes the sheet and the files, and all ranks get it.
    """
    check_answer("report", "result", result)
    if path is not None:
        _paths(path)
    settings: dict[str, Any] = {
        "title": title,
        "units": units,
        "bolts": bolts,
        "joints": joints,
        "seals": seals,
        "friction": friction,
        "stress_area": stress_area,
        "arc": arc,
        "quantiles": quantiles,
        "pictures": pictures,
        "renderer": renderer,
        "samples": samples,
        "seed": seed,
    }
    with Bar(1, "report", "sheet", result.problem.rank == 0):
        if result.problem.comm is None:
            known = partial(errors_known, result, errors)
            tight = partial(tightened, result) if _carries_on(errors) else _none
            made = _made(result, known, tight, **settings)
        else:
            made = _over_ranks(result, errors, settings)
    if path is not None and result.problem.rank == 0:
        made.save(path)
    return made


def _carries_on(errors: Any) -> bool:
    """Whether the iteration is carried on to know what it left."""
    return errors is True or (isinstance(errors, str) and errors == "goal")


def _none() -> None:
    """No answer that was carried on."""


def _over_ranks(result: Answer, errors: Any, settings: dict[str, Any]) -> Report:
    """The sheet of an answer whose parts are on several ranks; collective."""
    problem, comm = result.problem, result.problem.comm
    problem.check_alike("report", errors=errors if isinstance(errors, (bool, str)) else None, **settings)
    every: list[Any] = [result, tightened(result) if _carries_on(errors) else None]
    folder = comm.bcast(tempfile.mkdtemp() if problem.rank == 0 else None, root=0)
    found: Report | None = None
    try:
        files = [None if each is None else Path(folder) / f"{k}.h5" for k, each in enumerate(every)]
        for each, file in zip(every, files, strict=True):
            if each is not None:
                each.save(file)
        first: Any = None
        second: Any = None
        of: Sequence[Bolt] = ()
        with agreement(comm):
            if problem.rank == 0:
                laws = {name: interface.law for name, interface in problem.interfaces.items()}
                first, second = (None if file is None else load(file).with_laws(laws) for file in files)
                if isinstance(errors, str) and errors == "goal":
                    of = bolts_of(first, settings["bolts"], settings["joints"])
        known = errors_known(result, errors, comm.bcast(of, root=0))
        with agreement(comm):
            if problem.rank == 0:
                found = _made(first, lambda _: known, lambda: second, **settings)
    finally:
        if problem.rank == 0:
            shutil.rmtree(folder, ignore_errors=True)
    made: Report = comm.bcast(found, root=0)
    return made


def _made(
    result: Any,
    known: Callable[[Sequence[Bolt]], Known],
    tight: Callable[[], Any],
    *,
    title: str,
    units: tuple[str, str] | None,
    bolts: Any,
    joints: Any,
    seals: Any,
    friction: Any,
    stress_area: Any,
    arc: float,
    quantiles: Sequence[float],
    pictures: bool,
    renderer: Literal["auto", "vtk", "matplotlib"],
    samples: int | None,
    seed: int,
) -> Report:
    """The sheet of an answer that is on this rank, its errors, and what it is when it is carried on."""
    checked_name("report, title", title)
    checked_flag("report", "pictures", pictures)
    checked_word("report", "renderer", renderer, ("auto", "vtk", "matplotlib"))
    checked_number("report", "arc", arc, above=0.0, most=1.0)
    levels = checked_numbers("report", "quantiles", quantiles, "give probabilities", dimensions=1)
    for q in levels:
        checked_number("report", "quantile", float(q), above=0.0, below=1.0)
    found = bolts_of(result, bolts, joints)
    clamped = list(dict.fromkeys(j for bolt in found for j in bolt.joints))
    wanted = Wanted(
        found,
        seals_of(result, seals, arc),
        _positive("friction", friction, clamped, least=True),
        _positive("stress_area", stress_area, [b.name for b in found]),
        tuple(float(q) for q in levels),
        units_of(units),
        samples,
        seed,
    )
    content = content_of(result, wanted, known(found), tight)
    images = _pictures(content, renderer) if pictures else []
    sheet = html.page(title, _sections(content, title, images))
    return Report(
        sheet,
        content.table(),
        tuple(content.order),
        tuple(text for text, _ in content.verdicts),
        tuple(content.left_out),
        _printed(content),
    )


def _positive(what: str, given: Any, names: list[str], least: bool = False) -> dict[str, float]:
    bound: dict[str, float] = {"least": 0.0} if least else {"above": 0.0}
    if given is not None and not isinstance(given, Mapping):
        checked_number("report", what, given, **bound)
    found = by_pattern("report", what, given, names)
    return {n: checked_number(f"report, {what} of {n!r}", "value", v, **bound) for n, v in found.items()}


# --- pictures --------------------------------------------------------------------------------------
def _pictures(content: Content, renderer: str) -> list[Picture | View | str]:
    answer, units = content.answer, content.wanted.units
    renderer = "matplotlib" if renderer == "auto" else renderer  # which starts no other process
    found: list[Picture | View | str] = []
    margins = margins_of(content)
    if margins:
        found.append(drawn.draw("least margin of each bolt", lambda p: drawn.margins_picture(margins, p)))
    forces, times = content.numbers.forces, answer.times
    if times is not None and content.order and len(times) > 1:
        ordered = {name: forces[name] for name in forces}
        own = [answer.surface(b.interface).bolt for b in content.wanted.bolts]
        tightened = [float(times[k]) for k in own if k is not None]

        def history(path: Path) -> None:
            drawn.forces_picture(ordered, times, tightened, content.order[0], units["force"], path)

        found.append(drawn.draw("bolt forces over the load history (thick: the weakest)", history))
    for seal in content.wanted.seals:
        if seal.name in content.seals and len(seal.angles) > 1:
            numbers = content.seals[seal.name]

            def ring(path: Path, seal: Any = seal, numbers: Any = numbers) -> None:
                drawn.ring_picture(seal, numbers, units["stress"], path)

            found.append(drawn.draw(f"pressure around {seal.name}", ring))
    first = [content.numbers.joint[n] for n in content.order if n in content.numbers.joint]
    names = list(dict.fromkeys([*(s.name for s in content.wanted.seals), *first]))[:MOST_JOINTS]
    return [*found, *drawn.solid_pictures(answer, names, units, renderer)]


# --- the page --------------------------------------------------------------------------------------
def _sections(content: Content, title: str, images: Sequence[Picture | View | str]) -> Iterator[str]:
    yield f"<h1>{escape(title)}</h1>"
    yield html.paragraph(status_line(content), "sub")
    for text, bad in content.verdicts:
        yield html.paragraph(text, "verdict plain" if bad is None else f"verdict{' bad' if bad else ''}")
    if content.order:
        yield f"<h2>Bolts{', the weakest first' if len(content.order) > 1 else ''}</h2>"
        yield _ranking(content)
    if content.seals:
        yield "<h2>Gaskets</h2>"
        yield _details(content, "gasket", list(content.seals))
    if not content.rows:
        yield from _interfaces(content)
    shown = [each.html if isinstance(each, View) else html.figure(*each)
             for each in images if not isinstance(each, str)]
    if shown:
        yield f"<h2>Pictures{drawn.shown_answer(content.answer)}</h2>" + "".join(shown)
    if content.order:
        yield "<h2>All numbers of the bolts</h2>"
        yield _details(content, "bolt", content.order)
    yield "<h2>Not on this sheet</h2>"
    lost = [each for each in images if isinstance(each, str)]
    yield html.listing(escape(each) for each in [*content.left_out, *lost]) or ""
    yield "<h2>How to read it</h2>"
    yield html.listing(_reading(content))
    yield "<h2>How it was computed</h2>"
    yield f"<pre>{escape(str(content.answer.plan))}</pre>"
    yield html.paragraph(f"{software()}. {NO_CHECK}")


def _zeros(content: Content) -> dict[str, float]:
    """What is rounding, by kind of number."""
    largest: dict[str, float] = {}
    for row in content.rows:
        sizes = [abs(v) for v in row.statistics.values() if np.isfinite(v)]
        largest[row.name.of] = max([largest.get(row.name.of, 0.0), *sizes])
    return {of: ZERO * size if of else ZERO for of, size in largest.items()}


def _cell(row: Row | None, zeros: Mapping[str, float], limit: float) -> Cell:
    """A number with its quantiles and errors."""
    if row is None:
        return Cell("–")
    zero, found = zeros[row.name.of], row.statistics
    text = number(found[row.main], zero)
    more = [number(v, zero) for k, v in found.items() if k not in (row.main, "std")]
    if "std" in found and not np.isnan(found["std"]):
        text += f" ± {_deviation(found['std'], zero)}"
    more = [more[0], more[-1]] if len(more) > 2 else more  # the others are in the table of all numbers
    fails = row.key in ("margin", "m_K", "m_G", "m_L", "m_A") and row.low <= limit
    return Cell(text, " … ".join(more), _error(row, row.main, zero), fails=fails)


def _deviation(value: float, zero: float) -> str:
    """A standard deviation in two digits."""
    return number(float(f"{value:.2g}"), zero).rstrip("0").rstrip(".") if 0.0 < value < 1.0 else number(
        float(f"{value:.2g}"), zero
    )


def _error(row: Row, statistic: str, zero: float) -> str:
    shown = []
    for name, error in (("it.", row.algebra[statistic]), ("mesh", row.mesh[statistic])):
        if np.isfinite(error):
            shown.append(f"{name} {_short(error, zero)}")
    return "± " + "\n".join(shown) if shown else ""  # one below the other: the table is wide enough


def _short(error: float, zero: float) -> str:
    """An error in two digits."""
    if error <= zero:
        return "0"
    text = f"{error:.1e}" if error < 1e-3 or error >= 1e4 else f"{float(f'{error:.2g}'):g}"
    return text.replace("e-0", "e-").replace("e+0", "e")


def _ranked(content: Content) -> list[str]:
    """The columns of the first table."""
    keys = [k for k in RANKED if any(content.row(n, k) for n in content.order)]
    if "F_S max" in keys:
        keys.remove("F_S")
    if not {"m_K", "m_G"} <= set(keys):  # one of them is the least margin
        keys = [k for k in keys if k not in ("m_K", "m_G")]
    return keys


def _ranking(content: Content) -> str:
    units, zeros, keys = content.wanted.units, _zeros(content), _ranked(content)
    chances = any(r.probability for n in content.order if (r := content.row(n, "margin")) is not None)
    head = ["", "bolt", "clamps"]
    symbols = {"F_S max": "F_S min … F_S max"}
    head += [_headed(html.symbol(symbols.get(k, BOLT[k].symbol)), units[BOLT[k].of]) for k in keys]
    head += ["P(<i>m</i> ≤ 0)"] if chances else []
    rows = []
    for place, name in enumerate(content.order, start=1):
        row = [Cell(str(place)), Cell(name), Cell(content.numbers.joint.get(name, "–"))]
        for key in keys:
            cell = _cell(content.row(name, key), zeros, content.limit)
            lowest = content.row(name, "F_S min")
            if key == "F_S max" and lowest is not None:
                cell = _range(lowest, content.row(name, key), zeros["force"])
            row.append(cell)
        margin = content.row(name, "margin")
        if chances:
            chance = None if margin is None else margin.probability
            more = "" if chance is None else f"{chance.low:.2g} … {chance.high:.2g}"
            row.append(Cell("–" if chance is None else f"{chance.value:.3g}", more))
        rows.append(row)
    return html.table(head, rows, weak=0, left=3)


def _range(lowest: Row, highest: Row | None, zero: float) -> Cell:
    """The bolt force over the load steps."""
    assert highest is not None  # one comes with the other
    first = number(lowest.statistics[lowest.main], zero)
    last = list(highest.statistics)[1] if "highest" in highest.statistics else highest.main
    text = f"{first} … {number(highest.statistics[last], zero)}"
    levels = [k for k in highest.statistics if k.endswith("%")]
    ends = (lowest.statistics[levels[0]], highest.statistics[levels[-1]]) if levels else ()
    return Cell(text, " … ".join(number(v, zero) for v in ends), _error(highest, last, zero))


def _headed(name: str, unit: str) -> str:
    return f"{name}<br><small>{escape(unit)}</small>" if unit else name


def _details(content: Content, section: str, items: Sequence[str]) -> str:
    """All statistics of all numbers."""
    units, zeros = content.wanted.units, _zeros(content)
    mine = [row for row in content.rows if row.section == section]
    statistics = list(dict.fromkeys(s for row in mine for s in row.statistics))
    chances = any(row.probability is not None for row in mine)
    places = any(row.at for row in mine)
    head = ["", "", *map(escape, statistics), *(["P(used up)"] if chances else [])]
    head += ["error of<br>iteration", "error of<br>meshes", *(["at"] if places else [])]
    rows: list[Sequence[Cell] | str] = []
    names = BOLT if section == "bolt" else SEAL
    for item in items:
        rows.append(item)
        for row in (r for r in mine if r.item == item):
            zero, unit = zeros[row.name.of], units[row.name.of]
            cells = [
                Cell(names[row.key].symbol, ours=True),
                Cell(f"{row.name.says}, {unit}" if unit else row.name.says, ours=True),
            ]
            cells += [Cell(number(row.statistics.get(s, float("nan")), zero)) for s in statistics]
            if chances:
                p = row.probability
                more = "" if p is None else f"{p.low:.2g} … {p.high:.2g}"
                cells.append(Cell("" if p is None else f"{p.value:.3g}", more))
            for error in (row.algebra[row.main], row.mesh[row.main]):
                cells.append(Cell(_short(error, zero) if np.isfinite(error) else "not known"))
            rows.append([*cells, *([Cell(row.at, left=True)] if places else [])])
    return html.table(head, rows, left=2)


def _interfaces(content: Content) -> Iterator[str]:
    """Without bolts and gaskets: what is known of all interfaces."""
    try:
        table = content.answer.table(quantiles=content.wanted.quantiles)  # type: ignore[attr-defined]
    except SceneError as error:
        content.left_out.append(f"interfaces: {error}")
        return
    shown = [
        name
        for name, entries in table.columns.items()
        if any(not isinstance(v, float) or np.isfinite(v) for v in entries)
    ]
    rows = [
        [Cell(number(v) if isinstance(v, float) else str(v)) for n, v in row.items() if n in shown]
        for row in table.rows()
    ]
    yield "<h2>Interfaces</h2>"
    yield html.table([escape(n) for n in shown], rows, left=len(table.labels))
    yield from map(html.paragraph, table.notes)


def _reading(content: Content) -> Iterator[str]:
    """The words that the numbers need."""
    seals = {row.key for row in content.rows if row.section == "gasket"}
    bolts = {row.key for row in content.rows if row.section == "bolt"}
    for keys, names in ((bolts, BOLT), (seals, SEAL)):
        for key, name in names.items():
            if key in keys:
                yield f"{html.symbol(name.symbol)}: {html.rich(name.says)}"
    if "F_KR" in bolts:
        yield (
            "A joint that several bolts clamp is divided among them: each has the points nearest to its "
            "axis. Forces are those of the model: half a bolt has half the force. σ<sub>a</sub> is axial, "
            "σ<sub>ab</sub> the bending of a round bar of the stress area; there is none of beams."
        )
    if {"m_K", "m_G"} & bolts:
        yield (
            f"A margin up to {content.limit:.0e}, ten times the error of the iteration, counts as used up. "
            "<i>m</i><sub>G</sub> is the friction that is left over the friction when all is tightened "
            "(without a load history: over the friction now)."
        )
    if content.answer.statistics in ("random", "qmc", "quadrature"):
        levels = ", ".join(label(q) for q in content.wanted.quantiles)
        yield (
            "Numbers are computed sample by sample: mean ± standard deviation; below it the lowest and the "
            f"highest of the quantiles asked for ({levels})."
        )
    if content.answer.kind == "chaos":
        yield (
            "Probabilities in tables are those of the chaos; those in the sentences on top are checked by "
            "solved samples where a law is nonlinear."
        )
    how = content.known
    yield (
        f"Errors: of the iteration ({escape(how.algebra_how)}; where it could be carried on, the change "
        "of the number itself), of the meshes: the relative error in the energy norm times the number, of a "
        f"bolt force times what is not prescribed of it ({escape(how.mesh_how)}): an indication and no bound."
    )
    if how.goals:
        yield (
            "Errors of the meshes of F<sub>S</sub>, F<sub>SA</sub>, F<sub>KR</sub> and σ<sub>a</sub> of "
            f"{escape(', '.join(how.goals))}: dual weighted residuals of the force at the end, of a preload "
            "that of the joint, which differs from it by the load."
        )


# --- as text ---------------------------------------------------------------------------------------
def _printed(content: Content) -> str:
    lines = [status_line(content), *(text for text, _ in content.verdicts)]
    keys = _ranked(content)
    if content.order:
        rows = [["bolt", *(BOLT[k].symbol for k in keys)]]
        zeros = _zeros(content)
        for name in content.order:
            cells = [_cell(content.row(name, k), zeros, content.limit).text for k in keys]
            rows.append([name, *cells])
        lines += columns(rows, "<" + ">" * len(keys))
    lines += [f"not given: {each}" for each in content.left_out]
    return "\n".join(lines)
