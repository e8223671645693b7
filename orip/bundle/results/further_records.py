"""Records of a solution besides photos, points and cameras: rigs, figures, motions of rolling shutters.

The adjustment orients all photos independently. Where the photos of two cameras are always in the same relative
position, its mean over the instants is given with the standard deviation that follows from the cofactors of all photos
concerned, the correlations between them included: errors of a camera's parameters displace all instants alike, and do
not show in the scatter between them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.kinds.figure import FigureObservations
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.results.covariance import cofactors_times
from orip.bundle.results.ground import LEVEL_PHI, UNDETERMINED, deviations, reduced_cofactors
from orip.bundle.solve import SolvedBlock
from orip.bundle.state import RADIUS, SHIFTS, TILTS
from orip.bundle.unknowns import CONSTANT
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.geometry.stereo import RelativePoses, relative_poses_with_partials
from orip.interior.motions import rolling_cameras
from orip.records.block import Block
from orip.records.figures import FigureEstimate, figures_in
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import ExposureEstimate, MountingEstimate, PhotoMotion, RigEstimate
from orip.records.rig import MOUNTING_PARAMETERS
from orip.units import DEGREES_PER_RADIAN

_UNIT = np.array([1.0, 1.0, 1.0, *3 * [DEGREES_PER_RADIAN]])


def mounting_estimates(solved: SolvedBlock) -> tuple[MountingEstimate, ...]:
    """Return offset and rotation of each mounted camera."""
    rigs, columns = solved.state.rigs, solved.problem.unknowns.rigs
    if rigs is None or columns is None:
        return ()
    shown = np.broadcast_to(np.eye(6), (len(rigs.offsets), 6, 6)).copy()
    shown[:, 3:, 3:] = _of_rotations(rigs.mountings)
    values = np.hstack([rigs.offsets, angles_from_rotation(rigs.mountings)])
    names = [(camera.rig, camera.mounting.name) for camera in solved.block.places_on_rigs().mounted]
    rows = _figures(solved, columns.mountings, values, shown, names, MOUNTING_PARAMETERS)
    return tuple(MountingEstimate(*row) for row in rows)


def exposure_estimates(solved: SolvedBlock) -> tuple[ExposureEstimate, ...]:
    """Return centre and rotation of each exposure of a rig, as photos have them."""
    rigs, columns, ground = solved.state.rigs, solved.problem.unknowns.rigs, solved.block.ground
    if rigs is None or columns is None:
        return ()
    centres = ground.to_project(rigs.centres)
    axes = ground.axes_at(centres)
    rotations = axes @ rigs.rotations
    shown = np.zeros((len(centres), 6, 6))
    shown[:, :3, :3] = ground.project_with_partials(rigs.centres).by_local
    shown[:, 3:, 3:] = _of_rotations(rotations) @ axes
    values = np.hstack([centres, angles_from_rotation(rotations)])
    places = solved.block.places_on_rigs()
    names = list(zip(places.exposures, places.rig_of_exposure, strict=True))
    rows = _figures(solved, columns.exposures, values, shown, names, PHOTO_PARAMETERS)
    return tuple(ExposureEstimate(*row) for row in rows)


def _of_rotations(rotations: FloatArray) -> FloatArray:
    """Return the partials (n, 3, 3) of angles by small rotations; near phi = ±90 degrees these themselves."""
    angles = angles_from_rotation(rotations)
    found = angle_rates_from_axes_rotation(angles)
    found[np.abs(np.cos(angles[:, 1])) < LEVEL_PHI] = np.eye(3)
    return found


def _figures(
    solved: SolvedBlock,
    columns: IntArray,
    values: FloatArray,
    shown: FloatArray,
    names: Sequence[tuple[str, str]],
    parameters: Sequence[str],
) -> Iterator[tuple[str, str, str, float, float]]:
    """Yield two names, parameter, value and standard deviation of n records with unknowns at `columns` (n, 6).

    `shown` (n, 6, 6) are the partials of the values by these.
    """
    cofactors = shown @ reduced_cofactors(solved, columns) @ np.swapaxes(shown, 1, 2)
    sd = solved.deviation_scale * np.sqrt(np.maximum(np.einsum("nii->ni", cofactors), 0.0)) * _UNIT
    unknown: BoolArray = columns != CONSTANT
    touched = shown != 0.0
    sd[~(touched & unknown[:, None, :]).any(axis=2)] = np.nan
    removed = solved.is_undetermined(columns)
    sd[(touched & removed[:, None, :]).any(axis=2)] = UNDETERMINED
    for (one, other), of_values, of_sd in zip(names, (values * _UNIT).tolist(), sd.tolist(), strict=True):
        for parameter, value, deviation in zip(parameters, of_values, of_sd, strict=True):
            yield one, other, parameter, value, deviation


FEWEST_INSTANTS = 3
RIG_PARAMETERS = ("BX", "BY", "BZ", "OMEGA", "PHI", "KAPPA")

_LARGEST_SCATTER = 0.1
"""Of the base of a rig, as a part of how far the first camera moves from one instant to the next."""
_LARGEST_ANGLE = np.radians(5.0)
_NUMBER = re.compile(r"(\d+)(?:\.\w+)?$")


class Rig(NamedTuple):
    """Two cameras at n instants.

    Attributes
    ----------
    cameras : tuple of 2 int
        First and second camera of the block.
    photos : array (n, 2) of int
        Their photos.
    poses : RelativePoses
        Of the second camera against the first.
    """

    cameras: tuple[int, int]
    photos: IntArray
    poses: RelativePoses

    @property
    def mean_rotation(self) -> FloatArray:
        """Return the rotation (3, 3) nearest to the mean matrix."""
        u, _, vt = np.linalg.svd(self.poses.rotation.mean(axis=0))
        return np.asarray(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)

    @property
    def scatter(self) -> FloatArray:
        """Return the standard deviations (6,) of one instant: base, and rotations about the first camera's axes."""
        differences = self.poses.rotation @ self.mean_rotation.T
        skew = (differences - np.swapaxes(differences, 1, 2)) / 2.0
        turns = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        return np.asarray(np.std(np.hstack([self.poses.base, turns]), axis=0, ddof=1))


def rig_estimates(solved: SolvedBlock) -> tuple[RigEstimate, ...]:
    """Return base and rotation of each two cameras whose photos of the same instant are always in the same position."""
    state = solved.state
    photos = photos_by_instant(solved.block, _determined(solved))
    return tuple(row for rig in rigs(photos, state.centres, state.rotations) for row in _estimates(solved, rig))


def rigs(photos: Mapping[int, Mapping[object, int]], centres: FloatArray, rotations: FloatArray) -> Iterator[Rig]:
    """Yield each two cameras that move together.

    Parameters
    ----------
    photos : mapping of camera to mapping of instant to photo
    centres : array (number of photos, 3)
    rotations : array (number of photos, 3, 3)
        Photo to ground.
    """
    for first, second in combinations(photos, 2):
        common = [instant for instant in photos[first] if instant in photos[second]]
        if len(common) < FEWEST_INSTANTS:
            continue
        one, other = (np.array([photos[camera][instant] for instant in common]) for camera in (first, second))
        poses = relative_poses_with_partials(centres[one], rotations[one], centres[other], rotations[other])
        rig = Rig((first, second), np.column_stack([one, other]), poses)
        moved = float(np.median(np.linalg.norm(np.diff(centres[one], axis=0), axis=1)))
        base, turns = np.linalg.norm(rig.scatter[:3]), np.linalg.norm(rig.scatter[3:])
        if base <= _LARGEST_SCATTER * moved and turns <= _LARGEST_ANGLE:
            yield rig


def photos_by_instant(block: Block, photos: IntArray) -> Mapping[int, Mapping[object, int]]:
    """Return the photos of each camera by instant, without instants of which a camera has several photos."""
    instants = _instants(block)
    found: dict[int, dict[object, int]] = {}
    several: set[tuple[int, object]] = set()
    for photo in photos.tolist():
        camera, instant = int(block.photo_camera[photo]), instants.get(photo)
        if instant is None:
            continue
        if instant in found.setdefault(camera, {}):
            several.add((camera, instant))
        found[camera][instant] = photo
    in_order = sorted(found.items(), key=lambda item: record_key(block.cameras[item[0]].name))
    return {
        camera: {instant: photo for instant, photo in rows.items() if (camera, instant) not in several}
        for camera, rows in in_order
    }


def _instants(block: Block) -> dict[int, object]:
    """Return when each photo was taken: the time of its station in milliseconds, else the number in its name."""
    times = {record_key(station.photo): station.time for station in block.stations if np.isfinite(station.time)}
    found: dict[int, object] = {}
    for photo, record in enumerate(block.photos):
        time, number = times.get(record_key(record.name)), _NUMBER.search(record.name)
        if time is not None:
            found[photo] = ("time", round(1e3 * time))
        elif number is not None:
            found[photo] = ("number", int(number[1]))
    return found


def _determined(solved: SolvedBlock) -> IntArray:
    """Return the photos of which nothing was removed from the unknowns, but those of rigs, which have mountings."""
    columns, rigs = solved.problem.unknowns.photos, solved.problem.unknowns.rigs
    found = np.asarray(~solved.is_undetermined(columns).any(axis=1))
    if rigs is not None:
        found[rigs.photo] = False
    return np.flatnonzero(found)


def _estimates(solved: SolvedBlock, rig: Rig) -> Iterator[RigEstimate]:
    first, second = (solved.block.cameras[camera].name for camera in rig.cameras)
    angles = angles_from_rotation(rig.mean_rotation)
    unit = np.array([1.0, 1.0, 1.0, *3 * [DEGREES_PER_RADIAN]])
    values = unit * np.concatenate([rig.poses.base.mean(axis=0), angles])
    is_level = abs(np.cos(angles[1])) < LEVEL_PHI
    shown = np.eye(6)
    shown[3:, 3:] = np.eye(3) if is_level else angle_rates_from_axes_rotation(angles)
    sd = unit * _deviations_of_mean(solved, rig, shown)
    scatter = unit * rig.scatter
    for name, *figures in zip(RIG_PARAMETERS, values.tolist(), sd.tolist(), scatter.tolist(), strict=True):
        yield RigEstimate(first, second, len(rig.photos), name, *figures)


def _deviations_of_mean(solved: SolvedBlock, rig: Rig, shown: FloatArray) -> FloatArray:
    """Return the standard deviations (6,) of figures of the mean over all instants; NaN where all photos are constant.

    `shown` (6, 6) are the partials of the figures by the base and rotations about the first camera's axes.
    """
    columns = solved.problem.unknowns.photos
    by_unknowns = np.zeros((solved.problem.layout.size, 6))
    basis = solved.state.rotation_basis()
    for photos, partials in zip(rig.photos.T, (rig.poses.by_first, rig.poses.by_second), strict=True):
        rows = shown @ partials / len(photos)
        rows[:, :, 3:] = rows[:, :, 3:] @ basis[photos]
        mine = columns[photos]
        unknown = mine != CONSTANT
        by_unknowns[mine[unknown]] += np.swapaxes(rows, 1, 2)[unknown]
    cofactors = np.einsum("nk,nk->k", by_unknowns, cofactors_times(solved, by_unknowns))
    found = solved.deviation_scale * np.sqrt(np.maximum(cofactors, 0.0))
    return np.where(by_unknowns.any(axis=0), found, np.nan)


_VALUES = ("X", "Y", "Z", "dX", "dY", "dZ", "radius", "sd_place", "sd_direction", "sd_radius", "rms")


def figure_estimates(solved: SolvedBlock) -> tuple[FigureEstimate, ...]:
    """Return the adjusted figures of a block, in the project's coordinates."""
    block, placed, columns = solved.block, solved.state.figures, solved.problem.unknowns.figures
    figures = figures_in(block.figure_points)
    if not figures.names:
        return ()
    level = np.array([kind == "HEIGHT" for kind in figures.kinds])
    places = np.where(level[:, None], placed.origins, block.ground.to_project(placed.origins))
    directions = (block.ground.axes_at(places) @ placed.axes[:, :, 2, None])[:, :, 0]
    places[level, :2] = directions[level] = np.nan
    number, rms = _residuals(solved, len(figures.names))
    radii = np.where(columns[:, RADIUS] != CONSTANT, placed.radii, np.nan)
    values = np.column_stack([places, directions, radii, _deviations(solved), rms]).tolist()
    return tuple(
        FigureEstimate(name, kind, int(points), **dict(zip(_VALUES, row, strict=True)))
        for name, kind, points, row in zip(figures.names, figures.kinds, number, values, strict=True)
    )


def _deviations(solved: SolvedBlock) -> FloatArray:
    """Return the standard deviations (number of figures, 3) of place, direction (degrees) and radius, at their largest.

    NaN for what a figure has not, infinite for what nothing determines.
    """
    columns = solved.problem.unknowns.figures
    cofactors = reduced_cofactors(solved, columns)
    removed = solved.is_undetermined(columns)
    found = np.full((len(columns), 3), np.nan)
    for place, (part, unit) in enumerate(
        ((SHIFTS, 1.0), (TILTS, DEGREES_PER_RADIAN), (slice(RADIUS, RADIUS + 1), 1.0))
    ):
        known = (columns[:, part] != CONSTANT).any(axis=1)
        largest = np.linalg.eigvalsh(cofactors[:, part, part])[:, -1]
        sd = unit * solved.deviation_scale * np.sqrt(np.maximum(largest, 0.0))
        found[known, place] = np.where(removed[:, part].any(axis=1), np.inf, sd)[known]
    return found


def _residuals(solved: SolvedBlock, count: int) -> tuple[FloatArray, FloatArray]:
    """Return how many points of each figure are in use, and the root mean square of their distances."""
    points, squares, first = np.zeros(count), np.zeros(count), 0
    for kind in solved.problem.observations:
        rows = slice(first, first + len(kind.rows.error))
        first = rows.stop
        if isinstance(kind, FigureObservations):
            used = solved.equations.active[rows]
            distance = solved.equations.residual[rows] * kind.rows.error
            np.add.at(points, kind.figure[used & (kind.component == 0)], 1.0)
            np.add.at(squares, kind.figure[used], distance[used] ** 2)
    return points, np.sqrt(squares / np.maximum(points, 1.0))


_UNIT_OF_MOTION = np.repeat([1.0, DEGREES_PER_RADIAN], 3)


def photo_motions(solved: SolvedBlock) -> tuple[PhotoMotion, ...]:
    """Return the motions of the photos of rolling shutters along and about the project's axes; none of others."""
    block, state = solved.block, solved.state
    photos = np.flatnonzero(rolling_cameras(block)[block.photo_camera])
    if not len(photos):
        return ()
    axes = block.ground.axes_at(block.ground.to_project(state.centres[photos]))
    readout = state.readouts[photos, None]
    readout = np.where(readout == 0.0, np.inf, readout)
    local = (state.motions[photos] + state.motion_corrections[photos] / readout).reshape(-1, 2, 3)
    values = _UNIT_OF_MOTION * np.einsum("nij,nkj->nki", axes, local).reshape(-1, 6)
    sd = _UNIT_OF_MOTION * deviations(solved, solved.problem.unknowns.motions[photos]) / np.abs(readout)
    pixels = _pixels(solved)[photos]
    return tuple(
        PhotoMotion(block.photos[photo].name, *[*np.column_stack([of_photo, sds]).ravel().tolist(), size])
        for photo, of_photo, sds, size in zip(photos.tolist(), values, sd, pixels.tolist(), strict=True)
    )


def _pixels(solved: SolvedBlock) -> FloatArray:
    """Return the root mean square (number of photos,) of the motion of the image points of a photo in the readout."""
    kind, block = solved.problem.observations[0], solved.block
    assert isinstance(kind, PhotoPointObservations), "photo points are the first kind of observation"
    pixel = np.array(
        [np.nan if camera.sensor is None else camera.sensor.height / camera.sensor.rows for camera in block.cameras]
    )
    squares, number = np.zeros(len(block.photos)), np.zeros(len(block.photos))
    for part in kind.in_parts():
        ends = [part.moving_image(solved.state, end).image for end in (-0.5, 0.5)]
        seen = ends[0].in_front & ends[1].in_front
        moved = (ends[1].xy - ends[0].xy)[seen] / pixel[part.camera[seen], None]
        squares += np.bincount(part.photo[seen], np.sum(moved**2, axis=1), len(squares))
        number += np.bincount(part.photo[seen], minlength=len(squares))
    return np.asarray(np.sqrt(squares / np.maximum(number, 1.0)))
