"""Single photos that the others contradict: left out one by one, and read differently where the others accept that."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct

from orip.adjustment.residual_sums import joint_effects
from orip.arrays import FloatArray, IntArray
from orip.bundle.antennas import without_photo
from orip.bundle.solve import SolvedBlock
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.interior.image_coordinates import are_equidistant, image_vectors, suit_plane_image
from orip.mistakes.exchanged_photos import OTHER_CAMERA
from orip.mistakes.hypothesis import Hypothesis, Readjuster, finding, fit_of_adjustment, is_good
from orip.mistakes.mistake import MISPLACED_PHOTO, Consequence, declare
from orip.mistakes.photo_coordinates import MIRRORED, RESOLUTION, exchanged_axes
from orip.records.block import Block
from orip.structs import replace

if TYPE_CHECKING:  # most blocks need none
    from orip.prelim.resection.resection import Resected

_LARGEST_SIGMA0 = 6.0
"""sigma0 of the others above which a complete adjustment without the photo is not worth its time: three times that of a
block that fits. Where a photo was to blame, it was below 2 in all trials."""


def may_fit_without(solved: SolvedBlock, photo: str) -> bool:
    """Tell whether the other photos may fit when one is left out; not known where the adjustment has not converged."""
    return not solved.converged or not sigma0_without(solved, photo) > _LARGEST_SIGMA0


def sigma0_without(solved: SolvedBlock, photo: str) -> float:
    """Return sigma0 of the observations with full weight when those of a photo are left out, to the first order.

    The square sum falls by v^T (I - H)^-1 v; see `orip.adjustment.residual_sums`. NaN where the photo has no
    observation with full weight, or nothing checks the others.

    Parameters
    ----------
    solved : SolvedBlock
    photo : str
        Its name.
    """
    points, equations = solved.block.photo_points, solved.equations
    row = [record.name for record in solved.block.photos].index(photo)
    full = equations.active & (solved.weight_factors >= 1.0)
    # photo points are the first kind of observation
    mine = np.flatnonzero(full[: points.xy.size] & np.repeat(points.photo == row, 2))
    if not len(mine):
        return np.nan
    effects = joint_effects(equations, solved.normals, solved.problem.layout, mine)
    fall, checked = effects.square_sum_changes(np.arange(len(mine))[None])
    redundancy = solved.variance.redundancy_used - float(checked[0])
    square_sum = float(equations.residual[full] @ equations.residual[full]) - float(fall[0])
    return float(np.sqrt(max(square_sum, 0.0) / redundancy)) if redundancy > 0.0 else np.nan


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
_CONTRADICTING = declare("contradicting-photo", "", MISPLACED_PHOTO)


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
    block : Block
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
    block : Block
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


_FEWEST = 3
"""Least number of photos of a block of which one can contradict the others."""

_DETERMINED = 0.02
"""Standard deviation of a point, as a part of the extent of all, up to which it counts as known."""


def misread_photos(
    readjuster: Readjuster, photos: Sequence[str], solved: SolvedBlock | None = None
) -> Iterator[Hypothesis]:
    """Yield the reading in which a photo fits the others; without one, blocks without a photo.

    Parameters
    ----------
    readjuster : Readjuster
    photos : sequence of str
        Those that may be wrong, the likeliest first.
    solved : SolvedBlock or None
        The adjustment with all of them, if there is one.
    """
    block = readjuster.block
    rows = {photo.name: row for row, photo in enumerate(block.photos)}
    left_out: list[Hypothesis] = []
    alone: list[str] = []
    for name in photos:
        if solved is not None and not may_fit_without(solved, name):
            continue
        without = without_photo(block, rows[name])
        rest = readjuster.adjust_roughly(without) if len(without.photo_points.photo) else None
        if rest is None:
            alone.append(name)
            continue
        if not is_good(fit_of_adjustment(rest)):
            continue
        known = _known(block, rest)
        found = fitting_reading(_with_cameras_of(rest, block), rows[name], known, rest.variance.sigma0)
        if found is not None and found.reading.kind:
            yield _read_otherwise(block, rows[name], rest, found)
        elif found is None and len(block.photos) >= _FEWEST and _can_contradict(block, rows[name], known):
            text = (
                "the other photos fit without it, and it does not fit them: check its numbers of points, its camera "
                "and its measurements, or leave it out"
            )
            found_out = finding(_CONTRADICTING, f"photo {name}", text)
            # the photo itself has no starting value
            left_out.append(Hypothesis(without, found_out, concerns_start=True))
    # without these photos the others are not connected
    for name in alone:
        yield from _directly_mirrored(block, rows[name])
    yield from left_out


def _with_cameras_of(solved: SolvedBlock, block: Block) -> Block:
    """Return a block with the cameras as they were adjusted: the values where they start may be far off."""
    found = {of.name: values for of, values in zip(solved.block.cameras, solved.state.cameras.tolist(), strict=True)}
    cameras = tuple(replace(of, parameters=tuple(found.get(of.name, of.parameters))) for of in block.cameras)
    return replace(block, cameras=cameras)


def _can_contradict(block: Block, photo: int, known: np.ndarray) -> bool:
    """Return whether a photo has enough of the known points: with few it cannot be oriented, and nothing is wrong."""
    points = block.photo_points
    mine = points.point[(points.photo == photo) & points.in_use]
    return int(np.isfinite(known[mine]).all(axis=1).sum()) >= FEWEST


def _directly_mirrored(block: Block, photo: int) -> Iterator[Hypothesis]:
    for reading in mirror_readings(block, photo):
        orientation = block.photo_orientation.copy()
        orientation[photo] = np.nan
        changed = replace(reading.block, photo_orientation=orientation)
        yield Hypothesis(changed, finding(reading.kind, f"photo {block.photos[photo].name}", reading.text))


def _known(block: Block, rest: SolvedBlock) -> np.ndarray:
    """Return the coordinates (number of points of the block, 3) that the other photos determine, NaN elsewhere."""
    known = np.full((len(block.point_names), 3), np.nan)
    place = block.point_index()
    coordinates = rest.state.points
    extent = float(np.ptp(coordinates, axis=0).max())
    variance = np.array([np.diag(matrix) for matrix in rest.cofactors.blocks]).reshape(-1, 3)
    for row, name in enumerate(rest.block.point_names):
        columns = rest.problem.unknowns.points[row]
        known[place[name]] = coordinates[row]
        free = columns >= rest.problem.layout.reduced
        if free.all():
            deviation = rest.deviation_scale * np.sqrt(variance[(columns[0] - rest.problem.layout.reduced) // 3])
            removed = rest.normals.removed[columns].any()
            if removed or not (deviation < _DETERMINED * extent).all():
                known[place[name]] = np.nan
    return known


def _read_otherwise(block: Block, photo: int, rest: SolvedBlock, found: FittingReading) -> Hypothesis:
    """Return a block with a photo read differently; the other photos start where they were adjusted."""
    adjusted = np.hstack([rest.state.centres, angles_from_rotation(rest.state.rotations)])
    orientation = np.insert(adjusted, photo, found.orientation, axis=0)
    held = np.array([bool(record.constant) for record in block.photos])
    orientation[held] = block.photo_orientation[held]
    changed = replace(found.reading.block, photo_orientation=orientation)
    return Hypothesis(changed, finding(found.reading.kind, f"photo {block.photos[photo].name}", found.reading.text))
