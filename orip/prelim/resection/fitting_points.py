"""Orientations of many photos at once, and which of their known points fit, whatever part of these is wrong."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.compiled import kernels
from orip.prelim.resection.known_points import MANY_BLUNDERS, SURE, fits_beyond_chance, number_that_fits
from orip.prelim.resection.resection import MISFIT, RULES_OF_TRACKS, USELESS_ANGLE, USELESS_CENTRE, Resected, resect
from orip.prelim.resection.start import CANDIDATES, triples_for

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
