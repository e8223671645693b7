"""Sixty drone photos whose RTK stations are all shifted: 13 000 photo equations do not hide it."""

from __future__ import annotations

import re

import numpy as np
import pytest
from bundle.solving import OFF
from scipy.spatial.transform import Rotation

from orip.bundle.methods import Method, adjust_block
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.camera import Camera
from orip.records.control import ControlElement, ControlPoint
from orip.records.definition import BundleDefinition, Precision
from orip.records.photo import Photo
from orip.records.results.solution import Solution
from orip.structs import replace

SHIFT = np.array([0.04, -0.03, 0.25])
"""A wrong antenna offset and another height system, m."""

C_MM, HALF_MM = 8.8, np.array([6.6, 4.4])
PHOTO_ERROR, GROUND_ERROR = 0.001, 0.02
STATION_ERRORS = np.array([0.02, 0.02, 0.03])


def drone_block(shift: np.ndarray, seed: int = 5) -> Block:
    """Return six strips of ten photos at 80 m, five control and six check points, C to be calibrated."""
    random = np.random.default_rng(seed)
    east, north = np.meshgrid(24.0 * np.arange(10.0), 24.0 * np.arange(6.0))
    centres = np.stack([east.ravel(), north.ravel(), np.full(60, 80.0)], axis=1) + random.normal(size=(60, 3))
    angles = np.radians(random.normal(size=(60, 3)) * [2.0, 2.0, 5.0])
    x, y = np.meshgrid(np.linspace(-25.0, 240.0, 30), np.linspace(-15.0, 135.0, 22))
    points = np.stack([x, y, 6.0 * random.uniform(size=x.shape)], axis=-1).reshape(-1, 3)
    rotations = Rotation.from_euler("XYZ", angles).as_matrix()
    u = np.einsum("pkj,pik->pij", rotations, points[None] - centres[:, None])
    image = -C_MM * u[:, :, :2] / u[:, :, 2:]
    shown = (np.abs(image) < HALF_MM).all(axis=2)
    kept = shown.sum(axis=0) >= 3
    points, image, shown = points[kept], image[:, kept], shown[:, kept]
    photo, point = np.nonzero(shown)
    xy = image[photo, point] + PHOTO_ERROR * random.normal(size=(len(photo), 2))
    names = tuple(f"T{number}" for number in range(len(points)))
    given = random.choice(len(points), 11, replace=False).tolist()

    def known(row: int, sign: float) -> ControlPoint:
        x, y, z = (points[row] + GROUND_ERROR * random.normal(size=3)).tolist()
        return ControlPoint(names[row], (x, y, z), (sign * GROUND_ERROR,) * 3)

    observed = centres + shift + STATION_ERRORS * random.normal(size=centres.shape)
    photos = tuple(
        Photo(f"D{row}", "CAM", orientation=(*centre, *np.degrees(angle).tolist()))
        for row, (centre, angle) in enumerate(zip(observed.tolist(), angles, strict=True))
    )
    return Block(
        definition=BundleDefinition("MAIN", Precision(PHOTO_ERROR), **OFF),
        cameras=(Camera("CAM", (C_MM + 0.01, *[0.0] * 12), unknown=("C",)),),
        photos=photos,
        photo_camera=np.zeros(60, dtype=np.int64),
        photo_orientation=np.hstack([observed, angles]),
        point_names=names,
        point_start=points + 0.1 * random.normal(size=points.shape),
        photo_points=IndexedPhotoPoints(photo, point, xy, np.full(xy.shape, PHOTO_ERROR), np.ones(xy.shape, bool)),
        constant_points=np.zeros((len(points), 3), dtype=bool),
        control_points=tuple(known(row, 1.0 if place < 5 else -1.0) for place, row in enumerate(given)),
        elements=tuple(
            ControlElement(photo.name, "PHOTO", kind, value, float(error))
            for photo, values in zip(photos, observed.tolist(), strict=True)
            for kind, value, error in zip(("X0", "Y0", "Z0"), values, STATION_ERRORS, strict=True)
        ),
    )


def adjusted(block: Block) -> Solution:
    return adjust_block(block, Method(), lambda _: None, lambda: False)[0]


@pytest.fixture(scope="module")
def shifted() -> Solution:
    return adjusted(drone_block(SHIFT))


def test_sigma0_says_nothing_of_it(shifted: Solution) -> None:
    assert np.count_nonzero(np.array(shifted.residuals.kind) == "photo") > 10_000
    # 180 observed stations among some 13 000 equations: 1.2 as a whole at the most
    assert shifted.sigma0 < 1.2


def test_the_first_sentence_names_the_stations(shifted: Solution) -> None:
    assert shifted.verdict.startswith("Converged, but ")
    assert "exposure stations" in shifted.verdict


def test_the_doubted_groups_are_stations_and_not_photo_points(shifted: Solution) -> None:
    doubted = {(group.kind, group.component) for group in shifted.groups if group.doubted}
    assert ("element", "Z0") in doubted
    assert not {kind for kind, _ in doubted} & {"photo", "distance"}
    (station,) = (group for group in shifted.groups if (group.kind, group.component) == ("element", "Z0"))
    # observed minus what control predicts, and C takes part of a height; its standard deviation goes with the size
    assert station.shift == pytest.approx(SHIFT[2], abs=4.0 * station.shift_sd)


def test_the_same_block_without_a_shift_is_not_doubted() -> None:
    clean = adjusted(drone_block(np.zeros(3)))
    assert not [group for group in clean.groups if group.doubted]
    assert "exposure stations" not in clean.verdict
    (camera,) = clean.cameras.values
    assert camera[0] == pytest.approx(C_MM, abs=4.0 * float(clean.cameras.sd[0, 0]))


def test_without_control_check_points_tell(shifted: Solution) -> None:
    block = drone_block(SHIFT)
    without = replace(block, control_points=tuple(point for point in block.control_points if point.kind == "check"))
    found = adjusted(without)
    doubted = {group.kind for group in found.groups if group.doubted}
    assert doubted <= {"check", "element"}
    assert doubted
    assert found.verdict != shifted.verdict
    # only beside the check points do the stations show an error: the sentence has its size all the same
    (sentence,) = (text.text for text in found.diagnosis if "exposure stations are all off" in text.text)
    assert "instead it is a shift of the check points" in sentence
    ((size, sd),) = re.findall(r"Z0 \+([0-9.]+) ± ([0-9.]+)", sentence)
    assert float(size) == pytest.approx(SHIFT[2], abs=4.0 * float(sd))
