"""Space resection of one photo without initial values, and in the presence of blunders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orip.prelim.configuration import on_one_line
from orip.prelim.resection_adjustment import Adjusted, KnownPoints, Orientations, adjusted, improved
from orip.prelim.resection_start import starting_orientations

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_WORTHLESS_ANGLE = 0.1
"""Standard deviation of a rotation, radians: off by 6 degrees no adjustment starts well."""

_WORTHLESS_CENTRE = 0.2
"""Standard deviation of the projection centre over its distance from the points."""

_MISFIT = 0.04
"""Residuals over the radius of the image points; a camera constant that is wrong by a tenth leaves less."""

_ALIKE = 3.0
"""Excess of squared residuals, over those expected, up to which a second orientation is another possibility."""

_SAME = 0.02
"""Radians, and parts of the distance: orientations nearer to each other are one, stopped before its end."""


@dataclass(frozen=True, slots=True)
class Resected:
    """The orientation of a photo from n known points.

    Parameters
    ----------
    rotation : array (3, 3)
        Photo to ground.
    centre : array (3,)
        Ground units.
    rotation_deviation : array (3,)
        Standard deviations of small rotations about the ground axes, radians.
    centre_deviation : array (3,)
    residuals : array (n, 2)
        Computed minus measured, mm; NaN for a point behind the photo.
    weight_factor : array (n,)
        Below 1: down-weighted.
    s0 : float
        Standard error of unit weight; 1 without redundancy.
    redundancy : int
        Of the points with full weight.
    alternatives : Orientations
        Others that fit the points as well or nearly so, the best first; with more than three points seldom any.
    how : str
        What was done, as a sentence.
    remarks : tuple of str
        What the user should know, in sentences.
    """

    rotation: FloatArray
    centre: FloatArray
    rotation_deviation: FloatArray
    centre_deviation: FloatArray
    residuals: FloatArray
    weight_factor: FloatArray
    s0: float
    redundancy: int
    alternatives: Orientations
    how: str
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Unresected:
    """Why a photo could not be oriented, as a sentence."""

    reason: str


def resect(
    vectors: FloatArray,
    points: FloatArray,
    point_deviation: FloatArray | None = None,
    *,
    error_mm: float = 0.01,
    seed: int = 0,
) -> Resected | Unresected:
    """Orient a photo by known points, some of which may be wrong.

    Parameters
    ----------
    vectors : array (n, 3)
        Image vectors (x, y, -C), mm.
    points : array (n, 3)
        Ground coordinates.
    point_deviation : array (n,) or None
        Standard deviation of a ground coordinate, NaN where it is not known; None: the photo's error alone counts.
    error_mm : float
        A-priori error of a photo coordinate. Residuals may be larger altogether (a camera that is not calibrated): the
        scale of what is a blunder is estimated.
    seed : int
        Of the choice among many triples of points; equal input gives equal output.

    Returns
    -------
    Resected or Unresected
        With three points, that of several orientations is taken which looks at them most squarely; the others are its
        alternatives.

    Notes
    -----
    Up to 35 % of the points may be blunders, if four are left. The best orientations of triples are improved on the
    points that fit them best; that with the smallest residuals is adjusted with all points and Danish weights.
    """
    count = len(points)
    if count < 3:
        return Unresected(f"{count} known point{'s' if count != 1 else ''} in the photo, 3 are needed")
    for coordinates, where in ((points, "in space"), (vectors[:, :2], "in the photo")):
        if on_one_line(coordinates):
            return Unresected(f"the {count} known points lie on one line {where}")
    centroid = points.mean(axis=0)
    spread = float(np.sqrt(np.mean(np.sum((points - centroid) ** 2, axis=1))))
    deviations = np.zeros(count) if point_deviation is None else np.nan_to_num(point_deviation) / spread
    known = KnownPoints(vectors, (points - centroid) / spread, deviations, error_mm)
    start = starting_orientations(known, seed)
    if not len(start.centres):
        return Unresected(f"from nowhere are the {count} known points seen as they are in the photo")
    best, others = _best_of_three(known, start) if count == 3 else _best_of_many(known, start)
    unfit = _unfit(known, best)
    return Unresected(unfit) if unfit is not None else _result(best, others, centroid, spread)


def _best_of_three(known: KnownPoints, start: Orientations) -> tuple[Adjusted, Orientations]:
    return adjusted(known, start.of(slice(0, 1)), 1.0), start.of(slice(1, None))


def _best_of_many(known: KnownPoints, start: Orientations) -> tuple[Adjusted, Orientations]:
    """Return the adjusted orientation, and others whose residuals are not much larger."""
    tried, squares = improved(known, start)
    variance = float(known.trimmed_variance(squares).min())
    possible = _distinct(tried.of(_alike(known, squares)))
    found = [adjusted(known, possible.of(slice(row, row + 1)), variance) for row in range(len(possible.centres))]
    ends = _alike(known, np.concatenate([each.equations.squares for each in found]))
    at = [found[row].at for row in ends]
    others = Orientations(
        np.concatenate([each.rotations for each in at]), np.concatenate([each.centres for each in at])
    )
    return found[ends[0]], _distinct(others).of(slice(1, None))


def _alike(known: KnownPoints, squares: FloatArray) -> IntArray:
    """Return which of the squared residuals (k, n) are the least or not much more, the least first."""
    costs = np.nan_to_num(known.costs(squares), nan=np.inf)  # an orientation may have run away
    order = np.argsort(costs, kind="stable")
    expected = max(2 * known.least - 6, 2)
    return np.asarray(order[costs[order] <= costs[order[0]] + _ALIKE * expected])


def _distinct(orientations: Orientations) -> Orientations:
    """Return those that differ from all before them."""
    rotations, centres = orientations
    turn = np.sqrt(((rotations[:, None] - rotations) ** 2).sum(axis=(2, 3)) / 2.0)
    shift = np.sqrt(((centres[:, None] - centres) ** 2).sum(axis=2) / (centres**2).sum(axis=1)[:, None])
    same = (turn < _SAME) & (shift < _SAME)
    kept = [0]
    for row in range(1, len(centres)):
        if not same[kept, row].any():
            kept.append(row)
    return orientations.of(np.array(kept))


def _unfit(known: KnownPoints, best: Adjusted) -> str | None:
    """Return why the orientation is worth nothing; None: it is worth something."""
    xy = known.vectors[:, :2]
    radius = float(np.linalg.norm(xy - xy.mean(axis=0), axis=1).max())
    full = best.weight_factors == 1.0
    # s0 would count the error of the points as well
    squares = best.equations.residual[0][full] ** 2
    residual = float(np.sqrt(squares.sum() / max(squares.size, 1)))
    if not residual <= _MISFIT * radius:
        return (
            f"the {len(known)} known points do not fit their images: residuals of {residual:.2g} mm within "
            f"{radius:.3g} mm"
        )
    angle, shift = _deviations(best).reshape(2, 3).max(axis=1)
    shift /= np.linalg.norm(best.at.centres[0])
    if not (angle <= _WORTHLESS_ANGLE and shift <= _WORTHLESS_CENTRE):
        return (
            f"the {len(known)} known points do not determine the photo: its standard deviations are "
            f"{np.degrees(angle):.2g} degrees and {shift:.0%} of the distance"
        )
    return None


def _deviations(best: Adjusted) -> FloatArray:
    """Return standard deviations (6,) of rotation and centre, infinite where the points leave them open."""
    scale = np.sqrt(np.diag(best.normals))
    if not scale.all():
        return np.full(6, np.inf)
    values, axes = np.linalg.eigh(best.normals / np.outer(scale, scale))
    # below this ratio an eigenvalue is rounding
    if values[0] < 1e-13 * values[-1]:
        return np.full(6, np.inf)
    return np.asarray(best.s0 * np.sqrt(np.sum(axes**2 / values, axis=1)) / scale)


def _result(best: Adjusted, others: Orientations, centroid: FloatArray, spread: float) -> Resected:
    """Return the orientation in the ground system."""
    count = len(best.weight_factors)
    down_weighted = int(np.count_nonzero(best.weight_factors < 1.0))
    deviations = _deviations(best)
    equations = best.equations
    return Resected(
        rotation=best.at.rotations[0],
        centre=centroid + spread * best.at.centres[0],
        rotation_deviation=deviations[:3],
        centre_deviation=spread * deviations[3:],
        residuals=np.where(equations.in_front[0][:, None], equations.residual[0], np.nan),
        weight_factor=best.weight_factors,
        s0=best.s0,
        redundancy=best.redundancy,
        alternatives=Orientations(others.rotations, centroid + spread * others.centres),
        how=f"space resection from {count} points" + (f", {down_weighted} down-weighted" if down_weighted else ""),
        remarks=_remarks(count, best.redundancy, len(others.centres)),
    )


def _remarks(count: int, redundancy: int, others: int) -> tuple[str, ...]:
    remarks = []
    if redundancy == 0:
        remarks.append("three points fit whatever their errors: nothing checks the orientation")
    if others and count == 3:
        remarks.append(f"{others + 1} positions fit three points; taken is the one that looks at them most squarely")
    elif others:
        remarks.append("another position of the camera fits the points almost as well")
    return tuple(remarks)
