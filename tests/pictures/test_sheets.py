"""Sheets of coded dots, rendered: names, hidden dots, mirror images, and the eccentricity of circles."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from pictures.rendered import PER_MM, Camera, Station, drawing, photograph
from support.long_cases import every

from orip.arrays import FloatArray
from orip.errors import OripError
from orip.geometry.rotation import rotation_from_angles
from orip.pictures.targets.found_boards import eccentricity
from orip.pictures.targets.printing import Shape
from orip.pictures.targets.sheets import Sheet, find_sheet, sheet_of

CAMERA = Camera()
STEP, RADIUS, MARGIN = 24.0, 2.6, 30.0
COLUMNS, ROWS = 9, 7
CODED = {"4-2": 2, "1-8": 1, "5-7": 3, "0-0": 4}
NAMES = [f"{row}-{column}" for row in range(ROWS) for column in range(COLUMNS)]
XYZ = np.array([[column * STEP, row * STEP, 0.0] for row in range(ROWS) for column in range(COLUMNS)])
SIZE = ((COLUMNS - 1) * STEP, (ROWS - 1) * STEP)


def the_sheet(*, has_radius: bool = True) -> Sheet:
    return sheet_of(NAMES, XYZ, CODED, RADIUS if has_radius else None)


def drawn(*, without: tuple[str, ...] = ()) -> Any:
    """Return the sheet as samples; its coded dots have rings of 2.6 to 4.4 radii in so many parts."""
    shapes = [
        Shape(x - RADIUS, y - RADIUS, 2 * RADIUS, 2 * RADIUS, is_round=True)
        for name, (x, y, _) in zip(NAMES, XYZ, strict=True)
        if name not in without
    ]
    field = drawing(shapes, SIZE, MARGIN)
    x = (np.arange(field.shape[1]) + 0.5) / PER_MM - MARGIN
    y = ((np.arange(field.shape[0]) + 0.5) / PER_MM - MARGIN)[:, None]
    for name, parts in CODED.items():
        if name in without:
            continue
        at = XYZ[NAMES.index(name)]
        distance, angle = np.hypot(x - at[0], y - at[1]) / RADIUS, np.arctan2(y - at[1], x - at[0]) / (2 * np.pi)
        field[(distance > 2.6) & (distance < 4.4) & ((angle * parts + 0.1) % 1.0 < 0.55)] = 0.0
    return field


def station(angles: Sequence[float], distance: float = 300.0) -> Station:
    rotation = rotation_from_angles(np.radians(angles))
    return Station(np.array([SIZE[0] / 2, SIZE[1] / 2, 0.0]) + rotation[:, 2] * distance, rotation)


def off_truth(grey: Any, sheet: Sheet, at: Station) -> tuple[FloatArray, FloatArray, set[str]]:
    found = find_sheet(grey, sheet)
    assert not found.fault
    true = CAMERA.project(np.array([XYZ[NAMES.index(mark.name)] for mark in found.marks]), at)
    measured = np.array([[mark.column, mark.row] for mark in found.marks])
    return measured - true, np.array([mark.deviation for mark in found.marks]), {mark.name for mark in found.marks}


@pytest.mark.parametrize("angles", every(3, [[35.0, 10.0, 200.0], [0.0, 0.0, 0.0], [-20.0, 35.0, 95.0]]))
def test_all_dots_are_named_and_where_they_should_be(angles: list[float]) -> None:
    at = station(angles)
    off, deviations, names = off_truth(photograph(drawn(), MARGIN, CAMERA, at), the_sheet(), at)
    inside = CAMERA.project(XYZ, at)
    seen = (inside > 15).all(axis=1) & (inside < (CAMERA.columns - 15, CAMERA.rows - 15)).all(axis=1)
    assert {name for name, is_seen in zip(NAMES, seen, strict=True) if is_seen} <= names
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert 0.7 < np.sqrt(np.mean((off / deviations) ** 2)) < 2.0


def test_what_is_hidden_is_listed_and_the_others_keep_their_names() -> None:
    at = station((20.0, 25.0, 40.0), 400.0)
    hidden = ("3-3", "3-4", "2-3", "0-0", "6-8")
    grey = photograph(drawn(without=hidden), MARGIN, CAMERA, at)
    off, _, names = off_truth(grey, the_sheet(), at)
    assert names == set(NAMES) - set(hidden)
    assert np.abs(off).max() < 0.1
    assert {item.name for item in find_sheet(grey, the_sheet()).rejected} == set(hidden)


def test_two_coded_dots_are_enough_and_one_is_not() -> None:
    at = station((15.0, -20.0, 130.0), 340.0)
    two = photograph(drawn(without=("0-0", "5-7")), MARGIN, CAMERA, at)
    off, _, names = off_truth(two, the_sheet(), at)
    assert names == set(NAMES) - {"0-0", "5-7"}
    assert np.abs(off).max() < 0.1
    one = photograph(drawn(without=("0-0", "5-7", "4-2")), MARGIN, CAMERA, at)
    assert find_sheet(one, the_sheet()).fault.startswith("one coded dot")


def test_a_mirror_image_and_two_sheets_are_told() -> None:
    grey = photograph(drawn(), MARGIN, CAMERA, station((15.0, -20.0, 10.0), 340.0))
    assert "mirror image" in find_sheet(np.ascontiguousarray(np.fliplr(grey)), the_sheet()).fault
    assert "found twice" in find_sheet(np.hstack([grey, grey]), the_sheet()).fault
    assert "no coded dot" in find_sheet(np.full((300, 300), 200, dtype=np.uint8), the_sheet()).fault


def test_points_that_are_no_plane_are_no_sheet() -> None:
    bent = XYZ + np.column_stack([np.zeros((len(XYZ), 2)), 0.01 * XYZ[:, 0] ** 2])
    with pytest.raises(OripError, match="one plane"):
        sheet_of(NAMES, bent, CODED)


@pytest.mark.parametrize("upright", ["XZ", "YZ"])
def test_the_front_of_a_vertical_sheet_is_seen_from_the_left_or_below(upright: str) -> None:
    place = XYZ[:, :2]
    zero = np.zeros(len(place))
    xyz = np.column_stack([place[:, 0], zero, place[:, 1]] if upright == "XZ" else [zero, place[:, 0], place[:, 1]])
    turned = sheet_of(NAMES, xyz, CODED).xy
    a, b, c = (turned[NAMES.index(name)] for name in ("0-0", "0-8", "6-0"))
    assert np.linalg.det(np.stack([b - a, c - a])) > 0.0  # right-handed, as seen from the front


def test_eccentricity_is_that_of_a_fitted_ellipse() -> None:
    """The outline of a circle, projected point by point, fitted by a conic: closed form against numbers."""
    plane_to_image = np.array([[3.0, 0.4, 500.0], [-0.2, 2.5, 300.0], [4e-4, -9e-4, 1.0]])
    centre, radius = np.array([80.0, 120.0]), 15.0
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    outline = centre + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    image = np.column_stack([outline, np.ones(60)]) @ plane_to_image.T
    x, y = (image[:, :2] / image[:, 2:] - (600.0, 500.0)).T
    a, b, c, d, e = np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y], axis=1), np.ones(60), rcond=None)[0]
    fitted = np.linalg.solve([[2 * a, b], [b, 2 * c]], [-d, -e])
    fitted += (600.0, 500.0)
    of_centre = plane_to_image @ np.append(centre, 1.0)
    expected = fitted - of_centre[:2] / of_centre[2]
    assert np.hypot(*expected) > 0.3
    np.testing.assert_allclose(eccentricity(plane_to_image, centre[None], radius)[0], expected, atol=1e-7)
