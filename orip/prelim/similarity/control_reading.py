"""Control that fits a block as a mirror image, with another unit of Z, or as longitude and latitude.

A similarity with reflection fits equally well whether X and Y of the control are exchanged, one axis has the opposite
sign, or the photos are mirrored: mirrored photos give a block that is a perfect mirror image, with all points in front
of the cameras. Only the positions and the attitude of the cameras differ. Three points, or points in a plane, fit with
and without a reflection; only the side on which the cameras are decides.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarity, fit_similarity
from orip.prelim.sampling import median
from orip.prelim.similarity.absolute_orientation import KnownPositions, control_of_block
from orip.prelim.similarity.adjustment import CommonPoints, adjust_similarity
from orip.prelim.similarity.joining import Names
from orip.prelim.similarity.start import TRIPLES, start_from_triples
from orip.records.preliminary import ControlReading, PartialBlock
from orip.structs import replace
from orip.units import METRES_PER_FOOT

_BETTER = 0.1
"""A reading has to reduce the misfit to this part. A long block that is not adjusted yet may be so bent that a wrong
reading of few points fits three times better by chance."""

_BETTER_THAN_FROM_BELOW = 0.5
"""The same limit where the cameras look up from below the control as given: few photos are taken that way."""

_BETTER_THAN_FLAT = 0.7
"""A reading of X, Y or the unit of Z has to fit so much better than the control without its heights; otherwise single
heights are wrong, and any reading fits in which they are small."""

_EXPECTED = 3.0
"""Standard errors within which control fits as given, so that no other reading is needed."""

_MET = 0.1
"""Part of the distance from cameras to control within which projection centres are at their known positions."""

_TOO_FEW = 5
"""Number of points up to which a robust fit may accept any three of them and reject the others."""

_OF_ONE, _FEWEST_OF_ONE, _TOO_FEW_TO_HIDE = 0.1, 5, 10
"""Part of the misfit that remains without the one point that is wrong: no unit is, then. Fewer points always fit
without one of them, and more fit in spite of one."""

_ENOUGH = 60
"""Most control points that are compared: a wrong reading concerns nearly all of them."""

_METRES_PER_DEGREE = 111_195.0
"""Metres in a degree on a sphere of radius 6371 km; within a block the flattening does not matter."""

_DEGREES = 5.0
"""Largest extent of a block in latitude plus longitude: 500 km."""

_UPRIGHT = 0.5
"""Mean cosine from which photos are said to look down or to stand upright."""

_Z_FACTORS = (METRES_PER_FOOT, 1.0 / METRES_PER_FOOT, 1e-3, 1e3)

_CHANGES = {
    "exchanged": np.eye(3)[[1, 0, 2]],
    "X": np.diag([-1.0, 1.0, 1.0]),
    "Y": np.diag([1.0, -1.0, 1.0]),
    "Z": np.diag([1.0, 1.0, -1.0]),
    "photos": np.eye(3),
}
"""Matrices that take the control as given to the control as it would have to be."""


class _Fit(Struct, frozen=True):
    similarity: Similarity
    misfit: float


def other_reading(
    block: PartialBlock, names: Names, control: KnownPositions, centres: KnownPositions | None = None
) -> ControlReading | None:
    """Return the reading in which control fits a block that it does not fit as given.

    Parameters
    ----------
    block : PartialBlock
        In its own system.
    control : KnownPositions
        As given; at least three points known in X, Y and Z are needed.
    centres : KnownPositions, optional
        Known projection centres: they distinguish exchanged axes from mirrored photos.

    Returns
    -------
    ControlReading or None
        None where the control fits as given, or no reading makes it fit.
    """
    _, common = control_of_block(block, names, control)
    common = _sample(common)
    if len(common.source) < 3:
        return None
    given = _fit(common)
    if given is None:
        return None
    if (geographic := _geographic(common, given)) is not None:
        return geographic
    mirrored = _fit(replace(common, source=-common.source))
    if mirrored is None:
        return None
    mirrored = _Fit(replace(mirrored.similarity, rotation=-mirrored.similarity.rotation), mirrored.misfit)
    expected = _EXPECTED * median(common.errors(given.similarity))
    better = _BETTER_THAN_FROM_BELOW if _is_from_below(block, common, given) else _BETTER
    if given.misfit > expected and mirrored.misfit < better * given.misfit:
        changes = _changes(block, names, mirrored.similarity, centres)
        side = camera_side(mirrored.similarity.rotation @ block.rotations)
        count = len(common.source)
        return ControlReading("mirror image", count, mirrored.misfit, given.misfit, changes=changes, side=side)
    if given.misfit > expected:
        return _other_unit(common, given)
    # where the points exclude a reflection, the side of the cameras need not be looked at
    if mirrored.misfit <= max(expected, given.misfit / _BETTER):
        return _from_below(block, common, given)
    return None


def _flat_misfit(common: CommonPoints) -> float:
    """Return the misfit of the control without its heights, in units of the block; infinite where nothing fits.

    Where heights alone are wrong, every reading fits that makes them small beside X and Y.
    """
    target = common.target * [1.0, 1.0, 0.0]
    fit = _fit(replace(common, target=target))
    return float("inf") if fit is None else fit.misfit / fit.similarity.scale


def _geographic(common: CommonPoints, given: _Fit) -> ControlReading | None:
    """Return longitude and latitude in degrees as the reading if they fit, and X and Y as lengths do not."""
    x, y, _ = common.target.T
    for longitude, latitude in ((0, 1), (1, 0)):
        in_range = (
            np.abs(common.target[:, longitude]).max() <= 180.0 and np.abs(common.target[:, latitude]).max() <= 90.0
        )
        if not in_range or np.ptp(x) + np.ptp(y) > _DEGREES:
            continue
        metres = _METRES_PER_DEGREE * np.array([np.cos(np.radians(common.target[:, latitude].mean())), 1.0])
        target = np.column_stack([common.target[:, [longitude, latitude]] * metres, common.target[:, 2]])
        fit = _fit(replace(common, target=target))
        if fit is None:
            continue
        # all misfits in units of the block
        own = fit.misfit / fit.similarity.scale
        if own < _BETTER * given.misfit / given.similarity.scale and own < _BETTER_THAN_FLAT * _flat_misfit(common):
            count = len(common.source)
            if longitude == 0:
                return ControlReading("longitude, latitude", count, fit.misfit, given.misfit)
            return ControlReading("latitude, longitude", count, fit.misfit, given.misfit)
    return None


def _sample(common: CommonPoints) -> CommonPoints:
    """Return points that are known in full, at most `_ENOUGH`, evenly from the first to the last."""
    full = np.flatnonzero(common.full)
    return common.of(full[np.unique(np.linspace(0, len(full) - 1, min(len(full), _ENOUGH)).astype(np.int64))])


def _fit(common: CommonPoints) -> _Fit | None:
    """Return the fit and its typical residual, ground units; None where the points determine none."""
    try:
        if len(common.source) <= _TOO_FEW:
            similarity = fit_similarity(common.source, common.target)
            squares = ((similarity.apply(common.source) - common.target) ** 2).sum(axis=1)
            return _Fit(similarity, float(np.sqrt(squares.mean())))
        found = adjust_similarity(common, start_from_triples(common, TRIPLES[:1]))
    except ValueError:
        return None
    return _Fit(found.similarity, median(found.lengths))


def _changes(
    block: PartialBlock, names: Names, mirrored: Similarity, centres: KnownPositions | None
) -> tuple[str, ...]:
    """Return the changes of `_CHANGES` that bring projection centres to their known positions."""
    known = _known_centres(block, names, centres)
    if known is None:
        return ()
    rows, positions = known
    found = mirrored.apply(block.centres[rows])
    distance = float(np.median(np.linalg.norm(found - mirrored.apply(block.coordinates).mean(axis=0), axis=1)))
    return tuple(
        change
        for change, matrix in _CHANGES.items()
        if float(np.median(np.linalg.norm(found @ matrix.T - positions, axis=1))) < _MET * distance
    )


def _known_centres(
    block: PartialBlock, names: Names, centres: KnownPositions | None
) -> tuple[IntArray, FloatArray] | None:
    """Return rows of the block's photos whose centres are known, and these positions; None without any."""
    if centres is None:
        return None
    own = {names.photos[k]: row for row, k in enumerate(block.photos)}
    pairs = [
        (own[name], position)
        for name, position in zip(centres.names, centres.coordinates, strict=True)
        if name in own and np.isfinite(position).all()
    ]
    if not pairs:
        return None
    return np.array([row for row, _ in pairs]), np.array([position for _, position in pairs])


def camera_side(rotations: FloatArray) -> float:
    """Return 1 where photos look down or stand upright, -1 where they look up or are upside down, else 0.

    It follows from the third and second columns of the rotations, which a mirrored photo has, too.
    """
    down, up = rotations[:, 2, 2].mean(), rotations[:, 2, 1].mean()
    clearer = float(down if abs(down) >= abs(up) else up)
    return float(np.sign(clearer)) if abs(clearer) > _UPRIGHT else 0.0


def _other_unit(common: CommonPoints, given: _Fit) -> ControlReading | None:
    """Return another unit of Z as the reading if it explains the misfit."""
    fits = {}
    for factor in _Z_FACTORS:
        scaled = np.array([1.0, 1.0, factor])
        fit = _fit(replace(common, target=common.target * scaled, target_deviation=common.target_deviation * scaled))
        if fit is not None:
            fits[factor] = fit
    if not fits:
        return None
    factor = min(fits, key=lambda candidate: fits[candidate].misfit)
    fit = fits[factor]
    own = fit.misfit / fit.similarity.scale
    if fit.misfit >= _BETTER * given.misfit or own >= _BETTER_THAN_FLAT * _flat_misfit(common):
        return None
    if _misfit_without_one(common) < _OF_ONE * given.misfit:
        return None
    return ControlReading("unit of Z", len(common.source), fit.misfit, given.misfit, z_factor=factor)


def _misfit_without_one(common: CommonPoints) -> float:
    """Return the least misfit as given that leaving out one point leaves; infinite of points too few to show it."""
    count = len(common.source)
    if not _FEWEST_OF_ONE <= count <= _TOO_FEW_TO_HIDE:
        return float("inf")
    fits = (_fit(common.of(np.delete(np.arange(count), row))) for row in range(count))
    return min((fit.misfit for fit in fits if fit is not None), default=float("inf"))


def _from_below(block: PartialBlock, common: CommonPoints, given: _Fit) -> ControlReading | None:
    """Return the mirrored reading if points that fit with and without a reflection are seen from below."""
    if not _is_from_below(block, common, given):
        return None
    return ControlReading("from below", len(common.source), given.misfit, given.misfit)


def _is_from_below(block: PartialBlock, common: CommonPoints, given: _Fit) -> bool:
    """Return whether the cameras look up from below the control as it is given, and down in its mirror image.

    The mirror image of a facade has the cameras behind it, at the same heights.
    """
    normal = np.linalg.svd(common.target - common.target.mean(axis=0), full_matrices=False)[2][2]
    if abs(normal[2]) < _UPRIGHT:
        return False
    rotations = given.similarity.rotation @ block.rotations
    heights = given.similarity.apply(block.centres)[:, 2]
    return bool(rotations[:, 2, 2].mean() <= -_UPRIGHT and heights.mean() <= common.target[:, 2].mean())
