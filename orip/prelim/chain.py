"""The chain: decides how preliminary values are found, finds them, and says what it did for each photo.

The ways are tried in the order in which they promise most; the first that orients all photos, none of them against its
points, is taken, or what two ways agree on, else the best of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from orip.arrays import BoolArray, FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.prelim.ground_control import known_centres, known_points
from orip.prelim.growing import BlockGrower
from orip.prelim.growing_block import GrowingBlock, empty_growing_block
from orip.prelim.handedness import handedness
from orip.prelim.image_rays import image_rays
from orip.prelim.intersection.intersection import intersect
from orip.prelim.misplaced_photos import misplaced_photos, residual_lengths
from orip.prelim.photo_index import photo_index
from orip.prelim.reasons import doubtful_photos, why_not_oriented
from orip.prelim.refinement.camera_corrections import parameters_with
from orip.prelim.relative.pair_selection import common_point_counts
from orip.prelim.routes import Route, by_control, by_given, by_models, by_pairs, photos_with_control
from orip.prelim.similarity.absolute_orientation import absolute_orientation
from orip.prelim.similarity.arbitrary_datum import with_arbitrary_datum
from orip.prelim.similarity.joining import Joined
from orip.prelim.thinning import thinned
from orip.prelim.weak_connections import weak_connections
from orip.records.block import Block
from orip.records.preliminary import (
    NO_POINTS,
    CameraStart,
    NotOriented,
    PhotoStart,
    PointStarts,
    PreliminaryValues,
    RelativeOrientation,
    SimilarityStep,
)

_ENOUGH, _ENOUGH_LISTED = 30, 80
"""Points of a photo that orient it; and where models are listed, point by point."""

_TO_THE_END = 1e-9
"""Relative gain in the weighted square sum after which a system does not change its shape any more."""

_STARTING_PAIRS = 5
"""First pairs that are tried one after the other."""

_GOOD = 2.5
"""Mean residual over the a-priori error: with it there is nothing to look for in another way."""

_AS_GOOD = 1.03
"""Ratio of misfits: two ways that end alike are right, though the camera may be out of calibration."""

_FAR_OFF = 15.0
"""Residuals over the a-priori error count up to this."""

_LEAST_COORDINATES = 7

_DOUBTFUL = 20.0
"""Times the a-priori error: rays that miss each other by no more place a control point where none is to spare."""

_NAMED = 6
"""Photos of a piece of a block that are named one by one."""


@dataclass(frozen=True, slots=True)
class _Outcome:
    """Where a route led on the ground, or in its own system if it could not be taken there.

    Parameters
    ----------
    route : Route
    placed : GrowingBlock
    on_ground : bool
    absolute : SimilarityStep or None
    reason : str
        Why it is not on the ground.
    findings : tuple of str
        What was probably mixed up in the control, or in what system the block is without any.
    """

    route: Route
    placed: GrowingBlock
    on_ground: bool
    absolute: SimilarityStep | None
    reason: str
    findings: tuple[str, ...] = ()


def preliminary_values(block: Block) -> PreliminaryValues:
    """Find preliminary orientations of all photos, and coordinates of all points, from nothing but measurements.

    Parameters
    ----------
    block : Block
        As gathered. Orientations in it that are not NaN are used only where control does not suffice.

    Returns
    -------
    PreliminaryValues
        In the frame of the block.
    """
    return _Chain(block).values()


class _Chain:
    def __init__(self, block: Block) -> None:
        self.block = block
        self.control, self.centres = known_points(block), known_centres(block)
        self.all_rays = image_rays(block)
        known = set(self.control.names)
        kept = np.array([name in known for name in block.point_names], dtype=bool)
        self.rays = thinned(self.all_rays, kept, _ENOUGH_LISTED if block.definition.models else _ENOUGH)
        self.row_of = {name: row for row, name in enumerate(self.rays.points)}
        self.control_errors = self._control_errors()
        self.index = photo_index(self.rays)
        self.common = common_point_counts(self.rays)
        self.by_models: Route | None = None
        self.at_once = False
        """The first way led to the end."""
        self.models: dict[tuple[int, int], RelativeOrientation | NotOriented] = {}

    def values(self) -> PreliminaryValues:
        best: _Outcome | None = None
        rank = (False, -np.inf)
        ends: list[tuple[frozenset[int], float]] = []
        for number, route in enumerate(self._routes()):
            for outcome in self._outcomes(route):
                lengths = self._residual_lengths(outcome)
                misfit = self._misfit(outcome.placed, lengths)
                found = (outcome.on_ground or bool(outcome.findings), -misfit)
                if found > rank:
                    best, rank = outcome, found
                if self._is_complete(outcome):
                    wrong = np.flatnonzero(misplaced_photos(self.rays, outcome.placed, lengths))
                    ends.append((frozenset(wrong.tolist()), misfit))
            if _is_enough(ends):
                self.at_once = number == 0
                break
        return self._told(best)

    def _routes(self) -> Iterator[Route]:
        free, with_control = self._growth(), self._growth(self._full_control())
        seeing = photos_with_control(with_control)
        models = self.block.definition.models
        if models:
            self.by_models = by_models(free, models)
            yield self.by_models
        elif seeing.mean() > 0.5:
            yield by_control(with_control)
        for choice in range(_STARTING_PAIRS):
            yield by_pairs(free, choice)
            if choice == 0 and seeing.any() and (models or seeing.mean() <= 0.5):
                yield by_control(with_control)
        given: BoolArray = np.asarray(np.isfinite(self.block.photo_orientation).all(axis=1))
        if given.any():
            orientation = np.where(given[:, None], self.block.photo_orientation, np.nan)
            rotations = np.full((len(given), 3, 3), np.nan)
            rotations[given] = rotation_from_angles(orientation[given, 3:])
            yield by_given(free, rotations, orientation[:, :3])

    def _growth(self, held: FloatArray | None = None) -> BlockGrower:
        nothing = np.full((len(self.rays.points), 3), np.nan)
        everyone = np.ones(len(self.rays.photos), dtype=bool)
        held = nothing if held is None else held
        return BlockGrower(
            self.rays, self.index, self.common, held, everyone, self.models, held_errors=self.control_errors
        )

    def _full_control(self, wanted: frozenset[str] | None = None) -> FloatArray:
        """Return the coordinates (number of points, 3) of control points known in full; NaN for others."""
        held = np.full((len(self.rays.points), 3), np.nan)
        for name, xyz in zip(self.control.names, self.control.coordinates, strict=True):
            if np.isfinite(xyz).all() and name in self.row_of and (wanted is None or name in wanted):
                held[self.row_of[name]] = xyz
        return held

    def _control_errors(self) -> FloatArray:
        """Return the root mean square a-priori errors (number of points,) of coordinates of control, 0 for others."""
        errors = np.zeros(len(self.rays.points))
        for name, error in zip(self.control.names, self.control.errors, strict=True):
            if name in self.row_of:
                errors[self.row_of[name]] = np.sqrt(np.mean(np.nan_to_num(error) ** 2))
        return errors

    def _outcomes(self, route: Route) -> Iterator[_Outcome]:
        if not route.systems:
            return
        if route.on_ground:
            yield _Outcome(route, route.systems[0], True, None, "")
            return
        first, *others = route.systems
        if not np.isfinite(self._full_control()).any():
            # no point will hold it on the ground, where it would go on to change its shape
            first = self._growth().refined(first, _TO_THE_END)
        if self.block.definition.datum == "free" and not (self.control.names or self.centres.names):
            placed, finding = with_arbitrary_datum(first, self.rays, self.block.distances)
            yield _Outcome(route, placed, True, None, "", (finding,))
            return
        outcome = self._in_ground(route, first)
        if others and not outcome.on_ground and not outcome.findings:
            outcome = replace(outcome, reason=f"{outcome.reason}; {self._pieces(route)}")
        if outcome.on_ground:
            for other in others:
                outcome = self._with_system(outcome, other)
            grower = self._growth(self._fitting_control(outcome.absolute))
            outcome = replace(outcome, placed=grower.grown(outcome.placed))
        yield outcome

    def _pieces(self, route: Route) -> str:
        """Tell of what pieces a block consists, and what control each of them sees."""
        control = np.isfinite(self._full_control()).all(axis=1)
        pieces = []
        for system in route.systems:
            names = [self.rays.photos[photo] for photo in np.flatnonzero(system.oriented)]
            listed = ", ".join(names[:_NAMED]) + (f" and {len(names) - _NAMED} more" if len(names) > _NAMED else "")
            seen = int(np.count_nonzero(system.known & control))
            pieces.append(f"photos {listed} ({seen} full control point{'' if seen == 1 else 's'})")
        return (
            f"the block is in {len(pieces)} pieces that have too few points in common to be joined, and control is "
            f"spread over them: {'; '.join(pieces)}"
        )

    def _in_ground(self, route: Route, placed: GrowingBlock) -> _Outcome:
        """Take a system to the ground, unless the control would fit it better in another reading."""
        block = placed.partial_block()
        findings = handedness(block, self.rays, self.control, self.centres)
        if findings:
            return _Outcome(route, placed, False, None, findings[0], findings)
        found = absolute_orientation(block, self.rays, self.control, self.centres)
        if not isinstance(found, Joined):
            placed = self._with_all_control(placed)
            again = absolute_orientation(placed.partial_block(), self.rays, self.control, self.centres)
            if not isinstance(again, Joined):
                return _Outcome(route, placed, False, None, found.reason)
            found = again
        similarity = found.similarity
        moved = replace(
            placed,
            rotations=similarity.rotation @ placed.rotations,
            centres=similarity.apply(placed.centres),
            coordinates=similarity.apply(placed.coordinates),
            deviations=similarity.scale * placed.deviations,
        )
        return _Outcome(route, moved, True, found.step, "")

    def _with_all_control(self, placed: GrowingBlock) -> GrowingBlock:
        """Return the system with control points, too, whose rays miss each other by more than they should.

        A camera that is not calibrated lets the two rays of a point miss each other.
        """
        wanted = np.zeros(len(self.rays.points), dtype=bool)
        wanted[[self.row_of[name] for name in self.control.names if name in self.row_of]] = True
        wanted &= ~placed.known
        rows = np.flatnonzero(wanted[self.rays.point])
        rays = placed.corrected(self.rays.of(rows))
        rays = replace(rays, error=_DOUBTFUL * rays.error)
        found = intersect(placed.rotations, placed.centres, placed.oriented, rays)
        return replace(
            placed,
            coordinates=np.where(wanted[:, None], found.coordinates, placed.coordinates),
            deviations=np.where(wanted[:, None], found.deviations, placed.deviations),
        )

    def _fitting_control(self, absolute: SimilarityStep | None) -> FloatArray:
        if absolute is None:
            return self._full_control()
        fits = np.all(absolute.weight_factor >= 1.0, axis=1)
        return self._full_control(frozenset(name for name, good in zip(absolute.points, fits, strict=True) if good))

    def _with_system(self, outcome: _Outcome, other: GrowingBlock) -> _Outcome:
        """Add the photos of another system that has control of its own."""
        new = other.oriented & ~outcome.placed.oriented
        if not new.any():
            return outcome
        found = self._in_ground(outcome.route, other)
        if not found.on_ground:
            return outcome
        placed = outcome.placed
        for photo in np.flatnonzero(new):
            placed = placed.with_photo(
                int(photo), found.placed.rotations[photo], found.placed.centres[photo], found.placed.how[photo]
            )
        return replace(outcome, placed=placed)

    # how good it is

    def _residual_lengths(self, outcome: _Outcome) -> FloatArray:
        grower = self._growth(self._fitting_control(outcome.absolute) if outcome.on_ground else None)
        return residual_lengths(grower.seen(outcome.placed), outcome.placed)

    def _misfit(self, placed: GrowingBlock, lengths: FloatArray) -> float:
        """Return the mean residual over the a-priori error; what is far off or has no place counts with a limit."""
        counted = np.where(placed.oriented[self.rays.photo], lengths, np.inf)
        judged = counted[~np.isnan(counted)]
        return float(np.minimum(judged, _FAR_OFF).mean()) if len(judged) else _FAR_OFF

    def _is_complete(self, outcome: _Outcome) -> bool:
        """Tell whether all photos are oriented, and on the ground if there is control enough for that."""
        placed = outcome.on_ground or bool(outcome.findings) or not self._control_suffices
        return placed and bool(outcome.placed.oriented.all())

    @property
    def _control_suffices(self) -> bool:
        """Return whether there is control enough for a block that contains all of it."""
        known = np.isfinite(self.control.coordinates).sum() + np.isfinite(self.centres.coordinates).sum()
        return bool(known >= _LEAST_COORDINATES)

    # what is told

    def _told(self, best: _Outcome | None) -> PreliminaryValues:
        # the user's models are listed in any case: what failed there is what is to be mended
        steps = self.by_models or (best.route if best is not None else Route(()))
        if best is None:
            nothing = empty_growing_block(self.rays)
            photos = [self._not_oriented(nothing, photo) for photo in range(len(self.rays.photos))]
            return PreliminaryValues(
                steps.relative, steps.bridges, steps.connections, None, steps.failures, tuple(photos), NO_POINTS, ()
            )
        photos = [self._photo(best, photo) for photo in range(len(self.rays.photos))]
        points = self._points(best.placed) if best.on_ground else NO_POINTS
        return PreliminaryValues(
            steps.relative,
            steps.bridges,
            steps.connections,
            best.absolute,
            steps.failures,
            tuple(photos),
            points,
            best.findings or (*self._doubtful_photos(best), *self._weak_joints(best)),
            tuple(self._cameras(best)) if best.on_ground else (),
        )

    def _cameras(self, best: _Outcome) -> Iterator[CameraStart]:
        of_photo, corrections = self.rays.cameras.of_photo, best.placed.corrections
        for unknown, correction in enumerate(corrections):
            camera = self.block.cameras[self.block.photo_camera[np.argmax(of_photo == unknown)]]
            yield CameraStart(camera.name, parameters_with(camera, correction))

    def _points(self, placed: GrowingBlock) -> PointStarts:
        """Return where the rays of all points meet, control points too, which may be wrong; else where they are."""
        found = intersect(placed.rotations, placed.centres, placed.oriented, placed.corrected(self.all_rays))
        coordinates, deviations = found.coordinates, found.deviations
        place = self.block.point_index()
        rows = np.array([place[name] for name in self.rays.points], dtype=np.int64)
        alone = placed.known & np.isnan(coordinates[rows, 0])
        coordinates[rows[alone]], deviations[rows[alone]] = placed.coordinates[alone], placed.deviations[alone]
        known = np.isfinite(coordinates[:, 0])
        return PointStarts(tuple(compress(self.all_rays.points, known)), coordinates[known], deviations[known])

    def _not_oriented(self, placed: GrowingBlock, photo: int) -> PhotoStart:
        why = why_not_oriented(self.rays, self.index, self.common, placed, photo)
        return PhotoStart(self.rays.photos[photo], None, None, why)

    def _photo(self, best: _Outcome, photo: int) -> PhotoStart:
        name, placed = self.rays.photos[photo], best.placed
        if not placed.oriented[photo]:
            return self._not_oriented(placed, photo)
        if not best.on_ground:
            how = f"oriented in the block, but the block is not on the ground: {best.reason}"
            return PhotoStart(name, None, None, how)
        return PhotoStart(name, placed.rotations[photo], placed.centres[photo], placed.how[photo])

    def _doubtful_photos(self, best: _Outcome) -> Iterator[str]:
        if best.on_ground:
            yield from doubtful_photos(self.rays, best.placed, self._residual_lengths(best))

    def _weak_joints(self, best: _Outcome) -> Iterator[str]:
        """Name the parts whose scale hangs on a few points, where the first way did not lead to the end."""
        # a photo that has no place says itself what is missing
        if not self.at_once and best.placed.oriented.all():
            known: BoolArray = np.asarray(np.isfinite(self._full_control()).all(axis=1))
            yield from weak_connections(self.rays, self.common, known)


def _is_enough(ends: list[tuple[frozenset[int], float]]) -> bool:
    """Tell from the misplaced photos and the misfits of complete outcomes whether nothing better is to be expected.

    That is so if one fits as well as it can, or if two ways have ended alike: without misplaced photos, or with the
    same ones in a block that fits well but for them.
    """
    if not ends:
        return False
    wrong, least = min(ends, key=lambda end: (len(end[0]), end[1]))
    alike = sum(photos == wrong and misfit < _AS_GOOD * least for photos, misfit in ends)
    fits = least < _GOOD
    return (fits and not wrong) or (alike > 1 and (fits or not wrong))
