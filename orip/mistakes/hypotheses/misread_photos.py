"""Single photos that the others contradict: left out one by one, and read differently where the others then fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.bundle.antennas import without_photo
from orip.bundle.solve import SolvedBlock
from orip.geometry.rotation import angles_from_rotation
from orip.mistakes.fit_comparison import fit_of_adjustment, is_good
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.mistakes.left_out_photo import may_fit_without
from orip.mistakes.photo_readings import FEWEST, FittingReading, fitting_reading, mirror_readings
from orip.mistakes.readjuster import Readjuster
from orip.records.block import Block
from orip.structs import replace

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
        found = fitting_reading(block, rows[name], known, rest.variance.sigma0)
        if found is not None and found.reading.kind:
            yield _read_otherwise(block, rows[name], rest, found)
        elif found is None and len(block.photos) >= _FEWEST and _can_contradict(block, rows[name], known):
            text = (
                "the other photos fit without it, and it does not fit them: check its numbers of points, its camera "
                "and its measurements, or leave it out"
            )
            found_out = finding("contradicting-photo", f"photo {name}", text)
            # the photo itself has no starting value
            left_out.append(Hypothesis(without, found_out, concerns_start=True))
    # without these photos the others are not connected
    for name in alone:
        yield from _directly_mirrored(block, rows[name])
    yield from left_out


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
