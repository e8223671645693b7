"""A similarity from partly known coordinates, for which there is no closed form: starts with rotations all around.

Gauss-Newton finds the rotation from some 60 degrees off; rotations that turn axes into axes are never further than 63
degrees from any other. Where seven coordinates are just enough, several rotations may fit.
"""

from __future__ import annotations

from contextlib import suppress
from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.geometry.similarity import UNKNOWNS, Similarities, similarity_with_partials
from orip.prelim.least_squares import LARGEST_TURN, Marquardt, least_squares, shortened
from orip.prelim.sampling import subsets
from orip.prelim.similarity.adjustment import SimilarityAdjustment, adjust_similarity
from orip.prelim.similarity.common_points import CommonPoints
from orip.prelim.similarity.start import truncated_costs

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
    common : CommonPoints
    rotations : array (p, 3, 3)
        Of the block's photos, to its system. Of solutions that fit equally the one is used in which the photos look
        down, or stand upright.
    remarks : list of str
        A remark is added to it if there was such a choice.

    Returns
    -------
    SimilarityAdjustment

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
    rule = Marquardt(np.full(len(starts.scale), 1e-3), decrease=0.2, increase=5.0, least=1e-9, largest=_STUCK)
    at = least_squares(problem, problem.start, rule, _STEPS, reweightings=0).best.at
    return at._replace(shift=at.shift - at.scale[:, None] * (at.rotation @ problem.centroid))


class _Estimate(NamedTuple):
    """s similarities of the points reduced to their centroid, with residuals (s, k), partials (s, k, 7) and weights."""

    at: Similarities
    residual: FloatArray
    design: FloatArray
    weights: FloatArray


class _DampedProblem:
    """Many starts of one similarity side by side, with given weights."""

    def __init__(self, common: CommonPoints, starts: Similarities, weights: FloatArray) -> None:
        self._target, self._known = common.target, common.known
        errors = _errors(common, np.full(len(starts.scale), float(np.median(starts.scale))))
        self._root = np.sqrt(weights) / errors
        self.centroid = common.source.mean(axis=0)
        self._reduced = common.source - self.centroid
        self._weights = np.ones((len(starts.scale), 1))
        self.start = self._linearised(starts._replace(shift=starts.apply(self.centroid[None])[:, 0]))

    def _linearised(self, at: Similarities) -> _Estimate:
        found = similarity_with_partials(at, self._reduced)
        residual = (found.value - self._target)[:, self._known] * self._root
        return _Estimate(at, residual, found.by_unknowns[:, self._known] * self._root[:, :, None], self._weights)

    def stepped(self, here: _Estimate, damping: FloatArray) -> _Estimate:
        return self._linearised(here.at.moved(_changes(here.residual, here.design, damping)))

    def reweighted(self, here: _Estimate) -> _Estimate:
        return here

    def costs(self, here: _Estimate, _weights: FloatArray) -> FloatArray:
        return np.asarray((here.residual**2).sum(axis=1))

    def converged(self, before: _Estimate, after: _Estimate) -> BoolArray:
        cost = self.costs(before, before.weights)
        return np.asarray(cost - self.costs(after, after.weights) <= _SETTLED * cost)


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
    return shortened(changes, np.maximum(turn / LARGEST_TURN, np.abs(changes[:, 0])), 1.0)


def _robust_costs(common: CommonPoints, solutions: list[SimilarityAdjustment]) -> FloatArray:
    """Return the sums of min(u², 9), with residuals u in units of the standard error of the best solution."""
    known = common.known
    standard = np.array([(solution.residuals / common.errors(solution.similarity))[known] for solution in solutions])
    usual = max(1.0, min(solution.s0 for solution in solutions))
    return np.asarray(np.minimum((standard / usual) ** 2, 9.0).sum(axis=1))


def _angle(one: FloatArray, other: FloatArray) -> float:
    cosine = 0.5 * (np.trace(one.T @ other) - 1.0)
    return float(np.arccos(np.clip(cosine, -1.0, 1.0)))
