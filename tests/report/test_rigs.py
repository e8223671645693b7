"""Cameras that move together: their relative orientation is found from the oriented photos, and no other cameras'."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from report.sample_pages import sample
from scipy.spatial.transform import Rotation

from orip.records.project.camera import Camera
from orip.records.project.definition import BundleDefinition
from orip.records.project.photo import Photo
from orip.records.results.solution import Estimates
from orip.report.photos.rigs import rig_table, rigs
from orip.report.report_input import ReportInput

BASE, TURN = np.array([0.6, 0.02, -0.05]), Rotation.from_euler("XYZ", [1.5, -8.0, 0.4], degrees=True)
INSTANTS = 40
NOISE, NOISE_ANGLE = 0.002, 0.01


def given(*, fixed: bool = True) -> ReportInput:
    """Return photos of two cameras that were carried along a street, in a frame or each by itself."""
    random = np.random.default_rng(7)
    values, names = [], []
    for number in range(INSTANTS):
        centre = np.array([1.5 * number, 0.3 * np.sin(number), 1.7])
        pose = Rotation.from_euler("XYZ", [88.0, 3.0 * np.sin(number), 2.0], degrees=True)
        base = BASE if fixed else random.normal(size=3)
        second = pose * TURN * Rotation.from_rotvec(np.radians(NOISE_ANGLE) * random.normal(size=3))
        at = centre + pose.apply(base + NOISE * random.normal(size=3))
        for side, position, rotation in (("L", centre, pose), ("R", at, second)):
            # R = Rx Ry Rz: intrinsic turns about x, y, z
            values.append([*position, *rotation.as_euler("XYZ", degrees=True)])
            names.append(f"{side}_{number:04d}.jpg")
    made = sample("dcs260_calibration").solution
    photos = Estimates(tuple(names), np.array(values), np.full((len(names), 6), 0.01))
    parameters = tuple(made.cameras.values[0])
    cameras = {f"{side}": Camera(side, parameters) for side in "LR"}
    records = {name.upper(): Photo(name, name[0]) for name in names}
    solution = replace(made, photos=photos, photo_rotation_sd_about_axes=((0.01,) * 3,) * len(names))
    return ReportInput(solution, (), BundleDefinition("MAIN"), cameras, records)


def test_base_and_rotation_are_those_of_the_frame() -> None:
    (rig,) = rigs(given())
    assert (rig.first, rig.second, len(rig.base)) == ("L", "R", INSTANTS)
    # four standard deviations of the mean
    assert rig.base.mean(axis=0) == pytest.approx(BASE, abs=4.0 * NOISE / np.sqrt(INSTANTS))
    angle = (Rotation.from_matrix(rig.mean_rotation) * TURN.inv()).magnitude()
    assert np.degrees(angle) < 4.0 * np.sqrt(3.0) * NOISE_ANGLE / np.sqrt(INSTANTS)
    # the scatter of 40 instants is within a third of its expectation in all but one of ten thousand samples
    assert np.std(rig.base, axis=0, ddof=1) == pytest.approx(np.full(3, NOISE), rel=0.45)
    assert np.degrees(np.std(rig.turns, axis=0, ddof=1)) == pytest.approx(np.full(3, NOISE_ANGLE), rel=0.45)


def test_the_table_has_them_with_standard_deviations() -> None:
    table = rig_table(given())
    assert table is not None
    cells = {column.heading: column.cells[0] for column in table.columns}
    assert cells["Cameras"] == "L, R"
    value, sd = map(float, cells["BX"].split(" ± "))
    assert value == pytest.approx(0.6, abs=4.0 * sd)
    assert sd == pytest.approx(NOISE / np.sqrt(INSTANTS), rel=0.45)


def test_cameras_that_only_have_equal_numbers_are_no_rig() -> None:
    assert rig_table(given(fixed=False)) is None
    assert "Relative orientation of cameras" not in sample("zurich_city_hall").page
