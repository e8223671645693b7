"""Cameras whose rows were exposed one after the other while they flew: residuals along the flight depend on the row.

The readout time is tested as an unknown that was held, at zero or another value (a score test): by the residuals of the
photo points and the partials of the exact model, with motions from the adjusted orientations and the times of exposure
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
from orip.records.camera import READOUT


class ReadoutTest(NamedTuple):
    """The readout time of a camera, from an adjustment in which it was held.

    Attributes
    ----------
    readout, sd : float
        Seconds from the upper row to the lower one; negative: the lower row comes first. `sd` is infinite where the
        other unknowns absorb it.
    fall : float
        How much the square sum of the residuals, in a-priori variances, falls with it.
    number : int
        Photo coordinates that the motion acts on.
    pixels : float
        Root mean square of the motion of the images while it is off.
    """

    readout: float
    sd: float
    fall: float
    number: int
    pixels: float


def readout_test(solved: SolvedBlock, camera: int, motions: FloatArray) -> ReadoutTest:
    """Test the readout time of a camera with a sensor.

    Parameters
    ----------
    camera : int
        Its row in the block.
    motions : array (number of photos, 6)
        Of the photos; see `orip.interior.motions`.
    """
    kind, sensor = solved.problem.observations[0], solved.block.cameras[camera].sensor
    assert isinstance(kind, PhotoPointObservations), "photo points are the first kind of observation"
    assert sensor is not None, "readouts are those of digital frames"
    equations = solved.equations
    weight = np.where(equations.active & np.isfinite(equations.residual), solved.weight_factors, 0.0)
    value = square = motion = 0.0
    number, first, right = 0, 0, np.zeros(solved.problem.layout.size)
    for part in kind.in_parts():
        rows = slice(first, first + len(part.rows.error))
        first = rows.stop
        by_readout = np.where((part.camera == camera)[:, None], _by_readout(solved, part, motions, sensor.height), 0.0)
        acts = by_readout.ravel() / part.rows.error
        weighted = weight[rows] * acts
        value += float(weighted @ np.nan_to_num(equations.residual[rows]))
        square += float(weighted @ acts)
        motion += float(np.sum(by_readout[weight[rows].reshape(-1, 2).min(axis=1) > 0.0] ** 2))
        number += int(np.count_nonzero(weighted))
        _, (partials, columns) = partials_by_unknowns(part, solved.linearised_at, solved.problem.unknowns)
        partials = partials * (weighted / part.rows.error)[:, None]
        touched = columns != CONSTANT
        right += np.bincount(columns[touched], partials[touched], minlength=len(right))
    shown = square - float(right @ solved.normals.solve(right[:, None])[:, 0])
    if not number or shown <= 1e-6 * square:
        return ReadoutTest(float(solved.state.cameras[camera, READOUT]), np.inf, 0.0, number, 0.0)
    off, fall = -value / shown, value**2 / shown
    readout = float(solved.state.cameras[camera, READOUT]) + off
    # rows are spread evenly: the mean square of their part of the readout is 1/12
    pixels = abs(off) * np.sqrt(24.0 * motion / number) / (sensor.height / sensor.rows)
    return ReadoutTest(readout, solved.deviation_scale / float(np.sqrt(shown)), fall, number, float(pixels))


def _by_readout(solved: SolvedBlock, points: PhotoPointObservations, motions: FloatArray, height: float) -> FloatArray:
    """Return how the images of photo points (n, 2) move with the readout time, mm a second."""
    state, moving = solved.state, motions[points.photo]
    found = moving_image_with_partials(
        state.points[points.point] - state.centres[points.photo],
        state.rotations[points.photo],
        state.cameras[points.camera, 0],
        points.is_equidistant,
        Motion(moving[:, :3], moving[:, 3:]),
        -points.xy[:, 1] / height,
        state.cameras[points.camera, READOUT],
    )
    return np.where(found.image.in_front[:, None], found.by_readout, 0.0)
