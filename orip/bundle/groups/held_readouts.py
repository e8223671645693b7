"""Cameras whose rows were exposed one after the other while they flew: residuals along the flight depend on the row.

Or their columns, and on the column: the picture of a camera that was turned has them in place of the rows. The readout
time is tested as an unknown that was held, at zero or another value (a score test): by the residuals of the photo
points and the partials of the exact model, with motions from the adjusted orientations and the times of exposure
stations. What the other unknowns absorb has no part in it; where they absorb all, nothing is said.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.observation import partials_by_unknowns
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rolling_shutter import Motion, moving_image_with_partials
from orip.interior.motions import part_a_mm, rows_of_readout
from orip.records.camera import READOUT, ReadoutDirection, Sensor


class ReadoutTest(NamedTuple):
    """The readout time of a camera, from an adjustment in which it was held.

    Attributes
    ----------
    direction : {"down", "up", "right", "left"}
    readout, sd : float
        Seconds from the first row or column to the last one; negative: the last one comes first. `sd` is infinite where
        the other unknowns absorb it.
    fall, fall_of_both : float
        How much the square sum of the residuals, in a-priori variances, falls with it, and with that of the other
        direction besides: where a direction is wrong, each alone explains little.
    number : int
        Photo coordinates that the motion acts on.
    pixels : float
        Root mean square of the motion of the images while it is off.
    """

    direction: ReadoutDirection
    readout: float
    sd: float
    fall: float
    fall_of_both: float
    number: int
    pixels: float


def readout_tests(solved: SolvedBlock, camera: int, motions: FloatArray) -> tuple[ReadoutTest, ReadoutTest]:
    """Test the readout time of a camera with a sensor, in its direction, and from none across it.

    Parameters
    ----------
    camera : int
        Its row in the block.
    motions : array (number of photos, 6)
        Of the photos; see `orip.interior.motions`.
    """
    kind, record = solved.problem.observations[0], solved.block.cameras[camera]
    assert isinstance(kind, PhotoPointObservations), "photo points are the first kind of observation"
    sensor = record.sensor
    assert sensor is not None, "readouts are those of digital frames"
    own = record.readout_direction
    across: ReadoutDirection = "right" if own in ("down", "up") else "down"
    directions, held = (own, across), (float(solved.state.cameras[camera, READOUT]), 0.0)
    equations = solved.equations
    weight = np.where(equations.active & np.isfinite(equations.residual), solved.weight_factors, 0.0)
    value, motion, square = np.zeros(2), np.zeros(2), np.zeros((2, 2))
    number, first, right = 0, 0, np.zeros((2, solved.problem.layout.size))
    for part in kind.in_parts():
        rows = slice(first, first + len(part.rows.error))
        first = rows.stop
        moves = [_by_readout(solved, part, motions, sensor, *one) for one in zip(directions, held, strict=True)]
        by_readout = np.where((part.camera == camera)[:, None], moves, 0.0)
        acts = by_readout.reshape(2, -1) / part.rows.error
        weighted = weight[rows] * acts
        value += weighted @ np.nan_to_num(equations.residual[rows])
        square += weighted @ acts.T
        motion += np.sum(by_readout[:, weight[rows].reshape(-1, 2).min(axis=1) > 0.0] ** 2, axis=(1, 2))
        number += int(np.count_nonzero(weighted[0]))
        _, (partials, columns) = partials_by_unknowns(part, solved.linearised_at, solved.problem.unknowns)
        touched = columns != CONSTANT
        right += [
            np.bincount(columns[touched], (partials * factors[:, None])[touched], minlength=right.shape[1])
            for factors in weighted / part.rows.error
        ]
    shown = square - right @ solved.normals.solve(right.T)
    of_both = float(value @ np.linalg.pinv(shown, rcond=1e-6, hermitian=True) @ value)
    pixel = sensor.height / sensor.rows
    found = []
    for direction, start, *figures in zip(
        directions, held, value, square.diagonal(), motion, shown.diagonal(), strict=True
    ):
        of_value, of_square, of_motion, of_shown = map(float, figures)
        if not number or of_shown <= 1e-6 * of_square:
            found.append(ReadoutTest(direction, start, np.inf, 0.0, 0.0, number, 0.0))
            continue
        off = -of_value / of_shown
        # rows are spread evenly: the mean square of their part of the readout is 1/12
        pixels = abs(off) * float(np.sqrt(24.0 * of_motion / number)) / pixel
        sd = solved.deviation_scale / float(np.sqrt(of_shown))
        found.append(ReadoutTest(direction, start + off, sd, of_value**2 / of_shown, of_both, number, pixels))
    return found[0], found[1]


def _by_readout(
    solved: SolvedBlock,
    points: PhotoPointObservations,
    motions: FloatArray,
    sensor: Sensor,
    direction: ReadoutDirection,
    readout: float,
) -> FloatArray:
    """Return how the images of photo points (n, 2) move with the readout time, mm a second."""
    state, moving = solved.state, motions[points.photo]
    part = part_a_mm(sensor, direction)[None]
    found = moving_image_with_partials(
        state.points[points.point] - state.centres[points.photo],
        state.rotations[points.photo],
        state.cameras[points.camera, 0],
        points.is_equidistant,
        Motion(moving[:, :3], moving[:, 3:]),
        rows_of_readout(part, points.xy, np.zeros_like(points.camera)),
        np.full(len(points.xy), readout),
    )
    return np.where(found.image.in_front[:, None], found.by_readout, 0.0)
