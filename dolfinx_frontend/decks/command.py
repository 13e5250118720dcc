"""The command ``latin``: from a file to an answer."""

from __future__ import annotations

import argparse
import json
import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from latin_core import __version__

from dolfinx_frontend.assembly.assemble import assemble
from dolfinx_frontend.common.files import Files, write_text
from dolfinx_frontend.common.interrupts import as_interrupt
from dolfinx_frontend.decks.abaqus.writing import write_inp
from dolfinx_frontend.decks.lines import DeckError
from dolfinx_frontend.decks.proposing import proposed
from dolfinx_frontend.decks.reading import READERS, read_deck
from dolfinx_frontend.decks.running import (
    BALANCE,
    DONE,
    INPUT,
    INTERRUPTED,
    LIMIT,
    NUMBERS,
    RESULT,
    code_of_error,
    run_deck,
    sentence,
)
from dolfinx_frontend.decks.schema import json_schema
from dolfinx_frontend.decks.settings import Deck
from dolfinx_frontend.decks.showing import Life, outlook, shown
from dolfinx_frontend.decks.writing import write_deck
from dolfinx_frontend.geometry.step import read_step
from dolfinx_frontend.solving import export

__all__ = ["main"]

EVERY = 5.0
"""Seconds between two lines of progress."""

_CODES = f"""\
exit codes: {DONE} converged and as accurate as asked; {INPUT} wrong input; {BALANCE} no equilibrium;
{NUMBERS} not converged, or not as accurate; {LIMIT} out of time or memory; {INTERRUPTED} interrupted"""


class _Parser(argparse.ArgumentParser):
    """Errors in one sentence."""

    def error(self, message: str) -> NoReturn:
        self.exit(INPUT, f"latin: {message} ({self.prog} --help)\n")


def _percent(text: str) -> float:
    """``1%`` or ``0.01``."""
    try:
        return float(text[:-1]) / 100.0 if text.endswith("%") else float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no accuracy: write 1% or 0.01") from None


def _parser() -> argparse.ArgumentParser:
    parser = _Parser("latin", description="Assemblies of parts with uncertain interfaces: from a file "
                     "to an answer.", epilog=_CODES, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--version", action="version", version=f"latin {__version__}")
    common = _Parser(add_help=False)
    common.add_argument("--debug", action="store_true", help="tracebacks of errors")
    common.add_argument("--allow-code", action="store_true", help="import 'module:function' of the deck")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="verb")

    def verb(name: str, text: str) -> argparse.ArgumentParser:
        return verbs.add_parser(name, help=text, description=text, parents=[common], epilog=_CODES,
                                formatter_class=argparse.RawDescriptionHelpFormatter)

    new = verb("new", "write a deck for a STEP file, with what is recognised in it")
    new.add_argument("step", type=Path)
    new.add_argument("-o", "--output", type=Path, help="the deck; default: the name of the file with .toml")
    new.add_argument("--force", action="store_true", help="replace an existing deck")
    check = verb("check", "read a deck and say what it will do; nothing is solved")
    check.add_argument("deck", type=Path)
    run = verb("run", "solve a deck")
    run.add_argument("deck", type=Path)
    run.add_argument("--accuracy", type=_percent, help="of the answer, as 1%% or 0.01")
    run.add_argument("--samples", type=int, help="Sobol points, a power of two")
    run.add_argument("-o", "--output", type=Path, help="folder of the results; default: the name of the deck")
    run.add_argument("--json", action="store_true", help="the record on the standard output, not tables")
    convert = verb("convert", "write a deck in another form: .toml, .inp, or a folder for latin_run")
    convert.add_argument("source", type=Path)
    convert.add_argument("target", type=Path)
    show = verb("show", "print the tables of a folder of results")
    show.add_argument("folder", type=Path)
    show.add_argument("--json", action="store_true", help="the record")
    verb("schema", "print the JSON Schema of decks, for editors")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Carry out a command; the exit code."""
    given = _parser().parse_args(arguments)
    do = {"new": _new, "check": _check, "run": _run, "convert": _convert, "show": _show, "schema": _schema}
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _warned
            with as_interrupt(signal.SIGTERM):
                return do[given.verb](given)
    except BrokenPipeError:
        return DONE
    except (KeyboardInterrupt, Exception) as error:
        return _failed(given, sentence(error), code_of_error(error))


def _warned(message: Warning | str, *others: Any, **named: Any) -> None:
    print(f"latin: warning: {_line(str(message))}", file=sys.stderr)


def _line(text: str) -> str:
    """In one line."""
    return " ".join(text.split())


def _failed(given: argparse.Namespace, message: str, code: int) -> int:
    if given.debug and sys.exception() is not None:
        traceback.print_exc()
    print(f"latin: {_line(message)}", file=sys.stderr)
    return code


def _new(given: argparse.Namespace) -> int:
    deck: Path = given.output or given.step.with_suffix(".toml")
    if deck.suffix.lower() not in READERS:
        raise DeckError(f"{deck.name}: a deck ends with .toml")
    if deck.exists() and not given.force:
        raise DeckError(f"{deck} is there already: choose another name, or replace it with --force")
    step = read_step(given.step)
    write_text(deck, proposed(step, deck.parent, deck.name))
    print(f"wrote {deck}: {len(step.solids)} parts, {len(step.interfaces)} interfaces; edit it, then: "
          f"latin check {deck}")
    return DONE


def _read(given: argparse.Namespace, path: Path) -> Deck:
    return read_deck(path, allow_code=given.allow_code)


def _check(given: argparse.Namespace) -> int:
    deck = _read(given, given.deck)
    print(outlook(deck, assemble(deck.scene)))
    for note in deck.notes:
        print(f"note: {note}")
    return DONE


def _run(given: argparse.Namespace) -> int:
    folder: Path = given.output or given.deck.with_suffix("")
    if folder.exists() and not folder.is_dir():
        raise DeckError(f"{folder} is no folder: choose another one with -o")
    record: dict[str, Any] = {"exit_code": None, "status": "running", "message": "", "deck": given.deck.name}
    with Files() as files:
        files.folder(folder)
    write_text(folder / RESULT, json.dumps(record) + "\n")
    try:
        with Life(EVERY) as life:
            life("deck and meshes")
            deck = _read(given, given.deck)
            ways = {"accuracy": given.accuracy, "samples": given.samples}
            if any(value is not None for value in ways.values()):
                deck.run = {k: v for k, v in deck.run.items() if k not in ("accuracy", "samples", "chaos")}
                deck.run |= {name: value for name, value in ways.items() if value is not None}
            deck.way, deck.options  # noqa: B018
            run = run_deck(deck, folder, life)
    except BaseException as error:
        record |= {"exit_code": code_of_error(error), "status": None, "message": _line(sentence(error))}
        write_text(folder / RESULT, json.dumps(record) + "\n")
        raise
    print(json.dumps(run.record, indent=1) if given.json else shown(run.record))
    if run.message:
        _failed(given, run.message, run.code)
    return run.code


def _convert(given: argparse.Namespace) -> int:
    target: Path = given.target
    if target.resolve() == given.source.resolve():
        raise DeckError(f"{target} is the deck itself: give the other one another name")
    deck = _read(given, given.source)
    if target.suffix.lower() == ".toml":
        beside = {"run": deck.run, "asked": deck.asked, "units": deck.units, "title": deck.title}
        write_deck(deck.scene, target, **beside)
    elif target.suffix.lower() == ".inp":
        write_inp(assemble(deck.scene), target, deck.run.get("times"))
    elif not target.suffix:
        times = deck.run.get("times")
        given_times = {} if times is None else {"times": times}
        export(assemble(deck.scene), target, options=deck.options, **given_times)
    else:
        raise DeckError(f"{target.name}: write a deck as .toml, as .inp, or a folder for latin_run")
    print(f"wrote {target}")
    return DONE


def _show(given: argparse.Namespace) -> int:
    file: Path = given.folder / RESULT
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        text = json.dumps(record, indent=1) if given.json else shown(record)
    except (OSError, ValueError, AttributeError, TypeError, KeyError) as error:
        raise DeckError(f"{file} cannot be read: {_line(str(error))}: give the folder of a run") from None
    print(text)
    return DONE


def _schema(given: argparse.Namespace) -> int:
    print(json.dumps(json_schema(), indent=1))
    return DONE


if __name__ == "__main__":
    sys.exit(main())
