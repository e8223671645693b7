"""Photos left out: whether the others fit without them, and what was misread in a photo that does not fit these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.adjustment.residual_sums import joint_effects
from orip.arrays import FloatArray
from orip.bundle.antennas import without_photo, without_photos
from orip.bundle.solve import SolvedBlock
from orip.geometry.rotation import angles_from_rotation
from orip.mistakes.hypothesis import Hypothesis, Readjuster, finding, fit_of_adjustment, is_good
from orip.mistakes.misread_photos import FEWEST, FittingReading, fitting_reading, mirror_readings
from orip.mistakes.mistake import MISPLACED_PHOTO, declare
from orip.records.block import Block
from orip.structs import replace
from orip.wording import counted_names

_CONTRADICTING = declare("contradicting-photo", "", MISPLACED_PHOTO)

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
        found = _fitting(block, rows[name], rest)
        if found is not None and found.reading.kind:
            yield _read_otherwise(block, rows[name], rest, found)
        elif found is None and len(block.photos) >= _FEWEST and _can_contradict(block, rows[name], rest):
            left_out.append(_contradicting([name], _where_adjusted(without, rest)))
    # without these photos the others are not connected
    for name in alone:
        yield from _directly_mirrored(block, rows[name])
    yield from left_out


def misread_beside(block: Block, rest: SolvedBlock) -> Iterator[Hypothesis]:
    """Yield the reading in which a photo fits others that were adjusted without it, then that some photos fit in none.

    Parameters
    ----------
    rest : SolvedBlock
        The adjustment of those of its photos that could be oriented, which fits.
    """
    oriented = np.isin([photo.name for photo in block.photos], [photo.name for photo in rest.block.photos])
    contradicting: list[str] = []
    for row in np.flatnonzero(~oriented).tolist():
        others = ~oriented
        others[row] = False
        beside, place = without_photos(block, others), int(np.count_nonzero(oriented[:row]))
        found = _fitting(beside, place, rest)
        if found is not None and found.reading.kind:
            yield _read_otherwise(beside, place, rest, found)
        elif found is None and _can_contradict(beside, place, rest):
            contradicting.append(block.photos[row].name)
    if contradicting and np.count_nonzero(oriented) + 1 >= _FEWEST:
        yield _contradicting(contradicting, _where_adjusted(without_photos(block, ~oriented), rest))


def _fitting(block: Block, photo: int, rest: SolvedBlock) -> FittingReading | None:
    return fitting_reading(_with_cameras_of(rest, block), photo, _known(block, rest), rest.variance.sigma0)


def _contradicting(names: Sequence[str], without: Block) -> Hypothesis:
    them = "it" if len(names) == 1 else "them"
    they = "it does" if len(names) == 1 else "they do"
    its = "its" if len(names) == 1 else "their"
    text = (
        f"the other photos fit without {them}, and {they} not fit them: check {its} numbers of points, {its} camera "
        f"and {its} measurements, or leave {them} out"
    )
    # the photo itself has no starting value
    return Hypothesis(without, finding(_CONTRADICTING, counted_names("photo", names), text), concerns_start=True)


def _with_cameras_of(solved: SolvedBlock, block: Block) -> Block:
    """Return a block with the cameras as they were adjusted: the values where they start may be far off."""
    found = {of.name: values for of, values in zip(solved.block.cameras, solved.state.cameras.tolist(), strict=True)}
    cameras = tuple(replace(of, parameters=tuple(found.get(of.name, of.parameters))) for of in block.cameras)
    return replace(block, cameras=cameras)


def _can_contradict(block: Block, photo: int, rest: SolvedBlock) -> bool:
    """Return whether a photo has enough of the known points: with few it cannot be oriented, and nothing is wrong."""
    points, known = block.photo_points, _known(block, rest)
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
    given = np.delete(block.photo_orientation, photo, axis=0)
    orientation = np.insert(_adjusted_orientation(given, rest), photo, found.orientation, axis=0)
    if block.photos[photo].constant:
        orientation[photo] = block.photo_orientation[photo]
    changed = replace(found.reading.block, photo_orientation=orientation)
    return Hypothesis(changed, finding(found.reading.kind, f"photo {block.photos[photo].name}", found.reading.text))


def _where_adjusted(block: Block, rest: SolvedBlock) -> Block:
    """Return a block whose photos start where they were adjusted."""
    return replace(block, photo_orientation=_adjusted_orientation(block.photo_orientation, rest))


def _adjusted_orientation(given: FloatArray, rest: SolvedBlock) -> FloatArray:
    """Return the orientations (number of photos, 6) of an adjustment, but those that are held as given."""
    adjusted = np.hstack([rest.state.centres, angles_from_rotation(rest.state.rotations)])
    held = np.array([bool(record.constant) for record in rest.block.photos])
    return np.where(held[:, None], given, adjusted)
