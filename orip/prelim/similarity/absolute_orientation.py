"""Absolute orientation: the similarity that takes a block to the ground, by control points known in full or in part."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.sampling import median
from orip.prelim.similarity.adjustment import CommonPoints, SimilarityAdjustment, adjust_similarity
from orip.prelim.similarity.joining import Joined, Names, similarity_step
from orip.prelim.similarity.partial_blocks import steady_deviations, transformed
from orip.prelim.similarity.start import adjusted_from_all_sides, of_lowest_cost, start_from_triples
from orip.records.preliminary import NO_CONTROL, NotOriented, PartialBlock
from orip.structs import replace
from orip.wording import agreeing, counted

_CONSTANT = 0.1
"""Part of the median a-priori error that is used in place of the error 0 of a constant coordinate."""

_CENTRE = 0.01
"""A-priori error of projection centres that are given without one, as a part of their extent."""

_AGREEMENT = 0.3
"""Median residual, as a part of the extent of the control, above which block and control are not of the same object.
Blocks of an uncalibrated camera may be bent by a fifth; points with interchanged names lie some 0.5 apart. Control that
fits as its a-priori errors say, as positions of a few photos, is of the same object whatever these are."""

_BESIDE_ONE_LINE = 3.0
"""Standard deviations by which points must deviate from a line to determine the rotation about it."""

_FAR_MORE_PRECISE, _MOST_PRECISE = 5.0, 100
"""Ratio of a-priori errors, or of distances from a line, from which on the middle one tells nothing of a position; most
positions that are tried from all sides for that."""

_WELL = 2.0
"""Standard error of unit weight up to which control that is known in part and in full agrees."""

_COORDINATES = 7

_FEWEST = 3
"""Number of known positions that may determine a similarity."""

_FEW = 7
"""Number of points known in full up to which wrong ones among them may not be revealed."""


class KnownPositions(Struct, frozen=True):
    """Points or projection centres whose ground coordinates are known.

    Parameters
    ----------
    names : tuple of str
        n names.
    coordinates : array (n, 3)
        Ground units; NaN where not known.
    errors : array (n, 3)
        A-priori errors; 0 or NaN: constant, or in a centre not known; a negative one: not to be used.
    """

    names: tuple[str, ...]
    coordinates: FloatArray
    errors: FloatArray


def absolute_orientation(
    block: PartialBlock, names: Names, control: KnownPositions, centres: KnownPositions | None = None
) -> Joined | NotOriented:
    """Take a block to the ground.

    Parameters
    ----------
    names : Names
        For the block's indices.
    control : KnownPositions
        Control points; those that are not in the block are ignored.
    centres : KnownPositions, optional
        Projection centres, used where the control points alone do not suffice.

    Returns
    -------
    Joined or NotOriented
        Three points known in full and off one line are needed, or seven coordinates that determine the similarity.
    """
    found = _from(block, names, control)
    if isinstance(found, Joined) or centres is None:
        return found
    with_centres = _from(block, names, control, centres)
    if isinstance(with_centres, NotOriented):
        # what is the matter with given stations has to be said: without control points they are all there is
        why = f"{with_centres.reason}; {found.reason}" if len(centres.names) >= _FEWEST else found.reason
        return replace(found, reason=why)
    remark = f"projection centres are used as control, since without them {found.reason}"
    return replace(with_centres, step=replace(with_centres.step, remarks=(remark, *with_centres.step.remarks)))


def control_of_block(
    block: PartialBlock, names: Names, control: KnownPositions, centres: KnownPositions | None = None
) -> tuple[tuple[str, ...], CommonPoints]:
    """Return the control that is in a block, projection centres below the points, and its names: "photo P1"."""
    own = {names.points[k]: row for row, k in enumerate(block.points)}
    rows, at, target, errors = _usable(control, own)
    chosen = [control.names[k] for k in rows]
    source, deviation = block.coordinates[at], steady_deviations(block)[at]
    if centres is not None:
        photos = {names.photos[k]: row for row, k in enumerate(block.photos)}
        given, at_centre, place, error = _usable(centres, photos)
        chosen += [f"photo {centres.names[k]}" for k in given]
        reduced = place - place.mean(axis=0) if len(place) else place
        usual = _CENTRE * float(np.sqrt((reduced**2).sum(axis=1).mean())) if len(place) else 0.0
        source = np.vstack([source, block.centres[at_centre]])
        deviation = np.vstack([deviation, np.zeros((len(at_centre), 3))])
        target = np.vstack([target, place])
        errors = np.vstack([errors, np.where(error > 0.0, error, usual)])
    held = np.isfinite(target) & ~(errors > 0.0)
    positive = errors[errors > 0.0]
    errors = np.where(held, _CONSTANT * median(positive) if positive.size else 0.0, errors)
    return tuple(chosen), CommonPoints(source, target, deviation, errors, np.zeros(len(source), dtype=bool))


def _usable(known: KnownPositions, own: dict[str, int]) -> tuple[IntArray, IntArray, FloatArray, FloatArray]:
    """Return rows of the known positions, rows of the block, coordinates and errors of what is in both."""
    used = np.isfinite(known.coordinates) & ~(known.errors < 0.0)
    rows = np.array([k for k, name in enumerate(known.names) if name in own and used[k].any()], dtype=np.int64)
    at = np.array([own[known.names[k]] for k in rows], dtype=np.int64)
    return rows, at, np.where(used, known.coordinates, np.nan)[rows], np.where(used, known.errors, np.nan)[rows]


def _from(
    block: PartialBlock, names: Names, control: KnownPositions, centres: KnownPositions | None = None
) -> Joined | NotOriented:
    points, common = control_of_block(block, names, control, centres)
    remarks: list[str] = []
    of_photos = sum(name.startswith("photo ") for name in points) if centres is not None else 0
    noun = "exposure station" if of_photos == len(points) else "control point"
    try:
        found = fit_to_control(common, block.rotations, remarks, noun)
    except ValueError as error:
        return NotOriented(block.name, "", str(error))
    typical, extent = median(found.lengths), common.extent
    if typical > (extent if found.s0 < _WELL else _AGREEMENT * extent):
        return NotOriented(
            block.name,
            "",
            f"the control does not fit the block: residuals are {typical:.3g} with an extent of {extent:.3g} "
            f"({len(points)} control points: {', '.join(points)})",
        )
    step = similarity_step(found, "absolute", (block.name, ""), points, common.target)
    remarks += misfitting_control(points, found)
    return Joined(found.similarity, transformed(block, found.similarity), replace(step, remarks=tuple(remarks)))


def fit_to_control(
    common: CommonPoints, rotations: FloatArray, remarks: list[str], noun: str = "control point"
) -> SimilarityAdjustment:
    """Adjust the similarity from the block to its control.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Of the block's photos; of two solutions that fit equally the one with upright photos is used.
    remarks : list of str
        A remark on that choice is added to it.
    noun : str
        What the control is.

    Raises
    ------
    ValueError
        When the control does not suffice: too few points or coordinates, or points on one line.
    """
    full = common.full
    count = int(np.count_nonzero(full))
    width, length = _width(common)
    on_line = width < _BESIDE_ONE_LINE * _middle_error(common, width, length)
    if count >= 3 and not on_line:
        found = adjust_similarity(common, start_from_triples(common))
        if found.fits.all() and found.s0 < _WELL:
            return found
        if _is_of_the_precise(common, found) or _is_of_those_beside(common, found):
            # of two control points and many stations, these may be given up for what the others scatter by
            solutions = found, adjusted_from_all_sides(common, rotations, [])
            held = [solution for solution in solutions if not _is_of_those_beside(common, solution)]
            return of_lowest_cost(common, held or solutions)
        if full.all() or count > _FEW:
            return found
        # among few full points the wrong ones are revealed only by those known in part
        other = adjusted_from_all_sides(common, rotations, [])
        return min(found, other, key=lambda solution: median(solution.lengths))
    known = common.known
    axes = known.sum(axis=0)
    if count == len(full) and count >= 3:
        raise ValueError(_in_a_row(common, noun, width, length))
    if axes.sum() < _COORDINATES:
        raise ValueError(_too_few(count, len(full), axes))
    try:
        return adjusted_from_all_sides(common, rotations, remarks)
    except ValueError:
        message = (
            f"the known coordinates (X of {axes[0]}, Y of {axes[1]}, Z of {axes[2]} points) do not determine position, "
            "rotation and scale: two points known in X and Y and three in Z, off one line, are needed"
        )
        raise ValueError(message) from None


def _is_of_the_precise(common: CommonPoints, found: SimilarityAdjustment) -> bool:
    """Tell whether positions do not fit that are far more precise than most, in a block of few."""
    if len(common.source) > _MOST_PRECISE:
        return False
    errors = common.errors(found.similarity).max(axis=1)
    return bool((errors[~found.fits] < median(errors) / _FAR_MORE_PRECISE).any())


def _is_of_those_beside(common: CommonPoints, found: SimilarityAdjustment) -> bool:
    """Tell whether the positions that do not fit lie far beside the line of the others, as control beside one strip.

    They alone fix the rotation about it: without them the block may be turned to where a bent one fits the line best.
    """
    if len(common.source) > _MOST_PRECISE:
        return False
    across, _ = _spread(common.source[found.fits])
    return across < _spread(common.source)[0] / _FAR_MORE_PRECISE


def _in_a_row(common: CommonPoints, noun: str, width: float, length: float) -> str:
    """Return why control on one line, or at one place, does not suffice, and what to do."""
    places = common.target[common.full]
    of_photos = noun == "exposure station"
    if length < _BESIDE_ONE_LINE * _middle_error(common, width, length):
        farthest = float(np.linalg.norm(np.ptp(places, axis=0)))
        more = "check their coordinates" if of_photos else "measure others, far from there"
        where = f"all {counted(len(places), noun)} are at one place (distance {farthest:.3g})"
        return f"{where}, so they fix neither scale nor rotation; {more}"
    more = "give a control point off the line" if of_photos else "measure one more, off the line"
    where = f"the {noun}s lie on one line: they deviate from it by {width:.2g} over a length of {length:.3g}"
    return f"{where}, so they do not fix the rotation about it; {more}"


def _too_few(full: int, points: int, axes: IntArray) -> str:
    if not points:
        return NO_CONTROL
    control = counted(points, "control point")
    if full == points:
        return f"{control} in the block, 3 are needed"
    return (
        f"{control} in the block with {axes.sum()} known coordinates (X of {axes[0]}, Y of {axes[1]}, Z of {axes[2]}): "
        f"3 points known in X, Y and Z or at least {_COORDINATES} coordinates are needed"
    )


def _width(common: CommonPoints) -> tuple[float, float]:
    """Return root mean square distances across and along the line of best fit of the full points, ground units."""
    return _spread(common.target[common.full])


def _spread(positions: FloatArray) -> tuple[float, float]:
    """Return root mean square distances of positions (n, 3) across and along their line of best fit; 0 of two."""
    if len(positions) < _FEWEST:
        return 0.0, 0.0
    singular = np.linalg.svd(positions - positions.mean(axis=0), compute_uv=False) / np.sqrt(len(positions))
    return float(singular[1]), float(singular[0])


def _middle_error(common: CommonPoints, width: float, length: float) -> float:
    """Return the median error of the full points, ground units; a millionth of their length where none is given."""
    if not length:
        return np.inf
    source = common.source[common.full]
    size = float(np.sqrt(((source - source.mean(axis=0)) ** 2).sum(axis=1).mean()))
    scale = float(np.hypot(length, width)) / max(size, 1e-300)
    errors = common.errors(Similarity(scale, np.eye(3), np.zeros(3)))[common.full]
    given = (common.source_deviation > 0.0).any() or (common.target_deviation > 0.0).any()
    return max(median(errors), 1e-6 * length) if given else 1e-6 * length


def misfitting_control(points: Sequence[str], found: SimilarityAdjustment) -> list[str]:
    """Return a sentence for each control point of which a coordinate does not fit."""
    full = (found.weight_factor == 1.0) & np.isfinite(found.residuals)
    usual = float(np.sqrt(np.mean(found.residuals[full] ** 2))) if full.any() else 0.0
    sentences = []
    for k in np.argsort(-found.lengths):
        off = [axis for axis in range(3) if found.weight_factor[k, axis] < 1.0]
        if off:
            axes = ", ".join("XYZ"[axis] for axis in off)
            values = ", ".join(f"{found.residuals[k, axis]:.3g}" for axis in off)
            point = points[k] if points[k].startswith("photo ") else f"control point {points[k]}"
            sentences.append(
                f"{axes} of {point} {agreeing(len(off), 'does', 'do')} not fit: the block is off by "
                f"{values} (root mean square of the others: {usual:.2g})"
            )
    return sentences
