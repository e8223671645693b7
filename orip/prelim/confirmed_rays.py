"""Tracks, in which many photo points are wrong: which of them other photos confirm."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.stereo import TwoPhotos
from orip.prelim.rays import ImageRays, photo_index
from orip.prelim.relative.given_scale import PairAtScale, adjusted_at_scale, at_scale
from orip.prelim.relative.orientation import common_point_counts
from orip.prelim.relative.solution import Pairs, PairSolution, solve
from orip.prelim.resection.resection import SeenPoints, fitting_points

# Two photos show a wrong point only if it lies off the epipolar line; a third one shows wrong points on the line, too.
# Rays of points common to three photos are therefore compared by the relative orientation of two of the photos and the
# resection of the third one from the points of their model. Both find the orientation where more than half of the
# points are wrong. The third photo is then oriented relatively to both others, too: a pair of photos that it belongs to
# need not be oriented by samples of its points any more, whose wrong ones might bend the model.


_PARTNERS = 4
"""Photos with which each photo is oriented relatively: those with most common points."""

_SAMPLE, _LOT = 12, 4
"""Pairs of photos, spread over the block, that tell how large residuals are, and how many of them are oriented at once
until they do."""

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
    """Two photos, the rows of their common points, and their relative orientation."""

    photos: tuple[int, int]
    left: IntArray
    right: IntArray
    solution: PairSolution | PairAtScale


class _Start(NamedTuple):
    """A relative orientation that is nearly right, and how many points say so."""

    photos: TwoPhotos
    support: int


class _Orientation(NamedTuple):
    """Rotation (3, 3), photo to model, and projection centre (3,)."""

    rotation: FloatArray
    centre: FloatArray


class RayComparison:
    """Compares rays in pairs and triples of photos.

    Some pairs spread over the block are oriented by samples of their points, others from what the resection of a third
    photo in these and in earlier models tells.

    Parameters
    ----------
    starts : mapping, optional
        Relative orientations of pairs of photos that are nearly right.
    usual : float, optional
        Scale of the residuals of models that are not bent; None: samples of points tell.
    """

    def __init__(
        self,
        rays: ImageRays,
        starts: Mapping[tuple[int, int], _Start] | None = None,
        usual: float | None = None,
    ) -> None:
        self._rays, self._index = rays, photo_index(rays)
        self._waiting = list(compared_pairs(common_point_counts(rays)))
        self._starts = dict(starts or {})
        self._usual = usual
        self._votes = Votes(len(rays.photo))

    def votes_so_far(self) -> Iterator[Votes]:
        """Yield how often rays agreed with others, as more and more pairs are compared; at the end all of them are."""
        if self._usual is None:
            self._compare_sample()
        yield self._votes
        while self._waiting:
            ready = [pair for pair in self._waiting if pair in self._starts]
            self._compare(self._models_of(ready or self._waiting))
            yield self._votes

    def votes(self) -> Votes:
        """Return how often rays agreed with others."""
        *_, votes = self.votes_so_far()
        return votes

    def of(self, rows: IntArray) -> RayComparison:
        """Return a comparison of some of the rays, which begins with what is known of the orientations.

        A scale that is unusual itself is found again: more of the models may have been bent.
        """
        return RayComparison(self._rays.of(rows), self._starts, self._usual if _is_ordinary(self._usual) else None)

    def _compare_sample(self) -> None:
        """Compare the pairs that tell the usual scale: no more than needed."""
        sample = self._waiting[:: max(len(self._waiting) // _SAMPLE, 1)]
        number = math.ceil(len(sample) / _LOT)
        models: list[_Model] = []
        for lot in range(number):
            models += self._models_of(sample[lot::number])
            scale = float(np.quantile([model.solution.scale for model in models], _SURE_PART)) if models else None
            if _is_ordinary(scale):
                break
        if number:
            self._usual = scale
        self._compare(models)

    def _models_of(self, pairs: list[tuple[int, int]]) -> list[_Model]:
        """Return the relative orientations of pairs of photos, which no longer wait."""
        taken = set(pairs)
        self._waiting = [pair for pair in self._waiting if pair not in taken]
        return [model for pair in pairs if (model := self._model(pair)) is not None]

    def _compare(self, models: list[_Model]) -> None:
        """Count which rays of models agree with others, and keep what they tell of the orientations of photos."""
        unbent = [model for one in models if (model := self._at_usual_scale(one)) is not None]
        if unbent:
            pairs = {model.photos for model in models}
            told = _compare(self._rays, unbent, self._votes, pairs.union(self._waiting))
            for photos, start in (*_starts_of(unbent), *told):
                if photos not in self._starts or start.support > self._starts[photos].support:
                    self._starts[photos] = start

    def _pairs_of(self, left: IntArray, right: IntArray) -> Pairs:
        error = np.hypot(self._rays.error[left], self._rays.error[right])
        return Pairs(self._rays.vectors[left], self._rays.vectors[right], error)

    def _model(self, photos: tuple[int, int]) -> _Model | None:
        """Return the relative orientation of two photos, if it is not one by chance."""
        left, right = self._index.common_points(*photos)
        pairs, start = self._pairs_of(left, right), self._starts.get(photos)
        if start is not None and self._usual is not None:
            adjusted = adjusted_at_scale(start.photos, pairs, self._usual)
            if adjusted is not None:
                return _Model(photos, left, right, adjusted)
        found = solve(pairs)
        return None if found is None or found.by_chance else _Model(photos, left, right, found)

    def _at_usual_scale(self, model: _Model) -> _Model | None:
        """Return a model whose residuals are no larger than usual; None where it has no base or is unsure."""
        solution: PairSolution | PairAtScale | None = model.solution
        if isinstance(solution, PairSolution) and self._usual and solution.scale > _UNUSUAL * self._usual:
            solution = at_scale(solution, self._pairs_of(model.left, model.right), self._usual)
        if solution is None or solution.left_by_rotation < _NO_BASE * solution.scale:
            return None
        return model._replace(solution=solution)


def _is_ordinary(scale: float | None) -> bool:
    """Tell whether residuals are about as large as their a-priori errors: none have a smaller scale."""
    return scale is not None and scale <= _UNUSUAL


def _starts_of(models: Sequence[_Model]) -> Iterator[tuple[tuple[int, int], _Start]]:
    """Yield the orientations of models, from which a comparison of fewer rays begins."""
    for model in models:
        yield model.photos, _Start(model.solution.photos, int(np.count_nonzero(model.solution.usable)))


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


def _compare(
    rays: ImageRays, models: Sequence[_Model], votes: Votes, wanted: Container[tuple[int, int]]
) -> list[tuple[tuple[int, int], _Start]]:
    """Resect other photos in models, count which rays agree, and return how wanted pairs of photos lie."""
    points = _points_of(rays, models)
    _count(votes.in_pairs, (points.left, points.right), points.usable)
    thirds = _third_rays(rays, models, points)
    rows, at = thirds.rows, thirds.at
    seen = SeenPoints(
        thirds.starts, rays.xy[rows], rays.vectors[rows], rays.error[rows], points.coordinates[at], points.deviation[at]
    )
    found = fitting_points(seen)
    numbers = np.diff(thirds.starts)
    agreeing = np.add.reduceat(found.fits, thirds.starts[:-1], dtype=np.int64) if len(numbers) else numbers
    compared = np.repeat(agreeing > 0, numbers)
    fits = found.fits[compared]
    _count(votes.in_triples, (rows[compared], points.left[at[compared]], points.right[at[compared]]), fits)
    _count(votes.in_pairs, (rows[compared],), fits)
    first = thirds.starts[:-1]
    return [
        told
        for photo in np.flatnonzero(agreeing).tolist()
        for told in _told_by_third(
            models[points.model[at[first[photo]]]],
            int(rays.photo[rows[first[photo]]]),
            _Orientation(found.rotations[photo], found.centres[photo]),
            int(agreeing[photo]),
            wanted,
        )
    ]


def _told_by_third(
    model: _Model, third: int, of_third: _Orientation, support: int, wanted: Container[tuple[int, int]]
) -> Iterator[tuple[tuple[int, int], _Start]]:
    """Yield the relative orientations of a third photo and those of a model."""
    left = _Orientation(np.eye(3), np.zeros(3))
    right = _Orientation(model.solution.photos.rotation, model.solution.photos.base)
    for photo, of_photo in zip(model.photos, (left, right), strict=True):
        photos = (photo, third) if photo < third else (third, photo)
        if photos not in wanted:
            continue
        one, other = (of_photo, of_third) if photo < third else (of_third, of_photo)
        base = one.rotation.T @ (other.centre - one.centre)
        yield photos, _Start(TwoPhotos(base / np.linalg.norm(base), one.rotation.T @ other.rotation), support)


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
