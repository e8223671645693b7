"""From where a route has led to the ground: absolute orientation, one oriented photo, and growth by control."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.geometry.rotation import rotation_from_angles
from orip.geometry.similarity import Similarity
from orip.prelim.ground import ratios_of_distances, with_arbitrary_datum
from orip.prelim.growing_block import GrowingBlock, residual_lengths
from orip.prelim.measured_block import MeasuredBlock
from orip.prelim.rays import intersect, with_consensus
from orip.prelim.routes import Route, by_pairs
from orip.prelim.similarity.absolute_orientation import absolute_orientation
from orip.prelim.similarity.control_reading import other_reading
from orip.prelim.similarity.joining import Joined
from orip.records.preliminary import ControlReading, NotOriented, SimilarityStep
from orip.structs import replace
from orip.wording import counted, first_names

# Position and rotation are those of the photo; scale comes from known coordinates of other projection centres, else
# from distances.

_LEAST_BASE = 1e-3
"""Known coordinates have to differ from those of the photo by more than this part of the model's extent."""


class ByPhoto(NamedTuple):
    """A similarity, and a sentence that says where it comes from."""

    similarity: Similarity
    finding: str


def similarity_of_photo(measured: MeasuredBlock, grown: GrowingBlock) -> ByPhoto | None:
    """Return the similarity that takes a block to the ground; None where no photo of it is known, or no scale."""
    given = measured.block.photo_orientation
    known = np.flatnonzero(np.isfinite(given).all(axis=1) & grown.oriented)
    if not len(known):
        return None
    photo = int(known[0])
    turn = rotation_from_angles(given[photo, 3:]) @ grown.rotations[photo].T
    offset = (grown.centres - grown.centres[photo]) @ turn.T
    observed = given[:, :3] - given[photo, :3]
    extent = float(np.nanmax(np.linalg.norm(offset, axis=1)))
    tells = np.isfinite(observed) & grown.oriented[:, None] & (np.abs(np.nan_to_num(offset)) > _LEAST_BASE * extent)
    if tells.any():
        scale = float(offset[tells] @ observed[tells] / (offset[tells] @ offset[tells]))
        size = "other projection centres"
    else:
        ratios = ratios_of_distances(grown, measured.rays, measured.block.distances)
        scale = float(np.median(ratios)) if ratios else 0.0
        size = counted(len(ratios), "distance")
    if not scale > 0.0:
        return None
    similarity = Similarity(scale, turn, given[photo, :3] - scale * (turn @ grown.centres[photo]))
    name = measured.rays.photos[photo]
    return ByPhoto(similarity, f"origin and axes are given by the orientation of photo {name}, the scale by {size}")


_TO_THE_END = 1e-9
"""Relative gain in the weighted square sum below which a block no longer changes its shape."""

_DOUBTFUL = 20.0
"""Multiple of the a-priori error by which rays of control points may miss each other if none can be spared."""

_LOOKING_UP = -0.5
"""Mean cosine of the angle between the photos' z axes and the vertical below which photos are said to look up."""

_AS_WELL = 3.0
"""Multiple of the largest residual of control in an absolute orientation up to which it fits another one as well."""

_NAMED = 6
"""Number of photos of a part of a block that are named one by one."""


class Outcome(Struct, frozen=True):
    """Where a route led on the ground, or in its own system if it could not be taken there.

    Parameters
    ----------
    reason : str
        Why it is not on the ground.
    findings : tuple of str
        In what system the block is without control.
    reading : ControlReading or None
        How the control would have to be read to fit; the block is not taken to the ground then.
    has_arbitrary_datum : bool
        It is a free network in a system of its own.
    """

    route: Route
    grown: GrowingBlock
    on_ground: bool
    absolute: SimilarityStep | None
    reason: str
    findings: tuple[str, ...] = ()
    reading: ControlReading | None = None
    has_arbitrary_datum: bool = False

    @property
    def is_final(self) -> bool:
        """Return whether the block is on the ground, or it is known what is wrong with the control."""
        return self.on_ground or self.reading is not None


def outcome_of(measured: MeasuredBlock, route: Route) -> Outcome | None:
    """Return where a route leads on the ground; None where it orients no photo."""
    if not route.systems:
        return None
    if route.on_ground:
        (grown,) = route.systems
        reading = _reading_from_below(measured, grown)
        return _by_stations_too(measured, route, grown) if reading is None else _misread(route, grown, reading)
    first, *others = route.systems
    if not np.isfinite(measured.full_control()).any():
        # no point holds its shape once it is on the ground, so it has to be final before
        first = measured.grower().refined(first, _TO_THE_END)
    outcome = _absolute(measured, route, first)
    has_base = np.count_nonzero(outcome.grown.oriented) > 1  # refinement may have left a single photo of a bad block
    if measured.is_free and has_base and not outcome.is_final:
        return _with_arbitrary_datum(measured, outcome)
    if outcome.on_ground:
        return _grown_further(measured, outcome, others)
    if others and not outcome.is_final:
        return replace(outcome, reason=f"{outcome.reason}; {_parts(measured, route)}")
    return outcome


def lengths_of_residuals(measured: MeasuredBlock, outcome: Outcome) -> FloatArray:
    """Return the `residual_lengths` (n,) of the rays in an outcome."""
    held = measured.fitting_control(outcome.absolute) if outcome.on_ground else None
    return residual_lengths(measured.grower(held).seen(outcome.grown), outcome.grown)


def _absolute(measured: MeasuredBlock, route: Route, grown: GrowingBlock) -> Outcome:
    """Take a block to the ground, unless another reading of the control would fit it better."""
    reading = other_reading(grown.partial_block(), measured.rays, measured.control, measured.centres)
    if reading is not None:
        return _misread(route, grown, reading)
    found = _joined_to_ground(measured, grown)
    if not isinstance(found, Joined):
        grown = _with_all_control(measured, grown)
        again = _joined_to_ground(measured, grown)
        if not isinstance(again, Joined):
            by_photo = similarity_of_photo(measured, grown)
            if by_photo is None:
                return Outcome(route, grown, False, None, found.reason)
            grown = grown.transformed(by_photo.similarity)
            return Outcome(route, grown, True, None, "", findings=(f"{found.reason}: {by_photo.finding}",))
        found = again
    return Outcome(route, grown.transformed(found.similarity), True, found.step, "")


def _by_stations_too(measured: MeasuredBlock, route: Route, grown: GrowingBlock) -> Outcome:
    """Return a block that control has placed; where that leaves it free, as by two points, as exposure stations say."""
    placed = Outcome(route, grown, True, None, "")
    block = grown.partial_block()
    if not measured.centres.names or isinstance(absolute_orientation(block, measured.rays, measured.control), Joined):
        return placed
    found = _joined_to_ground(measured, grown)
    if not isinstance(found, Joined):
        return placed
    return Outcome(route, grown.transformed(found.similarity), True, found.step, "")


def _misread(route: Route, grown: GrowingBlock, reading: ControlReading) -> Outcome:
    return Outcome(route, grown, False, None, "its control fits only in another reading", reading=reading)


def _reading_from_below(measured: MeasuredBlock, grown: GrowingBlock) -> ControlReading | None:
    """Return another reading of control where photos were resected that look up at it from below; else None.

    Resections fit a mirror image of nearly plane control almost as well as the control itself; a block formed without
    control shows its relief.
    """
    oriented = grown.oriented
    known = np.isfinite(measured.control.coordinates[:, 2])
    ground = measured.control.coordinates[known, 2]
    if not oriented.any() or not len(ground):
        return None
    looks_up = grown.rotations[oriented, 2, 2].mean() < _LOOKING_UP
    if not looks_up or grown.centres[oriented, 2].mean() > ground.mean():
        return None
    systems = by_pairs(measured.grower(), 0).systems
    if not systems:
        return None
    return other_reading(systems[0].partial_block(), measured.rays, measured.control, measured.centres)


def _with_arbitrary_datum(measured: MeasuredBlock, outcome: Outcome) -> Outcome:
    """Return a free network in a system of its own."""
    reason = "no ground coordinates are known"
    if measured.control.names or measured.centres.names:
        reason = f"the given coordinates give the free network no datum ({outcome.reason})"
    grown, finding = with_arbitrary_datum(outcome.grown, measured.rays, measured.block.distances, reason)
    return replace(outcome, grown=grown, on_ground=True, findings=(finding,), has_arbitrary_datum=True)


def _joined_to_ground(measured: MeasuredBlock, grown: GrowingBlock) -> Joined | NotOriented:
    return absolute_orientation(grown.partial_block(), measured.rays, measured.control, measured.centres)


def _with_all_control(measured: MeasuredBlock, grown: GrowingBlock) -> GrowingBlock:
    """Return the block with those control points, too, whose rays miss each other by more than they should.

    A camera that is not calibrated lets the two rays of a point miss each other. Of more rays some may be wrong.
    """
    wanted = np.zeros(len(measured.rays.points), dtype=bool)
    wanted[[measured.row_of[name] for name in measured.control.names if name in measured.row_of]] = True
    wanted &= ~grown.known
    rays = grown.corrected(measured.rays.of(np.flatnonzero(wanted[measured.rays.point])))
    rays = replace(rays, error=_DOUBTFUL * rays.error)
    found = intersect(grown.rotations, grown.centres, grown.oriented, rays)
    coordinates = with_consensus(grown.rotations, grown.centres, rays, wanted, found.coordinates, 1.0)
    return replace(
        grown,
        coordinates=np.where(wanted[:, None], coordinates, grown.coordinates),
        deviations=np.where(wanted[:, None], found.deviations, grown.deviations),
    )


def _grown_further(measured: MeasuredBlock, outcome: Outcome, others: list[GrowingBlock]) -> Outcome:
    """Add the other parts that have control of their own, and the photos that can be oriented by control."""
    for other in others:
        outcome = _with_other(measured, outcome, other)
    return _with_all_its_control(measured, _grown(measured, outcome))


def _grown(measured: MeasuredBlock, outcome: Outcome) -> Outcome:
    grower = measured.grower(measured.fitting_control(outcome.absolute))
    return replace(outcome, grown=grower.grow(outcome.grown))


def _with_all_its_control(measured: MeasuredBlock, outcome: Outcome) -> Outcome:
    """Return the outcome on the ground by the control of all its photos, where more of that fits than before.

    Before the block had grown, a control point may have been in photos that were in the wrong place.
    """
    if outcome.absolute is None:
        return outcome
    by_rays = measured.grower().intersected(outcome.grown)
    seen = {name for name in measured.control.names if name in measured.row_of and by_rays.known[measured.row_of[name]]}
    if seen <= set(outcome.absolute.points):
        return outcome
    again = _absolute(measured, outcome.route, by_rays)
    if again.absolute is None:
        return outcome
    step = again.absolute
    rows = [measured.row_of[name] for name in step.points if name in seen]
    control = step.coordinates[[name in seen for name in step.points]]
    off = np.nan_to_num(np.abs(by_rays.coordinates[rows] - control)).max(axis=1)
    fitting = min(_fitting_points(outcome.absolute), int(np.count_nonzero(off <= _AS_WELL * step.max_residual)))
    return _grown(measured, again) if _fitting_points(step) > fitting else outcome


def _fitting_points(step: SimilarityStep) -> int:
    return int(np.count_nonzero(np.all(step.weight_factor >= 1.0, axis=1)))


def _with_other(measured: MeasuredBlock, outcome: Outcome, other: GrowingBlock) -> Outcome:
    """Add the photos of another block that has control of its own."""
    new = other.oriented & ~outcome.grown.oriented
    if not new.any():
        return outcome
    found = _absolute(measured, outcome.route, other)
    if not found.on_ground:
        return outcome
    grown, added = outcome.grown, found.grown
    for photo in np.flatnonzero(new):
        grown = grown.with_photo(int(photo), added.rotations[photo], added.centres[photo], added.how[photo])
    return replace(outcome, grown=grown)


def _parts(measured: MeasuredBlock, route: Route) -> str:
    """Name the parts of a block, and the control that each of them sees."""
    control = np.isfinite(measured.full_control()).all(axis=1)
    parts = []
    for system in route.systems:
        names = [measured.rays.photos[photo] for photo in np.flatnonzero(system.oriented)]
        seen = int(np.count_nonzero(system.known & control))
        parts.append(f"photos {first_names(names, _NAMED)} ({counted(seen, 'full control point')})")
    return (
        f"the block falls into {len(parts)} parts with too few common points to connect them, and the control is "
        f"spread over them: {'; '.join(parts)}"
    )
