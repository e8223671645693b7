"""Which rays are confirmed by two other photos, and which only contradict others.

Two photos show a wrong point only if it lies off the epipolar line; a third one shows wrong points on the line, too.
Rays of points common to three photos are therefore compared by the relative orientation of two of the photos and the
resection of the third one from the points of their model. Both find the orientation where more than half of the points
are wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.rays.photo_index import PhotoIndex, photo_index
from orip.prelim.relative.given_scale import at_scale
from orip.prelim.relative.pair_selection import common_point_counts
from orip.prelim.relative.parallax import Pairs
from orip.prelim.relative.solution import PairSolution, solve
from orip.prelim.resection.chance import fits_beyond_chance
from orip.prelim.resection.known_points import MANY_BLUNDERS
from orip.prelim.resection.resection import Resected, resect

_PARTNERS = 4
"""Photos with which each photo is oriented relatively: those with most common points."""

_THIRD_PHOTOS = 4
"""Photos that are resected in each model."""

_FEWEST_COMMON = 8
"""Points common to two photos, or known in a third one; with fewer, chance decides."""

_SURE_PART, _UNUSUAL = 0.1, 1.5
"""Part of the models that certainly fit as they should, and the multiple of the scale of their residuals above which a
model may be bent by wrong points along the epipolar lines."""

_WEAK = 30.0
"""Standard deviation of a point, as it is seen, over the a-priori error of a ray, above which it confirms no third ray.
"""

_NO_BASE = 3.0
"""Median of the parallaxes left by a rotation alone, in standard deviations, below which there may be no base."""

_CONFIRMED = 0.15
"""Part of the comparisons that must confirm a ray. A right one is confirmed where the two others are right; a wrong one
by chance."""


class Votes:
    """How often each ray was compared with another one and with two others, and how often they agreed.

    Attributes
    ----------
    in_pairs, in_triples : arrays (n, 2) of int
        Comparisons, and those in which all rays agreed.
    """

    def __init__(self, count: int) -> None:
        self.in_pairs, self.in_triples = np.zeros((2, count, 2), dtype=np.int64)

    @property
    def compared(self) -> BoolArray:
        """Return which rays (n,) were compared with others."""
        return np.asarray(self.in_pairs[:, 0] > 0)

    @property
    def contradicted(self) -> BoolArray:
        """Return which rays (n,) others hardly ever confirm: triples decide where there are some."""
        number, agreed = np.where(self.in_triples[:, :1] > 0, self.in_triples, self.in_pairs).T
        return np.asarray(agreed < _CONFIRMED * number)


class _Model(NamedTuple):
    """Two photos, the rows of their common points, these points, and their relative orientation."""

    photos: tuple[int, int]
    left: IntArray
    right: IntArray
    pairs: Pairs
    solution: PairSolution


class RayComparison:
    """Compares rays in pairs and triples of photos.

    Parameters
    ----------
    rays : ImageRays
    """

    def __init__(self, rays: ImageRays) -> None:
        self._rays, self._index = rays, photo_index(rays)
        self._pairs = list(compared_pairs(common_point_counts(rays)))
        self._models: dict[tuple[int, int], _Model | None] = {}

    def votes(self, most: int | None = None) -> Votes:
        """Return how often rays agreed with others.

        Parameters
        ----------
        most : int or None
            Number of pairs of photos to compare, spread over the block; None: all.
        """
        votes = Votes(len(self._rays.photo))
        step = 1 if most is None else max(len(self._pairs) // most, 1)
        models = [model for pair in self._pairs[::step] if (model := self._model(pair)) is not None]
        if models:
            usual = float(np.quantile([model.solution.scale for model in models], _SURE_PART))
            for model in models:
                if (unbent := _at_usual_scale(model, usual)) is not None:
                    _compare(self._rays, self._index, unbent, votes)
        return votes

    def _model(self, pair: tuple[int, int]) -> _Model | None:
        if pair not in self._models:
            self._models[pair] = _model(self._rays, self._index, pair)
        return self._models[pair]


def _model(rays: ImageRays, index: PhotoIndex, photos: tuple[int, int]) -> _Model | None:
    """Return the relative orientation of two photos, if it is not one by chance."""
    left, right = index.common_points(*photos)
    error = np.hypot(rays.error[left], rays.error[right])
    pairs = Pairs(rays.vectors[left], rays.vectors[right], error)
    found = solve(pairs)
    return None if found is None or found.by_chance else _Model(photos, left, right, pairs, found)


def _at_usual_scale(model: _Model, usual: float) -> _Model | None:
    """Return a model whose residuals are no larger than usual in the block; None where it has no base or is unsure."""
    solution: PairSolution | None = model.solution
    if model.solution.scale > _UNUSUAL * usual:
        solution = at_scale(model.solution, model.pairs, usual)
    if solution is None or solution.left_by_rotation < _NO_BASE * solution.scale:
        return None
    return model._replace(solution=solution)


def compared_pairs(common: IntArray) -> Iterator[tuple[int, int]]:
    """Yield the pairs of each photo and those with which it shares most points, once."""
    found: set[tuple[int, int]] = set()
    for photo, counts in enumerate(common):
        shared = counts.copy()
        shared[photo] = 0
        for other in np.argsort(-shared, kind="stable")[:_PARTNERS].tolist():
            pair = (min(photo, other), max(photo, other))
            if shared[other] >= _FEWEST_COMMON and pair not in found:
                found.add(pair)
                yield pair


def _compare(rays: ImageRays, index: PhotoIndex, model: _Model, votes: Votes) -> None:
    """Resect other photos in a model, and count which rays agree."""
    in_left, in_right, solution = model.left, model.right, model.solution
    usable = solution.usable
    weak = _deviations_in_photo(rays, model) > _WEAK * rays.error[in_left]
    _count(votes.in_pairs, (in_left, in_right), usable)
    known = rays.point[in_left[usable & ~weak]]
    place = np.full(len(rays.points), -1)
    place[known] = np.flatnonzero(usable & ~weak)
    seen = np.zeros(len(rays.points), dtype=bool)
    seen[known] = True
    counts = np.bincount(rays.photo[seen[rays.point]], minlength=len(rays.photos))
    counts[list(model.photos)] = 0
    for third in np.argsort(-counts, kind="stable")[:_THIRD_PHOTOS].tolist():
        if counts[third] < _FEWEST_COMMON:
            return
        rows = index.rows[third][seen[index.points[third]]]
        at = place[rays.point[rows]]
        fitting = _fitting(rays, rows, at, solution)
        if fitting is not None:
            _count(votes.in_triples, (rows, in_left[at], in_right[at]), fitting)
            votes.in_pairs[rows, 0] += 1
            votes.in_pairs[rows[fitting], 1] += 1


def _count(counts: IntArray, several: Sequence[IntArray], agree: BoolArray) -> None:
    """Count comparisons of rays, and those in which they agree."""
    for rows in several:
        counts[rows, 0] += 1
        counts[rows[agree], 1] += 1


def _deviations_in_photo(rays: ImageRays, model: _Model) -> FloatArray:
    """Return the standard deviations (n,) of points of a model as they are seen across their rays, mm."""
    solution = model.solution
    distance = np.linalg.norm(solution.coordinates, axis=1)
    deviation = solution.seuw * np.linalg.norm(solution.deviations, axis=1)
    return np.asarray(np.linalg.norm(rays.vectors[model.left], axis=1) * deviation / distance)


def _fitting(rays: ImageRays, rows: IntArray, at: IntArray, solution: PairSolution) -> BoolArray | None:
    """Return which rays of a photo fit its resection from points of a model; None if that may be chance."""
    deviation = max(solution.seuw, 1.0) * np.sqrt((solution.deviations[at] ** 2).sum(axis=1) / 3.0)
    found = resect(
        rays.vectors[rows],
        solution.coordinates[at],
        deviation,
        error_mm=float(rays.error[rows].mean()),
        blunders=MANY_BLUNDERS,
    )
    if not isinstance(found, Resected):
        return None
    fitting: BoolArray = np.asarray(found.weight_factor >= 1.0, dtype=bool)
    return fitting if fits_beyond_chance(rays.xy[rows], found.residuals, fitting) else None
