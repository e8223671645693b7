"""Of several orientations of a photo those that its known points agree with best, adjusted: one is left, as a rule."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.prelim.compiled import LEAST_WEIGHT, is_compiled, kernels
from orip.prelim.resection.adjustment import (
    IMPROVEMENTS,
    ITERATIONS,
    LIMIT,
    SAME_SCALE,
    STEADY,
    Adjusted,
    KnownPoints,
    Orientations,
    adjusted,
    improved,
)

_ALIKE = 3.0
"""Excess of squared residuals, over those expected, up to which a second orientation is another possibility."""

_SAME = 0.02
"""Radians, and parts of the distance: orientations nearer to each other are one, stopped before its end."""

_NUMBERS_OF_A_POINT = 36
"""Room of the compiled loops for two linearisations: residuals, partials, variance, square, weight, a place to sort."""


def settled(known: KnownPoints, start: Orientations) -> tuple[Adjusted, Orientations]:
    """Improve orientations, adjust those whose residuals are not much larger than the least, and compare them again.

    Parameters
    ----------
    known : KnownPoints
        More than three.
    start : Orientations
        At least one, and a dozen at most.

    Returns
    -------
    Adjusted
        The best.
    Orientations
        Others whose residuals are not much larger, the best first.
    """
    return _compiled(known, start) if is_compiled() else _side_by_side(known, start)


def _compiled(known: KnownPoints, start: Orientations) -> tuple[Adjusted, Orientations]:
    """Do what `_side_by_side` does in the compiled loop."""
    rotations, centres = np.array(start.rotations), np.array(start.centres)
    number, count = len(centres), len(known)
    squares, factors = np.empty((number, count)), np.empty((number, count))
    residual, normals, space = np.empty((count, 2)), np.empty((6, 6)), np.empty((_NUMBERS_OF_A_POINT, count))
    left = kernels.settled(
        *known.arrays, rotations, centres, squares, factors, residual, normals, space,
        known.error_mm, known.least, LIMIT, _excess(known), _SAME, known.variance_of_least, IMPROVEMENTS,
        LEAST_WEIGHT, STEADY, SAME_SCALE, ITERATIONS,
    )  # fmt: skip
    found = Orientations(rotations[:left], centres[:left])
    return Adjusted(found.of(slice(0, 1)), residual, squares[0], factors[0], normals), found.of(slice(1, None))


def _side_by_side(known: KnownPoints, start: Orientations) -> tuple[Adjusted, Orientations]:
    tried, squares = improved(known, start)
    variance = float(known.trimmed_variance(squares).min())
    likely = _likely(known, tried, squares)
    found = [adjusted(known, tried.of(slice(row, row + 1)), variance) for row in likely]
    ends = Orientations(*(np.concatenate(part) for part in zip(*(each.at for each in found), strict=True)))
    left = _likely(known, ends, np.stack([each.squares for each in found]))
    return found[left[0]], ends.of(left[1:])


def _excess(known: KnownPoints) -> float:
    return _ALIKE * max(2 * known.least - 6, 2)


def _likely(known: KnownPoints, at: Orientations, squares: FloatArray) -> IntArray:
    """Return which orientations with squared residuals (k, n) cost the least or not much more, the least first.

    Of those that are the same, the first.
    """
    costs = np.nan_to_num(known.costs(squares), nan=np.inf)  # an orientation may have run away
    order = np.argsort(costs, kind="stable")
    order = order[costs[order] <= costs[order[0]] + _excess(known)]
    rotations, centres = at.of(order)
    turn = np.sqrt(((rotations[:, None] - rotations) ** 2).sum(axis=(2, 3)) / 2.0)
    shift = np.sqrt(((centres[:, None] - centres) ** 2).sum(axis=2) / (centres**2).sum(axis=1)[:, None])
    same = (turn < _SAME) & (shift < _SAME)
    kept: list[int] = []
    for row in range(len(order)):
        if not same[kept, row].any():
            kept.append(row)
    return np.asarray(order[kept])
