"""The relative orientation that n points in two photos determine, without initial values.

Samples of five points, judged by all others, give starting values. The judgement has to tolerate gross errors, and
residuals that are all many times the a-priori error (a camera that is not calibrated). It therefore estimates the scale
of the residuals; a residual above three times that scale counts as three. The best orientations start adjustments of
all parallaxes by least squares with Danish weights; all points then decide between their results, and the best one is
adjusted until it converges.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.adjustment.weights import LEAST_WEIGHT
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.stereo import TwoPhotos
from orip.prelim.compiled import kernels
from orip.prelim.sampling import subsets

# As in `orip.geometry.rays` the ground is the left photo's system, image vectors are (x, y, -C) in millimetres,
# and R takes the right photo's system to the left one's.


class Pairs(NamedTuple):
    """n points in two photos.

    Attributes
    ----------
    left, right : arrays (n, 3)
        Image vectors, mm.
    error : array (n,)
        A-priori standard deviation of a parallax, mm: sqrt(2) times that of a photo coordinate.
    """

    left: FloatArray
    right: FloatArray
    error: FloatArray

    def of(self, rows: NDArray[np.bool_]) -> Pairs:
        """Return some of the points."""
        return Pairs(self.left[rows], self.right[rows], self.error[rows])

    def equal(self, others: Pairs) -> bool:
        """Tell whether others are the same points, measured and weighted alike."""
        return all(map(np.array_equal, self, others))


def parallaxes(essential: FloatArray, pairs: Pairs) -> FloatArray:
    """Return the parallaxes of n points for essential matrices (..., 3, 3), array (..., n), mm.

    Notes
    -----
    F = left^T E right over the length of its gradient by the four photo coordinates, to first order the shift of both
    image points that makes the rays meet (Sampson 1982), times sqrt(2): in the normal case this is y left - y right.
    """
    f, gradient_left, gradient_right = _condition(essential, pairs)
    return np.asarray(f * np.sqrt(2.0 / _square(gradient_left, gradient_right)))


# below, vectors of n points are columns (..., 3, n): sums over components are then fast


def _condition(essential: FloatArray, pairs: Pairs) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return F (..., n) and its gradients (..., 3, n) by the left and the right image vectors."""
    gradient_left = essential @ pairs.right.T
    gradient_right = np.swapaxes(essential, -1, -2) @ pairs.left.T
    return (gradient_left * pairs.left.T).sum(axis=-2), gradient_left, gradient_right


def _square(gradient_left: FloatArray, gradient_right: FloatArray) -> FloatArray:
    """Return the square (..., n) of the gradient by the four photo coordinates; never quite zero."""
    x, y = gradient_left[..., 0, :], gradient_left[..., 1, :]
    u, v = gradient_right[..., 0, :], gradient_right[..., 1, :]
    return np.asarray(np.maximum(x * x + y * y + u * u + v * v, 1e-300))


# The unknowns are two components of the base across itself and a small rotation of the right photo: no direction of the
# base and no rotation is singular. Several starts are adjusted side by side.

MAX_STANDARD_RESIDUAL = 5.0

_CONVERGED = 1e-9
"""Correction, in standard deviations of the unknowns, at which iterations end; rounding leaves some 1e-11."""

_WEIGHTS_HELD = 12
"""Iteration after which weights are held: one that alternates at the limit would never converge."""


_LONGEST_STEP = 0.3
"""Largest rotation of one step, radians: from a poor start the linear step may lead anywhere."""

_REGULAR = 1e-13
"""Part of the trace added to the diagonal, so that the equations can be solved where five points determine nothing."""

DANISH = (MAX_STANDARD_RESIDUAL, LEAST_WEIGHT, _CONVERGED, _LONGEST_STEP, _REGULAR, _WEIGHTS_HELD)
"""The constants as the compiled loop takes them: `RelativeDanish` in pair_loops.h."""

POINTS_NEEDED = 5

_SEED = 5
_SAMPLES = 500
_SAMPLES_AT_ONCE = 12
"""As many samples as points without blunders need; the share that agrees in the best one then decides on more."""

_MISSED = 1e-3
"""Probability that all samples have a blunder, at which sampling ends."""

_ORDINARY_SCALE = 3.0
_SAMPLES_OF_LARGE_SCALE = 160
"""Least samples where residuals are large, as no good one may have been drawn; 160 suffice for 50 % of blunders."""

_NO_BETTER = 2.0
"""Residual in units of the a-priori error below which smaller ones are no better."""

FIT_LIMIT = 3.0
"""Multiple of the scale above which a point does not fit."""

_KEPT, _STARTS = 16, 8
"""Matrices that are kept from one lot of samples to the next, and orientations tried in the adjustment: of the kept
matrices, those with the points in front."""

_ALIKE = 0.999
"""Product of two matrices of norm 1 above which they count as one, some 2.5 degrees apart: a plane has a second
solution that fits as well, and its samples must not crowd out those of the first."""

SAMPLING = (
    _SAMPLES_AT_ONCE, _MISSED, _ORDINARY_SCALE, _SAMPLES_OF_LARGE_SCALE, _NO_BETTER, FIT_LIMIT, _ALIKE, _KEPT, _STARTS,
)  # fmt: skip
"""The constants as the compiled loop takes them: `Sampling` in pair_loops.h."""


@lru_cache(maxsize=256)
def samples_of(count: int) -> IntArray:
    """Return samples of five of `count` points."""
    # if all subsets are taken they come in order, and the first of them have points in common
    return np.random.default_rng(_SEED).permutation(subsets(count, POINTS_NEEDED, _SAMPLES, _SEED))


@lru_cache(maxsize=256)
def log_of_sets(n: int) -> FloatArray:
    """Return the logarithm of (n - 5) C(n, m) C(m, 5) for m from 6 to n."""
    sets = [math.comb(n, m) * math.comb(m, POINTS_NEEDED) for m in range(POINTS_NEEDED + 1, n + 1)]
    return np.array([math.log(n - POINTS_NEEDED) + math.log(number) for number in sets])


_ITERATIONS_TO_COMPARE, _MAX_ITERATIONS = 5, 20

_EQUALLY_GOOD = 4.0
"""Difference of square sums, two standard deviations, below which the points do not tell two orientations apart."""

_SAME = 0.02
"""Radians between orientations that count as the same: their iterations ended at slightly different places."""

_SURE = 3.0
"""Logarithm of the factor by which points have to agree better than by chance; with fewer redundant points, their
number."""

_PLAIN_BASE = 1000.0
"""Median residual of a pure rotation, over the scale, that shows a base whatever the blunders; iterations end there."""

_ROTATION_STEPS = 8

CHOICE = (_ITERATIONS_TO_COMPARE, _MAX_ITERATIONS, _EQUALLY_GOOD, _SAME, _SURE, _PLAIN_BASE, _ROTATION_STEPS)
_RULES = np.array([*SAMPLING, *DANISH, *CHOICE])
"""The constants as the compiled loop takes them: `RelativeRules` in pair_loops.h."""


class PairSolution(Struct, frozen=True):
    """One relative orientation of n points; deviations are those of the a-priori errors.

    Parameters
    ----------
    photos : TwoPhotos
        The base has the length 1.
    angles, angle_deviation : arrays (3,)
        omega, phi, kappa of the right photo in the left one's system.
    base_deviation : array (3,)
        In units of the base, whose largest component is held.
    parallax : array (n,)
        mm.
    weight_factor, redundancy_number : arrays (n,)
    coordinates, deviations : arrays (n, 3)
        Where the rays meet, and its standard deviations for a fixed orientation, in units of the base; NaN for the
        deviations of points that are not usable.
    in_front : array (n,) of bool
        The point is in front of both photos.
    usable : array (n,) of bool
        The point is in front of both photos, has full weight, and its rays are not parallel.
    length : float
        Length of the base, in metres, for which the mean of the usable points' 1 / depth is 1 / C.
    scale : float
        Of the residuals of the points that agree, at least 1.
    seuw : float
        Standard error of unit weight of the points with full weight; 0 without redundancy.
    left_by_rotation : float
        Median residual of a pure rotation between the two photos, in standard deviations of a parallax, or some number
        above 1000 times the scale.
    by_chance : bool
        As many points would agree as well if they were placed at random.
    ambiguous : bool
        Another orientation fits as well.
    """

    photos: TwoPhotos
    angles: FloatArray
    angle_deviation: FloatArray
    base_deviation: FloatArray
    parallax: FloatArray
    weight_factor: FloatArray
    redundancy_number: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    in_front: BoolArray
    usable: BoolArray
    length: float
    iterations: int
    scale: float
    seuw: float
    left_by_rotation: float
    by_chance: bool
    ambiguous: bool


def solve(pairs: Pairs) -> PairSolution | None:
    """Orient the right photo to the left one.

    Parameters
    ----------
    pairs : Pairs
        Five points at least.

    Returns
    -------
    PairSolution or None
        None where the points determine nothing.
    """
    return _solution(pairs)


def _solution(pairs: Pairs) -> PairSolution | None:
    count = len(pairs.error)
    found = np.empty(28)
    parallax, weights, redundancy = np.empty(count), np.empty(count), np.empty(count)
    coordinates, deviations = np.empty((count, 3)), np.empty((count, 3))
    in_front, usable = np.empty(count, dtype=np.bool_), np.empty(count, dtype=np.bool_)
    if not kernels.orient_pair(
        *pairs, log_of_sets(count), _RULES, found, parallax, weights, coordinates, deviations, in_front, usable,
        samples_of(count), redundancy,
    ):  # fmt: skip
        return None
    scale, by_chance, ambiguous, iterations, seuw, length, left_by_rotation = found[21:].tolist()
    return PairSolution(
        TwoPhotos(found[:3], found[3:12].reshape(3, 3)), found[12:15], found[18:21], found[15:18], parallax, weights,
        redundancy, coordinates, deviations, in_front, usable, length, int(iterations), scale, seuw, left_by_rotation,
        bool(by_chance), bool(ambiguous),
    )  # fmt: skip
