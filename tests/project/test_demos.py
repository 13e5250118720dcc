"""Every demo runs alone, ends with its own check, and writes what it promises."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers import printed_as_shown, shown_blocks

ROOT = Path(__file__).resolve().parents[2]
DEMOS = sorted(path.name for path in (ROOT / "demos").glob("*.py"))

# demo -> arguments that make it short; "{}" is a folder to write to
SHORT = {
    "bolted_vessel.py": ["--size", "coarse", "--quick", "--output", "{}"],
    "bolted_lap_joint.py": ["--quick", "--output", "{}"],
    "bracket_from_step.py": ["--quick", "--no-figures", "--output", "{}"],
    "bonded_lap_joint.py": ["--output", "{}"],
    "own_law.py": ["--output", "{}"],
    "first_bolt.py": ["--no-figures", "--output", "{}"],
    "hinge.py": ["--samples", "4", "--output", "{}"],
    "press_fit.py": ["--samples", "16", "--output", "{}"],
    "frame_as_matrix.py": ["--no-figures", "--samples", "8", "--output", "{}"],
    "hertz.py": ["--quick", "--output", "{}"],
    "flange_from_step.py": ["--quick", "--output", "{}"],
    "make_bracket_step.py": ["{}/bracket.step"],
    "make_flange_step.py": ["{}/flange.step"],
    "make_mount_step.py": ["{}/mount.step"],
    "proposed_from_step.py": ["--output", "{}"],
    "loads_and_scatter.py": ["--output", "{}"],
    "tradeoff.py": ["--scenes", "vessel", "--output", "{}"],
}
WRITTEN = {
    "bolted_vessel.py": [
        "vessel.vtm",
        "figure_3_4_assembly.png",
        "figure_5_convergence_1.png",
        "figure_5_convergence_2.png",
        "figure_6_joint_stress.png",
        "figure_7_response_surface.png",
        "figure_8_u0.png",
        "figure_8_u1.png",
        "figure_8_u2.png",
        "figure_9_density.png",
    ],
    "bolted_lap_joint.py": [
        "tightened.vtm",
        "pulled.vtm",
        "pushed.vtm",
        "interfaces.pvd",
        "joint.png",
        "pressure.png",
        "loop.png",
        "contact.png",
        "load_friction_preload.png",
        "load_friction_stiffness.png",
        "slip_friction_preload.png",
        "slip_friction_stiffness.png",
    ],
    "bracket_from_step.py": ["bracket.step", "parts.pvd", "interfaces.pvd", "bracket.html", "bracket.csv"],
    "bonded_lap_joint.py": ["bonded.png"],
    "own_law.py": ["own_law.png"],
    "first_bolt.py": ["joint_diagram.png"],
    "hinge.py": ["hinge.step", "hinge.png", "sheet.html", "sheet.csv"],
    "press_fit.py": ["fit.step", "press_fit.png", "sheet.html", "sheet.csv"],
    "flange_from_step.py": [
        "flange.step",
        "flange.vtm",
        "flange.png",
        "gasket.png",
        "deformed.png",
        "tightening.png",
        "leak.png",
    ],
    "loads_and_scatter.py": [
        "temperature.png",
        "remote_force.png",
        "tightening.png",
        "random_field_rod.png",
        "sphere.png",
    ],
    "frame_as_matrix.py": ["frame.vtm"],
    "make_bracket_step.py": ["bracket.step"],
    "make_flange_step.py": ["flange.step"],
    "make_mount_step.py": ["mount.step"],
    "proposed_from_step.py": ["bracket.step"],
    "tradeoff.py": ["tradeoff_vessel.png"],
    "hertz.py": [
        "hertz.vtm",
        "friction_loaded.vtm",
        "friction_unloaded.vtm",
        "hertz_pressure.png",
        "hertz_convergence.png",
        "cattaneo_mindlin.png",
    ],
}
SHOWN = {"bonded_lap_joint.py": "bonded_lap_joint.md", "own_law.py": "own_law.md"}
VESSEL_PARTS = ("cylinder", "flange", "ring", "cover", "shank", "head")


def run(script: str, *arguments: str) -> str:
    """What a script printed; it must end well and warn of nothing."""
    # in a process of its own: what a user types, and nothing of the tests is loaded
    done = subprocess.run(
        [sys.executable, str(ROOT / script), *arguments],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
    )
    assert done.returncode == 0, f"{done.stdout[-2000:]}\n{done.stderr[-4000:]}"
    assert "Warning" not in done.stderr, done.stderr
    return done.stdout


DAILY = ("first_bolt.py", "own_law.py", "two_blocks.py")
NIGHTLY = pytest.mark.night(guard="the tutorials in test_docs.py, test_vessel_by_the_method_of_2004_only")


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=() if name in DAILY else NIGHTLY) for name in DEMOS]
)
def test_demo(name: str, tmp_path: Path) -> None:
    printed = run(f"demos/{name}", *(a.format(tmp_path) for a in SHORT.get(name, [])))
    for file in WRITTEN.get(name, []):
        assert (tmp_path / file).stat().st_size > 200, file
    if name in SHOWN:  # the tutorial shows what was printed
        page = (ROOT / "docs" / "tutorials" / SHOWN[name]).read_text()
        for shown in shown_blocks(page):
            printed_as_shown(printed, shown)
    if name == "bolted_lap_joint.py":
        assert printed.rstrip().endswith("all checks passed")
        assert max(len(line) for line in printed.splitlines()) <= 100
    if name == "flange_from_step.py":
        assert printed.rstrip().endswith("all checks passed")
        assert "35 parts" in printed and "P(leak)" in printed
    if name == "bolted_vessel.py":
        assert printed.rstrip().endswith("all checks passed")
        assert max(len(line) for line in printed.splitlines()) <= 100
        assert printed.count("P(traction)") == 2 and "Sobol" in printed
        grids = sorted((tmp_path / "vessel").iterdir())
        assert [grid.name for grid in grids] == [
            f"{i}_{part}.vtu" for i, part in enumerate(VESSEL_PARTS)
        ]
        assert min(grid.stat().st_size for grid in grids) > 10_000


def test_vessel_by_the_method_of_2004_only(tmp_path: Path) -> None:
    arguments = ["--size", "coarse", "--quick", "--no-figures", "--method", "latin"]
    printed = run("demos/bolted_vessel.py", *arguments, "--output", str(tmp_path))
    assert printed.rstrip().endswith("all checks passed")
    assert "accelerated" not in printed and "PCE" not in printed
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["vessel", "vessel.vtm"]


GASKET = pytest.param(["--gasket", "100"], marks=pytest.mark.night(guard="that with friction"))


@pytest.mark.parametrize("options", [["--friction", "0.3"], GASKET])
def test_vessel_with_true_contact(options: list[str], tmp_path: Path) -> None:
    arguments = ["--contact", "--size", "coarse", "--quick", *options, "--output", str(tmp_path)]
    printed = run("demos/bolted_vessel.py", *arguments)
    assert printed.rstrip().endswith("all checks passed")
    assert "The joint is open everywhere at 3.2 MPa and above." in printed
    assert max(len(line) for line in printed.splitlines()) <= 100
    for name in ("pressure", "opening", "forces"):
        assert (tmp_path / f"figure_contact_{name}.png").stat().st_size > 200
    assert (tmp_path / "contact.vtm").exists()


def test_friction_needs_contact(tmp_path: Path) -> None:
    with pytest.raises(AssertionError, match="--friction and --gasket need --contact"):
        run("demos/bolted_vessel.py", "--friction", "0.3", "--output", str(tmp_path))


@pytest.mark.night(guard="tests/verification/test_chaos.py")
def test_benchmark_of_the_vessel(tmp_path: Path) -> None:
    """Its record is complete, its answers are right; its times are nobody's business here."""
    file = tmp_path / "record.json"
    run("benchmarks/vessel.py", "--size", "coarse", "--repeats", "1", "--json", str(file))
    record = json.loads(file.read_text())
    assert record["dof"] > 5000 and record["unit_s"] > 0.0
    assert record["unit_solver"] in ("cholmod", "mumps")
    for name in ("latin_plain", "latin_all", "latin", "direct"):
        run_record = record[name]
        assert run_record["status"] == "converged"
        assert run_record["seconds"] > 0.0 and run_record["units"] > 0.0
        # the estimate may be off by a factor of 3
        assert run_record["energy_error"] <= max(3.0 * run_record["rtol"], 1e-10)
    assert record["direct"]["iterations"] == 0
    assert record["latin"]["iterations"] <= 60
    assert 100 <= record["latin_plain"]["indicator_1e-5"]["iterations"] <= 1000
    for name in ("sweep", "sweep_plain"):
        assert record[name]["points"] == record[name]["converged"] == 91
    assert record["sweep"]["max_energy_error"] <= 10.0 * record["sweep"]["rtol"]
    assert record["sweep"]["iterations_rest"] <= 10 * 90
    # the paper's regime: hundreds, then single digits for most of the points
    assert record["sweep_plain"]["iterations_first"] >= 100
    assert record["sweep_plain"]["iterations_median"] <= 9
    pce, plain, galerkin = (record[name] for name in ("latin_pce", "latin_pce_plain", "ssfem_cg"))
    assert pce["status"] == plain["status"] == "converged"
    assert pce["modes"] == plain["modes"] == galerkin["modes"] == 10
    assert pce["error_vs_ssfem"] <= 1e-8 and galerkin["error"] <= 1e-8
    assert plain["error_vs_ssfem"] <= 1e-2
    assert pce["iterations"] <= 40 and galerkin["iterations"] <= 20
    assert 100 <= plain["iterations"] <= 1000
    assert pce["truncation"] <= 0.01
    assert record["quadrature"]["points"] == 16
    assert max(record["quadrature"][f"error_{what}"] for what in ("mean", "std")) <= 1e-4
    drawn = record["p_traction"]["monte_carlo"]
    assert 0.0 < record["monte_carlo"]["half_width"] <= 0.02
    for name in ("multiresolution", "latin_pce", "ssfem_cg"):
        each = record["p_traction"][name]
        assert each["low"] <= each["value"] <= each["high"]
        assert drawn["low"] <= each["value"] <= drawn["high"]
    runs = (pce, plain, galerkin, record["quadrature"], record["monte_carlo"])
    assert all(each["units"] > 0.0 for each in runs)


@pytest.mark.night(guard="tests/verification/test_contact.py")
def test_benchmark_of_contact(tmp_path: Path) -> None:
    """Units of the sweep are there, and the peers agree where they are installed."""
    file = tmp_path / "record.json"
    small = ["--size", "coarse", "--sets", "2", "--cells", "2", "--checked", "2", "--repeats", "1"]
    run("benchmarks/contact.py", *small, "--sector", "16", "--json", str(file))
    record = json.loads(file.read_text())
    for key in ("unit_s", "first_solve_units", "per_set_units"):
        assert record[key] > 0.0
    assert record["iterations_first"] > 0 and record["iterations_per_set"] > 0
    assert record["lap"]["sets"] == record["lap"]["converged"] == 8
    assert record["lap"]["error"] <= 1e-3
    for each in record["lap"]["k"].values():
        assert each["status"] != "converged" or each["error"] <= 10.0 * 1e-5
    assert len(record["blocks"]) == 4
    for each in record["blocks"].values():
        assert each["ours"]["status"] == "converged"
        # the estimate may be off by a factor of 3
        assert max(each["ours"]["error_displacement"], each["ours"]["error_force"]) <= 3e-5
        for peer in each["peers"].values():
            if peer["seconds"] is None:
                assert "ccx" in peer["reason"] or "getfem" in peer["reason"]
                continue
            # their contact has another discretisation: O(h) at the rim, where the stress is singular
            assert peer["max_difference"] <= 0.0225
            assert peer["force_difference"] <= 0.005
