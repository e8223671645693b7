"""The block in 3-D: pyramids over the frames of the photos, and the points that a photo has."""

from __future__ import annotations

import numpy as np
from report.sample_pages import sample
from scipy.spatial.transform import Rotation

from orip.records.camera import Camera
from orip.records.definition import BundleDefinition
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.report.drawings.block_view import block_view, pyramid_corners
from orip.report.report_input import ReportInput

FRAME = (33.0, 21.0)


def given() -> ReportInput:
    solution = sample("small_frame_block").solution
    camera = Camera("REFLEX35", tuple(solution.cameras.values[0]), frame=FRAME)
    photos = {record_key(name): Photo(name, "reflex35") for name in solution.photos.names}
    return ReportInput(solution, (), BundleDefinition("MAIN"), {record_key(camera.name): camera}, photos)


def test_corners_of_the_pyramids_are_seen_in_the_corners_of_the_frame() -> None:
    found = given()
    c, dx, dy = found.solution.cameras.values[0, :3]
    for values, corners in zip(found.solution.photos.values, pyramid_corners(found), strict=True):
        # R = Rx Ry Rz: intrinsic turns about x, y, z
        rotation = Rotation.from_euler("XYZ", values[3:], degrees=True)
        u = rotation.inv().apply(corners - values[:3])
        assert (u[:, 2] < 0.0).all(), "the photo looks along its negative z axis"
        xy = -c * u[:, :2] / u[:, 2:] + (dx, dy)
        half = np.array(FRAME) / 2.0
        np.testing.assert_allclose(xy, np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * half, atol=1e-9)


def test_pyramids_point_at_what_the_photos_see() -> None:
    found = given()
    for values, corners, seen in zip(
        found.solution.photos.values, pyramid_corners(found), found.seen_points, strict=True
    ):
        axis = corners.mean(axis=0) - values[:3]
        towards = found.solution.points.values[seen].mean(axis=0) - values[:3]
        assert axis @ towards > 0.9 * np.linalg.norm(axis) * np.linalg.norm(towards)


def test_rays_are_those_measured() -> None:
    found = given()
    view, solution = block_view(found), found.solution
    measured = {(photo, point) for kind, photo, point in zip(
        solution.residuals.kind, solution.residuals.photo, solution.residuals.point, strict=True
    ) if kind == "photo"}  # fmt: skip
    names = view["points"]["names"]
    shown = {
        (photo, names[point])
        for photo, points in zip(view["photos"]["names"], view["photos"]["sees"], strict=True)
        for point in points
    }
    assert shown == measured
    assert len(names) == 146
