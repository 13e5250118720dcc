"""A deck for a STEP file: what was recognised, with proposals that a user edits."""

from __future__ import annotations

from pathlib import Path

from dolfinx_frontend.common.recorded import Call, made_by
from dolfinx_frontend.decks.words import OF_STEP
from dolfinx_frontend.decks.writing import Writer, quoted
from dolfinx_frontend.geometry.step import StepAssembly

__all__ = ["proposed"]

_HEAD = """\
# A deck of latin: every table is a call of the scene, every key an argument (latin schema; docs/command.md).
# Edit materials, laws of interfaces, supports and loads; then: latin check {deck}, latin run {deck}

units = ["mm", "N"]    # OpenCASCADE converts to millimetres: stresses are MPa

[run]
{times}
# accuracy = 0.01      # of the answer, with its meshes; or
# samples = 128        # Sobol points, a power of two, where something is random
# max_seconds = 600

# [[quantity]]         # a number of the tables that the report has, with its probability
# of = "{interface}.pressure_max"
# unit = "MPa"
# above = 100.0

# [amplitude.load]
# times = [1, 2]
# values = [0, 1]      # then: force = {{ amplitude = "load", value = [0, 0, 1000] }}
"""
_PROPOSED = ("rename", "material", "size", "sizes", "join", "leave")


def proposed(step: StepAssembly, folder: Path, deck: str) -> str:
    """The text of a deck in a folder: what parts are taken for, and a scene without supports and loads."""
    made = step.proposal()
    names = list(made.interfaces)
    bolted = any(touch.kind == "cut" for touch in made.touches.values())
    times = "times = [1.0, 2.0]    # bolts are tightened until 1"
    if not bolted:
        times = "# times = [1.0, 2.0]  # of a load history"
    head = _HEAD.format(deck=deck, interface=names[0] if names else "joint", times=times)
    writer = Writer(folder)
    body: list[str] = []
    call = made_by(made)
    assert call is not None
    lines = writer.call(Call("step", {**call.arguments, "calls": (), "mesh": {}}))
    for each in made.journal:
        if each.name in _PROPOSED:
            pattern = str(each.arguments.get("pattern", ""))
            kind = "join" if each.name == "leave" else each.name
            body += ["", f"[[step.{each.name}]]", *_reason(made, kind, pattern),
                     *writer.keys(writer.arguments(each, OF_STEP[each.name]))]
    comments = ["", *(f"# {row}".rstrip() for row in str(step).splitlines())]
    text = "\n".join([head, *writer.named(), *lines, *comments, *body, *_beside(made)])
    return text.replace("\n\n\n", "\n\n") + "\n"


def _reason(step: StepAssembly, kind: str, pattern: str) -> list[str]:
    """Why this is proposed, as a comment."""
    why = step.why.get((kind, pattern), "")
    touch = step.touches.get(pattern) if kind == "join" else None
    if touch is not None:
        why = f"{touch.kind}, {touch.area:.4g} mm^2, gap {touch.gap:.3g} mm: {why}"
    return [f"# {why}"] if why else []


def _beside(step: StepAssembly) -> list[str]:
    """What is left to the user."""
    free = [(s, part) for part, solid in step.solids.items() for s in solid.surfaces]
    low = min(free, key=lambda each: each[0].centre[2])[0]
    return ["", "# Free faces, by their numbers:",
            *(f"# {row}".rstrip() for row in step.faces().splitlines()),
            "", "# [[step.face]]      # a name for faces that are held or loaded",
            f"# name = {quoted(f'{low.part}:support')}", f"# tags = [{low.tag}]",
            "", "# [[fix]]", f"# faces = {quoted(f'{low.part}:support')}",
            "", "# [[force]]", '# face = "PART:FACE"', "# force = [0.0, 0.0, 1000.0]    # N"]
