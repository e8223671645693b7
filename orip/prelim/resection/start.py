"""Orientations that the space resection of a photo starts from, and of several those that fit its known points best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import FloatArray, IntArray
from orip.geometry.plane import plane_orientations
from orip.prelim.compiled import LARGEST_TURN, kernels
from orip.prelim.resection.known_points import FEW_BLUNDERS, KnownPoints, Orientations
from orip.prelim.sampling import subsets

_TRIPLES, _TRIPLES_OF_TRACKS = 50, 400
"""Number of triples. With 35 % blunders a triple is free of them with probability 0.27: none of 50 is with probability
1e-7, and some of the good ones have a good shape. With 70 % it is free of them with probability 0.027: none of 400 is
with probability 2e-5."""

CANDIDATES = 5
"""Orientations that are improved before the best one is chosen; both solutions of a plane are among them."""

FITS = 9.0
"""Squared standardised residual that most points exceed at a wrong orientation; as soon as enough candidates stay below
it, no more triples are tried."""

PLANE = 0.15
"""Thickness over width of an object below which its homography gives orientations too, where few points are wrong: it
is of all of them."""


def starting_orientations(known: KnownPoints) -> Orientations:
    """Return the most promising orientations, the best first; of three points all there are.

    Returns
    -------
    Orientations
        None where no camera position shows a triple as measured.

    Notes
    -----
    Orientations of triples (Grunert 1841), and of an object that is nearly plane from its homography, are ranked by the
    quantile of the residuals that blunders do not affect (least median of squares, Rousseeuw 1984).
    """
    triples = triples_of(known)
    tried, quantile = _of_triples(known, triples)
    if len(known) == 3:
        return _most_square_first(known, tried)
    if quantile.min(initial=np.inf) > FITS and known.blunders <= FEW_BLUNDERS and _is_flat(known):
        of_plane = _of_plane(known)
        tried, quantile = tried.joined(of_plane), np.concatenate([quantile, _quantile(known, of_plane)])
        tried, _ = _best(tried, quantile)
    return tried


def triples_of(known: KnownPoints) -> IntArray:
    """Return the triples of points (s, 3) that orientations are computed from."""
    return triples_for(len(known), known.blunders)


def triples_for(count: int, blunders: float) -> IntArray:
    """Return the triples (s, 3) of `count` points of which such a part may be blunders."""
    return subsets(count, 3, _TRIPLES if blunders <= FEW_BLUNDERS else _TRIPLES_OF_TRACKS)


def _of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Return the best orientations of triples of points, the best first, and their quantiles.

    Once enough fitting candidates have been found, further triples are ignored.
    """
    rotations, centres, quantile = np.empty((CANDIDATES, 3, 3)), np.empty((CANDIDATES, 3)), np.empty(CANDIDATES)
    kernels.rank_triples(
        *known.arrays, triples, rotations, centres, quantile,
        known.error_mm, known.least, FITS,
    )  # fmt: skip
    number = np.count_nonzero(np.isfinite(quantile))
    return Orientations(rotations[:number], centres[:number]), quantile[:number]


def _best(tried: Orientations, quantile: FloatArray) -> tuple[Orientations, FloatArray]:
    """Return the orientations that most points fit best, and their quantiles."""
    best = np.argsort(quantile, kind="stable")
    best = best[np.isfinite(quantile[best])][:CANDIDATES]
    return tried.of(best), quantile[best]


def _quantile(known: KnownPoints, at: Orientations) -> FloatArray:
    return np.asarray(np.partition(known.squares(at), known.least - 1, axis=1)[:, known.least - 1])


def _is_flat(known: KnownPoints) -> bool:
    _, width, thickness = np.linalg.svd(known.coordinates, compute_uv=False)
    return bool(thickness < PLANE * width)


def _of_plane(known: KnownPoints) -> Orientations:
    try:
        return Orientations(*plane_orientations(known.vectors, known.coordinates))
    except ValueError:
        return Orientations(np.empty((0, 3, 3)), np.empty((0, 3)))


def _most_square_first(known: KnownPoints, found: Orientations) -> Orientations:
    """Return orientations in the order of the angle at which they see the plane of three points."""
    normal = np.cross(known.coordinates[1] - known.coordinates[0], known.coordinates[2] - known.coordinates[0])
    cosine = np.abs(found.centres @ normal) / np.linalg.norm(found.centres, axis=1)
    return found.of(np.argsort(-cosine, kind="stable"))


IMPROVEMENTS = 3
"""Steps of least trimmed squares: enough to tell good starts from bad ones."""

ITERATIONS = 30
STEADY = 1e-6
"""Last correction, in radians and parts of the points' spread: the next one would be of the order of its square."""

SAME_SCALE = 1.04
"""Ratio of two estimates of the variance up to which they give the same limit for blunders."""

_ALIKE = 3.0
"""Excess of squared residuals, over the expected ones, up to which a second orientation is also possible."""

_SAME = 0.02
"""Radians, and parts of the distance: orientations nearer to each other are the same one, not iterated to the end."""

CHOICE = (
    LIMIT_OF_TWO_COMPONENTS, _ALIKE, _SAME, IMPROVEMENTS, LEAST_WEIGHT, STEADY, SAME_SCALE, ITERATIONS, LARGEST_TURN,
)  # fmt: skip
"""The constants as the compiled loop of a whole resection takes them."""

_NUMBERS_OF_A_POINT = 36
"""Numbers a point that the compiled loops need for two linearisations: residuals, partials, variance, square, weight,
and space to sort."""


class AdjustedResection(NamedTuple):
    """One adjusted orientation.

    Attributes
    ----------
    at : Orientations
        One.
    residual : array (n, 2)
        Computed minus measured, mm.
    squares : array (n,)
        Squared standardised residuals; infinite behind the photo.
    weight_factors : array (n,)
    normals : array (6, 6)
        Normal equations of rotations about the ground axes and projection centre.
    """

    at: Orientations
    residual: FloatArray
    squares: FloatArray
    weight_factors: FloatArray
    normals: FloatArray

    @property
    def redundancy(self) -> int:
        """Return the redundancy of the points with full weight."""
        return max(_redundancy(self.weight_factors), 0)

    @property
    def s0(self) -> float:
        """Return the standard error of unit weight; 1 without redundancy."""
        return math.sqrt(_variance(self.squares, self.weight_factors))


def _redundancy(factors: FloatArray) -> int:
    return 2 * int(np.count_nonzero(factors == 1.0)) - 6


def _variance(squares: FloatArray, factors: FloatArray) -> float:
    """Return the variance of unit weight from the points with full weight; 1 without redundancy."""
    redundancy = _redundancy(factors)
    return float(squares[factors == 1.0].sum()) / redundancy if redundancy > 0 else 1.0


def best_orientations(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    """Improve orientations, adjust those whose residuals are close to the smallest, and compare them again.

    Parameters
    ----------
    known : KnownPoints
        Three at least.
    start : Orientations
        At least one, and a dozen at most.

    Returns
    -------
    AdjustedResection
        The best.
    Orientations
        Others whose residuals are not much larger, the best first.
    """
    return _best_orientations(known, start)


def _best_orientations(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    rotations, centres = np.array(start.rotations), np.array(start.centres)
    number, count = len(centres), len(known)
    squares, factors = np.empty((number, count)), np.empty((number, count))
    residual, normals, space = np.empty((count, 2)), np.empty((6, 6)), np.empty((_NUMBERS_OF_A_POINT, count))
    left = kernels.best_orientations(
        *known.arrays, rotations, centres, squares, factors, residual, normals, space,
        known.error_mm, known.least, LIMIT_OF_TWO_COMPONENTS, _excess(known), _SAME, known.variance_of_least,
        IMPROVEMENTS, LEAST_WEIGHT, STEADY, SAME_SCALE, ITERATIONS, LARGEST_TURN,
    )  # fmt: skip
    found = Orientations(rotations[:left], centres[:left])
    return AdjustedResection(found.of(slice(0, 1)), residual, squares[0], factors[0], normals), found.of(slice(1, None))


def _excess(known: KnownPoints) -> float:
    return _ALIKE * max(2 * known.least - 6, 2)
