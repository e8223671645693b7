"""Single photos that the others contradict: read differently where the others accept that."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.interior.image_coordinates import are_equidistant, image_vectors, suit_plane_image
from orip.mistakes.exchanged_photos import OTHER_CAMERA
from orip.mistakes.mistake import MISPLACED_PHOTO, Consequence, declare
from orip.mistakes.photo_coordinates import MIRRORED, RESOLUTION, exchanged_axes
from orip.records.block import Block
from orip.structs import replace

if TYPE_CHECKING:  # most blocks need none
    from orip.prelim.resection.resection import Resected

# A photo that the others contradict is resected from the points that they determine, in every reading.

_FITS = 6.0
"""Standard errors within which a point fits a resected photo."""

_MOST = 0.75
"""Part of the points that has to fit."""

FEWEST = 5
"""Least number of known points of a photo: fewer fit any reading by chance, and contradict nothing."""

_RESOLUTIONS = (2.0, 4.0)
"""Factors of reduced pictures."""

_SAME_DIRECTION = np.radians(30.0)
"""Rotation within which a given KAPPA shows which axis was mirrored."""

TURNED = declare("turned", "", MISPLACED_PHOTO, Consequence(warnings=("points-outside",), of_same_photo=True))
_EXCHANGED_AXES = declare("exchanged-axes", "", MISPLACED_PHOTO)
_SHIFTED = declare("shifted-numbers", "", MISPLACED_PHOTO)


class Reading(Struct, frozen=True):
    """A photo read differently from how it was measured.

    Parameters
    ----------
    kind : str
        Stable name in kebab-case.
    block : Block
        With what was measured in the photo, or its camera, as it was probably meant.
    text : str
        What is probably wrong and what to do.
    is_turned : bool
        Turned by 180 degrees beside the mirror image with the opposite sign of y.
    """

    kind: str
    block: Block
    text: str
    is_turned: bool = False

    def unturned(self, rotation: FloatArray) -> FloatArray:
        """Return the rotation (3, 3) with the opposite sign of y that belongs to one of this reading."""
        return rotation * [-1.0, -1.0, 1.0] if self.is_turned else rotation


class FittingReading(Struct, frozen=True):
    """A reading that fits the other photos, and the orientation (6,) of its photo, ground unit and radians.

    Its kind is "" where the photo fits as it was measured.
    """

    reading: Reading
    orientation: FloatArray


def fitting_reading(block: Block, photo: int, known: FloatArray, scale: float) -> FittingReading | None:
    """Return the reading in which a photo fits the points that the other photos determine.

    Parameters
    ----------
    photo : int
        Its index in the block.
    known : array (number of points, 3)
        Coordinates in the frame, NaN where the other photos do not determine them.
    scale : float
        Standard error of unit weight of the other photos.

    Returns
    -------
    FittingReading or None
        None where the photo fits in no reading.
    """
    best, fitting = None, _Fit(_MOST, np.inf, None)
    for reading in (Reading("", block, ""), *_readings(block, photo)):
        fit = _fit(reading.block, photo, known, scale)
        if fit is not None and fit.is_better_than(fitting):
            best, fitting = reading, fit
    if best is None or fitting.resected is None:
        return None
    found = fitting.resected
    orientation = np.concatenate([found.centre, angles_from_rotation(found.rotation[None])[0]])
    if best.kind == MIRRORED:
        best = replace(best, text=mirrored_text(block, photo, best.unturned(found.rotation)))
    return FittingReading(best, orientation)


class _Fit(Struct, frozen=True):
    """Part of the points that fit a resected photo, and the median of their residuals over the a-priori error."""

    part: float
    median: float
    resected: Resected | None

    def is_better_than(self, other: _Fit) -> bool:
        # a mirror image of flat ground fits nearly as well from below: the smaller residuals decide
        return self.part >= _MOST and (self.part > other.part + 0.1 or self.median < 0.7 * other.median)


def _fit(block: Block, photo: int, known: FloatArray, scale: float) -> _Fit | None:
    points = block.photo_points
    rows = np.flatnonzero((points.photo == photo) & points.in_use)
    rows = rows[np.isfinite(known[points.point[rows]]).all(axis=1)]
    if len(rows) < FEWEST:
        return None
    error = float(np.median(points.error[rows]))
    vectors = image_vectors(block)[rows]
    if not np.isfinite(vectors).all():
        return None
    near = suit_plane_image(vectors, are_equidistant(block)[rows])
    rows, vectors = rows[near], vectors[near]
    if len(rows) < FEWEST:
        return None
    from orip.prelim.resection.resection import Resected, resect

    resected = resect(vectors, known[points.point[rows]], error_mm=error)
    if not isinstance(resected, Resected):
        return None
    size = np.linalg.norm(resected.residuals, axis=1) / error / max(scale, 1.0)
    size = np.where(np.isnan(size), np.inf, size)
    return _Fit(float(np.mean(size < _FITS)), float(np.median(size)), resected)


def _readings(block: Block, photo: int) -> Iterator[Reading]:
    rows = np.flatnonzero(block.photo_points.photo == photo)
    yield from mirror_readings(block, photo)
    sensor = block.cameras[block.photo_camera[photo]].sensor
    if sensor is not None:
        xy, half = block.photo_points.xy[rows], np.array([sensor.width, -sensor.height]) / 2.0
        for factor in _RESOLUTIONS:
            text = (
                f"it fits when its pixels are multiplied by {factor:g}: it was measured at a lower resolution; measure "
                "the picture in its full size, or multiply columns and rows"
            )
            yield Reading(RESOLUTION, _with_xy(block, rows, (xy + half) * factor - half), text)
        if any(block.cameras[block.photo_camera[photo]].parameters[1:3]):  # else the photo is turned, and fits
            text = (
                "it fits when its picture is turned by 180°; turn it as the others are, and measure it again (or write "
                f"{sensor.columns} - column and {sensor.rows} - row)"
            )
            yield Reading(TURNED, _with_xy(block, rows, -xy), text)
    yield from _other_cameras(block, photo)
    yield from _shifted_numbers(block, rows)


def mirror_readings(block: Block, photo: int) -> Iterator[Reading]:
    """Yield a photo as its mirror image, and with columns and rows exchanged where that is something else."""
    rows = np.flatnonzero(block.photo_points.photo == photo)
    xy = block.photo_points.xy[rows]
    yield Reading(MIRRORED, _with_xy(block, rows, xy * [1.0, -1.0]), mirrored_text(block, photo))
    camera = block.cameras[block.photo_camera[photo]]
    if any(camera.parameters[1:3]):  # the principal point is on the other side of the middle then
        yield Reading(MIRRORED, _with_xy(block, rows, xy * [-1.0, 1.0]), mirrored_text(block, photo), is_turned=True)
    sensor = camera.sensor
    if sensor is not None and sensor.width != sensor.height:
        text = "it fits when columns and rows are exchanged in it, a mirror image; write the column first"
        yield Reading(_EXCHANGED_AXES, _with_xy(block, rows, exchanged_axes(xy, sensor)), text)


def _with_xy(block: Block, rows: IntArray, xy: FloatArray) -> Block:
    changed = block.photo_points.xy.copy()
    changed[rows] = xy
    return replace(block, photo_points=replace(block.photo_points, xy=changed))


def _other_cameras(block: Block, photo: int) -> Iterator[Reading]:
    own = block.cameras[block.photo_camera[photo]]
    for camera in block.defined_cameras:
        if camera.name == own.name or camera.sensor != own.sensor:
            continue
        names = [known.name for known in block.cameras]
        known = block.cameras if camera.name in names else (*block.cameras, camera)
        photo_camera = block.photo_camera.copy()
        photo_camera[photo] = [record.name for record in known].index(camera.name)
        text = (
            f"it fits with camera {camera.name}, and not with {own.name}; write "
            f'camera = "{camera.name}" in its [[photo]]'
        )
        yield Reading(OTHER_CAMERA, replace(block, cameras=known, photo_camera=photo_camera), text)


def _shifted_numbers(block: Block, rows: IntArray) -> Iterator[Reading]:
    for step, way in ((1, "down"), (-1, "up")):
        point = block.photo_points.point.copy()
        point[rows] = np.roll(point[rows], step)
        text = f"it fits when the numbers in its POINTS lines are moved {way} by a line: they are shifted; correct them"
        yield Reading(_SHIFTED, replace(block, photo_points=replace(block.photo_points, point=point)), text)


def mirrored_text(block: Block, photo: int, rotation: FloatArray | None = None) -> str:
    """Return which axis was mirrored: a given KAPPA shows it; without one the cases differ only by a rotation.

    Parameters
    ----------
    photo : int
        Its index in the block.
    rotation : array (3, 3), optional
        Of the photo with the opposite sign of y.
    """
    text = "it fits as a mirror image"
    given = block.photo_orientation[photo, 3:]
    ways = {
        0.0: "y seems to have the opposite sign",
        np.pi: "x seems to have the opposite sign",
        np.pi / 2.0: "x and y seem to be exchanged",
        -np.pi / 2.0: "x and y seem to be exchanged, with opposite signs",
    }
    if rotation is not None and np.isfinite(given).all():
        turned = rotation_from_angles(given[None])[0].T @ rotation
        kappa = float(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
        for angle, way in ways.items():
            if abs(np.remainder(kappa - angle + np.pi, 2.0 * np.pi) - np.pi) < _SAME_DIRECTION:
                return f"{text}: {way} in it; correct its POINTS lines"
    camera = block.cameras[block.photo_camera[photo]]
    if camera.sensor is not None:
        return f"{text}: its rows seem to count upwards, or its columns from the right; correct its POINTS lines"
    return (
        f"{text}: x or y has the opposite sign in it, or x and y are exchanged (or film was scanned from its back); "
        "correct its POINTS lines"
    )
