"""Space resection of one photo without initial values, and in the presence of blunders."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.prelim.resection.adjustment import AdjustedResection, adjust_resection
from orip.prelim.resection.best_orientations import best_orientations
from orip.prelim.resection.configuration import on_one_line
from orip.prelim.resection.known_points import FEW_BLUNDERS, KnownPoints, Orientations
from orip.prelim.resection.start import starting_orientations
from orip.wording import counted

_USELESS_ANGLE = 0.1
"""Largest standard deviation of a rotation, radians: no adjustment starts well 6 degrees off."""

_USELESS_CENTRE = 0.2
"""Largest standard deviation of the projection centre, as a part of its distance from the points."""

_MISFIT = 0.04
"""Largest residuals, as a part of the radius of the image points; a principal distance wrong by a tenth leaves less."""


class Resected(Struct, frozen=True):
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


class Unresected(Struct, frozen=True):
    """Why a photo could not be oriented, as a sentence."""

    reason: str


def resect(
    vectors: FloatArray,
    points: FloatArray,
    point_deviation: FloatArray | None = None,
    *,
    error_mm: float = 0.01,
    blunders: float = FEW_BLUNDERS,
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
        A-priori error of a photo coordinate. All residuals may be larger (a camera that is not calibrated): the limit
        for blunders follows their estimated scale.
    blunders : float
        Largest part of the points that may be wrong; four points fit always.

    Returns
    -------
    Resected or Unresected
        Three points have up to four orientations: the one seeing them most nearly at right angles is used, the others
        are its alternatives.

    Notes
    -----
    The best orientations of triples are improved on the
    points that fit them best; that with the smallest residuals is adjusted with all points and Danish weights.
    """
    count = len(points)
    if count < 3:
        return Unresected(f"{counted(count, 'known point')} in the photo, 3 are needed")
    for coordinates, where in ((points, "in space"), (vectors[:, :2], "in the photo")):
        if on_one_line(coordinates):
            return Unresected(f"the {count} known points lie on one line {where}")
    centroid = points.sum(axis=0) / count
    offset = points - centroid
    spread = math.sqrt(np.vdot(offset, offset) / count)
    deviation = np.zeros(count) if point_deviation is None else point_deviation
    deviation = np.where(np.isnan(deviation), 0.0, deviation)
    known = KnownPoints(vectors, offset / spread, deviation / spread, error_mm, blunders)
    start = starting_orientations(known)
    if not len(start.centres):
        return Unresected(f"no camera position shows the {count} known points as measured; check point numbers and C")
    best, others = _best_of_three(known, start) if count == 3 else best_orientations(known, start)
    deviations = _deviations(best)
    unfit = _unfit(known, best, deviations)
    return Unresected(unfit) if unfit is not None else _result(best, others, deviations, centroid, spread)


def _best_of_three(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    return adjust_resection(known, start.of(slice(0, 1)), 1.0), start.of(slice(1, None))


def _unfit(known: KnownPoints, best: AdjustedResection, deviations: FloatArray) -> str | None:
    """Return why the orientation is useless; None if it can be used."""
    xy = known.vectors[:, :2]
    radius = math.sqrt(((xy - xy.sum(axis=0) / len(xy)) ** 2).sum(axis=1).max())
    # s0 would count the error of the points as well
    fitting = best.residual[best.weight_factors == 1.0]
    residual = math.sqrt(np.vdot(fitting, fitting) / max(fitting.size, 1))
    if not residual <= _MISFIT * radius:
        return (
            f"the {len(known)} known points do not fit their images: residuals of {residual:.2g} mm within "
            f"{radius:.3g} mm"
        )
    angle, shift = deviations.reshape(2, 3).max(axis=1)
    shift /= np.linalg.norm(best.at.centres[0])
    if not (angle <= _USELESS_ANGLE and shift <= _USELESS_CENTRE):
        return (
            f"the {len(known)} known points do not determine the photo: its standard deviations are "
            f"{np.degrees(angle):.2g} degrees and {shift:.0%} of the distance"
        )
    return None


def _deviations(best: AdjustedResection) -> FloatArray:
    """Return standard deviations (6,) of rotation and centre, infinite where the points do not determine them."""
    scale = np.sqrt(best.normals.diagonal())
    if not scale.all():
        return np.full(6, np.inf)
    values, axes = np.linalg.eigh(best.normals / (scale[:, None] * scale))
    # below this ratio an eigenvalue is nothing but rounding
    if values[0] < 1e-13 * values[-1]:
        return np.full(6, np.inf)
    return np.asarray(best.s0 * np.sqrt((axes**2 / values).sum(axis=1)) / scale)


def _result(
    best: AdjustedResection, others: Orientations, deviations: FloatArray, centroid: FloatArray, spread: float
) -> Resected:
    """Return the orientation in the ground system."""
    count, redundancy = len(best.weight_factors), best.redundancy
    down_weighted = int(np.count_nonzero(best.weight_factors < 1.0))
    return Resected(
        rotation=best.at.rotations[0],
        centre=centroid + spread * best.at.centres[0],
        rotation_deviation=deviations[:3],
        centre_deviation=spread * deviations[3:],
        residuals=np.where(np.isfinite(best.squares)[:, None], best.residual, np.nan),
        weight_factor=best.weight_factors,
        s0=best.s0,
        redundancy=redundancy,
        alternatives=Orientations(others.rotations, centroid + spread * others.centres),
        how=f"space resection from {count} points" + (f", {down_weighted} down-weighted" if down_weighted else ""),
        remarks=_remarks(count, redundancy, len(others.centres)),
    )


def _remarks(count: int, redundancy: int, others: int) -> tuple[str, ...]:
    remarks = []
    if redundancy == 0:
        remarks.append("three points always fit: nothing checks the orientation")
    if others and count == 3:
        remarks.append(
            f"{others + 1} positions fit three points; the one seeing them most nearly at right angles was used"
        )
    elif others:
        remarks.append("another position of the camera fits the points almost as well")
    return tuple(remarks)
