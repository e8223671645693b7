"""How the photos of rolling shutters move while they are exposed: velocities and angular rates from their neighbours.

They follow from the orientations and times of the photos before and after in the strip: by a parabola, at the ends of
the strip by a line. That is good for the velocities of a steady flight, and for the turning of a camera that is led
around something. It says nothing of the swinging of a camera between two exposures: a component whose changes do not
go on from one interval to the next is taken as zero. For that the bundle may have corrections as weighted unknowns
(`velocity_error`, `rate_error`).

While an iteration lasts the motions are held; they are found again from what it has changed.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import angles_between, rotation_about_axes, rotation_vectors_with_partials
from orip.records.block import Block
from orip.records.camera import ReadoutDirection, Sensor

_LONGEST_PAUSE = 2.5
"""In median intervals of a strip: after a longer one the flight was another one."""

_GOES_ON, _FADES = 0.75, 0.25
"""Correlation of the changes in successive intervals from which a component counts fully, and up to which not at all.

It is near 1 for what is steady, 1/2 for a swing of six intervals, and -1/2 for attitudes that are independent.
"""

_LARGEST_TURN = 1.0
"""Radians between two exposures: a camera that turns further does not do so evenly."""


class TimedPhotos(Struct, frozen=True):
    """Photos in the order of the exposures of a strip.

    Parameters
    ----------
    photos : array (k,) of int
        Their rows in the block, k at least 2.
    times : array (k,)
        Seconds, ascending.
    """

    photos: IntArray
    times: FloatArray


def rolling_cameras(block: Block) -> BoolArray:
    """Return which cameras (number of cameras,) have a readout time that is not zero, or unknown."""
    return np.array([camera.is_rolling for camera in block.cameras])


def motions(strips: tuple[TimedPhotos, ...], centres: FloatArray, rotations: FloatArray) -> FloatArray:
    """Return velocities and angular rates (number of photos, 6), radians a second; zero where they are not known.

    Parameters
    ----------
    centres : array (number of photos, 3)
    rotations : array (number of photos, 3, 3)
        Photo to ground.
    """
    found = np.zeros((len(centres), 6))
    products, squares = np.zeros(6), np.zeros(6)
    for strip in strips:
        turns = _turns(rotations[strip.photos[:-1]], rotations[strip.photos[1:]])
        steps, intervals = np.hstack([np.diff(centres[strip.photos], axis=0), turns]), np.diff(strip.times)
        slopes, counted = steps / intervals[:, None], _are_one_flight(strip, rotations)
        found[strip.photos] = _derivatives(slopes, intervals, counted)
        both = counted[:-1] & counted[1:]
        one, other = slopes[:-1][both], slopes[1:][both]
        products += np.sum(one * other, axis=0)
        squares += 0.5 * np.sum(one**2 + other**2, axis=0)
    return found * _part_that_goes_on(products, squares)


def _part_that_goes_on(products: FloatArray, squares: FloatArray) -> FloatArray:
    """Return with which factor (6,) each component counts; where no interval has a neighbour, velocities do."""
    if not squares.any():
        return np.repeat([1.0, 0.0], 3)
    correlation = products / np.maximum(squares, np.finfo(np.float64).tiny)
    return np.clip((correlation - _FADES) / (_GOES_ON - _FADES), 0.0, 1.0)


def _turns(before: FloatArray, after: FloatArray) -> FloatArray:
    """Return the vectors (n, 3) about the ground axes that turn one photo into the next."""
    return rotation_vectors_with_partials(after @ np.swapaxes(before, 1, 2))[0]


def _are_one_flight(strip: TimedPhotos, rotations: FloatArray) -> BoolArray:
    """Return between which neighbours (k - 1,) the motion was even."""
    intervals = np.diff(strip.times)
    turn = angles_between(rotations[strip.photos[:-1]], rotations[strip.photos[1:]])
    return np.asarray((intervals <= _LONGEST_PAUSE * np.median(intervals)) & (turn <= _LARGEST_TURN))


def _derivatives(slopes: FloatArray, intervals: FloatArray, counted: BoolArray) -> FloatArray:
    """Return derivatives (k, m) by time from the slopes (k - 1, m) between neighbours and their intervals.

    Of a parabola through a value and both neighbours it is the mean of both slopes, each weighted with the interval of
    the other one.
    """
    of_others = np.where(counted, 1.0, 0.0)
    before, after = np.zeros(len(slopes) + 1), np.zeros(len(slopes) + 1)
    before[1:], after[:-1] = of_others, of_others
    both = np.flatnonzero((before > 0.0) & (after > 0.0))
    before[both], after[both] = intervals[both], intervals[both - 1]
    padded = np.vstack([np.zeros_like(slopes[:1]), slopes, np.zeros_like(slopes[:1])])
    total = np.maximum(before + after, np.finfo(np.float64).tiny)
    return np.asarray((before[:, None] * padded[:-1] + after[:, None] * padded[1:]) / total[:, None])


class Poses(Struct, frozen=True):
    """Where the camera of each of n photo points was when their row was exposed.

    Parameters
    ----------
    centres : array (n, 3)
    rotations : array (n, 3, 3)
        Photo to ground.
    """

    centres: FloatArray
    rotations: FloatArray


_ALONG_AXES: Final[Mapping[ReadoutDirection, tuple[float, float]]] = MappingProxyType(
    {"down": (0.0, -1.0), "up": (0.0, 1.0), "right": (1.0, 0.0), "left": (-1.0, 0.0)}
)


def readout_a_mm(block: Block) -> FloatArray | None:
    """Return the part of each camera's readout (number of cameras, 2) that a mm of its photos takes along x and y.

    It is 0 for cameras without a readout; None: no camera has one.
    """
    rolling = rolling_cameras(block)
    if not rolling.any():
        return None
    found = np.zeros((len(rolling), 2))
    for row in np.flatnonzero(rolling).tolist():
        record = block.cameras[row]
        if record.sensor is not None:
            found[row] = part_a_mm(record.sensor, record.readout_direction)
    return found


def part_a_mm(sensor: Sensor, direction: ReadoutDirection) -> FloatArray:
    """Return the part (2,) of a readout that a mm of the photo takes along x and y."""
    return np.divide(_ALONG_AXES[direction], sensor.size)


def rows_of_readout(a_mm: FloatArray, xy: FloatArray, camera: IntArray) -> FloatArray:
    """Return the place (n,) of photo points in the readout, −1/2 in the first row or column to 1/2.

    Parameters
    ----------
    a_mm : array (number of cameras, 2)
        See `readout_a_mm`.
    xy : array (n, 2)
        Photo coordinates, mm.
    camera : array (n,) of int
    """
    along = a_mm[camera]
    return np.asarray(xy[:, 0] * along[:, 0] + xy[:, 1] * along[:, 1])


def poses(centres: FloatArray, rotations: FloatArray, motion: FloatArray, row: FloatArray) -> Poses:
    """Return poses at rows (n,), of centres (n, 3), rotations (n, 3, 3) and motions (n, 6) during the readout."""
    part = row[:, None]
    return Poses(centres + motion[:, :3] * part, rotation_about_axes(motion[:, 3:] * part) @ rotations)
