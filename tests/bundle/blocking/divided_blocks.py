"""Blocks of a few dozen photos with all kinds of unknowns, and two adjustments compared by standard deviations."""

from __future__ import annotations

import numpy as np
from aerial_blocks import aerial_block

from orip.bundle.kinds.terrain_height import with_terrain_heights
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block
from orip.records.control import ControlDistance, Station
from orip.records.definition import Antenna
from orip.records.ground import HeightGrid, Terrain, TerrainModel
from orip.structs import replace

_POINTS_A_PHOTO = 40


def calibrated(photos: int) -> Block:
    """Return a block with control and a camera of five unknowns."""
    return aerial_block(photos, _POINTS_A_PHOTO)


def free(photos: int) -> Block:
    """Return a free network."""
    block = calibrated(photos)
    return replace(block, control_points=(), definition=replace(block.definition, datum="free"))


def with_stations(photos: int) -> Block:
    """Return a block with exposure stations, an unknown lever arm and a shift for each strip."""
    block = calibrated(photos)
    random = np.random.default_rng(photos)
    strips = np.cumsum(np.diff(block.photo_orientation[:, 0], prepend=0.0) < 0.0)
    stations = tuple(
        Station(
            photo.name, tuple((place[:3] + random.normal(size=3)).tolist()), (1.0,) * 3,
            tuple(place[3:].tolist()), (0.005,) * 3, time=10.0 * row, strip=str(strip),
        )
        for row, (photo, place, strip) in enumerate(zip(block.photos, block.photo_orientation, strips, strict=True))
    )  # fmt: skip
    antenna = Antenna("GNSS", unknown=("LX", "LY", "LZ"), shift="strip")
    return replace(block, stations=stations, antennas=(antenna,))


def with_terrain(photos: int) -> Block:
    """Return a block whose points lie on a terrain model that is rough by some units, observed with that error."""
    block = calibrated(photos)
    low, high = block.point_start.min(axis=0) - 500.0, block.point_start.max(axis=0) + 500.0
    size = float((high - low)[:2].max()) / 40.0
    heights = float(np.median(block.point_start[:, 2])) + 5.0 * np.random.default_rng(photos).normal(size=(42, 42))
    grid = HeightGrid(heights, (1.0 / size, 0.0, -low[0] / size + 1.0, 0.0, -1.0 / size, high[1] / size + 1.0))
    error = 2.0 * float(np.std(block.point_start[:, 2])) + 5.0
    return with_terrain_heights(replace(block, terrains=(TerrainModel(Terrain("DTM", "dtm.tif", error), grid),)))[0]


def with_distances(photos: int) -> Block:
    """Return a block with observed distances, one of them exact, of points that so stay among the reduced unknowns."""
    block = calibrated(photos)
    ends = np.linspace(0, len(block.point_names) - 30, 7).astype(int)
    lengths = np.linalg.norm(block.point_start[ends] - block.point_start[ends + 9], axis=1)
    distances = tuple(
        ControlDistance(f"D{end}", block.point_names[end], block.point_names[end + 9], "XYZ", float(length), error)
        for end, length, error in zip(ends, lengths, [0.0] + 6 * [5.0], strict=True)
    )
    return replace(block, distances=distances)


def with_blunders(photos: int) -> Block:
    """Return a block with some gross errors, adjusted with Danish weights."""
    block = calibrated(photos)
    rays = block.photo_points
    xy = rays.xy.copy()
    xy[:: len(xy) // 12] += 0.2
    definition = replace(block.definition, start_down_weight=3, max_iterations=40)
    return replace(block, definition=definition, photo_points=replace(rays, xy=xy))


def undetermined(photos: int) -> Block:
    """Return a block with two photos that are not determined: one shows a single point, one two."""
    block = calibrated(photos)
    points = block.photo_points
    used = points.used.copy()
    for photo, kept in ((photos // 3, 1), (photos - 1, 2)):
        used[np.flatnonzero(points.photo == photo)[kept:]] = False
    return replace(block, photo_points=replace(points, used=used))


def largest_difference(one: SolvedBlock, other: SolvedBlock) -> float:
    """Return the largest difference of all unknowns of two adjustments, in their standard deviations."""
    unknowns = one.problem.unknowns
    roots = np.sqrt(
        np.concatenate([one.cofactors.reduced.diagonal(), np.einsum("bii->bi", one.cofactors.blocks).ravel()])
    )
    deviation = one.deviation_scale * roots
    largest = 0.0
    for name in ("cameras", "antennas", "shifts", "drifts", "theodolites", "points"):
        columns = getattr(unknowns, name)
        difference = getattr(one.state, name) - getattr(other.state, name)
        largest = max(largest, _in_deviations(difference, columns, deviation))
    turned = np.swapaxes(one.state.rotations, 1, 2) @ other.state.rotations
    rotation = np.stack([turned[:, 2, 1], turned[:, 0, 2], turned[:, 1, 0]], axis=1)
    centres = one.state.centres - other.state.centres
    return max(largest, _in_deviations(np.hstack([centres, rotation]), unknowns.photos, deviation))


def largest_difference_of_shape(one: SolvedBlock, other: SolvedBlock) -> float:
    """Return the largest difference of points and centres, in their standard deviations, without one of their datum.

    A similarity transformation of the whole block is fitted to the differences and taken off.
    """
    unknowns = one.problem.unknowns
    roots = np.concatenate([one.cofactors.reduced.diagonal(), np.einsum("bii->bi", one.cofactors.blocks).ravel()])
    columns = np.vstack([unknowns.photos[:, :3], unknowns.points])
    deviation = one.deviation_scale * np.sqrt(roots[columns])
    at, there = (np.vstack([solved.state.centres, solved.state.points]) for solved in (one, other))
    about = at - at.mean(axis=0)
    movements = np.stack(
        [*(np.tile(axis, (len(at), 1)) for axis in np.eye(3)), *(np.cross(axis, about) for axis in np.eye(3)), about],
        axis=2,
    ).reshape(-1, 7)
    movements /= np.linalg.norm(movements, axis=0)
    difference = (there - at).ravel()
    difference = difference - movements @ np.linalg.lstsq(movements, difference, rcond=None)[0]
    return float(np.abs(difference / deviation.ravel()).max())


def _in_deviations(difference: np.ndarray, columns: np.ndarray, deviation: np.ndarray) -> float:
    known = columns != CONSTANT
    sizes = deviation[columns[known]]
    determined = sizes > 0.0
    return float(np.abs(difference[known][determined] / sizes[determined]).max(initial=0.0))
