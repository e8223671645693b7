"""Relative orientation of a model without initial values: pairs that share points, the orientation, remarks on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.adjustment.precision import residual_cofactor
from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import cross_matrix
from orip.prelim.rays import ImageRays, PhotoIndex, photo_index
from orip.prelim.relative.solution import POINTS_NEEDED, Pairs, PairSolution, parallaxes, solve
from orip.records.preliminary import NotOriented, PartialBlock, RelativeOrientation
from orip.wording import counted, first_names


class Pair(NamedTuple):
    """Two photos, and how many points they share; `left` is the smaller index."""

    left: int
    right: int
    common: int


def common_point_counts(rays: ImageRays) -> IntArray:
    """Return the number of points that each two photos share, array (photos, photos); the diagonal has their own."""
    from scipy.sparse import csr_array

    photo, starts = rays.photo[rays.order_by_point()].astype(np.int32), rays.point_starts().astype(np.int32)
    shown = csr_array((np.ones(len(photo), dtype=np.int64), photo, starts), shape=(len(starts) - 1, len(rays.photos)))
    return np.asarray((shown.T.tocsr() @ shown).toarray())


def pairs_by_common_points(counts: IntArray, fewest: int) -> list[Pair]:
    """Return the pairs with at least `fewest` points in common, those with most first."""
    left, right = np.nonzero(np.triu(counts >= fewest, k=1))
    common = counts[left, right]
    order = np.lexsort((right, left, -common))
    return [Pair(int(left[k]), int(right[k]), int(common[k])) for k in order]


_NAMED = 6
"""Number of points that are named one by one."""

_MANY = 0.2

_LARGE_SEUW = 3.0

_TO_THE_LEFT = -0.5
"""The base lies within 60 degrees of the negative x axis."""


def remarks_on(
    points: Sequence[str],
    parallax: FloatArray,
    deviation: FloatArray,
    weight_factor: FloatArray,
    in_front: NDArray[np.bool_],
    *,
    base: FloatArray,
    seuw: float,
    ambiguous: bool,
    exchanged: Sequence[tuple[int, int]] = (),
) -> tuple[str, ...]:
    """Return remarks on a relative orientation.

    Parameters
    ----------
    points : sequence of str
        n names.
    parallax, deviation : arrays (n,)
        Residual parallaxes and their standard deviations before the adjustment, mm.
    weight_factor : array (n,)
    in_front : array (n,) of bool
    base : array (3,)
    ambiguous : bool
        Another orientation fits as well.
    exchanged : sequence of (int, int)
        Two points each that fit when they are exchanged in one photo.
    """
    return (
        *_on_blunders(points, parallax, deviation, weight_factor),
        *(f"points {points[one]} and {points[other]} fit when exchanged in one photo" for one, other in exchanged),
        *_on_points_behind(points, weight_factor, in_front),
        *_on_the_whole(len(points), base, seuw, ambiguous),
    )


def _on_blunders(
    points: Sequence[str], parallax: FloatArray, deviation: FloatArray, weight_factor: FloatArray
) -> Iterator[str]:
    reduced = np.flatnonzero(weight_factor < 1.0)
    if not len(reduced):
        return
    standard = np.abs(parallax) / deviation
    worst = reduced[np.argsort(-standard[reduced], kind="stable")]
    for row in worst[:_NAMED]:
        size = f"py {parallax[row]:.3g} mm, {standard[row]:.0f} standard deviations"
        yield f"point {points[row]} does not fit: {size}"
    if len(worst) > _NAMED:
        yield f"{len(worst) - _NAMED} more points do not fit"
    if len(worst) >= _MANY * len(points):
        yield (f"{len(worst)} of {len(points)} points do not fit: check point numbers, photos and camera")


def _on_points_behind(points: Sequence[str], weight_factor: FloatArray, in_front: NDArray[np.bool_]) -> Iterator[str]:
    behind = [points[row] for row in np.flatnonzero((weight_factor == 1.0) & ~in_front).tolist()]
    if behind:
        yield f"rays do not meet in front of both photos: point {first_names(behind, _NAMED)}"


def _on_the_whole(count: int, base: FloatArray, seuw: float, ambiguous: bool) -> Iterator[str]:
    if seuw > _LARGE_SEUW:
        yield f"parallaxes are {seuw:.1f} times as large as the a-priori error; is the camera calibrated?"
    if base[0] < _TO_THE_LEFT * np.linalg.norm(base):
        yield "the right photo lies to the left of the left one; are they exchanged?"
    if count == 5:
        yield "five points: nothing checks the orientation"
    if ambiguous:
        yield "another orientation fits as well; the one with the smaller rotation was used"


_NO_BASE = 3.0
"""Median of the parallaxes left by a rotation alone, in standard deviations, below which measuring errors explain them:
half of these are below 1.2."""

_NO_MODEL = 0.01
"""Standard deviation of parallaxes, as part of the principal distance, that no uncalibrated camera causes."""

_FITS = 3.0
"""Standard deviations within which a point fits if it is taken to be measured under another number."""

_LARGEST_SCALE = 20.0
"""Scale of the residuals that an uncalibrated camera may cause; above it points are confused."""


class OrientedPair(Struct, frozen=True):
    """Two photos that are oriented relatively, and their n common points.

    Parameters
    ----------
    photos : (int, int)
    rows : two arrays (n,) of int
        Of the rays: those of the left and those of the right photo.
    base : array (3,)
        Metres at photo scale.
    block : PartialBlock
        The photos, and the points that are usable.
    fitting : float
        Part of the points that has full weight.
    """

    photos: tuple[int, int]
    rows: tuple[IntArray, IntArray]
    pairs: Pairs
    solution: PairSolution
    base: FloatArray
    block: PartialBlock
    fitting: float


def orient_two_photos(
    rays: ImageRays,
    left: int,
    right: int,
    *,
    model: str,
    index: PhotoIndex,
    earlier: OrientedPair | NotOriented | None = None,
) -> OrientedPair | NotOriented:
    """Orient the right photo to the left one as `orient_pair` does, without what only a listing shows.

    An `earlier` model of the two photos has the solution already where it has the same points.
    """
    rows = index.common_points(left, right)
    names = rays.photos[left], rays.photos[right]
    pairs = Pairs(rays.vectors[rows[0]], rays.vectors[rows[1]], np.hypot(rays.error[rows[0]], rays.error[rows[1]]))
    count = len(pairs.error)
    if count < POINTS_NEEDED:
        reason = f"photo {names[0]} and photo {names[1]} share {counted(count, 'point')}, {POINTS_NEEDED} are needed"
        return NotOriented(model, "", reason)
    same = earlier if isinstance(earlier, OrientedPair) and pairs.equal(earlier.pairs) else None
    solution = solve(pairs) if same is None else same.solution
    reason = f"the {count} points that photo {names[0]} and photo {names[1]} share do not determine an orientation"
    if solution is None:
        return NotOriented(model, "", reason)
    fault = _fault(solution, pairs)
    if fault is not None:
        return NotOriented(model, "", f"{reason}: {fault}")
    base = solution.length * solution.photos.base
    block = _model(model, (left, right), rays.point[rows[0]], solution)
    fitting = np.count_nonzero(solution.weight_factor >= 1.0) / count
    return OrientedPair((left, right), rows, pairs, solution, base, block, fitting)


def orient_pair(
    rays: ImageRays,
    left: int,
    right: int,
    *,
    model: str,
    row: int | None,
    column: int | None,
    index: PhotoIndex | None = None,
) -> RelativeOrientation | NotOriented:
    """Orient the right photo to the left one (dependent pair), without initial values.

    Five-point solutions of samples of the points start an adjustment of all parallaxes with Danish weights. It succeeds
    where a third of the points are blunders, and where all residuals are many times the a-priori error: weights are
    reduced above five times the a-priori error or, where it is larger, a robust estimate of the residuals' scale.

    Parameters
    ----------
    left, right : int
        Photos.
    model : str
        Its name.
    index : PhotoIndex, optional
        The index of the rays, given where many pairs are oriented.

    Notes
    -----
    The residual parallax is y left - y right in the normal case; in general see `orip.prelim.relative.adjustment`. Its
    a-priori error is the root of the squares of both photos' errors of a coordinate.

    The base has the length for which the mean of the points' 1 / depth is 1 / C: in the normal case bx is then the
    mean x parallax. Its largest component fixes the scale and has no standard deviation.

    Standard deviations are those of the a-priori errors times `seuw` (without redundancy, times 1). Those of model
    coordinates are those of the intersection of two rays with fixed orientation, times `seuw` where it is above 1.
    """
    found = orient_two_photos(rays, left, right, model=model, index=index or photo_index(rays))
    return found if isinstance(found, NotOriented) else listed(rays, found, row, column)


def _fault(solution: PairSolution, pairs: Pairs) -> str | None:
    """Return why an orientation cannot be used, or None."""
    count = len(pairs.error)
    typical = solution.seuw * float(pairs.error.sum()) / count
    if solution.by_chance or typical > _NO_MODEL * float(np.abs(pairs.left[:, 2]).sum()) / count:
        return f"their rays miss each other by {typical:.2g} mm; are point numbers or photos confused?"
    if solution.left_by_rotation < _NO_BASE * min(solution.scale, _LARGEST_SCALE):
        return "there is no base between them; both were taken from one place"
    usable = int(np.count_nonzero(solution.usable))
    if usable < max(POINTS_NEEDED, count / 2):
        return f"the rays of only {usable} of them meet in front of both photos"
    return None


def listed(
    rays: ImageRays, pair: OrientedPair, row: int | None = None, column: int | None = None
) -> RelativeOrientation:
    """Return an oriented pair as listings show it."""
    pairs, solution, photos = pair.pairs, pair.solution, pair.photos
    seuw, at_least_one = solution.seuw, max(solution.seuw, 1.0)
    cofactor = residual_cofactor(solution.redundancy_number, solution.weight_factor)
    unit_weight = seuw or 1.0
    names = tuple(rays.points[point] for point in rays.point[pair.rows[0]].tolist())
    return RelativeOrientation(
        model=pair.block.name,
        left=rays.photos[photos[0]],
        right=rays.photos[photos[1]],
        row=row,
        column=column,
        points=names,
        left_xy=rays.xy[pair.rows[0]],
        right_xy=rays.xy[pair.rows[1]],
        parallax=solution.parallax,
        parallax_deviation=seuw * pairs.error * np.sqrt(cofactor),
        weight_factor=solution.weight_factor,
        in_front=solution.in_front,
        base=pair.base,
        base_deviation=unit_weight * solution.length * solution.base_deviation,
        angles=solution.angles,
        angle_deviation=unit_weight * solution.angle_deviation,
        iterations=solution.iterations,
        seuw=seuw,
        max_residual=float(np.abs(solution.parallax[solution.weight_factor == 1.0]).max()),
        block=pair.block,
        remarks=remarks_on(
            names,
            solution.parallax,
            pairs.error * at_least_one,
            solution.weight_factor,
            solution.in_front,
            base=pair.base,
            seuw=seuw,
            ambiguous=solution.ambiguous,
            exchanged=_exchanged(solution, pairs, at_least_one),
        ),
    )


def _model(name: str, photos: tuple[int, int], points: IntArray, solution: PairSolution) -> PartialBlock:
    rotations, centres = np.zeros((2, 3, 3)), np.zeros((2, 3))
    rotations[0], rotations[1] = np.eye(3), solution.photos.rotation
    centres[1] = solution.length * solution.photos.base
    return PartialBlock(
        name,
        np.array(photos, dtype=np.int64),
        rotations,
        centres,
        points[solution.usable],
        solution.length * solution.coordinates[solution.usable],
        max(solution.seuw, 1.0) * solution.length * solution.deviations[solution.usable],
    )


def _exchanged(solution: PairSolution, pairs: Pairs, unit_weight: float) -> list[tuple[int, int]]:
    """Return pairs of rows whose points do not fit, but would if they were exchanged in one photo."""
    wrong = np.flatnonzero(solution.weight_factor < 1.0)
    if len(wrong) < 2:
        return []
    in_left, in_right = wrong.repeat(len(wrong)), np.tile(wrong, len(wrong))
    mixed = Pairs(pairs.left[in_left], pairs.right[in_right], pairs.error[in_left])
    sizes = np.abs(parallaxes(cross_matrix(solution.photos.base) @ solution.photos.rotation, mixed))
    fits = (sizes < _FITS * unit_weight * mixed.error).reshape(len(wrong), len(wrong))
    both = fits & fits.T
    if not both.any():
        return []
    first, second = np.nonzero(np.triu(both, k=1))
    return list(zip(wrong[first].tolist(), wrong[second].tolist(), strict=True))
