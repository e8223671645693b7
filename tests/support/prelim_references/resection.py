"""The space resection with arrays: orientations of triples, least squares of many at once, and the choice."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from support.prelim_references.iterations import (
    GaussNewton,
    Iterated,
    Marquardt,
    enlarged_diagonal,
    largest_elements,
    least_squares,
    shortened,
)
from support.prelim_references.three_points import three_point_resection

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS, danish_weights
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.perspective import perspective_with_partials
from orip.geometry.rotation import rotation_about_axes
from orip.prelim.resection.known_points import KnownPoints, Orientations
from orip.prelim.resection.start import (
    _SAME,
    CANDIDATES,
    FITS,
    IMPROVEMENTS,
    ITERATIONS,
    SAME_SCALE,
    STEADY,
    AdjustedResection,
    _best,
    _excess,
    _quantile,
    _variance,
)


def _smallest(squares: FloatArray, number: int) -> FloatArray:
    return np.asarray(np.partition(squares, number - 1, axis=1)[:, :number])


_FLOOR = 1e-13
"""Part of the largest diagonal element that is added to all, so that undetermined unknowns keep their values."""


def _fitting(known: KnownPoints, squares: FloatArray) -> FloatArray:
    """Return weights (k, n): 1 for the points that fit best, 0 for the others and those behind the photo."""
    limit = _smallest(squares, known.least).max(axis=1, keepdims=True)
    return np.where((squares <= limit) & np.isfinite(squares), 1.0, 0.0)


def _trimmed_variance(known: KnownPoints, squares: FloatArray) -> FloatArray:
    """Return the variances of unit weight (k,) estimated from the smallest squared residuals (k, n)."""
    return np.asarray(known.variance_of_least * _smallest(squares, known.least).sum(axis=1))


def _costs(known: KnownPoints, squares: FloatArray) -> FloatArray:
    """Return the costs (k,) of orientations: sums of squared residuals (k, n), each counted up to the limit.

    In units of the least variance among the orientations, or of the a-priori one.
    """
    # finite even where all points are behind the photo
    variance = min(max(float(_trimmed_variance(known, squares).min()), 1.0), 1e300)
    return np.asarray(np.minimum(squares / variance, LIMIT_OF_TWO_COMPONENTS**2).sum(axis=1))


class ResectionEquations(NamedTuple):
    """The equations of k orientations and n points.

    Attributes
    ----------
    at : Orientations
    residual : array (k, n, 2)
        Computed minus measured, mm.
    partials : array (k, n, 2, 6)
        By rotations about the ground axes and by the projection centre.
    in_front : array (k, n) of bool
    variance : array (k, n)
        Of a residual, mm².
    weights : array (k, n)
        Weight factors.
    correction : array (k, 6)
        The last one: rotations in radians, centre in units of the points' spread.
    """

    at: Orientations
    residual: FloatArray
    partials: FloatArray
    in_front: BoolArray
    variance: FloatArray
    weights: FloatArray
    correction: FloatArray

    @property
    def squares(self) -> FloatArray:
        """Return the squared standardised residuals (k, n); infinite behind the photo."""
        return np.where(self.in_front, np.sum(self.residual**2, axis=2) / self.variance, np.inf)

    def normal_equations(self) -> tuple[FloatArray, FloatArray]:
        """Return the normal matrices (k, 6, 6) and their right sides (k, 6, 1)."""
        root = np.sqrt(np.where(self.in_front, self.weights / self.variance, 0.0))[:, :, None]
        design = (self.partials * root[..., None]).reshape(len(root), -1, 6)
        misclosure = (self.residual * root).reshape(len(root), -1, 1)
        transposed = np.swapaxes(design, 1, 2)
        return transposed @ design, transposed @ misclosure


class _Resection:
    """The adjustment of k orientations, whatever the weights of the points."""

    def __init__(self, known: KnownPoints) -> None:
        self._known = known

    def linearised(self, at: Orientations, weights: FloatArray, correction: FloatArray) -> ResectionEquations:
        known, many, count = self._known, len(at.centres), len(self._known)
        offset = (known.coordinates - at.centres[:, None]).reshape(-1, 3)
        principal_distance = np.tile(-known.vectors[:, 2], many)
        image = perspective_with_partials(offset, np.repeat(at.rotations, count, axis=0), principal_distance)
        scale = (principal_distance / np.linalg.norm(offset, axis=1)).reshape(many, count)
        return ResectionEquations(
            at,
            image.xy.reshape(many, count, 2) - known.vectors[:, :2],
            np.concatenate([image.by_rotation, -image.by_point], axis=2).reshape(many, count, 2, 6),
            image.in_front.reshape(many, count),
            known.error_mm**2 + (scale * known.deviations) ** 2,
            weights,
            correction,
        )

    def stepped(self, here: ResectionEquations, damping: FloatArray) -> ResectionEquations:
        normals, right = here.normal_equations()
        correction = -np.linalg.solve(enlarged_diagonal(normals, damping, _FLOOR * largest_elements(normals)), right)[
            :, :, 0
        ]
        correction = shortened(np.asarray(correction, dtype=np.float64), np.linalg.norm(correction[:, :3], axis=1))
        turned = rotation_about_axes(correction[:, :3]) @ here.at.rotations
        moved = Orientations(turned, here.at.centres + correction[:, 3:])
        return self.linearised(moved, here.weights, correction)

    def start(self, at: Orientations) -> ResectionEquations:
        many = len(at.centres)
        return self.linearised(at, np.ones((many, len(self._known))), np.full((many, 6), np.inf))


class _TrimmedResection(_Resection):
    """Weights 1 for the points that fit best, 0 for the others: least trimmed squares."""

    def reweighted(self, here: ResectionEquations) -> ResectionEquations:
        return here._replace(weights=_fitting(self._known, here.squares))

    def costs(self, here: ResectionEquations, _weights: FloatArray) -> FloatArray:
        return _trimmed_variance(self._known, here.squares)

    def converged(self, _before: ResectionEquations, _after: ResectionEquations) -> bool:
        return False


class _RobustResection(_Resection):
    """Weights of the Danish method, one for each point, for a given variance of unit weight."""

    def __init__(self, known: KnownPoints, variance: float) -> None:
        super().__init__(known)
        self._variance = variance

    def reweighted(self, here: ResectionEquations) -> ResectionEquations:
        return here._replace(weights=danish_weights(np.sqrt(here.squares / self._variance), LIMIT_OF_TWO_COMPONENTS))

    def costs(self, here: ResectionEquations, weights: FloatArray) -> FloatArray:
        return np.asarray((weights * here.squares).sum(axis=1))

    def converged(self, _before: ResectionEquations, after: ResectionEquations) -> bool:
        return bool(np.abs(after.correction).max() < STEADY)


def improve_orientations(known: KnownPoints, start: Orientations) -> tuple[Orientations, FloatArray]:
    """Improve k orientations by least trimmed squares (Rousseeuw and Van Driessen 1999).

    Parameters
    ----------
    known : KnownPoints
    start : Orientations

    Returns
    -------
    Orientations
        Not iterated to the end.
    array (k, n)
        Their squared standardised residuals.
    """
    problem = _TrimmedResection(known)
    rule = Marquardt(np.full(len(start.centres), 1e-3), decrease=0.1, increase=10.0)
    best = least_squares(problem, problem.reweighted(problem.start(start)), rule, IMPROVEMENTS).best
    return best.at, best.squares


def adjust_resection(known: KnownPoints, start: Orientations, variance: float) -> AdjustedResection:
    """Adjust one orientation with the weights of the Danish method, one for each point.

    Parameters
    ----------
    known : KnownPoints
    start : Orientations
        One.
    variance : float
        Variance of unit weight, on which the limit for blunders depends; estimated again from the points that fit.

    Returns
    -------
    AdjustedResection
    """
    here, limit, steps_left = _RobustResection(known, 1.0).start(start), max(variance, 1.0), ITERATIONS
    while True:
        problem = _RobustResection(known, limit)
        found = least_squares(problem, problem.reweighted(here), GaussNewton(), steps_left)
        here, steps_left = found.best, steps_left - found.iterations
        estimated = _variance_before(found)
        if 1.0 / SAME_SCALE < estimated / limit < SAME_SCALE or steps_left < ITERATIONS // 2 - 1:
            break
        limit = estimated
    # the last step is so small that weights from the residuals after it would be the same
    end = here._replace(weights=found.before.weights)
    normals, _ = end.normal_equations()
    return AdjustedResection(end.at, end.residual[0], end.squares[0], end.weights[0], normals[0])


def _variance_before(found: Iterated[ResectionEquations]) -> float:
    """Return the variance of unit weight, at least 1, of the residuals before the last step."""
    return max(_variance(found.before.squares[0], found.before.weights[0]), 1.0)


def _of_triples(known: KnownPoints, triples: IntArray) -> tuple[Orientations, FloatArray]:
    """Return the best orientations of triples of points, the best first, and their quantiles.

    Once enough fitting candidates have been found, further triples are ignored.
    """
    found = three_point_resection(known.vectors[triples], known.coordinates[triples])
    tried = Orientations(found.rotations[found.valid], found.centres[found.valid])
    quantile = _quantile(known, tried)
    triple = np.nonzero(found.valid)[0]
    enough = np.flatnonzero(np.cumsum(quantile <= FITS) >= CANDIDATES)
    looked_at = triple <= (triple[enough[0]] if len(enough) else len(triples))
    return _best(tried.of(looked_at), quantile[looked_at])


def _side_by_side(known: KnownPoints, start: Orientations) -> tuple[AdjustedResection, Orientations]:
    tried, squares = improve_orientations(known, start)
    variance = float(_trimmed_variance(known, squares).min())
    likely = _likely(known, tried, squares)
    found = [adjust_resection(known, tried.of(slice(row, row + 1)), variance) for row in likely]
    ends = Orientations(*(np.concatenate(part) for part in zip(*(adjusted.at for adjusted in found), strict=True)))
    left = _likely(known, ends, np.stack([adjusted.squares for adjusted in found]))
    return found[left[0]], ends.of(left[1:])


def _likely(known: KnownPoints, at: Orientations, squares: FloatArray) -> IntArray:
    """Return which orientations with squared residuals (k, n) cost the least or not much more, the least first.

    Of equal ones, the first.
    """
    costs = np.nan_to_num(_costs(known, squares), nan=np.inf)  # an orientation may have run away
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
