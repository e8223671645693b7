"""The fiducial system: where its axes lie among digitised marks, and how far a camera's photos reach in it."""

from __future__ import annotations

from typing import Literal

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.plane import PlaneTransformation
from orip.records.observations.measurement import MeasuredMarks
from orip.records.project.camera import Camera, Mark

_ONE_PLACE = 1e-6
"""Marks on opposite sides are apart by the size of the frame, not by a millionth of it."""


def frame_corners(camera: Camera) -> tuple[FloatArray, FloatArray] | None:
    """Return the lower left and the upper right corner, (2,) each in mm of the fiducial system, of a camera's frame.

    A frame or sensor is centred at the fiducial centre; where a camera has neither, its fiducial marks (reseau crosses,
    photo corners) tell how far it reaches. None where it has no marks either.
    """
    if camera.frame is not None:
        half = np.array(camera.frame) / 2.0
        return -half, half
    if camera.sensor is not None:
        half = np.array([camera.sensor.width, camera.sensor.height]) / 2.0
        return -half, half
    marks = np.array([(mark.x, mark.y) for mark in camera.fiducials])
    if len(marks) < 2 or np.ptp(marks, axis=0).min() <= 0.0:
        return None
    return marks.min(axis=0), marks.max(axis=0)


def fiducials_from_plate(marks: MeasuredMarks, arrangement: Literal["corners", "midsides"]) -> tuple[Mark, ...]:
    """Return fiducial marks with the origin at the mean of four of them and the x axis nearest to the plate's.

    Parameters
    ----------
    marks : MeasuredMarks
        Four marks or more that are not disregarded, plate mm. Of more than four (eight fiducial marks, reseau crosses)
        the outermost in the corners, or on the axes, make the system; the others are transformed with them.
    arrangement : {"corners", "midsides"}
        Midsides: the x axis goes through the two marks nearest to the plate's x direction. Corners: through the middles
        of the left and the right side.

    Raises
    ------
    ValueError
        Unless there are at least four marks, four of which lie around their mean.

    Notes
    -----
    The rule of ORIPROGRAM (Dueholm 1989, menu 1.4.1.1); for corners the middle of the sides is this program's reading.
    """
    used = ~marks.disregarded
    plate = marks.measured[used]
    if len(plate) < 4:
        message = f"{len(plate)} marks; at least four are needed, one in each corner or in the middle of each side"
        raise ValueError(message)
    outer = plate if len(plate) == 4 else plate[_outermost(plate, arrangement)]
    centred = plate - outer.mean(axis=0)
    around = outer - outer.mean(axis=0)
    direction = _x_axis(around if arrangement == "midsides" else _middles_of_sides(around))
    cosine, sine = direction / np.hypot(*direction)
    turn = PlaneTransformation(np.array([[cosine, sine], [-sine, cosine]]), np.zeros(2))
    names = [name for name, use in zip(marks.names, used, strict=True) if use]
    return tuple(Mark(name, float(x), float(y)) for name, (x, y) in zip(names, turn.apply(centred), strict=True))


def _outermost(plate: FloatArray, arrangement: Literal["corners", "midsides"]) -> list[int]:
    """Return which of many marks lie farthest out in the four corners, or along the four half axes.

    Holds for films turned by less than 45 degrees (corners), or 20 degrees where marks in the corners could be taken
    for those on the axes.
    """
    x, y = (plate - (plate.min(axis=0) + plate.max(axis=0)) / 2.0).T
    if arrangement == "corners":
        reach = (x + y, y - x, -x - y, x - y)
    else:
        reach = (x - np.abs(y), y - np.abs(x), -x - np.abs(y), -y - np.abs(x))
    found = [int(np.argmax(part)) for part in reach]
    if len(set(found)) < 4:
        message = f"none of the marks lie in the four {arrangement}; digitise those too"
        raise ValueError(message)
    return found


def _around(centred: FloatArray) -> FloatArray:
    """Return the four marks in their order around the mean."""
    return centred[np.argsort(np.arctan2(centred[:, 1], centred[:, 0]), kind="stable")]


def _middles_of_sides(centred: FloatArray) -> FloatArray:
    corners = _around(centred)
    return (corners + np.roll(corners, -1, axis=0)) / 2.0


def _x_axis(midsides: FloatArray) -> FloatArray:
    """Return the direction of the pair of opposite marks nearest to the plate's x direction, pointing right."""
    around = _around(midsides)
    pairs = around[2:] - around[:2]
    lengths = np.hypot(pairs[:, 0], pairs[:, 1])
    if lengths.min() < _ONE_PLACE * np.abs(midsides).max(initial=0.0) or lengths.min() == 0.0:
        message = "the marks do not lie around their mean; digitise one in each corner, or in the middle of each side"
        raise ValueError(message)
    nearest: FloatArray = pairs[np.argmax(np.abs(pairs[:, 0]) / lengths)]
    return nearest if nearest[0] > 0.0 else -nearest
