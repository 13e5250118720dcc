"""Mutants: do the tests see a small fault in what the kernel and the statistics decide?

    ./run python tools/mutants.py                  60 mutants, for a night
    ./run python tools/mutants.py --list           what is drawn, as differences
    ./run python tools/mutants.py --seconds 3000 --only rare iteration

Each mutant has one fault, made by an operator in the source as it is (``mutation.py``): a comparison turned,
a sign, a tolerance times ten, a `not` dropped, `and` for `or`, an index off by one, `min` for `max`. It is
built in a copy under ``build/mutants`` and run against the tests of its own sub-package until the first one
fails: ``tests/NAME``, or where there is none, the test files that import it; of the kernel, the C++ tests
that include its folder.

    killed      a test failed, or it ran three times as long as without the fault (said so)
    survived    all passed: the tests miss it, or it changes nothing that matters; a reader has to say which
    equivalent  the same program was compiled, or `mutants.toml` names it with the reason
    broken      it does not compile
    unjudged    the tests fail without a fault, too

The floor is a record of such a run, ``tools/mutants.json``, which ``--keep`` writes: its faults are made
again wherever the lines that they change still stand, others are drawn in the place of those that are gone,
and a fault that was killed must not survive. (Shares of two draws differ by chance, 60 mutants by 6 % of
deviation; the 95 % interval is printed.) Results are kept by seed and state of sources and tests: a run that
was stopped is gone on with.
"""

from __future__ import annotations

import argparse
import contextlib
import difflib
import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from time import monotonic
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from mutation import Mark, Site, applied, drawn  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / "build" / "mutants"
EXCUSED, FLOOR = ROOT / "tools" / "mutants.toml", ROOT / "tools" / "mutants.json"
KERNEL = tuple(
    f"latin_core/src/{name}"
    for name in ("iteration", "substructure", "interface", "algebra", "stochastic", "mortar", "equilibration")
)
STATISTICS = tuple(
    f"dolfinx_frontend/{name}" for name in "estimate evaluate inference moments rare fit uncertainty".split()
)
# a folder of the kernel and one of the statistics in turns: as many of both
FOLDERS = tuple(STATISTICS[k // 2 % 3] if k % 2 else KERNEL[k // 2] for k in range(12))
NAMES = tuple(Path(each).name for each in dict.fromkeys(FOLDERS))
COUNT, SEED = 60, 45
SLOWER, LEAST_S = 3.0, 60.0
"""Time limit over the seconds without a fault, and the smallest one."""


def tracked() -> list[str]:
    """Files of the working tree that git knows or would add."""
    listed = ["git", "-C", str(ROOT), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, capture_output=True, text=True, check=True).stdout.split("\0")
    return sorted({name for name in names if name and (ROOT / name).is_file()})


def copied(scratch: Path) -> str:
    """Make the copy as the working tree is, touching what differs only; a digest of sources and tests."""
    digest, names = hashlib.sha256(), tracked()
    known = scratch / ".files"
    before = known.read_text().splitlines() if known.exists() else []
    for name in set(before) - set(names):
        (scratch / name).unlink(missing_ok=True)
    for name in names:
        content, place = (ROOT / name).read_bytes(), scratch / name
        if name.startswith(("latin_core/", "dolfinx_frontend/", "tests/", "CMakeLists.txt")):
            digest.update(name.encode() + hashlib.sha256(content).digest())
        if not place.is_file() or place.read_bytes() != content:
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_bytes(content)
            place.chmod((ROOT / name).stat().st_mode)
    known.write_text("\n".join(names))
    return digest.hexdigest()[:12]


class Ended(Exception):
    """A command took longer than its limit."""


def run(scratch: Path, *command: str, limit: float | None = None, build: bool = False) -> tuple[int, str]:
    """Exit code and words of a command through the `run` of the copy; its processes end at the limit."""
    # a file changes twice in a second; what only warns is a program
    environment = os.environ | {"PYTHONDONTWRITEBYTECODE": "1", "LATIN_WERROR": "OFF"}
    environment.pop("LATIN_SKIP_BUILD", None)
    if not build:
        environment["LATIN_SKIP_BUILD"] = "1"
    process = subprocess.Popen(
        [str(scratch / "run"), *command], cwd=scratch, env=environment, text=True, errors="replace",
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        words, _ = process.communicate(timeout=limit)
    except BaseException as error:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        if isinstance(error, subprocess.TimeoutExpired):
            raise Ended from None
        raise
    return process.returncode, words


# --- the tests of a mutant's own sub-package --------------------------------------------------------


def python_tests(root: Path, path: str) -> list[str]:
    """Test files of a module's sub-package, those that import the module itself first."""
    package, module = Path(path).parent.name, Path(path).stem
    own = root / "tests" / package
    texts = {each: each.read_text(encoding="utf-8") for each in sorted(root.glob("tests/**/test_*.py"))}
    use = re.compile(rf"dolfinx_frontend\.{package}\b|dolfinx_frontend import .*\b{package}\b")
    found = [
        each for each, text in texts.items() if own in each.parents or not own.is_dir() and use.search(text)
    ]
    itself = re.compile(rf"\b{package}\.{module}\b|\b{package} import .*\b{module}\b")
    found.sort(key=lambda each: itself.search(texts[each]) is None)
    return [str(each.relative_to(root)) for each in found]


def cpp_filter(root: Path, path: str) -> str:
    """GoogleTest's filter of the suites whose files include a folder of the kernel, or its namespace."""
    folder = Path(path).parent.name
    use = re.compile(rf'#include "(?:latin/)?{folder}/|namespace latin::{folder}\b')
    suites: set[str] = set()
    for each in sorted(root.glob("tests/cpp/test_*.cpp")):
        text = each.read_text(encoding="utf-8")
        if use.search(text):
            suites |= set(re.findall(r"^(?:TYPED_)?TEST(?:_[FP])?\(\s*(\w+),", text, re.MULTILINE))
    return ":".join(f"{name}.*:*/{name}.*:{name}/*" for name in sorted(suites))


def first_failure(words: str) -> str:
    """The name of the test that failed first."""
    found = re.search(r"^(?:FAILED|ERROR) (\S+)|\[  FAILED  \] ([\w/.]+)", words, re.MULTILINE)
    return (found[1] or found[2]) if found else (words.strip().splitlines() or ["nothing was said"])[-1][:200]


class Bench:
    """The copy, built once, and what its tests take without a fault."""

    def __init__(self, scratch: Path) -> None:
        self.scratch, self.seconds = scratch, dict[str, float]()
        self.cmake = f"build/{os.environ['LATIN_ENVIRONMENT']}/cmake"
        self.program = scratch / self.cmake / "latin_tests"
        self.binary = ""

    def built(self, language: set[str]) -> None:
        """Everything, without a fault."""
        steps = [(["python", "-c", "import dolfinx_frontend"], True)]
        if "cpp" in language:
            steps += [(["cmake", "-S", ".", "-B", self.cmake, "-DLATIN_BUILD_TESTS=ON"], False)]
            steps += [(["cmake", "--build", self.cmake, "--target", "latin_tests"], False)]
        for command, build in steps:
            code, words = run(self.scratch, *command, build=build)
            if code:
                raise SystemExit(f"mutants: {' '.join(command)} failed in {self.scratch}:\n{words[-3000:]}")
        if "cpp" in language:
            self.binary = hashlib.sha256(self.program.read_bytes()).hexdigest()

    def command(self, path: str) -> list[str]:
        """What runs the tests of a file's sub-package, up to the first failure."""
        if path.endswith(".cpp"):
            suites = cpp_filter(self.scratch, path)
            return [str(self.program), "--gtest_fail_fast", f"--gtest_filter={suites}"]
        return ["test", "-x", "-q", "-p", "no:cacheprovider", *python_tests(self.scratch, path)]

    def limit(self, path: str) -> float | None:
        """Seconds that a mutant of a file gets; None: its tests fail without a fault."""
        folder = str(Path(path).parent)
        if folder not in self.seconds:
            if path.endswith(".cpp"):  # the program is that of the last mutant
                run(self.scratch, "cmake", "--build", self.cmake, "--target", "latin_tests")
            began = monotonic()
            code, words = run(self.scratch, *self.command(path))
            self.seconds[folder] = -1.0 if code else monotonic() - began
            said = f"FAIL: {first_failure(words)}" if code else f"take {self.seconds[folder]:.0f} s"
            print(f"  without a fault the tests of {folder} {said}", flush=True)
        return None if self.seconds[folder] < 0.0 else max(LEAST_S, SLOWER * self.seconds[folder])

    def judged(self, site: Site) -> tuple[str, str]:
        """Status of a mutant, and the test that killed it or why it was not judged."""
        if (limit := self.limit(site.path)) is None:
            return "unjudged", "its tests fail without a fault"
        with self.fault(site):
            if site.path.endswith(".cpp"):
                code, words = run(self.scratch, "cmake", "--build", self.cmake, "--target", "latin_tests")
                if code:
                    reason = next((x for x in words.splitlines() if "error" in x), words[-200:])
                    return "broken", reason.replace(f"{self.scratch}/", "")
                if hashlib.sha256(self.program.read_bytes()).hexdigest() == self.binary:
                    return "equivalent", "the same program"
            try:
                code, words = run(self.scratch, *self.command(site.path), limit=limit)
            except Ended:
                return "killed", f"ran longer than {limit:.0f} s"
        return ("killed", first_failure(words)) if code else ("survived", "")

    @contextlib.contextmanager
    def fault(self, site: Site) -> Iterator[None]:
        """The fault stands in the copy, and is gone afterwards."""
        place = self.scratch / site.path
        text = place.read_bytes()
        try:
            place.write_bytes(applied(site, text.decode()).encode())
            yield
        finally:
            place.write_bytes(text)


# --- what is said ----------------------------------------------------------------------------------


def difference(site: Site) -> str:
    """A mutant as a unified difference with a line around."""
    text = (ROOT / site.path).read_text(encoding="utf-8")
    before, after = text.splitlines(), applied(site, text).splitlines()
    return "\n".join(difflib.unified_diff(before, after, site.path, site.operator, n=1, lineterm=""))


def excuses() -> dict[tuple[str, str], str]:
    """Reasons of ``[[equivalent]]`` (``path``, ``becomes``: the changed line, ``reason``)."""
    known = tomllib.loads(EXCUSED.read_text(encoding="utf-8")) if EXCUSED.exists() else {}
    return {(each["path"], each["becomes"]): each["reason"] for each in known.get("equivalent", [])}


def floor() -> dict[Mark, str]:
    """Statuses of the mutants of the record."""
    known = json.loads(FLOOR.read_text(encoding="utf-8")) if FLOOR.exists() else []
    return {tuple(each["mark"]): each["status"] for each in known}


def share_of(statuses: Sequence[str]) -> tuple[float, float, float] | None:
    """Killed over killed and survived, and its 95 % interval (Wilson); None: neither."""
    count = Counter(statuses)
    judged = count["killed"] + count["survived"]
    if not judged:
        return None
    share, normal = count["killed"] / judged, 1.96**2 / judged
    middle, half = share + normal / 2.0, (normal * (share * (1.0 - share) + normal / 4.0)) ** 0.5
    return share, (middle - half) / (1.0 + normal), (middle + half) / (1.0 + normal)


def lost(before: Mapping[Mark, str], now: Mapping[Mark, str]) -> list[Mark]:
    """Faults that the tests saw and see no more."""
    return [mark for mark, status in now.items() if status == "survived" and before.get(mark) == "killed"]


def keep(records: Sequence[dict[str, Any]]) -> None:
    """Write the floor."""
    rows = [json.dumps({name: each[name] for name in ("mark", "status", "by")}) for each in records]
    FLOOR.write_text("[\n" + ",\n".join(rows) + "\n]\n", encoding="utf-8")


def main() -> None:
    """Draw, build, run, print."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--count", type=int, default=COUNT)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="no mutant begins after these")
    parser.add_argument("--only", nargs="+", choices=NAMES, metavar="NAME", help="sub-packages of the draw")
    parser.add_argument("--first", type=int, help="so many of these only")
    parser.add_argument("--json", type=Path, help="file to write the record to")
    parser.add_argument("--keep", action="store_true", help="this run is the floor from now on")
    parser.add_argument("--list", action="store_true", help="print the mutants, and end")
    given = parser.parse_args()
    texts = {
        str(each.relative_to(ROOT)): each.read_text(encoding="utf-8")
        for folder in dict.fromkeys(FOLDERS)
        for each in sorted((ROOT / folder).glob("*.cpp" if folder in KERNEL else "*.py"))
    }
    before = floor()
    chosen = drawn(texts, FOLDERS, given.count, given.seed, list(before) if given.seed == SEED else ())
    if given.only:
        chosen = {mark: each for mark, each in chosen.items() if Path(each.path).parent.name in given.only}
    chosen = dict(list(chosen.items())[: given.first])
    if given.list:
        print("\n".join(map(difference, chosen.values())))
        return
    # what it started ends with it, and the fault is taken out
    signal.signal(signal.SIGTERM, lambda *_: sys.exit("mutants: ended from outside"))
    began = monotonic()
    scratch = WORK / "source"
    state = copied(scratch)
    store = WORK / f"{given.seed}-{state}.json"
    done: dict[str, Any] = json.loads(store.read_text()) if store.exists() else {}
    excused = excuses()
    bench = Bench(scratch)
    unjudged = {"status": "unjudged"}  # they get another try: the machine may have been too busy
    found = {mark: done.get(repr(each), unjudged)["status"] for mark, each in chosen.items()}
    waiting = [mark for mark, status in found.items() if status == "unjudged"]
    if waiting:
        print(f"building a copy in {scratch} ...", file=sys.stderr, flush=True)
        bench.built({"python" if path.endswith(".py") else "cpp" for path, *_ in waiting})
    for mark in waiting:
        if monotonic() - began > given.seconds:
            break
        start, site = monotonic(), chosen[mark]
        status, by = bench.judged(site)
        done[repr(site)] = asdict(site) | {"status": status, "by": by, "seconds": monotonic() - start}
        store.write_text(json.dumps(done, indent=1))
        print(f"{status:11}{monotonic() - start:6.0f} s  {site.path}: {mark[3]}  [{by}]", flush=True)
    records = []
    for mark, site in ((mark, each) for mark, each in chosen.items() if repr(each) in done):
        record = done[repr(site)] | {"mark": mark}
        if record["status"] == "survived" and (reason := excused.get((site.path, mark[3]))):
            record |= {"status": "equivalent", "by": reason}
        records.append(record)
        if record["status"] == "survived":
            print(f"\n{difference(site)}")
    share, count = share_of([each["status"] for each in records]), Counter(each["status"] for each in records)
    said = ", ".join(f"{number} {status}" for status, number in sorted(count.items()))
    if share is not None:
        said += f"; killed: {share[0]:.1%} (95 % between {share[1]:.1%} and {share[2]:.1%})"
    again = {each["mark"]: each["status"] for each in records if each["mark"] in before}
    print(f"\n{len(records)} of {given.count} mutants, {len(again)} of them of the record: {said}")
    if given.json:
        record = {"seed": given.seed, "state": state, "share": share, "mutants": records}
        given.json.write_text(json.dumps(record, indent=1))
    if given.keep and len(records) == given.count:
        keep(records)
    elif gone := lost(before, again):
        rows = "\n".join(f"  {mark[0]}: {mark[3]}" for mark in gone)
        sys.exit(f"mutants: killed before, survive now (tools/mutants.json):\n{rows}")


if __name__ == "__main__":
    main()
