"""Geometry refuses what is no length, count, mesh or file with its name and value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import dolfinx_frontend as lf
from dolfinx_frontend import geometry
from tests.helpers import NO_NUMBERS, NOT_FINITE, refused

JUNK = ("a", None, 3, 1.5, True, 1j, np.nan, ["a"], {}, b"x")
UNIT = geometry.box((1.0, 1.0), (1, 1))


@pytest.mark.parametrize("shown, wrong", {**NO_NUMBERS, **NOT_FINITE, "0": 0, "-1": -1.0}.items())
def test_boxes(shown: str, wrong: Any) -> None:
    refused(lambda: geometry.box(wrong, (1, 1)), "lengths")
    refused(lambda: geometry.box((1.0, wrong), (1, 1)), "lengths")
    refused(lambda: geometry.box((1.0, 1.0), wrong), "divisions = ")
    refused(lambda: geometry.box((1.0, 1.0), (1, wrong)), "divisions = ")
    if shown not in ("0", "-1"):
        refused(lambda: geometry.box((1.0, 1.0), (1, 1), (0.0, wrong)), "origin = ")
    if wrong is not None:
        refused(lambda: geometry.box((1.0, 1.0), (1, 1), wrong), "origin = ")
        if wrong != 0:
            refused(lambda: geometry.box((1.0, 1.0), (1, 1), cell=wrong), "cell = ")


def test_cells() -> None:
    for wrong in ("", np.array("triangle"), np.array(["triangle", "quadrilateral"]), ["triangle"], False):
        refused(lambda wrong=wrong: geometry.box((1.0, 1.0), (1, 1), cell=wrong), "cell = ")


def test_records() -> None:
    for wrong in JUNK:
        refused(lambda wrong=wrong: geometry.Part(wrong, UNIT.facet_tags, UNIT.names), "mesh = ")
        refused(lambda wrong=wrong: geometry.Part(UNIT.mesh, wrong, UNIT.names), "facet_tags = ")
        if wrong != {}:
            refused(lambda wrong=wrong: geometry.Part(UNIT.mesh, UNIT.facet_tags, wrong), "names = ")
            refused(lambda wrong=wrong: geometry.Assembly(wrong), "parts = ")
        refused(lambda wrong=wrong: geometry.Assembly({"p": wrong}), "parts['p'] = ")
        refused(lambda wrong=wrong: geometry.Assembly({"p": UNIT}).face(wrong), repr(wrong))
        refused(lambda wrong=wrong: UNIT.facets(wrong), repr(wrong), "'x0'")
        refused(lambda wrong=wrong: UNIT.face_area(wrong), repr(wrong), "'x0'")


def test_cuts() -> None:
    for wrong in JUNK:
        if wrong != "a":
            refused(lambda wrong=wrong: geometry.Cut(wrong, (0.0, 0.0, 1.0)), "parts = ")
        refused(lambda wrong=wrong: geometry.Cut("stud", wrong), "normal = ")
        if wrong is not None:
            refused(lambda wrong=wrong: geometry.Cut("stud", (0.0, 0.0, 1.0), wrong), "through = ")
        if wrong not in (3, 1.5):
            refused(lambda wrong=wrong: geometry.Cut("stud", (0.0, 0.0, wrong)), "normal = ")
    refused(lambda: geometry.Cut("stud", (0.0, 0.0, 0.0)), "normal = ")


def test_files(tmp_path: Path) -> None:
    for wrong in (3, None, True, 1.5, "", ["a"], b"a.msh"):
        refused(lambda wrong=wrong: geometry.read_msh(wrong), f"path = {wrong!r}")
        refused(lambda wrong=wrong: geometry.read_step(wrong), f"path = {wrong!r}")
        refused(lambda wrong=wrong: geometry.from_gmsh(wrong), f"model = {wrong!r}")
    refused(lambda: geometry.read_msh(tmp_path / "none.msh"), "none.msh")
    for wrong in ("a", np.nan, -1.0, True, 1j, [1.0]):
        refused(lambda wrong=wrong: geometry.read_step("a.step", gap=wrong), "gap = ")
        refused(lambda wrong=wrong: geometry.read_step("a.step", tolerance=wrong), "tolerance = ")
    for wrong in ("stud", 3, ["stud"], None):
        refused(lambda wrong=wrong: geometry.read_step("a.step", cuts=wrong), "cuts = ")
    refused(lambda: geometry.read_step("a.step", imprint="no"), "imprint = 'no'")  # type: ignore[arg-type]


def test_a_damaged_mesh_file_is_named(tmp_path: Path) -> None:
    pytest.importorskip("gmsh")
    path = tmp_path / "damaged.msh"
    path.write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 x\n")
    refused(lambda: geometry.read_msh(path), "damaged.msh")


def test_progress() -> None:
    for wrong in ("no", 1, 0.5, []):
        refused(lambda wrong=wrong: lf.progress(wrong), f"on = {wrong!r}")
