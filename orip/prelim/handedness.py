"""Control that would fit if it were a mirror image, or had another unit in Z: what was probably mixed up.

A similarity with reflection fits equally well whether X and Y of the control are exchanged, one axis counts backwards,
or the photos are mirrored: mirrored photos give a block that is a perfect mirror image, points in front of the cameras
and all. What differs is where the cameras are then, and how they look. Three points, or points in a plane, fit with and
without a reflection; only the side of the cameras tells.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.geometry.similarity import Similarity, fit_similarity
from orip.prelim.similarity.absolute_orientation import KnownPositions, control_of_block
from orip.prelim.similarity.adjustment import adjust_similarity
from orip.prelim.similarity.common_points import CommonPoints
from orip.prelim.similarity.joining import Names
from orip.prelim.similarity.start import TRIPLES, start_from_triples
from orip.records.preliminary import PartialBlock

_BETTER = 0.1
"""Of the misfit as given: what fits that much better is what was meant. A long block that is not adjusted yet may be
bent so much that a wrong reading of few points fits three times better by chance."""

_EXPECTED = 3.0
"""Standard errors of the control; what fits within them as given needs no explanation."""

_NEAR = 0.1
"""Of the distance from the cameras to the control: known projection centres that are met."""

_TOO_FEW = 5
"""Points of which three always fit, and a robust fit would call the others wrong."""

_ENOUGH = 60
"""Control points that are looked at: what was mixed up was mixed up in all of them, but for a few."""

_METRES_PER_DEGREE = 111_195.0
"""On a sphere of the radius 6371 km; within a block its flattening is of no account."""

_DEGREES = 5.0
"""Largest extent of a block in latitude and longitude together, 500 km."""

_FOOT = 0.3048
_Z_UNITS = {
    _FOOT: "Z seems to be in feet, X and Y in metres",
    1.0 / _FOOT: "Z seems to be in metres, X and Y in feet",
    1e-3: "Z seems to be in thousandths of the unit of X and Y, as millimetres beside metres",
    1e3: "X and Y seem to be in thousandths of the unit of Z, as millimetres beside metres",
}
"""Factor of Z, and what it says."""

_EXCHANGED = "exchange the columns X and Y of the control file"
_CAUSES = {
    "swapped": "when X and Y are exchanged: the control file probably has north, east in place of X = east, Y = north; "
    + _EXCHANGED,
    "X": "when X has the opposite sign: X of the control seems to count to the west; reverse its sign",
    "Y": "when Y has the opposite sign: Y of the control seems to count to the south; reverse its sign",
    "Z": "when Z has the opposite sign: Z of the control seems to count downwards; reverse its sign",
    "mirrored": "when the photos are mirrored: their x seems to count to the left, as on film scanned from the back; "
    "reverse it, or check the fiducial marks",
    "swapped or mirrored": "as a mirror image: X and Y of the control are exchanged (north, east in place of X = east, "
    "Y = north), or one of them has the opposite sign, or the photos are mirrored (x counted to the left); the control "
    f"alone cannot tell which. {_EXCHANGED[0].upper()}{_EXCHANGED[1:]} first",
    "any": "as a mirror image: X and Y of the control are exchanged (north, east in place of X = east, Y = north), or "
    "one axis has the opposite sign, or the photos are mirrored (x counted to the left); check them in this order",
}

_BACK = {
    "swapped": np.eye(3)[[1, 0, 2]],
    "X": np.diag([-1.0, 1.0, 1.0]),
    "Y": np.diag([1.0, -1.0, 1.0]),
    "Z": np.diag([1.0, 1.0, -1.0]),
    "mirrored": np.eye(3),
}
"""What takes the control as given to the control as meant."""


@dataclass(frozen=True, slots=True)
class _Fit:
    similarity: Similarity
    misfit: float


def handedness(
    block: PartialBlock, names: Names, control: KnownPositions, centres: KnownPositions | None = None
) -> tuple[str, ...]:
    """Say what was probably mixed up in control that does not fit a block, or fits with the cameras below the ground.

    Parameters
    ----------
    block : PartialBlock
        In its own system.
    names : Names
    control : KnownPositions
        As given; three points known in X, Y and Z are needed to find anything.
    centres : KnownPositions, optional
        Projection centres that are known: they tell an exchange of axes from mirrored photos.

    Returns
    -------
    tuple of str
        Sentences; none where nothing is wrong or nothing explains it.
    """
    _, common = control_of_block(block, names, control)
    common = _some(common)
    if len(common.source) < 3:
        return ()
    given = _fit(common)
    if given is None:
        return ()
    if findings := _geographic(common, given):
        return findings
    mirrored = _fit(replace(common, source=-common.source))
    if mirrored is None:
        return ()
    mirrored = _Fit(replace(mirrored.similarity, rotation=-mirrored.similarity.rotation), mirrored.misfit)
    expected = _EXPECTED * float(np.median(common.errors(given.similarity)))
    if given.misfit > expected and mirrored.misfit < _BETTER * given.misfit:
        return (_fits(mirrored, given) + _CAUSES[_cause(block, names, mirrored.similarity, centres)],)
    if given.misfit > expected:
        return _other_unit(common, given)
    # a reflection that the points exclude needs no look at the cameras
    if mirrored.misfit <= max(expected, given.misfit / _BETTER):
        return _seen_from_below(block, common, given)
    return ()


def _geographic(common: CommonPoints, given: _Fit) -> tuple[str, ...]:
    """Say so when X and Y are longitude and latitude in degrees: taken as such they fit, and as lengths they do not."""
    x, y, _ = common.target.T
    for longitude, latitude, order in ((0, 1, "X, Y"), (1, 0, "Y, X")):
        in_range = (
            np.abs(common.target[:, longitude]).max() <= 180.0 and np.abs(common.target[:, latitude]).max() <= 90.0
        )
        if not in_range or np.ptp(x) + np.ptp(y) > _DEGREES:
            continue
        metres = _METRES_PER_DEGREE * np.array([np.cos(np.radians(common.target[:, latitude].mean())), 1.0])
        target = np.column_stack([common.target[:, [longitude, latitude]] * metres, common.target[:, 2]])
        fit = _fit(replace(common, target=target))
        # both misfits in units of the block
        if fit is not None and fit.misfit / fit.similarity.scale < _BETTER * given.misfit / given.similarity.scale:
            sentence = (
                f"the control fits when {order} are longitude and latitude in degrees, and orip wants X, Y and Z in "
                "one unit of length: convert them to projected coordinates (a national grid or UTM: easting, "
                "northing), and name the system as crs in [project] if the area is large"
            )
            return (sentence,)
    return ()


def _some(common: CommonPoints) -> CommonPoints:
    """Return points that are known in full, no more than are enough, from the first to the last."""
    full = np.flatnonzero(common.full)
    return common.of(full[np.unique(np.linspace(0, len(full) - 1, min(len(full), _ENOUGH)).astype(np.int64))])


def _fit(common: CommonPoints) -> _Fit | None:
    """Return the fit and its typical residual, ground units; None where the points determine none."""
    try:
        if len(common.source) <= _TOO_FEW:
            plain = fit_similarity(common.source, common.target)
            squares = ((plain.apply(common.source) - common.target) ** 2).sum(axis=1)
            return _Fit(plain, float(np.sqrt(squares.mean())))
        found = adjust_similarity(common, start_from_triples(common, TRIPLES[:1]))
    except ValueError:
        return None
    return _Fit(found.similarity, float(np.median(found.lengths)))


def _fits(better: _Fit, given: _Fit) -> str:
    return f"control fits within {better.misfit:.2g} (as given it fits within {given.misfit:.3g}) "


def _cause(block: PartialBlock, names: Names, mirrored: Similarity, centres: KnownPositions | None) -> str:
    """Return what explains a block that fits as a mirror image."""
    known = _known_centres(block, names, centres)
    if known is not None:
        rows, places = known
        found = mirrored.apply(block.centres[rows])
        distance = float(np.median(np.linalg.norm(found - mirrored.apply(block.coordinates).mean(axis=0), axis=1)))
        misses = {
            cause: float(np.median(np.linalg.norm(found @ back.T - places, axis=1))) for cause, back in _BACK.items()
        }
        met = [cause for cause, miss in misses.items() if miss < _NEAR * distance]
        if len(met) == 1:
            return met[0]
    side = _side(mirrored.rotation @ block.rotations)
    if side > 0.0:
        return "swapped or mirrored"
    return "Z" if side < 0.0 else "any"


def _known_centres(
    block: PartialBlock, names: Names, centres: KnownPositions | None
) -> tuple[NDArray[np.int64], FloatArray] | None:
    """Return rows of the block's photos and the places where their centres are known to be; None if nowhere."""
    if centres is None:
        return None
    own = {names.photos[k]: row for row, k in enumerate(block.photos)}
    pairs = [
        (own[name], place)
        for name, place in zip(centres.names, centres.coordinates, strict=True)
        if name in own and np.isfinite(place).all()
    ]
    if not pairs:
        return None
    return np.array([row for row, _ in pairs]), np.array([place for _, place in pairs])


def _side(rotations: FloatArray) -> float:
    """Return 1 where photos look down or stand upright, -1 where they look up or stand on their head, else 0.

    The third and second columns say so; they are the same in a mirrored photo.
    """
    down, up = rotations[:, 2, 2].mean(), rotations[:, 2, 1].mean()
    clearer = float(down if abs(down) >= abs(up) else up)
    return float(np.sign(clearer)) if abs(clearer) > 0.5 else 0.0


def _other_unit(common: CommonPoints, given: _Fit) -> tuple[str, ...]:
    """Return what another unit of Z explains."""
    fits = {}
    for factor in _Z_UNITS:
        scaled = np.array([1.0, 1.0, factor])
        fit = _fit(replace(common, target=common.target * scaled, target_deviation=common.target_deviation * scaled))
        if fit is not None:
            fits[factor] = fit
    if not fits:
        return ()
    factor = min(fits, key=lambda each: fits[each].misfit)
    if fits[factor].misfit >= _BETTER * given.misfit:
        return ()
    return (_fits(fits[factor], given) + f"when Z is multiplied by {factor:.5g}: {_Z_UNITS[factor]}; use one unit",)


def _seen_from_below(block: PartialBlock, common: CommonPoints, given: _Fit) -> tuple[str, ...]:
    """Say so when points that fit with and without a reflection are seen from below."""
    rotations = given.similarity.rotation @ block.rotations
    heights = given.similarity.apply(block.centres)[:, 2]
    if rotations[:, 2, 2].mean() > -0.5 or heights.mean() > common.target[:, 2].mean():
        return ()
    points = "three control points" if len(common.source) == 3 else "control points that lie in a plane"
    sentence = (
        f"{points} fit within {given.misfit:.2g}, but with the cameras below them, looking up; {points} fit a mirror "
        "image equally well. If the photos were taken from above, X and Y of the control are exchanged (north, east in "
        "place of X = east, Y = north), or one axis has the opposite sign, or the photos are mirrored; "
        f"{_EXCHANGED} first, or measure control points at other heights"
    )
    return (sentence,)
