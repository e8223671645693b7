"""Which rays are confirmed by two other photos, and which only contradict others.

Two photos show a wrong point only if it lies off the epipolar line; a third one shows wrong points on the line, too.
Rays of points common to three photos are therefore compared by the relative orientation of two of the photos and the
resection of the third one from the points of their model. Both find the orientation where more than half of the points
are wrong.
"""

from __future__ import annotations

import math
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
from orip.prelim.resection.fitting_points import SeenPoints, fitting_points

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
            unbent = [model for one in models if (model := _at_usual_scale(one, usual)) is not None]
            if unbent:
                _compare(self._rays, unbent, votes)
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


class _ModelPoints(NamedTuple):
    """The points of several models, one after the other.

    Attributes
    ----------
    model : array (n,) of int
    left, right : arrays (n,) of int
        Rows of their rays.
    usable : array (n,) of bool
    coordinates : array (n, 3)
    deviation : array (n,)
        Standard deviation of a point, in units of the base.
    deviation_in_photo : array (n,)
        The same as it is seen across its rays, mm; without the scale of small residuals.
    """

    model: IntArray
    left: IntArray
    right: IntArray
    usable: BoolArray
    coordinates: FloatArray
    deviation: FloatArray
    deviation_in_photo: FloatArray


def _points_of(rays: ImageRays, models: Sequence[_Model]) -> _ModelPoints:
    solutions = [model.solution for model in models]
    model = np.repeat(np.arange(len(models)), [len(model.left) for model in models])
    left, right = (np.concatenate(rows) for rows in zip(*((model.left, model.right) for model in models), strict=True))
    coordinates = np.concatenate([solution.coordinates for solution in solutions])
    seuw = np.array([solution.seuw for solution in solutions])[model]
    length = np.linalg.norm(np.concatenate([solution.deviations for solution in solutions]), axis=1)
    distance = np.linalg.norm(coordinates, axis=1)
    return _ModelPoints(
        model,
        left,
        right,
        np.concatenate([solution.usable for solution in solutions]),
        coordinates,
        np.maximum(seuw, 1.0) * length / math.sqrt(3.0),
        np.linalg.norm(rays.vectors[left], axis=1) * (seuw * length) / distance,
    )


class _ThirdRays(NamedTuple):
    """Rays of other photos that see points of models: rows of rays, places of points, and where each photo begins."""

    rows: IntArray
    at: IntArray
    starts: IntArray


def _compare(rays: ImageRays, models: Sequence[_Model], votes: Votes) -> None:
    """Resect other photos in models, and count which rays agree."""
    points = _points_of(rays, models)
    _count(votes.in_pairs, (points.left, points.right), points.usable)
    thirds = _third_rays(rays, models, points)
    rows, at = thirds.rows, thirds.at
    seen = SeenPoints(
        thirds.starts, rays.xy[rows], rays.vectors[rows], rays.error[rows], points.coordinates[at], points.deviation[at]
    )
    fits = fitting_points(seen).fits
    numbers = np.diff(thirds.starts)
    agreeing = np.add.reduceat(fits, thirds.starts[:-1], dtype=np.int64) if len(numbers) else numbers
    compared = np.repeat(agreeing > 0, numbers)
    rows, at, fits = rows[compared], at[compared], fits[compared]
    _count(votes.in_triples, (rows, points.left[at], points.right[at]), fits)
    _count(votes.in_pairs, (rows,), fits)


def _third_rays(rays: ImageRays, models: Sequence[_Model], points: _ModelPoints) -> _ThirdRays:
    """Return the rays of the photos that see most of the points of each model, photo by photo, by ascending point."""
    weak = points.deviation_in_photo > _WEAK * rays.error[points.left]
    known = np.flatnonzero(points.usable & ~weak)
    starts, order = rays.point_starts(), np.arange(len(rays.point))[rays.order_by_point()]
    first, number = starts[rays.point[points.left[known]]], np.diff(starts)[rays.point[points.left[known]]]
    at = np.repeat(known, number)
    rows = order[np.arange(len(at)) + np.repeat(first - np.cumsum(number) + number, number)]
    photos = len(rays.photos)
    place = points.model[at] * photos + rays.photo[rows]
    counts = np.bincount(place, minlength=len(models) * photos).reshape(-1, photos)
    of_model = np.array([model.photos for model in models])
    np.put_along_axis(counts, of_model, 0, axis=1)
    chosen = np.zeros(counts.shape, dtype=bool)
    np.put_along_axis(chosen, np.argsort(-counts, axis=1, kind="stable")[:, :_THIRD_PHOTOS], True, axis=1)
    used = (chosen & (counts >= _FEWEST_COMMON)).ravel()[place]
    rows, at, place = rows[used], at[used], place[used]
    ordered = np.lexsort((rays.point[rows], place))
    rows, at, place = rows[ordered], at[ordered], place[ordered]
    begins = np.flatnonzero(np.diff(place, prepend=-1))
    return _ThirdRays(rows, at, np.append(begins, len(place)))


def _count(counts: IntArray, several: Sequence[IntArray], agree: BoolArray) -> None:
    """Count comparisons of rays, and those in which they agree."""
    for rows in several:
        counts[:, 0] += np.bincount(rows, minlength=len(counts))
        counts[:, 1] += np.bincount(rows[agree], minlength=len(counts))
