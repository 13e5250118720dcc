"""A deck for a STEP file: what was recognised, with proposals that a user edits."""

from __future__ import annotations

from dolfinx_frontend.decks.writing import quoted
from dolfinx_frontend.geometry.step import StepAssembly

__all__ = ["proposed"]

_HEAD = """\
# A deck of latin: every table is a call of the scene, every key an argument (latin schema; docs/command.md).
# Edit materials, laws of interfaces, supports and loads; then: latin check {deck}, latin run {deck}

units = ["mm", "N"]    # OpenCASCADE converts to millimetres: stresses are MPa

[run]
# accuracy = 0.01      # of the answer, with its meshes; or
# samples = 128        # Sobol points, a power of two, where something is random
# times = [1.0, 2.0]   # of a load history
# max_seconds = 600

# [[quantity]]         # a number of the tables that the report has, with its probability
# of = "{interface}.pressure_max"
# unit = "MPa"
# above = 100.0

# [random]
# mu = {{ lognormal = {{ mean = 0.15, cov = 0.1 }} }}    # then: friction = "mu"

# [amplitude.load]
# times = [1, 2]
# values = [0, 1]      # then: force = {{ amplitude = "load", value = [0, 0, 1000] }}
"""


def proposed(step: StepAssembly, file: str, deck: str) -> str:
    """The text of a deck, in whose folder the file has this name."""
    names = list(step.interfaces)
    head = _HEAD.format(deck=deck, interface=names[0] if names else "joint")
    lines = [head, "[step]", f"path = {quoted(file)}"]
    lines += ["# cuts = [{ parts = \"bolt *\", normal = [0, 0, 1] }]    # pretension sections of bolts", ""]
    lines += [f"# {row}".rstrip() for row in str(step).splitlines()]
    lines += ["", "[[step.material]]", 'pattern = "*"', 'material = "LinearElastic"',
              "E = 210e3    # steel; N/mm^2", "nu = 0.3"]
    for name, solid in step.solids.items():
        size = f"size = {solid.thickness:.3g}    # of cells, mm"
        lines += ["", "[[step.size]]", f"pattern = {quoted(name)}", size]
    for name in names:
        touch = step.touches[name]
        lines += ["", "[[step.join]]", f"pattern = {quoted(name)}",
                  f"# {touch.kind}, {touch.area:.4g} mm^2, gap {touch.gap:.3g} mm",
                  'law = "Perfect"    # or: law = "Contact", friction = 0.15; law = "Preload", force = 10e3']
    free = [(s, part) for part, solid in step.solids.items() for s in solid.surfaces]
    low = min(free, key=lambda each: each[0].centre[2])[0]
    lines += ["", "# Free faces, by their numbers:",
              *(f"# {row}".rstrip() for row in step.faces().splitlines()),
              "", "# [[step.face]]      # a name for faces that are held or loaded",
              f"# name = {quoted(f'{low.part}:support')}", f"# tags = [{low.tag}]",
              "", "# [[fix]]", f"# faces = {quoted(f'{low.part}:support')}",
              "", "# [[force]]", '# face = "PART:FACE"', "# force = [0.0, 0.0, 1000.0]    # N"]
    return "\n".join(lines) + "\n"
