"""Adding photo after photo to a block: resection from its known points, then intersection of the points newly seen.

A photo that sees too few known points for resection is added by a model with an oriented photo: rotation and base come
from all points of the two photos, and one known point gives the scale.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from functools import cached_property
from itertools import islice

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.growing_block import (
    MISFIT,
    FromModels,
    GrowingBlock,
    growing_block_of,
    misplaced_photos,
    residual_lengths,
)
from orip.prelim.rays import ImageRays, PhotoIndex, intersect
from orip.prelim.refinement import ROUGH, refine
from orip.prelim.relative.orientation import OrientedPair, orient_two_photos
from orip.prelim.resection.known_points import FEW_BLUNDERS, fits_beyond_chance, image_configuration
from orip.prelim.resection.resection import Resected, resect
from orip.prelim.similarity.joining import Joined, join
from orip.prelim.similarity.start import upright
from orip.progress import stage
from orip.records.preliminary import NotOriented
from orip.structs import replace

_WELL, _BARELY = 8, 4
"""Known points in a photo: eight reveal one or two blunders; four give only a check."""

_LEAST = 3
"""Known points that suffice to orient a photo, in up to four positions."""

_NEARLY_MOST = 0.7
"""Only photos seeing at least this part of the best photo's known points are added now."""

_SCALE_CHECKED = 3
"""Known points of a model: three reveal a wrong one."""

FITTING = 0.6
"""Part of the known points that has to fit a resection; fewer where many may be wrong, if it is no chance."""

_FEWEST_FOR_MODEL = 5

_MODELS_TRIED = 6
"""Models with oriented photos that are tried for one photo."""

_BLOCKS_TRIED = 3
"""Models from which growing a partial block is tried."""

_REMOVALS = 2
"""How often a photo may be removed; after that it stays, and its residuals show that it does not fit."""

_REFINED_AT = 1.5
"""Errors add up as a block grows: when it has grown by this factor it is adjusted as a whole."""


class _Refused(Struct, frozen=True):
    """What could not be added, and how many points were known then: it is tried again once there are more.

    Photos, and models of an oriented photo and one that is not.
    """

    photos: dict[int, int] = field(default_factory=dict)
    models: dict[tuple[int, int], int] = field(default_factory=dict)


class BlockGrower(Struct, frozen=True, dict=True):
    """The rays from which a block grows, and what does not change while it grows.

    Parameters
    ----------
    common : array (photos, photos)
        Numbers of common points.
    held : array (number of points, 3)
        Coordinates of points that do not change; NaN for the others.
    allowed : array (photos,) of bool
        Photos that may be added.
    from_models : FromModels
        Of these rays.
    branching : bool
        Partial blocks may grow by themselves before they are connected; they do not branch again.
    held_errors : array (number of points,) or None
        A-priori errors of the coordinates of points that do not change; None: they are exact.
    blunders : float
        Largest part of the known points of a photo that may be wrong.
    """

    rays: ImageRays
    index: PhotoIndex
    common: IntArray
    held: FloatArray
    allowed: BoolArray
    from_models: FromModels = field(default_factory=FromModels)
    branching: bool = True
    held_errors: FloatArray | None = None
    blunders: float = FEW_BLUNDERS

    @cached_property
    def held_points(self) -> BoolArray:
        """Return which points do not change, array (number of points,)."""
        return np.isfinite(self.held[:, 0])

    @cached_property
    def _inexact_rows(self) -> IntArray:
        """Return the rays of points that do not change and have errors."""
        if self.held_errors is None:
            return np.empty(0, dtype=np.int64)
        return np.flatnonzero((self.held_points & (self.held_errors > 0.0))[self.rays.point])

    @cached_property
    def _pairs(self) -> tuple[IntArray, IntArray]:
        """Return both photos of the pairs that share points enough for a model, those with most points first."""
        first, second = np.nonzero(self.common >= _FEWEST_FOR_MODEL)
        order = np.argsort(-self.common[first, second], kind="stable")
        return first[order], second[order]

    def seen(self, current: GrowingBlock) -> ImageRays:
        """Return the rays with the cameras corrected and the a-priori errors of points that do not change included."""
        return current.corrected(self._with_errors_of_held(current))

    def _with_errors_of_held(self, current: GrowingBlock) -> ImageRays:
        """Return the rays with the errors of points that are held counted as errors of their photo points."""
        rays, rows = self.rays, self._inexact_rows
        if self.held_errors is None or not len(rows):
            return rays
        rows = rows[current.oriented[rays.photo[rows]]]
        photo, point = rays.photo[rows], rays.point[rows]
        distance = np.linalg.norm(self.held[point] - current.centres[photo], axis=1)
        error = rays.error.copy()
        error[rows] = np.hypot(error[rows], -rays.vectors[rows, 2] * self.held_errors[point] / distance)
        return replace(rays, error=error)

    def grow(self, start: GrowingBlock, enough: float = 0.0) -> GrowingBlock:
        """Return the system with all photos that can be added to it, adjusted as a whole.

        Photos that are in the wrong place after an adjustment are removed, and added again on the basis of the others.

        Parameters
        ----------
        enough : float
            Gain at which the last adjustment ends (see `refine`): `ROUGH` where another one follows.
        """
        if not self.branching:
            return self._grow(start, enough, lambda _photos: None)
        with stage("orienting photos", len(self.rays.photos)) as advance:
            return self._grow(start, enough, advance)

    def _grow(self, start: GrowingBlock, enough: float, advance: Callable[[int], None]) -> GrowingBlock:
        current, refined = start, int(start.oriented.sum())
        refused = _Refused()
        removals = np.zeros(len(self.rays.photos), dtype=np.int64)
        while True:
            added = self._with_more_photos(current, refused)
            if added is not None:
                current = self._intersected_again(added, added.oriented & ~current.oriented)
            count = int(current.oriented.sum())
            advance(count)
            if added is not None and count < _REFINED_AT * refined + 1:
                continue
            current, refined = self.refined(current, enough if added is None else ROUGH), count
            lengths = residual_lengths(self.seen(current), current)
            wrong = misplaced_photos(self.rays, current, lengths, self.blunders) & (removals < _REMOVALS)
            if wrong.any() and not wrong[current.oriented].all():
                removals += wrong
                refused = _Refused()
                current = self.intersected(current.without_photos(wrong))
            elif added is None:
                return current

    def intersected(self, current: GrowingBlock) -> GrowingBlock:
        """Return the system with all points that its photos determine."""
        found = intersect(current.rotations, current.centres, current.oriented, current.corrected(self.rays))
        return self._with_points(current, found.coordinates, found.deviations)

    def _intersected_again(self, current: GrowingBlock, photos: BoolArray) -> GrowingBlock:
        """Return the block after a new intersection of the points that some of its photos see."""
        concerned = np.zeros(len(self.rays.points), dtype=bool)
        for photo in np.flatnonzero(photos):
            concerned[self.index.points[photo]] = True
        part = self.rays.of(np.flatnonzero(concerned[self.rays.point]))
        found = intersect(current.rotations, current.centres, current.oriented, current.corrected(part))
        coordinates = np.where(concerned[:, None], found.coordinates, current.coordinates)
        deviations = np.where(concerned[:, None], found.deviations, current.deviations)
        return self._with_points(current, coordinates, deviations)

    def refined(self, current: GrowingBlock, enough: float) -> GrowingBlock:
        """Return the system after an adjustment of all its photos and points, which ends at a gain (see `refine`)."""
        found = refine(
            self._with_errors_of_held(current),
            current.rotations,
            current.centres,
            current.oriented,
            current.coordinates,
            corrections=current.corrections,
            held_points=self.held_points,
            enough=enough,
        )
        moved = replace(current, rotations=found.rotations, centres=found.centres, corrections=found.corrections)
        return self.intersected(moved)

    def _with_points(self, current: GrowingBlock, coordinates: FloatArray, deviations: FloatArray) -> GrowingBlock:
        """Return the system with points newly computed, which are overwritten where they are held."""
        rows = self.held_points
        if rows.any():
            coordinates[rows] = self.held[rows]
            deviations[rows] = 0.0 if self.held_errors is None else self.held_errors[rows, None]
        return replace(current, coordinates=coordinates, deviations=deviations)

    def _with_more_photos(self, current: GrowingBlock, refused: _Refused) -> GrowingBlock | None:
        """Return the block with the photos that can be added in the safest possible way; None if there are none."""
        counts = np.bincount(self.rays.photo[current.known[self.rays.point]], minlength=len(self.rays.photos))
        counts[current.oriented | ~self.allowed] = 0
        return (
            self._resected(current, counts, _WELL, refused)
            or self._with_model(current, refused)
            or self._resected(current, counts, _BARELY, refused)
            or (self._with_block(current) if self.branching else None)
            or (self._by_three_points(current) if self.held_points.any() else None)
        )

    def _resected(self, current: GrowingBlock, counts: IntArray, fewest: int, refused: _Refused) -> GrowingBlock | None:
        """Return the block with the photos that see most of its points, and at least `fewest`.

        Of photos that may be added `counts` (photos,) says how many known points they see.
        """
        # what failed is tried again when more points are known
        counts[[photo for photo, count in refused.photos.items() if count >= counts[photo]]] = 0
        most = int(counts.max(initial=0))
        if most < fewest:
            return None
        result, seen, known = None, current.corrected(self.rays), current.known
        for photo in np.flatnonzero(counts >= max(fewest, _NEARLY_MOST * most)):
            found = self.resection(current, seen, int(photo), known)
            if found is None:
                refused.photos[int(photo)] = int(counts[photo])
            else:
                result = (result or current).with_photo(int(photo), found.rotation, found.centre, found.how)
        return result

    def resection(self, current: GrowingBlock, seen: ImageRays, photo: int, known: BoolArray) -> Resected | None:
        """Return the orientation of a photo from the `known` points of a system that it sees, if they agree on one.

        `seen` are the rays with the cameras corrected as estimated in the system.
        """
        is_known = known[self.index.points[photo]]
        rows, points = self.index.rows[photo][is_known], self.index.points[photo][is_known]
        deviation = np.sqrt((current.deviations[points] ** 2).sum(axis=1) / 3.0)
        error = float(self.rays.error[rows].sum()) / max(len(rows), 1)
        found = resect(
            seen.vectors[rows], current.coordinates[points], deviation, error_mm=error, blunders=self.blunders
        )
        if not isinstance(found, Resected) or len(found.alternatives.centres) or found.redundancy < 2:
            return None
        if not self._enough_fit(found, self.rays.xy[rows]):
            return None
        spread = image_configuration(self.rays.xy[rows], None, self.rays.xy[self.index.rows[photo]])
        return found if spread.shortcoming is None else replace(found, how=f"{found.how}; {spread.shortcoming}")

    def _enough_fit(self, found: Resected, xy: FloatArray) -> bool:
        """Tell whether so many known points fit a resection, or fit it so well, that it is no chance.

        Where many points may be wrong, most of a few fit by chance.
        """
        fitting: BoolArray = np.asarray(found.weight_factor >= 1.0)
        part = int(np.count_nonzero(fitting)) / len(fitting)
        if part >= FITTING and (len(fitting) >= _WELL or self.blunders <= FEW_BLUNDERS):
            return True
        return part >= 1.0 - self.blunders and fits_beyond_chance(xy, found.residuals, fitting)

    def _by_three_points(self, current: GrowingBlock) -> GrowingBlock | None:
        """Return the block with the photos that see exactly three known points, each in its most likely position.

        Of up to four positions the one is used in which most other rays of the photo meet those of oriented photos;
        of equally good ones the most upright, as the vertical is known on the ground.
        """
        known, result = current.known, None
        for photo in np.flatnonzero(self.allowed & ~current.oriented):
            rows = self.index.rows[photo][known[self.index.points[photo]]]
            if len(rows) != _LEAST:
                continue
            points = self.rays.point[rows]
            seen = current.corrected(self.rays.of(rows))
            found = resect(seen.vectors, current.coordinates[points], error_mm=float(np.median(seen.error)))
            if not isinstance(found, Resected):
                continue
            rotations = np.concatenate([found.rotation[None], found.alternatives.rotations])
            centres = np.concatenate([found.centre[None], found.alternatives.centres])
            tried = [current.with_photo(int(photo), *position, "") for position in zip(rotations, centres, strict=True)]
            met = np.array([self._rays_that_meet(position, int(photo)) for position in tried])
            best = np.flatnonzero(met == met.max())
            chosen = max(best, key=lambda row: upright(rotations[[row]]))
            how = "space resection from 3 points, without a check"
            if len(best) > 1:
                how += f"; {len(best)} positions fit them, the most upright one was used: measure one more known point"
            result = (result or current).with_photo(int(photo), rotations[chosen], centres[chosen], how)
        return result

    def _rays_that_meet(self, current: GrowingBlock, photo: int) -> int:
        """Return how many points are determined only with the rays of a photo, and fit them."""
        found = self._intersected_again(current, np.arange(len(current.oriented)) == photo)
        lengths = residual_lengths(self.seen(found), found)[self.index.rows[photo]]
        return int(np.count_nonzero(lengths <= MISFIT))

    def _with_model(self, current: GrowingBlock, refused: _Refused) -> GrowingBlock | None:
        """Return the system with the photo that shares most points with an oriented one, connected by their model.

        Known points have to fit: they give the scale and check it.
        """
        all_known = current.known
        for oriented, photo in self._models_to_try(current):
            model = self.model(oriented, photo)
            if isinstance(model, NotOriented) or model.fitting < FITTING:
                continue
            known = np.count_nonzero(all_known[model.block.points])
            if known < _SCALE_CHECKED or refused.models.get((oriented, photo), 0) >= known:
                continue
            joined = join(model.block, current.part(oriented, model.block.points), self.rays, "connect")
            if isinstance(joined, Joined) and _fitting_points(joined) >= _SCALE_CHECKED:
                place = int(np.flatnonzero(joined.block.photos == photo)[0])
                how = (
                    f"model with photo {self.rays.photos[oriented]} ({len(model.rows[0])} points), connected by "
                    f"{len(joined.step.points)} known points"
                )
                return current.with_photo(photo, joined.block.rotations[place], joined.block.centres[place], how)
            refused.models[oriented, photo] = int(known)
        return None

    def _with_block(self, current: GrowingBlock) -> GrowingBlock | None:
        """Return the system with a partial block grown from an oriented photo, which has too few known points at first.

        The partial block grows by itself: the more photos it has, the more of its points are known, and give its scale.
        """
        for oriented, photo in islice(self._models_to_try(current), _BLOCKS_TRIED):
            model = self.model(oriented, photo)
            if isinstance(model, NotOriented) or model.fitting < FITTING:
                continue
            how = f"model with photo {self.rays.photos[oriented]} ({len(model.rows[0])} points)"
            allowed = self.allowed & ~current.oriented
            grower = replace(self, held=np.full_like(self.held, np.nan), allowed=allowed, branching=False)
            block = grower.grown_from(model, how, current.corrections)
            joined = join(
                block.partial_block(), current.part(oriented, np.flatnonzero(block.known)), self.rays, "connect"
            )
            if not isinstance(joined, Joined) or _fitting_points(joined) < 1:
                continue
            # the photos that the partial block began with may have been removed from it as wrong
            more = current.with_photos_of(block, joined)
            if more is not current:
                return more
        return None

    def model(self, left: int, right: int) -> OrientedPair | NotOriented:
        """Return the relative orientation of a photo to another one."""
        models, pair, name = self.from_models.models, (left, right), self.rays.photos[left]
        if pair not in models:
            earlier = self.from_models.earlier.get(pair)
            models[pair] = orient_two_photos(self.rays, *pair, model=name, index=self.index, earlier=earlier)
        return models[pair]

    def grown_from(self, model: OrientedPair, how: str, corrections: FloatArray) -> GrowingBlock:
        """Return what grows from a model without control, by which `how` its two photos are oriented.

        The cameras start with `corrections` (cameras, 4).
        """
        key = (*model.photos, self.branching, self.allowed.tobytes(), corrections.tobytes())
        if key not in self.from_models.blocks:
            start = replace(growing_block_of(self.rays, model.block, how), corrections=corrections)
            self.from_models.blocks[key] = self.grow(start, ROUGH)
        return self.from_models.blocks[key]

    def _models_to_try(self, current: GrowingBlock) -> Iterator[tuple[int, int]]:
        """Yield pairs of an oriented photo and one that is not, those with most common points first."""
        first_of, photo_of = self._pairs
        waiting = ~current.oriented
        rows = np.flatnonzero((waiting & self.allowed)[photo_of] & ~waiting[first_of])
        tried: Counter[int] = Counter()
        for first, photo in zip(first_of[rows].tolist(), photo_of[rows].tolist(), strict=True):
            if tried[photo] < _MODELS_TRIED:
                tried[photo] += 1
                yield first, photo


def _fitting_points(joined: Joined) -> int:
    return int(np.sum(np.all(joined.step.weight_factor >= 1.0, axis=1)))
