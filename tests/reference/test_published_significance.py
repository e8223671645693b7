"""Which distortion parameters are significant: orip's tests against the published program's.

Proves that the same parameters are called insignificant, and that pruning keeps what is needed. The published
probability of a parameter is that of its own test; A3, A5, A7 of orip are -K1, -K2, -K3 there.
"""

from __future__ import annotations

from pathlib import Path

from reference.olympus_camera import camera_text
from reference.olympus_projects import calibration_project, defective_project, defects
from reference.published_data import read_export
from workflow.quiet import run_quietly, solve_quietly

from orip.bundle.methods import Method
from orip.records.camera import CAMERA_PARAMETERS

PRUNING = Method(prune=True)
UNKNOWN = {"C", "DX", "DY", "A3", "A5", "A7", "P1", "P2", "B1"}


def kept_by_pruning(folder: Path) -> set[str]:
    cameras = solve_quietly(folder, method=PRUNING).solution.cameras
    return {kind for kind, sd in zip(CAMERA_PARAMETERS, cameras.sd[0], strict=True) if sd == sd}


def test_pruning_keeps_two_parameters_that_correlate_by_98_percent(tmp_path: Path) -> None:
    folder = calibration_project(camera_text(7.5)).write(tmp_path / "block")
    run_quietly(folder)
    assert kept_by_pruning(folder) == UNKNOWN


def test_few_points_leave_a5_a7_and_b1_insignificant(tmp_path: Path) -> None:
    folder = defective_project(read_export(defects() / "camcal-pmexport5.txt"), enp_stop=7.0).write(tmp_path / "block")
    (outcome,) = run_quietly(folder)
    named = [diagnosis.text for diagnosis in outcome.solution.diagnosis if diagnosis.code == "not-significant"]
    assert sorted(text.split(" of camera ")[0] for text in named) == ["A5", "A7", "B1"]
    # A5 and A7 stand for each other: without A7, A5 is needed
    assert kept_by_pruning(folder) == UNKNOWN - {"A7", "B1"}
