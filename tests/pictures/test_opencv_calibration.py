"""The same marks of a board through OpenCV's calibration and orip: the same minimum."""

from __future__ import annotations

import cv2
import numpy as np
from pictures.rendered import Camera, looking_at, photograph_of

import orip
from orip.pictures.targets.boards import Board, board_points
from orip.pictures.targets.found_boards import find_board
from orip.records.observation_kinds import PHOTO_POINT

BOARD = Board("charuco", 9, 6, 24.0, 18.0, "5X5_100")
CAMERA = Camera()
VIEWS = ((0, 0, 0), (30, 5, 90), (-30, 10, 180), (5, 32, 270), (10, -30, 45))


def marks() -> list[tuple[str, str, float, float]]:
    """Return photo, point, column and row of all marks."""
    found = []
    for number, angles in enumerate(VIEWS, start=1):
        picture = photograph_of(BOARD, CAMERA, looking_at(BOARD, angles, 300.0), seed=number, noise=4.0)
        found += [(f"V{number}", mark.name, mark.column, mark.row) for mark in find_board(picture, BOARD).marks]
    return found


def test_the_same_minimum_and_camera() -> None:
    measured, points = marks(), board_points(BOARD)
    views = sorted({mark[0] for mark in measured})
    plane = [np.array([[*points[m[1]], 0.0] for m in measured if m[0] == view], dtype=np.float32) for view in views]
    # OpenCV counts from the centre of the first pixel
    image = [np.array([[m[2] - 0.5, m[3] - 0.5] for m in measured if m[0] == view], dtype=np.float32) for view in views]
    f = CAMERA.c / CAMERA.pixel
    start = np.array([[f, 0.0, CAMERA.columns / 2 - 0.5], [0.0, f, CAMERA.rows / 2 - 0.5], [0.0, 0.0, 1.0]])
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO
    stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 300, 1e-15)
    rms, matrix, distortion, *_ = cv2.calibrateCamera(
        plane, image, (CAMERA.columns, CAMERA.rows), start, np.zeros(5), flags=flags, criteria=stop
    )
    pixel = CAMERA.pixel
    sensor = {
        "columns": CAMERA.columns, "rows": CAMERA.rows,
        "width": CAMERA.columns * pixel, "height": CAMERA.rows * pixel,
    }  # fmt: skip
    unknown = ["C", "DX", "DY", "A3", "A5", "A7", "P1", "P2"]
    solution = orip.Block(
        [orip.Camera("CAM", CAMERA.c, sensor=sensor, unknown=unknown)],
        orip.Photos(views, "CAM"),
        # OpenCV takes coordinates of single precision: both adjust the same numbers
        orip.PhotoPoints(
            [m[0] for m in measured], [m[1] for m in measured],
            np.concatenate(image).astype(float) + 0.5, error=0.1 * pixel,
        ),
        orip.ControlPoints(
            list(points), np.array([[*place, 0.0] for place in points.values()]), np.zeros((len(points), 3))
        ),
        start_down_weight=59, max_iterations=60,
    ).adjust()  # fmt: skip
    rows = solution.residuals
    own = rows.residual[rows.kind == PHOTO_POINT.name] / pixel
    assert len(own) == 2 * len(measured)
    # OpenCV's is the root of the mean square of distances, not of coordinates
    assert abs(np.sqrt(2.0 * np.mean(own**2)) - rms) < 1e-6
    camera = solution.cameras["CAM"]
    assert abs(camera.c / pixel - matrix[0, 0]) < 1e-2
    assert abs(camera.a3 * camera.c**2 - distortion.ravel()[0]) < 1e-5
