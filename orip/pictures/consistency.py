"""Tie points examined by an adjustment of their own: rays that contradict the others, and how large errors really are.

The residuals of patches show noise that differs from place to place. What moves a patch as a whole they do not show:
strong compression, relief within the patch. Rays of many photos do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import OripError
from orip.pictures.matching.tracks import Tracks
from orip.progress import stage
from orip.records.camera import CAMERA_PARAMETERS, Camera

if TYPE_CHECKING:
    from orip.api import Camera as CameraOfBlock

LEAST_REDUNDANCY = 200.0
"""Below it errors are left as they are: their factor would be worse than 5 %."""
LEAST_PHOTOS = 4
_CALIBRATED = ("C", "DX", "DY", "A3", "A5", "A7", "P1", "P2")
_BEFORE = 3.0
"""By which errors are multiplied at first: blunders then draw the block less."""
_MOST = 4.5
"""Standard deviations of a ray that is kept."""
_CHECKED = 0.15
"""Least redundancy number of a coordinate whose residual says something."""
_MEDIAN = 0.6744897501960817
"""Of the size of a normal variable."""


class Examined(Struct, frozen=True):
    """What the adjustment says of rays.

    Parameters
    ----------
    is_good : ndarray (r,)
        Not those that contradict the others, nor those of points that no two photos determine.
    factor : float or None
        By which the errors of the rays are to be multiplied, 1 or more: what all photos have in common the adjustment
        takes for their camera, so that it may say too little. None: too few rays to say.
    """

    is_good: NDArray[np.bool_]
    factor: float | None


def examine_rays(
    tracks: Tracks,
    place: NDArray[np.float64],
    error: NDArray[np.float64],
    cameras: Sequence[Camera],
) -> Examined:
    """Adjust tie points alone, as a free network with cameras that are calibrated.

    Parameters
    ----------
    place, error : ndarray (r, 2)
        Pixels.
    cameras : sequence of Camera
        Of each photo, with their sensors.
    """
    nothing = Examined(np.ones(len(place), dtype=np.bool_), None)
    if len(np.unique(tracks.photo)) < LEAST_PHOTOS or any(camera.sensor is None for camera in cameras):
        return nothing
    factor = _BEFORE
    good = nothing.is_good
    with stage("examining the rays", 2) as advance:
        for done in (1, 2):
            rays = np.flatnonzero(good)
            try:
                normalised, redundancy = _normalised(tracks.take(rays), place[rays], factor * error[rays], cameras)
            except OripError:  # what the block lacks the user's own adjustment says
                return nothing
            advance(done)
            is_checked = np.isfinite(normalised)
            if np.count_nonzero(is_checked) < LEAST_REDUNDANCY:
                return nothing
            found = float(np.median(np.abs(normalised[is_checked]))) / _MEDIAN
            factor *= found
            worst = np.max(np.abs(np.nan_to_num(normalised, posinf=np.inf)), axis=1) / found
            good = good.copy()
            good[rays] = worst < (_MOST if done == 2 else 2.0 * _MOST)
    kept = is_checked & good[rays][:, None]
    # as sigma0 of the rays that stay: the median would miss that errors of matching have long tails
    factor *= float(np.sqrt(np.average(normalised[kept] ** 2, weights=redundancy[kept]))) / found
    return Examined(good, max(factor, 1.0))


def _normalised(
    tracks: Tracks, place: NDArray[np.float64], error: NDArray[np.float64], cameras: Sequence[Camera]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return residuals over their standard deviations, (r, 2), and redundancy numbers.

    NaN is what nothing checks, infinite what is not determined.
    """
    from orip.api import Block, PhotoPoints, Photos

    photos = [f"P{number}" for number in range(len(cameras))]
    names = np.array(photos, dtype=object)[tracks.photo]
    points = np.array([f"T{number}" for number in range(len(tracks))], dtype=object)[tracks.track]
    used = np.unique(tracks.photo).tolist()
    sensors = [camera.sensor for camera in cameras]
    pixel = np.array([[1.0, 1.0] if s is None else [s.width / s.columns, s.height / s.rows] for s in sensors])
    given = {camera.name: _calibrated(camera) for camera in (cameras[number] for number in used)}
    block = Block(
        list(given.values()),
        Photos([photos[number] for number in used], [cameras[number].name for number in used]),
        PhotoPoints(names, points, place, error * pixel[tracks.photo]),
        datum="free",
    )
    residuals = block.adjust().residuals
    row_of = {key: row for row, key in enumerate(zip(names.tolist(), points.tolist(), strict=True))}
    found, numbers = np.full(place.shape, np.inf), np.zeros(place.shape)
    is_ray = residuals.kind == "photo"
    redundancy = residuals.redundancy_number[is_ray]
    with np.errstate(invalid="ignore", divide="ignore"):
        value = residuals.residual[is_ray] / (residuals.a_priori[is_ray] * np.sqrt(redundancy))
    value = np.where(np.isnan(redundancy), np.inf, np.where(redundancy < _CHECKED, np.nan, value))
    keys = zip(residuals.photo[is_ray].tolist(), residuals.point[is_ray].tolist(), strict=True)
    rows = np.array([row_of[key] for key in keys], dtype=np.intp)
    columns = (residuals.component[is_ray] == "y").astype(np.intp)
    found[rows, columns] = value
    numbers[rows, columns] = np.nan_to_num(redundancy)
    return found, numbers


def _calibrated(camera: Camera) -> CameraOfBlock:
    """Return a camera with all that is usually unknown of it to be adjusted."""
    from orip.api import Camera as Given

    sensor = camera.sensor
    size = {} if sensor is None else {
        "columns": sensor.columns, "rows": sensor.rows, "width": sensor.width, "height": sensor.height
    }  # fmt: skip
    values = dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True))
    return Given(
        camera.name,
        c=values.pop("C"),
        principal_point=(values.pop("DX"), values.pop("DY")),
        distortion={name: value for name, value in values.items() if value},
        distortion_at=camera.distortion_at,
        sensor=size,
        unknown=_CALIBRATED,
        projection=camera.projection,
    )
