"""Parameters and readouts of cameras that are held: each is a hypothesis, like an error common to a group.

Not adjusting a parameter says that it is known exactly. Where it is not, stations, control and scale bars seem to be
wrong: the photo points themselves absorb most of it.

The readout time is tested as an unknown that was held, at zero or another value (a score test): by the residuals of the
photo points and the partials of the exact model, with motions from the adjusted orientations and the times of exposure
stations. Rows were exposed one after the other, or columns, as in the picture of a camera that was turned. What the
other unknowns absorb has no part in it; where they absorb all, nothing is said.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from orip.adjustment.residual_sums import HeldParameters
from orip.arrays import FloatArray, IntArray, rows_of_groups
from orip.bundle.groups.observation_groups import ObservationGroup
from orip.bundle.kinds.observation import partials_by_unknowns
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rolling_shutter import Motion, moving_image_with_partials
from orip.interior.motions import part_a_mm, rows_of_readout
from orip.records.camera import CAMERA_PARAMETERS, OWN_PARAMETERS, READOUT, ReadoutDirection, Sensor, first_of_lens

TESTED = ("C", "DX", "DY", "A3", "READOUT")
"""What differs from one lens or calibration to another; further coefficients of distortion follow A3."""

_MOST_PHOTO_POINTS = 200_000
"""Most photo points that are linearised once more for this."""

_MOST_NUMBERS = 20_000_000
"""Of what all unknowns absorb of the held parameters: a camera for each of many photos has as many of these."""


class HeldCameras(NamedTuple):
    """The held parameters as groups without observations, how many photo coordinates each acts on, and their sums."""

    groups: tuple[ObservationGroup, ...]
    number: IntArray
    sums: HeldParameters


class _Parameter(NamedTuple):
    """The place of a lens, of the cameras with it that share a parameter, and of the parameter."""

    lens: int
    cameras: IntArray
    place: int


def held_cameras(solved: SolvedBlock, weight: FloatArray) -> HeldCameras | None:
    """Return the tested parameters that are held; None where there are none, or where the block is too large.

    Parameters
    ----------
    weight : array (n,)
        Weight factors of all equations, 0 where one is disregarded.
    """
    parameters, size = list(_held(solved)), solved.problem.layout.size
    count, rays = len(parameters), len(solved.block.photo_points.photo)
    if not parameters or rays > _MOST_PHOTO_POINTS or count * size > _MOST_NUMBERS:
        return None
    values, square, right, number = np.zeros(count), np.zeros((count,) * 2), np.zeros((size, count)), np.zeros(count)
    lens_of_camera = np.array(first_of_lens(solved.block.cameras))
    of_lens = rows_of_groups(np.array([one.lens for one in parameters]), len(lens_of_camera))
    first = 0
    # what the rows of the normal equations absorb of others, of a state that is hardly different, may be more than all
    for part in _photo_points(solved).in_parts():
        start = first
        first = start + len(part.rows.error)
        _, (partials, columns) = partials_by_unknowns(part, solved.linearised_at, solved.problem.unknowns)
        partials = partials / part.rows.error[:, None]
        camera = np.repeat(part.camera, 2)
        for held, mine in zip(of_lens, rows_of_groups(lens_of_camera[camera], len(lens_of_camera)), strict=True):
            if not len(held) or not len(mine):
                continue
            acts = np.column_stack(
                # a parameter that is too large acts like photo coordinates that are too small by its partials
                [
                    np.where(np.isin(camera[mine], one.cameras), -partials[mine, one.place], 0.0)
                    for one in (parameters[row] for row in held.tolist())
                ]
            )
            weighted = weight[start + mine, None] * acts
            values[held] += weighted.T @ solved.equations.residual[start + mine]
            square[np.ix_(held, held)] += weighted.T @ acts
            number[held] += np.count_nonzero(weighted, axis=0)
            touched = columns[mine] != CONSTANT
            for place, one in enumerate(held.tolist()):
                products = (partials[mine] * weighted[:, place, None])[touched]
                right[:, one] += np.bincount(columns[mine][touched], products, minlength=size)
    acting = np.flatnonzero(np.diag(square) > 0.0)
    if not len(acting):
        return None
    right = right[:, acting]
    groups = tuple(_group(solved, parameters[row]) for row in acting.tolist())
    moved = solved.normals.solve(right)
    sums = HeldParameters(values[acting], square[np.ix_(acting, acting)], right, moved)
    return HeldCameras(groups, number[acting].astype(np.int64), sums)


def _held(solved: SolvedBlock) -> Iterator[_Parameter]:
    cameras, columns = solved.block.cameras, solved.problem.unknowns.cameras
    first = np.array(first_of_lens(cameras))
    for row in range(len(cameras)):
        for name in TESTED:
            place = CAMERA_PARAMETERS.index(name)
            if columns[row, place] == CONSTANT and (first[row] == row or name in OWN_PARAMETERS):
                same = np.array([row]) if name in OWN_PARAMETERS else np.flatnonzero(first == row)
                yield _Parameter(int(first[row]), same, place)


def _group(solved: SolvedBlock, held: _Parameter) -> ObservationGroup:
    name, nothing = CAMERA_PARAMETERS[held.place], np.zeros(0, dtype=np.int64)
    return ObservationGroup("element", "CAMERA", name, nothing, (solved.block.cameras[held.cameras[0]].name,))


def _photo_points(solved: SolvedBlock) -> PhotoPointObservations:
    kind = solved.problem.observations[0]
    assert isinstance(kind, PhotoPointObservations), "photo points are the first kind of observation"
    return kind


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
    record = solved.block.cameras[camera]
    sensor = record.sensor
    assert sensor is not None, "readouts are those of digital frames"
    own = record.readout_direction
    across: ReadoutDirection = "right" if own in ("down", "up") else "down"
    directions, held = (own, across), (float(solved.state.cameras[camera, READOUT]), 0.0)
    equations = solved.equations
    weight = np.where(equations.active & np.isfinite(equations.residual), solved.weight_factors, 0.0)
    value, motion, square = np.zeros(2), np.zeros(2), np.zeros((2, 2))
    number, first, right = 0, 0, np.zeros((2, solved.problem.layout.size))
    for part in _photo_points(solved).in_parts():
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
