"""Size of the house, and whether it stays within ``tools/budget.toml``.

``house_size.py`` prints the table and exits with 1 if a number is above its budget; ``--check`` prints only
those; ``--write`` lowers the budget to what is there and raises nothing.

Of each sub-package of ``dolfinx_frontend`` and ``latin_core`` (its headers and sources, Python, bindings and
program): ``code`` lines (no blanks, comments and docstrings), ``modules`` (files), ``numbers`` (literals that
may decide: in Python and data files all but 0, 0.5, 1, 2, 3, 10 and their negatives, in C++ floating ones but
0, 0.5, 1, 2), ``integers`` (of C++, but 0, 1, 2, 3, 10), ``long_files`` and ``long_functions``. What is
neither Python nor C++ is data that code reads: its lines and numbers count, of a binary file a number every
eight bytes.

Of all imports, those inside functions and for type checkers too, as ``check_layers.py`` follows them:
``import_chain`` and ``include_chain`` (modules in the longest one, the arrows up of ``LAZY`` and ``PENDING``
left out; files of a circle stand in one link), ``circles`` (files that lie in one, with these arrows) and
``upward`` (these arrows).
"""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import check_layers

ROOT = Path(__file__).resolve().parents[1]
BUDGET = Path("tools") / "budget.toml"

PLAIN = {0, 0.5, 1, 2, 3, 10}
PLAIN_FLOATS = {0, 0.5, 1, 2}
LINES_OF_A_FILE = 600
LINES_OF_A_FUNCTION = 60

PYTHON = {".py", ".pyi"}
CPP = {".c", ".cc", ".cpp", ".cxx", ".h", ".hh", ".hpp", ".hxx", ".inl", ".ipp", ".tpp"}

Sizes = dict[str, Counter[str]]
Budget = Mapping[str, Mapping[str, int]]

IMPORTS = "imports"
LIBRARY = ("latin_core/include", "latin_core/src")
BESIDE = {"benchmarks", "build", "demos", "docs", "packaging", "tests", "tools"}
"""Folders at the top that are no part of the library; any other has a budget."""

HEADER = """\
# Upper bounds of what tools/house_size.py counts; `./run lint` compares. `./run python tools/house_size.py
# --write` lowers them. They are raised by hand, in a commit of its own that says what it buys.
"""


class Counted(NamedTuple):
    """What a file holds; `functions` are the lengths of its functions in lines."""

    code: int
    numbers: int
    integers: int
    functions: list[int]


def python_counted(text: str) -> Counted:
    """Of a Python file."""
    loose: set[int] = set()
    spanned: set[int] = set()
    numbers, functions = 0, []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr):
            if isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
                loose.update(_lines(node))
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float):
            numbers += node.value not in PLAIN
        elif isinstance(node, ast.Constant | ast.JoinedStr):
            spanned.update(_lines(node))
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            functions.append(len(_lines(node)))
    # a line that is blank or looks like a comment is code within a string only
    lines = enumerate(map(str.strip, text.splitlines()), start=1)
    held = {number for number, line in lines if line and line[0] != "#"}
    return Counted(len((held | spanned) - loose), numbers, 0, functions)


def _lines(node: ast.expr | ast.stmt) -> range:
    return range(node.lineno, (node.end_lineno or node.lineno) + 1)


_LITERAL = re.compile(r'R"(?P<raw>[^(\s]*)\(.*?\)(?P=raw)"|"(?:\\.|[^"\\\n])*"', re.DOTALL)
_CHARACTER = re.compile(r"(?<![\w])(?:u8|[uUL])?'(?:\\.[^'\n]*|[^'\\\n])'")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
_DIRECTIVE = re.compile(r"^[ \t]*#(?:[^\n]*\\\n)*[^\n]*", re.MULTILINE)
_FLOAT = re.compile(
    r"(?<![\w.])((?:\d[\d']*\.[\d']*|\.\d[\d']*)(?:[eE][+-]?\d+)?|\d[\d']*[eE][+-]?\d+)[fFlL]?(?![\w.])"
)
_INTEGER = re.compile(r"(?<![\w.])(0[xX][\da-fA-F']+|0[bB][01']+|\d[\d']*)[uUlLzZ]*(?![\w.])")


def cpp_counted(text: str) -> Counted:
    """Of a C++ file."""
    # strings first, for they may hold what looks like a comment; the lines they span stay
    bare = _LITERAL.sub(lambda found: re.sub(r"[^\n]+", '"', found.group()), text)
    bare = _COMMENT.sub(lambda found: "\n" * found.group().count("\n"), bare)
    bare = _CHARACTER.sub("''", bare)
    floats = [float(found.replace("'", "")) for found in _FLOAT.findall(bare)]
    whole = _DIRECTIVE.sub(lambda found: "\n" * found.group().count("\n"), bare)
    integers = [int(_decimal(found), 0) for found in _INTEGER.findall(_FLOAT.sub("", whole))]
    return Counted(
        sum(bool(line.strip()) for line in bare.splitlines()),
        sum(value not in PLAIN_FLOATS for value in floats),
        sum(value not in PLAIN for value in integers),
        list(cpp_functions(whole)),
    )


def _decimal(literal: str) -> str:
    """An integer of C++ as Python reads it: without separators, octal ones with their mark."""
    digits = literal.replace("'", "")
    return f"0o{digits}" if len(digits) > 1 and digits.isdigit() and digits[0] == "0" else digits


_SPACE = re.compile(r"(?:inline\s+)?(?:namespace|class|struct|union|enum|extern)\b")
_ACCESS = re.compile(r"\s*(?:(?:public|private|protected)\s*:\s*)*")
_BRACKETS = re.compile(r"\btemplate\s*(?=<)|<[^<>]*>")
_MEMBERS = re.compile(r"\)\s*(?:noexcept\s*)?:(?!:)")


def cpp_functions(bare: str) -> Iterator[int]:
    """Lines of the functions of C++ without comments, strings and directives; lambdas are part of theirs.

    A brace outside of functions opens one if there are parentheses since the last statement, which names
    neither a namespace nor a type; those in parentheses and of members that a constructor sets are values.
    """
    scopes: list[tuple[str, int]] = []
    start, parentheses, inside = 0, 0, False
    for found in re.finditer(r"[{};()]", bare):
        mark, at = found.group(), found.start()
        if mark in "()":
            parentheses += 1 if mark == "(" else -1
        elif mark == "{":
            kind, began = "block", 0
            if not inside:
                began = _end(_ACCESS, bare, start)
                kind = _brace(bare[began:at], parentheses)
                inside = kind == "function"
            scopes.append((kind, began))
            if kind == "space":
                start = at + 1
        elif mark == "}":
            kind, began = scopes.pop()
            if kind == "function":
                yield bare.count("\n", began, at) + 1
                inside = False
            if kind in ("function", "space"):
                start = at + 1
        elif not inside and parentheses == 0:
            start = at + 1


def _end(pattern: re.Pattern[str], text: str, start: int) -> int:
    found = pattern.match(text, start)
    return found.end() if found else start


def _brace(head: str, parentheses: int) -> str:
    """What a brace behind this head opens: "function", "space" (of names or values) or "value" in a head."""
    count = 1
    while count:  # the innermost first
        head, count = _BRACKETS.subn("", head)
    head = head.strip()
    if parentheses or (_MEMBERS.search(head) and re.search(r"\w$", head)):
        return "value"
    return "function" if "(" in head and not _SPACE.match(head) else "space"


def data_counted(content: bytes) -> Counted:
    """Of a file that is neither Python nor C++."""
    try:
        text = content.decode()
    except UnicodeDecodeError:
        return Counted(0, len(content) // 8, 0, [])
    lines = [line for line in text.splitlines() if line.strip() and not re.match(r"\s*#(\W|$)", line)]
    found = re.findall(r"(?<![\w.])(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?(?![\w.])", "\n".join(lines))
    return Counted(len(lines), sum(float(number) not in PLAIN for number in found), 0, [])


def walked(root: Path) -> Iterator[tuple[str, Path]]:
    """Sub-package and path of each file: folders of the frontend, of the kernel and of its layers."""
    kernel = root / "latin_core"
    tops = [root / "dolfinx_frontend", kernel / "include" / "latin", kernel / "src"]
    others = [f for f in root.iterdir() if f.is_dir() and f.name not in BESIDE and not f.name.startswith(".")]
    for path in sorted(path for folder in others for path in (folder, *folder.rglob("*"))):
        if path.is_symlink():
            raise SystemExit(f"{path} is a link: what it leads to is not counted, put it there")
        if not path.is_file() or path.suffix == ".pyc":
            continue
        first = root / path.relative_to(root).parts[0]
        top = next((top for top in (*tops, kernel) if path.is_relative_to(top)), first)
        parts = path.relative_to(top).parts
        folder = top / parts[0] if len(parts) > 1 else top
        yield folder.relative_to(root).as_posix(), path


def measured(root: Path) -> Sizes:
    """All that has a budget: sub-package -> what is counted -> how much; and of the imports."""
    sizes: Sizes = {}
    for folder, path in walked(root):
        content = path.read_bytes()
        kind = python_counted if path.suffix in PYTHON else cpp_counted if path.suffix in CPP else None
        counted = data_counted(content) if kind is None else kind(content.decode())
        here = sizes.setdefault(folder, Counter())
        here["code"] += counted.code
        here["modules"] += kind is not None
        here["numbers"] += counted.numbers
        here["integers"] += counted.integers
        here["long_files"] += kind is not None and content.count(b"\n") > LINES_OF_A_FILE
        here["long_functions"] += sum(lines > LINES_OF_A_FUNCTION for lines in counted.functions)
    arrows, upward = imported(root)
    included = includes(root)
    links = components(arrows | {file: arrows.get(file, set()) | upward[file] for file in upward})
    sizes[IMPORTS] = Counter(
        import_chain=longest(arrows),
        include_chain=longest(included),
        circles=sum(len(link) for link in (*links, *components(included)) if len(link) > 1),
        upward=sum(map(len, upward.values())),
    )
    return sizes


def imported(root: Path) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Imports among the modules of the frontend: those along the arrow, and those that point upward."""
    arrows: dict[str, set[str]] = {}
    upward: dict[str, set[str]] = {}
    for use in check_layers.uses(root / "dolfinx_frontend"):
        here, there = check_layers.place_of(use.module), check_layers.place_of(use.used)
        along = here is None or there is None or there < here
        (arrows if along else upward).setdefault(use.module, set()).add(use.used)
    return arrows, upward


def includes(root: Path) -> dict[str, set[str]]:
    """Includes among the files of the kernel."""
    kernel = root / "latin_core"
    files = [path for path in kernel.rglob("*") if path.suffix in CPP]
    return {str(path): {str(used) for _, _, used in check_layers.included(path, kernel)} for path in files}


def components(arrows: Mapping[str, set[str]]) -> list[list[str]]:
    """Strongly connected components of a graph, each behind those that it points to (Tarjan)."""
    order: dict[str, int] = {}
    lowest: dict[str, int] = {}
    stack: list[str] = []
    found: list[list[str]] = []

    def visit(node: str) -> None:
        order[node] = lowest[node] = len(order)
        stack.append(node)
        for following in arrows.get(node, ()):
            if following not in order:
                visit(following)
            if following in stack:
                lowest[node] = min(lowest[node], lowest[following])
        if lowest[node] == order[node]:
            first = stack.index(node)
            found.append(stack[first:])
            del stack[first:]

    for node in arrows:
        if node not in order:
            visit(node)
    return found


def longest(arrows: Mapping[str, set[str]]) -> int:
    """Nodes of the longest path of a graph whose circles are one node each."""
    lengths: dict[str, int] = {}
    for link in components(arrows):
        after = {used for node in link for used in arrows.get(node, ())} - set(link)
        lengths |= dict.fromkeys(link, 1 + max((lengths[used] for used in after), default=0))
    return max(lengths.values(), default=0)


def above(sizes: Sizes, budget: Budget) -> Iterator[str]:
    """What is above its budget, a line each; what is not in it has a budget of 0."""
    for folder, counted in sizes.items():
        for what, count in counted.items():
            allowed = budget.get(folder, {}).get(what, 0)
            if count > allowed:
                yield f"{folder}: {what} {count}, budget {allowed}"


def lowered(budget: Budget, sizes: Sizes) -> Budget:
    """The budget where it is above what there is; what is gone has none."""
    return {
        folder: {what: min(count, budget[folder].get(what, 0)) for what, count in counted.items()}
        for folder, counted in sizes.items()
        if folder in budget
    }


def written(budget: Budget) -> str:
    """The text of the budget."""
    lines = [HEADER]
    for folder, counted in sorted(budget.items()):
        bounds = ", ".join(f"{what} = {count}" for what, count in counted.items() if count)
        lines.append(f'"{folder}" = {{ {bounds} }}')
    return "\n".join(lines) + "\n"


def table(sizes: Sizes) -> Iterator[str]:
    """What there is: a line a sub-package, and the sums of the frontend, of the library, and of the rest."""
    sums: Sizes = {name: Counter() for name in ("frontend", "headers and sources", "rest of latin_core")}
    frontend, library, rest = sums.values()
    for folder, counted in sizes.items():
        if folder.startswith("dolfinx_frontend"):
            frontend.update(counted)
        elif folder.startswith(LIBRARY):
            library.update(counted)
        elif folder != IMPORTS:
            rest.update(counted)
    for name, counted in (*sorted(sizes.items()), *sums.items()):
        yield f"{name:36s}" + ", ".join(f"{count} {what}" for what, count in counted.items() if count)


def main(arguments: list[str]) -> int:
    """Count, then print, compare or write; 1 if something is above its budget."""
    root = Path(arguments.pop()) if arguments and not arguments[-1].startswith("-") else ROOT
    sizes, file = measured(root), root / BUDGET
    budget: Budget = tomllib.loads(file.read_text()) if file.exists() else {}
    if arguments == ["--write"]:
        budget = lowered(budget, sizes) if file.exists() else sizes
        file.write_text(written(budget))
    elif arguments != ["--check"]:
        print(*table(sizes), sep="\n")
    grown = list(above(sizes, budget))
    for line in grown:
        print(f"{BUDGET}: {line}")
    if grown:
        print("Take away as much, or raise the budget by hand in a commit of its own that says what it buys.")
    return 1 if grown else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
