"""What the user should know of a relative orientation, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.wording import first_names

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
    seuw : float
    ambiguous : bool
        Another orientation fits as well.
    exchanged : sequence of (int, int)
        Two points each that fit when they are exchanged in one photo.

    Returns
    -------
    tuple of str
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
