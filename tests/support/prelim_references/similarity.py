"""Similarities with arrays: starts, adjustment with Danish weights, partial blocks put together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from support.prelim_references.iterations import GaussNewton, least_squares, shortened

from orip.adjustment.weights import MEDIAN_OF_NORMAL, danish_weights
from orip.arrays import FloatArray, IntArray
from orip.geometry.rotation import angle_rates_from_axes_rotation, angles_from_rotation
from orip.geometry.similarity import (
    UNKNOWNS,
    Similarities,
    Similarity,
    fit_similarities,
    several,
    similarity_with_partials,
)
from orip.prelim.sampling import median
from orip.prelim.similarity.adjustment import (
    _FREE_STEPS,
    _LIMIT,
    _SINGULAR,
    _STEADY,
    _STEADY_WEIGHTS,
    _STEPS,
    CommonPoints,
    SimilarityAdjustment,
)
from orip.prelim.similarity.partial_blocks import CommonPlaces, InCommon, steady_deviations
from orip.prelim.similarity.start import _Best, _compared, truncated_costs
from orip.records.preliminary import PartialBlock


def _adjustment(common: CommonPoints, start: Similarity, unknowns: IntArray) -> SimilarityAdjustment:
    problem = _SimilarityProblem(common, start, unknowns)
    found = least_squares(problem, problem.start, GaussNewton(), _STEPS, reweightings=_FREE_STEPS - 1)
    return problem.result(found.best, found.iterations)


class _Estimate(NamedTuple):
    """One similarity of the points reduced to their centroid.

    Attributes
    ----------
    at : Similarities
        One.
    residual : array (1, k)
        Transformed minus target over the standard deviation, of the k known coordinates.
    design : array (1, k, u)
        Partials of the residuals.
    weights : array (1, k)
    step : float
        Length of the step that led here, in standard deviations of the unknowns.
    """

    at: Similarities
    residual: FloatArray
    design: FloatArray
    weights: FloatArray
    step: float


class _SimilarityProblem:
    """The adjustment of one similarity; source points are reduced to their centroid, so that the shift is its image."""

    def __init__(self, common: CommonPoints, start: Similarity, unknowns: IntArray) -> None:
        self.common, self.unknowns = common, unknowns
        self.centroid = common.source.mean(axis=0)
        self.reduced = common.source - self.centroid
        self.known = common.known
        self.errors = common.errors(start)[self.known]
        self.trusted = np.repeat(common.trusted[:, None], 3, axis=1)[self.known]
        self.redundancy = len(self.errors) - len(unknowns)
        at = Similarities(np.array([start.scale]), start.rotation[None], np.asarray(start.apply(self.centroid))[None])
        self.start = self.reweighted(self._linearised(at, np.ones((1, len(self.errors))), np.inf))

    def _linearised(self, at: Similarities, weights: FloatArray, step: float) -> _Estimate:
        found = similarity_with_partials(at, self.reduced)
        residual = (found.value - self.common.target)[:, self.known] / self.errors
        design = found.by_unknowns[:, self.known][:, :, self.unknowns] / self.errors[:, None]
        return _Estimate(at, residual, design, weights, step)

    def reweighted(self, here: _Estimate) -> _Estimate:
        residual = np.abs(here.residual[0])
        if self.redundancy <= 0 or self.trusted.all():
            return here._replace(weights=np.ones((1, len(residual))))
        shrunk = np.sqrt(len(residual) / self.redundancy)
        scale = float(np.median(residual[~self.trusted])) * shrunk / MEDIAN_OF_NORMAL
        limit = _LIMIT if scale <= 1.0 else scale * student_limit(self.redundancy)
        return here._replace(weights=np.where(self.trusted, 1.0, danish_weights(residual, limit))[None])

    def stepped(self, here: _Estimate, _damping: FloatArray) -> _Estimate:
        factors, residual, design = here.weights[0], here.residual[0], here.design[0]
        normal, scaling = _scaled_normals(design, factors)
        right = scaling * (design.T @ (factors * residual))
        change = -np.linalg.solve(normal, right)
        step = float(np.sqrt(max(0.0, -float(change @ right)) / len(self.unknowns)))
        changes = np.zeros((1, UNKNOWNS))
        changes[0, self.unknowns] = change * scaling
        changes = shortened(changes, np.linalg.norm(changes[:, 4:], axis=1))
        return self._linearised(here.at.moved(changes), here.weights, step)

    def costs(self, here: _Estimate, weights: FloatArray) -> FloatArray:
        return np.asarray((weights * here.residual**2).sum(axis=1))

    def converged(self, before: _Estimate, after: _Estimate) -> bool:
        return after.step < _STEADY and bool(np.abs(after.weights - before.weights).max() < _STEADY_WEIGHTS)

    def result(self, end: _Estimate, iterations: int) -> SimilarityAdjustment:
        at, residual, design, factors = end.at, end.residual[0], end.design[0], end.weights[0]
        normal, scaling = _scaled_normals(design, factors)
        cofactor = scaling[:, None] * np.linalg.inv(normal) * scaling
        s0 = _unit_weight_error(residual, design, factors, cofactor)
        similarity = Similarity(
            float(at.scale[0]), at.rotation[0], at.shift[0] - at.scale[0] * (at.rotation[0] @ self.centroid)
        )
        covariance = np.zeros((UNKNOWNS, UNKNOWNS))
        covariance[np.ix_(self.unknowns, self.unknowns)] = cofactor * (1.0 if s0 is None else s0**2)
        angles = angles_from_rotation(similarity.rotation)
        deviations = _deviations(similarity, angles, self.centroid, covariance)
        residuals, weights = np.full(self.known.shape, np.nan), np.ones(self.known.shape)
        residuals[self.known], weights[self.known] = residual * self.errors, factors
        return SimilarityAdjustment(
            similarity,
            angles,
            float(deviations[0]),
            deviations[1:4],
            deviations[4:],
            residuals,
            weights,
            iterations,
            s0 or 0.0,
        )


def _unit_weight_error(
    residual: FloatArray, design: FloatArray, factors: FloatArray, cofactor: FloatArray
) -> float | None:
    """Return the standard error of unit weight from the observations of full weight; None without redundancy."""
    redundancy = 1.0 - factors * ((design @ cofactor) * design).sum(axis=1)
    full = factors == 1.0
    used = float(redundancy[full].sum())
    # redundancy numbers add up to whole numbers apart from rounding
    return float(np.sqrt((residual[full] ** 2).sum() / used)) if used > 1e-6 else None


def _scaled_normals(design: FloatArray, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the normal equations with unit diagonal, and the scaling of the unknowns that made it."""
    normal = design.T @ (factors[:, None] * design)
    diagonal = np.diag(normal)
    if not (diagonal > 0.0).all():
        message = "the points do not determine the transformation"
        raise ValueError(message)
    scaling = 1.0 / np.sqrt(diagonal)
    normal = scaling[:, None] * normal * scaling
    if np.linalg.eigvalsh(normal)[0] < _SINGULAR:
        message = "the points do not determine the transformation"
        raise ValueError(message)
    return normal, scaling


def _deviations(similarity: Similarity, angles: FloatArray, centroid: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the deviations of scale, shift and angles from the covariance of the unknowns at the centroid."""
    unit = Similarities(np.array([similarity.scale]), similarity.rotation[None], np.zeros((1, 3)))
    lever = similarity_with_partials(unit, centroid[None]).by_unknowns[0, 0]
    change = np.eye(UNKNOWNS)
    change[0, 0] = similarity.scale
    # T = (image of the centroid) - m R centroid
    change[1:4, 0], change[1:4, 4:] = -lever[:, 0], -lever[:, 4:]
    change[4:, 4:] = angle_rates_from_axes_rotation(angles)
    return np.asarray(np.sqrt(np.maximum(np.diag(change @ covariance @ change.T), 0.0)))


def student_limit(redundancy: float) -> float:
    """Return the limit that a residual exceeds as rarely as a normal one exceeds 3, for s0 of small redundancy.

    Expansion of Student's distribution (Abramowitz and Stegun 1964, 26.7.5).
    """
    z = _LIMIT
    first, second = (z**3 + z) / 4.0, (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    return z + first / redundancy + second / redundancy**2


def _best_of(common: CommonPoints, triples: IntArray) -> _Best | None:
    """Return the best similarity of triples (s, 3) of points, None if all lie on lines."""
    starts = fit_similarities(common.source[triples], common.target[triples])
    if not len(starts.scale):
        return None
    costs, most = _compared(common, starts)
    return _Best(starts.one(int(costs.argmin())), most)


def best_start(common: CommonPoints, starts: list[Similarity]) -> Similarity:
    """Return the start with the least of `truncated_costs`."""
    if len(starts) == 1:
        return starts[0]
    return starts[int(truncated_costs(common, several(starts)).argmin())]


def _assembled(blocks: Sequence[PartialBlock]) -> PartialBlock:
    photos, first = np.unique(np.concatenate([block.photos for block in blocks]), return_index=True)
    all_points = np.concatenate([block.points for block in blocks])
    order = np.argsort(all_points, kind="stable")
    points = all_points[order]
    coordinates = np.concatenate([block.coordinates for block in blocks])[order]
    deviations = np.concatenate([block.deviations for block in blocks])[order]
    steady = np.concatenate([steady_deviations(block) for block in blocks])[order]
    weights = 1.0 / np.maximum(steady, _tiny(coordinates)) ** 2
    is_first = np.ones(len(points), dtype=bool)
    is_first[1:] = points[1:] != points[:-1]
    starts, place = np.flatnonzero(is_first), np.cumsum(is_first) - 1
    count = np.bincount(place)
    mean = np.add.reduceat(weights * coordinates, starts) / np.add.reduceat(weights, starts)
    square = np.add.reduceat((coordinates - mean[place]) ** 2, starts)
    spread = np.sqrt(square / np.maximum(count - 1, 1)[:, None])
    once = count == 1
    mean[once], spread[once] = coordinates[starts[once]], deviations[starts[once]]
    return PartialBlock(
        blocks[0].name,
        photos,
        np.concatenate([block.rotations for block in blocks])[first],
        np.concatenate([block.centres for block in blocks])[first],
        points[starts],
        mean,
        spread,
    )


def _tiny(coordinates: FloatArray) -> float:
    """Return a deviation that is negligible beside the coordinates, where none is given."""
    return 1e-12 * float(np.abs(coordinates).max(initial=1e-300))


def _places(source: PartialBlock, target: PartialBlock, common: InCommon) -> CommonPlaces:
    places = CommonPoints(
        np.concatenate([source.coordinates[common.at_source], source.centres[common.photo_source]]),
        np.concatenate([target.coordinates[common.at_target], target.centres[common.photo_target]]),
        _with_centres(steady_deviations(source)[common.at_source], common.photos),
        _with_centres(steady_deviations(target)[common.at_target], common.photos),
        np.arange(common.points + common.photos) >= common.points,
    )
    pairs = zip(common.photo_source.tolist(), common.photo_target.tolist(), strict=True)
    starts = [_start(source, target, pair, places) for pair in pairs]
    return CommonPlaces(places, best_start(places, starts) if starts else None, places.extent)


def _with_centres(deviations: FloatArray, centres: int) -> FloatArray:
    """Return deviations of points and, below them, of projection centres, which get the median of the points."""
    middle = median(deviations) if deviations.size else 0.0
    return np.concatenate([deviations, np.full((centres, 3), middle)])


def _start(source: PartialBlock, target: PartialBlock, photo: tuple[int, int], places: CommonPoints) -> Similarity:
    """Return the similarity that one common photo gives: only its scale comes from the points."""
    at_source, at_target = photo
    rotation = target.rotations[at_target] @ source.rotations[at_source].T
    own, other = source.centres[at_source], target.centres[at_target]
    lengths = np.linalg.norm(places.source - own, axis=1)
    images = np.linalg.norm(places.target - other, axis=1)
    far = lengths > 1e-9 * lengths.max()
    scale = median(images[far] / lengths[far]) if far.any() else 1.0
    return Similarity(scale, rotation, other - scale * (rotation @ own))
