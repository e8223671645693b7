"""Starting values of a spatial similarity that wrong points do not spoil, and from partly known coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import UNKNOWNS, Similarities, Similarity, similarity_with_partials
from orip.prelim.compiled import LARGEST_TURN, kernels
from orip.prelim.sampling import subsets
from orip.prelim.similarity.adjustment import LEAST_ERROR, CommonPoints, SimilarityAdjustment, adjust_similarity

TRIPLES = 40, 500
"""Numbers of triples: tried first, and tried if none of those fits; the second is all triples of up to 15 points. With
half of the points wrong one triple in eight is good; 500 practically never miss it."""

FITTING = 9.0
"""d²/s² below which most points stay at a start that fits."""

MEDIAN_OF_CHI2 = 2.37
"""Median of the square sum of three standard normal residuals."""


def start_from_triples(common: CommonPoints, tried: Sequence[int] = TRIPLES) -> Similarity:
    """Return the similarity of the three points that most others agree with.

    Parameters
    ----------
    common : CommonPoints
        Three full points at least.
    tried : sequence of int
        Numbers of triples, each of which is tried if nothing fits with those before.

    Raises
    ------
    ValueError
        When all triples lie on lines.
    """
    full = np.flatnonzero(common.full)
    for number in tried:
        found = _best_of(common, full[subsets(len(full), 3, number)])
        if found is not None and (found.most <= FITTING or number == tried[-1]):
            return found.start
    message = "the common points lie on one line"
    raise ValueError(message)


class _Best(NamedTuple):
    """The best start of several, and the least d²/s² that most points stay below at one of them."""

    start: Similarity
    most: float


def _best_of(common: CommonPoints, triples: IntArray) -> _Best | None:
    """Return the best similarity of triples (s, 3) of points, None if all lie on lines."""
    start = np.empty(13)
    most = kernels.best_triple(
        *common.arrays, triples, start, most_points(len(common.source)), LEAST_ERROR, MEDIAN_OF_CHI2, FITTING
    )
    return _Best(Similarity(float(start[0]), start[1:10].reshape(3, 3), start[10:]), most) if most >= 0.0 else None


def most_points(count: int) -> int:
    """Return how many points make most of them.

    Least median of squares (Rousseeuw 1984), counted so that one wrong point of four or five does no harm.
    """
    return min(count // 2 + 2, count - 1) if count > 3 else count


def truncated_costs(common: CommonPoints, starts: Similarities) -> FloatArray:
    """Return the sums (s,) of min(d²/s², 9) over the points, with s² scaled to the points that fit best."""
    return _compared(common, starts)[0]


def _compared(common: CommonPoints, starts: Similarities) -> tuple[FloatArray, float]:
    """Return the truncated costs (s,) of starts, and the least d²/s² that most points stay below at one of them."""
    squares = _squares(common, starts)
    rank = most_points(squares.shape[1])
    most = float(np.partition(squares, rank - 1, axis=1)[:, rank - 1].min())
    factor = max(1.0, most / MEDIAN_OF_CHI2)
    return np.asarray(np.minimum(squares / factor, FITTING).sum(axis=1)), most


def _squares(common: CommonPoints, starts: Similarities) -> FloatArray:
    """Return d²/s² (s, n) of the points at each start, as of three coordinates."""
    known = common.known
    difference = np.where(known, starts.apply(common.source) - common.target, 0.0)
    source = (common.source_deviation**2).mean(axis=1)
    target = np.nanmean(np.where(known, common.target_deviation, np.nan) ** 2, axis=1)
    variance = target + starts.scale[:, None] ** 2 * source
    floor = LEAST_ERROR**2 * np.median(variance, axis=1, keepdims=True)
    variance = np.maximum(variance, np.where(floor > 0.0, floor, 1.0))
    return np.asarray((difference**2).sum(axis=2) / variance * (3.0 / known.sum(axis=1)))


# Gauss-Newton finds the rotation from some 60 degrees off; rotations that turn axes into axes are never further than 63
# degrees from any other. Where seven coordinates are just enough, several rotations may fit.

_STEPS = 40
_SETTLED = 1e-3
"""Relative gain of a step below which a start is good enough for an adjustment with Danish weights."""

_STUCK = 1e4
"""Damping of a start that no step improves noticeably."""

_BEST = 8
"""Number of starts that are adjusted with Danish weights."""

_SUBSETS = 100
"""Number of subsets that are left out in turn: with two wrong points of 14, three in a hundred leave out both."""

_WELL = 2.0
"""Standard error of unit weight up to which no blunder is sought."""

_SAME = 0.05
"""Radians between rotations up to which they count as the same solution."""

_EQUAL = 9.0
"""Solutions whose square sums differ by less are indistinguishable: three standard deviations."""


def adjusted_from_all_sides(common: CommonPoints, rotations: FloatArray, remarks: list[str]) -> SimilarityAdjustment:
    """Adjust a similarity without knowing its rotation.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Of the block's photos, to its system. Of solutions that fit equally the one is used in which the photos look
        down, or stand upright.
    remarks : list of str
        A remark is added to it if there was such a choice.

    Raises
    ------
    ValueError
        When the coordinates do not determine the similarity.
    """
    everything = np.ones(int(np.count_nonzero(common.known)))
    starts = _least_squares(common, _starts(common), everything)
    solutions = _solutions(common, starts)
    if not solutions or not all(solution.fits.all() and solution.s0 < _WELL for solution in solutions):
        solutions += _solutions(common, _without_some(common, starts))
    if not solutions:
        message = "the points do not determine the transformation"
        raise ValueError(message)
    costs = _robust_costs(common, solutions)
    best = [solution for solution, cost in zip(solutions, costs, strict=True) if cost <= costs.min() + _EQUAL]
    chosen = max(best, key=lambda solution: upright(solution.similarity.rotation @ rotations))
    others = sum(_angle(chosen.similarity.rotation, solution.similarity.rotation) > _SAME for solution in best)
    if others:
        remarks.append(
            "the control fits in more than one position of the block; the one with the most upright photos was used: "
            "check it, or measure one more control point"
        )
    elif np.count_nonzero(common.known) == UNKNOWNS:
        remarks.append("seven known coordinates are just enough: nothing checks them; measure one more control point")
    return chosen


def _solutions(common: CommonPoints, starts: Similarities) -> list[SimilarityAdjustment]:
    """Return adjustments from the best starts that have one, no two of them from nearly the same rotation."""
    solutions: list[SimilarityAdjustment] = []
    tried: list[FloatArray] = []
    for index in np.argsort(truncated_costs(common, starts)):
        rotation = starts.rotation[index]
        if any(_angle(rotation, other) < _SAME for other in tried):
            continue
        tried.append(rotation)
        with suppress(ValueError):
            solutions.append(adjust_similarity(common, starts.one(int(index))))
        if len(tried) == _BEST:
            break
    return solutions


def _without_some(common: CommonPoints, starts: Similarities) -> Similarities:
    """Return the solutions when every time another quarter of the points is left out, from the best two starts."""
    count = len(common.source)
    left_out = subsets(count, max(1, count // 4), _SUBSETS)
    weights = np.ones((len(left_out), count))
    np.put_along_axis(weights, left_out, 0.0, axis=1)
    weights = np.repeat(weights[:, :, None], 3, axis=2)[:, common.known]
    best = np.argsort(truncated_costs(common, starts))[:2]
    repeated = np.repeat(best, len(left_out))
    again = Similarities(*(values[repeated] for values in starts))
    return _least_squares(common, again, np.vstack([weights, weights]))


def upright(rotations: FloatArray) -> float:
    """Return how far photos look down or stand upright on the average: 1 entirely, -1 upside down.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    """
    return float(np.mean(np.maximum(rotations[:, 2, 2], rotations[:, 2, 1]))) if len(rotations) else 0.0


def _axis_rotations() -> FloatArray:
    """Return the 24 rotations (24, 3, 3) that turn axes into axes."""
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.array([rotation for rotation in signed if np.linalg.det(rotation) > 0.0])


def _starts(common: CommonPoints) -> Similarities:
    """Return starts in which the points have the extent, and on each axis the centre, that is known."""
    rotation = _axis_rotations()
    known = common.known
    count = np.maximum(known.sum(axis=0), 1)
    turned = common.source @ np.swapaxes(rotation, 1, 2)
    source_mean = (turned * known).sum(axis=1) / count
    target = np.where(known, common.target, 0.0)
    target_mean = target.sum(axis=0) / count
    source_size = (((turned - source_mean[:, None]) * known) ** 2).sum(axis=(1, 2))
    target_size = ((np.where(known, common.target - target_mean, 0.0)) ** 2).sum()
    scale = np.sqrt(target_size / np.maximum(source_size, np.finfo(float).tiny))
    return Similarities(scale, rotation, target_mean - scale[:, None] * source_mean)


def _errors(common: CommonPoints, scale: FloatArray) -> FloatArray:
    """Return standard deviations (s, k) of the known differences, the same on all axes of the block."""
    source = (common.source_deviation**2).mean(axis=1, keepdims=True)
    variance = common.target_deviation**2 + scale[:, None, None] ** 2 * source
    variance = variance[:, common.known]
    floor = 1e-6 * np.median(variance, axis=1, keepdims=True)
    return np.asarray(np.sqrt(np.maximum(variance, np.where(floor > 0.0, floor, 1.0))))


def _least_squares(common: CommonPoints, starts: Similarities, weights: FloatArray) -> Similarities:
    """Improve all starts at once, damped as by Levenberg and Marquardt; weights (s, k) or (k,) are those of each."""
    problem = _DampedProblem(common, starts, weights)
    best, damping = problem.start, np.full(len(starts.scale), 1e-3)
    for _ in range(_STEPS):
        tried = problem.stepped(best, damping)
        better, gain = tried.cost <= best.cost, best.cost - tried.cost
        damping = np.maximum(damping * np.where(better, 0.2, 5.0), 1e-9)
        done = (damping >= _STUCK) | (better & (gain <= _SETTLED * best.cost))
        best = _chosen(better, tried, best)
        if done.all():
            break
    return best.at._replace(shift=best.at.shift - best.at.scale[:, None] * (best.at.rotation @ problem.centroid))


def _chosen(rows: BoolArray, new: _Estimate, old: _Estimate) -> _Estimate:
    """Return estimates of which some are taken from new ones and the others from old ones."""

    def merged(one: FloatArray, other: FloatArray) -> FloatArray:
        return np.where(rows.reshape(-1, *[1] * (one.ndim - 1)), one, other)

    return _Estimate(Similarities(*map(merged, new.at, old.at)), *map(merged, new[1:], old[1:]))


class _Estimate(NamedTuple):
    """s similarities of the points reduced to their centroid: residuals (s, k), partials (s, k, 7), costs (s,)."""

    at: Similarities
    residual: FloatArray
    design: FloatArray
    cost: FloatArray


class _DampedProblem:
    """Many starts of one similarity side by side, with given weights."""

    def __init__(self, common: CommonPoints, starts: Similarities, weights: FloatArray) -> None:
        self._target, self._known = common.target, common.known
        errors = _errors(common, np.full(len(starts.scale), float(np.median(starts.scale))))
        self._root = np.sqrt(weights) / errors
        self.centroid = common.source.mean(axis=0)
        self._reduced = common.source - self.centroid
        self.start = self._linearised(starts._replace(shift=starts.apply(self.centroid[None])[:, 0]))

    def _linearised(self, at: Similarities) -> _Estimate:
        found = similarity_with_partials(at, self._reduced)
        residual = (found.value - self._target)[:, self._known] * self._root
        design = found.by_unknowns[:, self._known] * self._root[:, :, None]
        return _Estimate(at, residual, design, np.asarray((residual**2).sum(axis=1)))

    def stepped(self, here: _Estimate, damping: FloatArray) -> _Estimate:
        return self._linearised(here.at.moved(_changes(here.residual, here.design, damping)))


def _changes(residual: FloatArray, design: FloatArray, damping: FloatArray) -> FloatArray:
    """Return damped corrections (s, 7), no turn above `LARGEST_TURN`, no scale changed by more than a factor e."""
    transposed = np.swapaxes(design, 1, 2)
    normal = transposed @ design
    diagonal = np.maximum(np.einsum("sii->si", normal), np.finfo(float).tiny)
    scaling = 1.0 / np.sqrt(diagonal)
    normal = scaling[:, :, None] * normal * scaling[:, None] + damping[:, None, None] * np.eye(UNKNOWNS)
    right = scaling * (transposed @ residual[:, :, None])[:, :, 0]
    changes = -scaling * np.linalg.solve(normal, right[:, :, None])[:, :, 0]
    turn = np.linalg.norm(changes[:, 4:], axis=1)
    largest = np.maximum(turn / LARGEST_TURN, np.abs(changes[:, 0]))
    return np.asarray(changes / np.maximum(largest, 1.0)[:, None])


def of_lowest_cost(common: CommonPoints, solutions: Sequence[SimilarityAdjustment]) -> SimilarityAdjustment:
    """Return the solution of lowest robust cost; of equal ones the first."""
    return solutions[int(np.argmin(_robust_costs(common, solutions)))]


def _robust_costs(common: CommonPoints, solutions: Sequence[SimilarityAdjustment]) -> FloatArray:
    """Return the sums of min(u², 9), with residuals u in units of the standard error of the best solution."""
    known = common.known
    standard = np.array([(solution.residuals / common.errors(solution.similarity))[known] for solution in solutions])
    usual = max(1.0, min(solution.s0 for solution in solutions))
    return np.asarray(np.minimum((standard / usual) ** 2, 9.0).sum(axis=1))


def _angle(one: FloatArray, other: FloatArray) -> float:
    cosine = 0.5 * (np.trace(one.T @ other) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
