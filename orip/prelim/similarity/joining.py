"""Joining two partial blocks: the similarity that transforms one to the system of the other, from what both contain.

Both contain points, and often a photo. A common photo gives the rotation directly, and its projection centre is a point
that cannot be numbered wrongly and lies far from the ground points, which may all be near one line.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Literal, Protocol

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.compiled import kernels
from orip.prelim.sampling import median
from orip.prelim.similarity.adjustment import (
    ALL_UNKNOWNS,
    NO_ROTATION,
    NUMBERS_FOUND,
    RULES,
    SimilarityAdjustment,
    adjust_similarity,
    adjustment_of,
    misfits,
    room_for_cameras,
)
from orip.prelim.similarity.partial_blocks import STEADY, CommonPlaces, common_places, in_common, transformed
from orip.prelim.similarity.start import FITTING, MEDIAN_OF_CHI2, start_from_triples
from orip.records.preliminary import NotOriented, PartialBlock, SimilarityStep
from orip.structs import replace
from orip.wording import counted

Step = Literal["bridge", "connect", "absolute"]

POINTS_WITHOUT_PHOTO = 3
"""Common points that are needed where no photo is common."""

_WITH_ROTATION = 4
"""Common places that determine the rotation better than a common photo does."""

_AGREEMENT = 0.05
"""Median residual, as a part of the extent of the points, above which two systems are not of the same object:
measuring errors, however large, stay below 0.01; points with interchanged names lie some 0.3 apart."""

_LARGE = 0.1 * _AGREEMENT
"""Median residual, as a part of the extent, above which most points have to fit."""

_RULES_OF_JOINING = np.array([STEADY, MEDIAN_OF_CHI2, FITTING, _AGREEMENT, _LARGE])
"""The constants as the compiled loop takes them: `JoiningRules` in joining.h."""

_MM = 1000.0
"""Millimetres in a metre: systems are in metres at photo scale."""


class Names(Protocol):
    """Names by index of photos and points, such as `ImageRays`."""

    @property
    def photos(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def points(self) -> tuple[str, ...]: ...  # noqa: D102


class Joined(Struct, frozen=True):
    """A partial block in the system of another one, or on the ground.

    Parameters
    ----------
    similarity : Similarity
        The transformation to that system.
    block : PartialBlock
        In the target system. Points that do not fit have their residuals as deviations.
    step : SimilarityStep
        For the listing.
    """

    similarity: Similarity
    block: PartialBlock
    step: SimilarityStep


def join(source: PartialBlock, target: PartialBlock, names: Names, step: Step) -> Joined | NotOriented:
    """Transform a partial block to the system of another one, by their common points and photos.

    Parameters
    ----------
    source, target : PartialBlock
        The one that is moved, and the one that stays.
    names : Names
        For the points and photos of remarks.
    step : {"bridge", "connect"}
        What the listing calls it.

    Returns
    -------
    Joined or NotOriented
        Without a common photo three points off one line are needed; with one, a single point. With fewer than four
        common places (points and projection centres) the rotation is that of the common photo.
    """
    found = _found(source, target, names)
    if isinstance(found, str):
        return NotOriented(source.name, target.name, found)
    points = [names.points[k] for k in source.points[found.at_source].tolist()]
    photo = names.photos[found.photo] if found.photo is not None else ""
    remarks = list(found.remarks)
    if found.unfit:
        remarks += misfits(
            points, found.coordinates, found.adjustment, room_for_cameras(names, (*source.photos, *target.photos))
        )
    return Joined(
        found.adjustment.similarity,
        found.block,
        similarity_step(
            found.adjustment,
            step,
            (source.name, target.name),
            points,
            found.coordinates,
            common_photo=photo,
            remarks=remarks,
        ),
    )


class _Found(Struct, frozen=True):
    """A partial block that was joined to another one by n common points.

    Parameters
    ----------
    at_source : array (n,) of int
        The common points, as rows of the points of the source.
    coordinates : array (n, 3)
        In the target.
    adjustment : SimilarityAdjustment
        With the residuals and weight factors of these points.
    block : PartialBlock
        The source in the target system.
    photo : int or None
        The first common photo.
    unfit : int
        Number of points that do not fit.
    """

    at_source: IntArray
    coordinates: FloatArray
    adjustment: SimilarityAdjustment
    block: PartialBlock
    photo: int | None
    unfit: int
    remarks: tuple[str, ...] = ()


def _found(source: PartialBlock, target: PartialBlock, names: Names) -> _Found | str:
    """Join by common photos in the compiled loop where these and the points agree, else as `_Joint` does."""
    points, photos = len(source.points), len(source.photos)
    at_source, targets, moved = np.empty(points, dtype=np.int64), np.empty((points, 3)), np.empty((2, points, 3))
    residuals, factors = np.empty((2, points + photos, 3))
    rotations, centres, adjustment = np.empty((photos, 3, 3)), np.empty((photos, 3)), np.empty(NUMBERS_FOUND)
    joined = kernels.join_by_photos(
        *_arrays(source), *_arrays(target), RULES, _RULES_OF_JOINING,
        at_source, targets, residuals, factors, *moved, rotations, centres, adjustment,
    )  # fmt: skip
    if isinstance(joined, bool):
        joint = _Joint(source, target, names)
        by_points = joined and joint.point_count >= POINTS_WITHOUT_PHOTO
        return joint.found_by_points() if by_points else joint.found()
    common, common_photos, row, unfit = joined
    photo = int(source.photos[row])
    held = common + common_photos < _WITH_ROTATION
    return _Found(
        at_source[:common],
        targets[:common],
        adjustment_of(adjustment, residuals[:common], factors[:common]),
        PartialBlock(source.name, source.photos, rotations, centres, source.points, moved[0], moved[1]),
        photo,
        unfit,
        (_held_rotation(common, [names.photos[photo]]),) if held else (),
    )


def _arrays(block: PartialBlock) -> Iterator[FloatArray | IntArray]:
    """Return the arrays of a partial block as the compiled loop takes them."""
    arrays = block.points, block.photos, block.coordinates, block.deviations, block.rotations, block.centres
    return map(np.ascontiguousarray, arrays)


def _held_rotation(points: int, photos: Sequence[str]) -> str:
    return f"with {counted(points, 'common point')} the rotation is that of photo {', '.join(photos)}"


class _Joint:
    """What two partial blocks have in common: points first, then the projection centres of photos."""

    def __init__(self, source: PartialBlock, target: PartialBlock, names: Names) -> None:
        self.source, self.target, self.names = source, target, names
        self.common = in_common(source, target)
        self.point_count, self.photo_count = self.common.points, self.common.photos

    @cached_property
    def photos(self) -> list[str]:
        """The names of the common photos."""
        return [self.names.photos[k] for k in self.source.photos[self.common.photo_source].tolist()]

    @cached_property
    def places(self) -> CommonPlaces:
        """The common points and projection centres, and the start that the common photos give."""
        return common_places(self.source, self.target, self.common)

    def found(self) -> _Found | str:
        """Return how the one is joined to the other, or why it cannot be."""
        missing = self._missing()
        if missing:
            return missing
        remarks: list[str] = []
        try:
            start = self.places.start
            adjustment = self._by_triples() if start is None else self._by_photos(start, remarks)
            reason = self._disagreement(adjustment)
        except ValueError as error:
            return f"{error}; {self._shared()}"
        if reason and self.photo_count and self.point_count >= POINTS_WITHOUT_PHOTO:
            return self.found_by_points(remarks)
        return reason or self._result(adjustment, remarks)

    def found_by_points(self, remarks: Sequence[str] = ()) -> _Found | str:
        """Return the same where the rotations of the common photos do not agree with the points."""
        try:
            adjustment = self._by_triples()
        except ValueError as error:
            return f"{error}; {self._shared()}"
        said = *remarks, "the rotations of the common photo do not agree; joined by the points"
        return self._disagreement(adjustment) or self._result(adjustment, said)

    def _missing(self) -> str:
        points, photos = self.point_count, self.photo_count
        if photos and points + photos < 2:
            return (
                f"photo {self.photos[0]} is common, but no point is: the scale is not determined; measure common points"
            )
        if not photos and points < POINTS_WITHOUT_PHOTO:
            needed = f"no common photo, {POINTS_WITHOUT_PHOTO} points are needed"
            return f"{counted(points, 'common point')} and {needed}; measure more of them"
        return ""

    def _shared(self) -> str:
        photos = f" and photo {', '.join(self.photos)}" if self.photo_count else ""
        return f"in common: {counted(self.point_count, 'point')}{photos}"

    def _by_triples(self) -> SimilarityAdjustment:
        return adjust_similarity(self.places.places, start_from_triples(self.places.places))

    def _by_photos(self, start: Similarity, remarks: list[str]) -> SimilarityAdjustment:
        """Adjust from the rotations and centres of the common photos."""
        if self.point_count + self.photo_count >= _WITH_ROTATION:
            try:
                return adjust_similarity(self.places.places, start, ALL_UNKNOWNS)
            except ValueError:
                remarks.append("the common points and the projection centre lie on one line")
        remarks.append(_held_rotation(self.point_count, self.photos))
        return adjust_similarity(self.places.places, start, NO_ROTATION)

    def _disagreement(self, found: SimilarityAdjustment) -> str:
        """Return why the common points cannot be those of the same object; empty if they can."""
        typical = median(found.lengths[: self.point_count]) if self.point_count else 0.0
        extent = self.places.extent
        if typical <= _LARGE * extent:
            return ""
        if typical > _AGREEMENT * extent:
            return (
                f"the common points do not agree: their residuals are {typical * _MM:.2g} mm with an extent of "
                f"{extent * _MM:.2g} mm at photo scale; {self._shared()}: are points of one model numbered wrongly?"
            )
        fits = int(np.count_nonzero(found.fits[: self.point_count]))
        if 2 * fits < self.point_count:
            return (
                f"only {fits} of {self.point_count} common points agree: are points of one model numbered wrongly? "
                f"The residuals are {typical * _MM:.2g} mm with an extent of {extent * _MM:.2g} mm at photo scale"
            )
        return ""

    def _result(self, found: SimilarityAdjustment, remarks: Sequence[str]) -> _Found:
        count, rows = self.point_count, self.common.at_source
        own = replace(found, residuals=found.residuals[:count], weight_factor=found.weight_factor[:count])
        block = transformed(self.source, found.similarity)
        off = np.flatnonzero(~own.fits)
        if len(off):
            deviations = block.deviations.copy()
            deviations[rows[off]] = np.maximum(deviations[rows[off]], np.abs(own.residuals[off]))
            block = replace(block, deviations=deviations)
        photo = int(self.source.photos[self.common.photo_source[0]]) if self.photo_count else None
        return _Found(rows, self.places.places.target[:count], own, block, photo, len(off), tuple(remarks))


def similarity_step(
    found: SimilarityAdjustment,
    step: Step,
    systems: tuple[str, str],
    points: Sequence[str],
    coordinates: FloatArray,
    *,
    common_photo: str = "",
    remarks: Sequence[str] = (),
) -> SimilarityStep:
    """Return an adjustment as listings show it, with the names of its points."""
    return SimilarityStep(
        step=step,
        source=systems[0],
        target=systems[1],
        common_photo=common_photo,
        points=tuple(points),
        coordinates=coordinates,
        residuals=found.residuals,
        weight_factor=found.weight_factor,
        scale=found.similarity.scale,
        scale_deviation=found.scale_deviation,
        shift=found.similarity.shift,
        shift_deviation=found.shift_deviation,
        angles=found.angles,
        angle_deviation=found.angle_deviation,
        iterations=found.iterations,
        s0=found.s0,
        max_residual=found.max_residual,
        remarks=tuple(remarks),
    )
