"""The relative orientation of cameras that move together, from the photos that they took at the same instant.

The adjustment orients all photos independently. Where the photos of two cameras are always in the same relative
position, its mean over the instants is given with the standard deviation that follows from the cofactors of all photos
concerned, the correlations between them included: errors of a camera's parameters displace all instants alike, and do
not show in the scatter between them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.results.covariance import cofactors_times
from orip.bundle.results.ground import LEVEL_PHI
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.geometry.essential import RelativePoses, relative_poses_with_partials
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.results.solution import RigEstimate
from orip.units import DEGREES_PER_RADIAN

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
    found = ~(solved.normals.removed[columns] & (columns != CONSTANT)).any(axis=1)
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
