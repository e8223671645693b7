"""Of several orientations of a photo those that fit its known points best, adjusted: usually a single one."""

from __future__ import annotations

import numpy as np

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import FloatArray, IntArray
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.least_squares import LARGEST_TURN
from orip.prelim.resection.adjustment import (
    IMPROVEMENTS,
    ITERATIONS,
    SAME_SCALE,
    STEADY,
    AdjustedResection,
    adjust_resection,
    improve_orientations,
)
from orip.prelim.resection.known_points import KnownPoints, Orientations

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


def best_orientations(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    """Improve orientations, adjust those whose residuals are close to the smallest, and compare them again.

    Parameters
    ----------
    known : KnownPoints
        More than three.
    start : Orientations
        At least one, and a dozen at most.

    Returns
    -------
    AdjustedResection
        The best.
    Orientations
        Others whose residuals are not much larger, the best first.
    """
    return _compiled(known, start) if is_compiled() else _side_by_side(known, start)


def _compiled(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    """Do what `_side_by_side` does in the compiled loop."""
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


def _side_by_side(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    tried, squares = improve_orientations(known, start)
    variance = float(known.trimmed_variance(squares).min())
    likely = _likely(known, tried, squares)
    found = [adjust_resection(known, tried.of(slice(row, row + 1)), variance) for row in likely]
    ends = Orientations(*(np.concatenate(part) for part in zip(*(adjusted.at for adjusted in found), strict=True)))
    left = _likely(known, ends, np.stack([adjusted.squares for adjusted in found]))
    return found[left[0]], ends.of(left[1:])


def _excess(known: KnownPoints) -> float:
    return _ALIKE * max(2 * known.least - 6, 2)


def _likely(known: KnownPoints, at: Orientations, squares: FloatArray) -> IntArray:
    """Return which orientations with squared residuals (k, n) cost the least or not much more, the least first.

    Of equal ones, the first.
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
