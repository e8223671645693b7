"""Space resection of one photo, or of many at once, without initial values, and in the presence of blunders."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import kernels
from orip.prelim.resection.known_points import (
    FEW_BLUNDERS,
    MANY_BLUNDERS,
    ONE_LINE,
    SURE,
    KnownPoints,
    Orientations,
    fits_beyond_chance,
    number_that_fits,
    on_one_line,
)
from orip.prelim.resection.start import (
    CANDIDATES,
    CHOICE,
    FITS,
    PLANE,
    AdjustedResection,
    best_orientations,
    starting_orientations,
    triples_for,
    triples_of,
)
from orip.structs import replace
from orip.wording import counted

USELESS_ANGLE = 0.1
"""Largest standard deviation of a rotation, radians: no adjustment starts well 6 degrees off."""

USELESS_CENTRE = 0.2
"""Largest standard deviation of the projection centre, as a part of its distance from the points."""

_SINGULAR = 1e-13
"""Ratio of eigenvalues of normal equations with unit diagonal below which the smallest one is nothing but rounding."""

_RULES, RULES_OF_TRACKS = (
    np.array([ONE_LINE, FITS, plane, *CHOICE, _SINGULAR], dtype=np.float64) for plane in (PLANE, 0.0)
)
"""The constants as the compiled loop takes them: `ResectionRules` in photo.h."""

MISFIT = 0.04
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
    deviation = np.zeros(count) if point_deviation is None else point_deviation
    given = KnownPoints(vectors, points, deviation, error_mm, blunders)
    found = (_solution_at_once(given) if count > 3 else None) or _solution(given)
    if isinstance(found, Unresected):
        return found
    unfit = _unfit(found)
    return Unresected(unfit) if unfit is not None else _result(found)


class _Solution(NamedTuple):
    """Orientations of a photo from n known points, and how well the best one fits.

    Attributes
    ----------
    at : Orientations
        In the ground system, the best first.
    residuals : array (n, 2)
        Of the best; NaN for a point behind the photo.
    weight_factors : array (n,)
    deviations : array (6,)
        Standard deviations of rotations about the ground axes, and of the projection centre; infinite where the points
        do not determine them.
    misfit : float
        Root mean square residual of a coordinate, of the points with full weight, mm.
    radius : float
        Of the image points about their centroid, mm.
    distance : float
        Of the projection centre from the centroid of the known points.
    """

    at: Orientations
    residuals: FloatArray
    weight_factors: FloatArray
    deviations: FloatArray
    s0: float
    redundancy: int
    misfit: float
    radius: float
    distance: float


def _solution_at_once(given: KnownPoints) -> _Solution | None:
    """Do what `_solution` does by one compiled loop; None where it finds no orientation, or something unusual."""
    count = len(given)
    rotations, centres = np.empty((CANDIDATES, 3, 3)), np.empty((CANDIDATES, 3))
    residuals, factors, found = np.empty((count, 2)), np.empty((CANDIDATES, count)), np.empty(11)
    rules = _RULES if given.blunders <= FEW_BLUNDERS else RULES_OF_TRACKS
    number = kernels.resect(
        *given.arrays, triples_of(given), rules, rotations, centres, factors, residuals, found,
        given.error_mm, given.least,
    )  # fmt: skip
    if not number:
        return None
    s0, redundancy, misfit, radius, distance = found[:5].tolist()
    at = Orientations(rotations[:number], centres[:number])
    return _Solution(at, residuals, factors[0], found[5:], s0, int(redundancy), misfit, radius, distance)


def _solution(given: KnownPoints) -> _Solution | Unresected:
    count, points, vectors = len(given), given.coordinates, given.vectors
    for coordinates, where in ((points, "in space"), (vectors[:, :2], "in the photo")):
        if on_one_line(coordinates):
            return Unresected(f"the {count} known points lie on one line {where}")
    centroid = points.sum(axis=0) / count
    offset = points - centroid
    spread = math.sqrt(np.vdot(offset, offset) / count)
    deviation = np.where(np.isnan(given.deviations), 0.0, given.deviations)
    known = replace(given, coordinates=offset / spread, deviations=deviation / spread)
    start = starting_orientations(known)
    if not len(start.centres):
        return Unresected(f"no camera position shows the {count} known points as measured; check point numbers and C")
    if count == 3:
        (best, _), others = best_orientations(known, start.of(slice(0, 1))), start.of(slice(1, None))
    else:
        best, others = best_orientations(known, start)
    xy, fitting = vectors[:, :2], best.residual[best.weight_factors == 1.0]
    reduced = best.at.joined(others)
    return _Solution(
        at=Orientations(reduced.rotations, centroid + spread * reduced.centres),
        residuals=np.where(np.isfinite(best.squares)[:, None], best.residual, np.nan),
        weight_factors=best.weight_factors,
        deviations=_deviations(best) * np.repeat([1.0, spread], 3),
        s0=best.s0,
        redundancy=best.redundancy,
        # s0 would count the error of the points as well
        misfit=math.sqrt(np.vdot(fitting, fitting) / max(fitting.size, 1)),
        radius=math.sqrt(((xy - xy.sum(axis=0) / count) ** 2).sum(axis=1).max()),
        distance=spread * float(np.linalg.norm(best.at.centres[0])),
    )


def _unfit(found: _Solution) -> str | None:
    """Return why the orientation is useless; None if it can be used."""
    count = len(found.weight_factors)
    if not found.misfit <= MISFIT * found.radius:
        return (
            f"the {count} known points do not fit their images: residuals of {found.misfit:.2g} mm within "
            f"{found.radius:.3g} mm"
        )
    deviations = found.deviations.tolist()
    angle, shift = max(deviations[:3]), max(deviations[3:]) / found.distance
    if not (angle <= USELESS_ANGLE and shift <= USELESS_CENTRE):
        return (
            f"the {count} known points do not determine the photo: with residuals of {found.misfit:.2g} mm its "
            f"standard deviations are {np.degrees(angle):.2g} degrees and {shift:.0%} of the distance"
        )
    return None


def _deviations(best: AdjustedResection) -> FloatArray:
    """Return standard deviations (6,) of rotation and centre, infinite where the points do not determine them."""
    scale = np.sqrt(best.normals.diagonal())
    if not scale.all():
        return np.full(6, np.inf)
    values, axes = np.linalg.eigh(best.normals / (scale[:, None] * scale))
    if values[0] < _SINGULAR * values[-1]:
        return np.full(6, np.inf)
    return np.asarray(best.s0 * np.sqrt((axes**2 / values).sum(axis=1)) / scale)


def _result(found: _Solution) -> Resected:
    count, others = len(found.weight_factors), found.at.of(slice(1, None))
    down_weighted = int(np.count_nonzero(found.weight_factors < 1.0))
    return Resected(
        rotation=found.at.rotations[0],
        centre=found.at.centres[0],
        rotation_deviation=found.deviations[:3],
        centre_deviation=found.deviations[3:],
        residuals=found.residuals,
        weight_factor=found.weight_factors,
        s0=found.s0,
        redundancy=found.redundancy,
        alternatives=others,
        how=f"space resection from {count} points" + (f", {down_weighted} down-weighted" if down_weighted else ""),
        remarks=_remarks(count, found.redundancy, len(others.centres)),
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


_JUDGEMENT = np.array([MISFIT, USELESS_ANGLE, USELESS_CENTRE, SURE], dtype=np.float64)
"""The constants as the compiled loop takes them: `PhotoJudgement` in fitting_points.h."""


class SeenPoints(Struct, frozen=True):
    """n known points as s photos see them, photo by photo; each photo has more than three.

    Parameters
    ----------
    starts : array (s + 1,) of int
        Where the points of each photo begin, and where the last ones end.
    xy : array (n, 2)
        Measured photo coordinates, mm.
    vectors : array (n, 3)
        Image vectors (x, y, -C), mm.
    error : array (n,)
        A-priori errors of a photo coordinate, mm.
    coordinates : array (n, 3)
    deviations : array (n,)
        Standard deviation of a coordinate.
    """

    starts: IntArray
    xy: FloatArray
    vectors: FloatArray
    error: FloatArray
    coordinates: FloatArray
    deviations: FloatArray

    def mean_errors(self) -> FloatArray:
        """Return the mean of the a-priori errors of each photo (s,), mm."""
        return np.asarray(np.add.reduceat(self.error, self.starts[:-1]) / np.diff(self.starts))


class FittedPhotos(Struct, frozen=True):
    """The orientations of s photos, and which of their n points fit.

    Parameters
    ----------
    rotations : array (s, 3, 3)
        Photo to ground; NaN where there is no orientation.
    centres : array (s, 3)
    fits : array (n,) of bool
        None of a photo whose orientation may be chance.
    """

    rotations: FloatArray
    centres: FloatArray
    fits: BoolArray


def fitting_points(seen: SeenPoints) -> FittedPhotos:
    """Orient photos by their known points, and find those that fit."""
    photos, count = len(seen.starts) - 1, len(seen.error)
    found = FittedPhotos(np.full((photos, 3, 3), np.nan), np.full((photos, 3), np.nan), np.zeros(count, dtype=bool))
    left = _fit_all(seen, found) if photos else []
    for photo in left:
        _fit(seen, photo, found)
    return found


def _fit_all(seen: SeenPoints, found: FittedPhotos) -> list[int]:
    """Do what `_fit` does for each photo by one compiled loop; return photos in which something is unusual."""
    counts = np.diff(seen.starts)
    each, of_photo = np.unique(counts, return_inverse=True)
    triples = [triples_for(count, MANY_BLUNDERS) for count in each.tolist()]
    ends = np.cumsum([0, *map(len, triples)])
    least = np.array([number_that_fits(count, MANY_BLUNDERS) for count in each.tolist()])[of_photo]
    corners = np.column_stack([ends[of_photo], ends[of_photo + 1]])
    places = seen.starts[:-1]
    extent = np.prod(np.maximum.reduceat(seen.xy, places) - np.minimum.reduceat(seen.xy, places), axis=1)
    is_found = np.empty(len(counts), dtype=bool)
    kernels.fitting_points(
        *map(np.ascontiguousarray, (seen.starts, seen.vectors, seen.coordinates, seen.deviations)),
        seen.mean_errors(), extent, least, np.concatenate(triples), corners, RULES_OF_TRACKS, _JUDGEMENT,
        found.rotations, found.centres, found.fits, is_found, CANDIDATES,
    )  # fmt: skip
    unusual: list[int] = np.flatnonzero(~is_found).tolist()
    return unusual


def _fit(seen: SeenPoints, photo: int, found: FittedPhotos) -> None:
    """Orient one photo, and mark which of its points fit."""
    rows = slice(*seen.starts[photo : photo + 2].tolist())
    error = seen.error[rows]
    found.fits[rows] = False
    resected = resect(
        seen.vectors[rows],
        seen.coordinates[rows],
        seen.deviations[rows],
        error_mm=float(np.add.reduceat(error, [0])[0] / len(error)),
        blunders=MANY_BLUNDERS,
    )
    if not isinstance(resected, Resected):
        return
    found.rotations[photo], found.centres[photo] = resected.rotation, resected.centre
    fitting: BoolArray = np.asarray(resected.weight_factor >= 1.0, dtype=bool)
    if fits_beyond_chance(seen.xy[rows], resected.residuals, fitting):
        found.fits[rows] = fitting
