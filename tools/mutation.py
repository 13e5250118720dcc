"""Small faults drawn from source: where an operator applies in Python (by its tree) and in C++ (by tokens).

``sites(path, text)`` lists them; ``drawn`` takes some with a seed; ``applied`` makes the text of a mutant;
``marks`` names them by the lines that they change, so that a fault is found again in a later state.
Left alone is what decides nothing: annotations, assertions, the text of exceptions, headers of C++ loops
(they only count), template brackets, preprocessor lines.
"""

from __future__ import annotations

import ast
import random
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

OPERATORS = ("comparison", "sign", "tolerance", "not", "and-or", "index", "extreme")
FACTOR = 10.0
"""Of a tolerance; one that may be ten times as large decides nothing that a test sees."""
FORMULAS = 12.0
"""Whole numbers up to it, a half and a quarter stand in formulas; others decide."""

COMPARISONS = {"<": ">=", ">": "<=", "<=": ">", ">=": "<", "==": "!=", "!=": "=="}
TURNED = COMPARISONS | {"is": "is not", "is not": "is", "in": "not in", "not in": "in"}
EXTREMES = {
    **{"min": "max", "minimum": "maximum", "fmin": "fmax", "argmin": "argmax", "nanmin": "nanmax"},
    **{"minCoeff": "maxCoeff", "cwiseMin": "cwiseMax"},
}
EXTREMES |= {after: before for before, after in EXTREMES.items()}


@dataclass(frozen=True, order=True)
class Site:
    """``text[begin:end]`` of a file becomes ``new``."""

    path: str
    begin: int
    end: int
    operator: str
    old: str
    new: str


def applied(site: Site, text: str) -> str:
    """The text of the mutant."""
    assert text[site.begin : site.end] == site.old, site
    return text[: site.begin] + site.new + text[site.end :]


def sites(path: str, text: str) -> list[Site]:
    """All places of a file where an operator applies, in order."""
    found = python_sites(text) if path.endswith(".py") else cpp_sites(text)
    return sorted(Site(path, begin, end, name, text[begin:end], new) for begin, end, name, new in found)


Place = tuple[int, int, str, str]
"""Begin, end, operator, new text."""


def larger(number: str) -> str | None:
    """A tolerance times FACTOR; None: an integer, or a number of formulas."""
    if not re.search(r"[.eE]", number) or number.lower().startswith("0x"):
        return None
    value = float(number)
    if value in (0.25, 0.5) or value.is_integer() and value <= FORMULAS:
        return None
    return repr(FACTOR * value)


# --- Python ----------------------------------------------------------------------------------------


class PythonSites(ast.NodeVisitor):
    """Collects places; positions of the tree are lines and bytes, those of the places characters."""

    def __init__(self, text: str) -> None:
        self.text, self.found = text, list[Place]()
        lines = text.splitlines(keepends=True)
        self.starts, self.lines = [0], lines
        for each in lines:
            self.starts.append(self.starts[-1] + len(each))

    def at(self, line: int, column: int) -> int:
        return self.starts[line - 1] + len(self.lines[line - 1].encode()[:column].decode())

    def begin(self, node: ast.expr) -> int:
        return self.at(node.lineno, node.col_offset)

    def end(self, node: ast.expr) -> int:
        assert node.end_lineno is not None and node.end_col_offset is not None
        return self.at(node.end_lineno, node.end_col_offset)

    def between(self, left: ast.expr, right: ast.expr, old: str, name: str, new: str) -> None:
        """An operator that stands between two operands; brackets and comments may stand there, too."""
        low, high = self.end(left), self.begin(right)
        gap = re.sub(r"#[^\n]*", lambda comment: " " * len(comment[0]), self.text[low:high])
        pattern = re.escape(old).replace(r"\ ", r"\s+")
        pattern = rf"\b{pattern}\b" if old[0].isalpha() else pattern
        if (match := re.search(pattern, gap)) is not None:
            self.found.append((low + match.start(), low + match.end(), name, new))

    # what decides nothing
    def visit_Assert(self, node: ast.Assert) -> None:
        pass

    def visit_Raise(self, node: ast.Raise) -> None:
        pass

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        pass

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_arguments(self, node: ast.arguments) -> None:
        for default in (*node.defaults, *node.kw_defaults):
            if default is not None:
                self.visit(default)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.visit(node.args)
        for each in node.body:
            self.visit(each)

    def visit_If(self, node: ast.If) -> None:
        if isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            return
        self.generic_visit(node)

    # what decides
    def visit_Compare(self, node: ast.Compare) -> None:
        words = {"Is": "is", "IsNot": "is not", "In": "in", "NotIn": "not in", "Lt": "<", "Gt": ">"}
        words |= {"LtE": "<=", "GtE": ">=", "Eq": "==", "NotEq": "!="}
        rights = node.comparators
        for left, kind, right in zip([node.left, *rights], node.ops, rights, strict=False):
            old = words[type(kind).__name__]
            self.between(left, right, old, "comparison", TURNED[old])
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        signs = {ast.Add: ("+", "-"), ast.Sub: ("-", "+")}
        operands = (node.left, node.right)
        texts = any(isinstance(each, (ast.JoinedStr, ast.List, ast.Tuple)) for each in operands)
        texts = texts or any(isinstance(e, ast.Constant) and isinstance(e.value, str) for e in operands)
        if type(node.op) in signs and not texts:
            self.between(*operands, signs[type(node.op)][0], "sign", signs[type(node.op)][1])
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        signs = {ast.Add: ("+=", "-="), ast.Sub: ("-=", "+=")}
        texts = (ast.List, ast.Tuple, ast.ListComp, ast.JoinedStr)
        if type(node.op) in signs and not isinstance(node.value, texts):
            self.between(node.target, node.value, signs[type(node.op)][0], "sign", signs[type(node.op)][1])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:], strict=False):
            self.between(left, right, old, "and-or", new)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        begin, operand = self.begin(node), self.begin(node.operand)
        if isinstance(node.op, ast.Not) and self.text[begin:operand].strip() == "not":
            self.found.append((begin, operand, "not", ""))
        number = isinstance(node.operand, ast.Constant)  # -1 is an index or an axis more often than a sign
        if isinstance(node.op, ast.USub) and not number and self.text[begin:operand] == "-":
            self.found.append((begin, operand, "sign", ""))
        self.generic_visit(node)

    def visit_Subscript(self, node: ast.Subscript) -> None:
        inside = node.slice
        indices = inside.elts if isinstance(inside, ast.Tuple) else [inside]
        typed = isinstance(node.value, ast.Name) and node.value.id[0].isupper()
        if isinstance(node.ctx, ast.Load) and not typed:
            for each in indices:
                parts = [each.lower, each.upper] if isinstance(each, ast.Slice) else [each]
                for part in parts:
                    if isinstance(part, ast.Constant) and type(part.value) is int:
                        self.found.append((self.begin(part), self.end(part), "index", str(part.value + 1)))
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        f = node.func
        name = f.id if isinstance(f, ast.Name) else f.attr if isinstance(f, ast.Attribute) else ""
        if name in EXTREMES:
            end = self.end(f)
            self.found.append((end - len(name), end, "extreme", EXTREMES[name]))
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        if isinstance(node.value, float) and (new := larger(self.text[self.begin(node) : self.end(node)])):
            self.found.append((self.begin(node), self.end(node), "tolerance", new))


def python_sites(text: str) -> list[Place]:
    """Places of a module."""
    visitor = PythonSites(text)
    visitor.visit(ast.parse(text))
    return visitor.found


# --- C++ -------------------------------------------------------------------------------------------

TOKEN = re.compile(
    r"""(?P<skip>//[^\n]*|/\*.*?\*/|^[ \t]*\#(?:[^\n\\]|\\.)*)   # comments, preprocessor lines
      | (?P<string>(?:u8|[uUL])?R"(?P<raw>[^(\s]*)\(.*?\)(?P=raw)"|"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)+')
      | (?P<number>(?<![\w.])(?:\d[\d']*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?[fFlLuU]*\b)
      | (?P<word>[A-Za-z_]\w*)
      | (?P<mark><=>|<<=|>>=|->\*?|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||\+=|-=|::|\[\[|\]\]|[^\s\w])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Token:
    """A word, number, mark or string."""

    kind: str
    text: str
    begin: int
    end: int


def tokens(text: str) -> list[Token]:
    """Tokens without comments and preprocessor lines."""
    found = []
    for match in TOKEN.finditer(text):
        kind = next(name for name in ("skip", "string", "number", "word", "mark") if match[name] is not None)
        if kind != "skip":
            found.append(Token(kind, match[0], match.start(), match.end()))
    return found


def statements(all_tokens: Sequence[Token]) -> Iterator[tuple[list[Token], bool]]:
    """Runs of tokens between ``;``, ``{`` and ``}``, and whether they are in the header of a ``for``."""
    run: list[Token] = []
    depth = 0  # of brackets in the header of a loop
    for k, token in enumerate(all_tokens):
        run.append(token)
        if token.text == "for" and k + 1 < len(all_tokens) and all_tokens[k + 1].text == "(":
            yield run, False
            run, depth = [], -1
        elif depth:
            depth = 1 if depth < 0 else depth + (token.text == "(") - (token.text == ")")
            if not depth:
                yield run, True
                run = []
        elif token.text in (";", "{", "}"):
            yield run, False
            run = []
    yield run, False


def cpp_sites(text: str) -> list[Place]:
    """Places of a source file as clang-format leaves it: operators of two operands have blanks on both sides,
    template brackets and those of one operand do not."""
    found: list[Place] = []
    for run, loop in statements(tokens(text)):
        words = {token.text for token in run if token.kind == "word"}
        if loop or words & {"static_assert", "assert", "throw", "template", "using", "operator"}:
            continue
        says = any(token.kind == "string" for token in run)
        for k, token in enumerate(run):
            before, after = (run[k - 1] if k else None), (run[k + 1] if k + 1 < len(run) else None)
            both = text[token.begin - 1].isspace() and text[token.end : token.end + 1].isspace()
            place = (token.begin, token.end)
            if token.kind == "number":
                if token.text[-1] not in "fFlLuU" and (new := larger(token.text.replace("'", ""))):
                    found.append((*place, "tolerance", new))
            elif token.text in EXTREMES and after is not None and after.text in ("(", "<"):
                if before is not None and before.text in ("::", ".", "->"):
                    found.append((*place, "extreme", EXTREMES[token.text]))
            elif token.text in COMPARISONS and both:
                found.append((*place, "comparison", COMPARISONS[token.text]))
            elif token.text in ("&&", "||") and both:
                found.append((*place, "and-or", "||" if token.text == "&&" else "&&"))
            elif token.text in ("+", "-", "+=", "-=") and both and not says:
                found.append((*place, "sign", token.text.translate(str.maketrans("+-", "-+"))))
            elif token.text in ("!", "-") and after is not None and not both and token.end == after.begin:
                operand = before is None or before.kind == "mark" and before.text not in (")", "]")
                operand = operand or before is not None and before.text == "return"
                if operand and after.kind != "number":
                    found.append((*place, "not" if token.text == "!" else "sign", ""))
            elif token.text == "[" and before is not None and after is not None and k + 2 < len(run):
                subscripted = before.kind == "word" and before.text not in ("return", "auto")
                subscripted = subscripted or before.text in (")", "]")
                single = after.kind in ("word", "number") and run[k + 2].text == "]"
                if subscripted and single:
                    found.append((after.begin, after.end, "index", f"{after.text} + 1"))
    return found


# --- drawing ---------------------------------------------------------------------------------------


def line_of(site: Site, text: str) -> str:
    """The line of a text at which a mutant begins."""
    begin = text.rfind("\n", 0, site.begin) + 1
    return text[begin:].split("\n", 1)[0].strip()


Mark = tuple[str, str, str, str, int]
"""Path, operator, the line before and after the fault, and which of the places that are equal in these."""


def marks(path: str, text: str) -> dict[Mark, Site]:
    """All sites of a file by their marks."""
    found: dict[Mark, Site] = {}
    for site in sites(path, text):
        lines = (line_of(site, text), line_of(site, applied(site, text)))
        which = 0
        while (path, site.operator, *lines, which) in found:
            which += 1
        found[(path, site.operator, *lines, which)] = site
    return found


def drawn(
    texts: Mapping[str, str], folders: Sequence[str], count: int, seed: int, kept: Sequence[Mark] = ()
) -> dict[Mark, Site]:
    """Sites without repetition: folders take turns, each draws an operator that applies in it, then a place.

    Marks that are `kept` and still stand in the source take the turns of their folders first. An operator is
    drawn before a place, for there are ten times more signs than tolerances. Fewer than `count` come only
    where there are no more sites.
    """
    rng = random.Random(seed)
    everything = {mark: site for path in sorted(texts) for mark, site in marks(path, texts[path]).items()}
    again: dict[str, list[Mark]] = {folder: [] for folder in folders}
    left: dict[str, dict[str, list[Mark]]] = {folder: {} for folder in folders}
    for mark in kept:
        if mark in everything:
            again[str(Path(mark[0]).parent)].append(mark)
    for mark in everything:
        if mark not in kept:
            left[str(Path(mark[0]).parent)].setdefault(mark[1], []).append(mark)
    found: dict[Mark, Site] = {}
    while len(found) < count and (any(again.values()) or any(left.values())):
        for folder in folders:
            if len(found) == count or not again[folder] and not left[folder]:
                continue
            if again[folder]:
                mark = again[folder].pop(0)
            else:
                operator = rng.choice(sorted(left[folder]))
                places = left[folder][operator]
                mark = places.pop(rng.randrange(len(places)))
                if not places:
                    del left[folder][operator]
            found[mark] = everything[mark]
    return found
