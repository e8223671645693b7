"""What the chain found: preliminary values, sentences on them, how well they fit, and what hangs on one photo."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import compress

import numpy as np

from orip.adjustment.weights import LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.growing_block import GrowingBlock, doubtful_photos, empty_growing_block, why_not_oriented
from orip.prelim.measured_block import MeasuredBlock
from orip.prelim.rays import ImageRays, intersect, with_consensus
from orip.prelim.refinement import parameters_with
from orip.prelim.resection.resection import Unresected, resect
from orip.prelim.routes import LEAST_RESECTION, Route
from orip.prelim.to_ground import Outcome
from orip.records.preliminary import NO_POINTS, CameraStart, PhotoStart, PointStarts, PreliminaryValues
from orip.wording import agreeing, counted, first_names

_PHOTO, _POINT = 6, 3
"""Unknowns."""

_STRONG = 10.0
"""Redundancy per photo."""

_LIMIT = 3.1
"""Of a normal deviate: chance exceeds it once in a thousand blocks."""


def robust_square_sum(lengths: FloatArray) -> float:
    """Return the sum of the squares of residual lengths (n,), large ones counted as the limit for blunders.

    NaN does not count.
    """
    return float((np.minimum(lengths[~np.isnan(lengths)], LIMIT_OF_TWO_COMPONENTS) ** 2).sum())


def redundancy(rays: ImageRays, held_points: BoolArray, used: BoolArray) -> int:
    """Return the redundancy of an adjustment of photos and points.

    Parameters
    ----------
    held_points : array (number of points,) of bool
        Control that does not move.
    used : array (n,) of bool
        Rays that take part, and so do their photos and points.
    """
    points = len(np.unique(rays.point[used & ~held_points[rays.point]]))
    photos = len(np.unique(rays.photo[used]))
    unknowns = _PHOTO * photos + _POINT * points + int(np.count_nonzero(rays.cameras.unknown))
    return int(2 * np.count_nonzero(used)) - unknowns


def rays_that_count(rays: ImageRays, photos: BoolArray, held_points: BoolArray) -> BoolArray:
    """Return which rays (n,) of some photos determine something: of points held, or seen by two of the photos."""
    used = photos[rays.photo]
    number = np.bincount(rays.point[used], minlength=len(rays.points))
    return np.asarray(used & ((number >= 2) | held_points)[rays.point])


def is_strong(redundancy: int, photos: int) -> bool:
    """Tell whether a wrong block cannot nearly fit its rays, as it can where few of them are redundant."""
    return redundancy >= _STRONG * photos


def fits_by_chance(square_sum: float, redundancy: int) -> bool:
    """Tell whether a sum of squares is no larger than measuring errors as large as the a-priori ones explain.

    Notes
    -----
    The quantile of chi-square is that of Wilson and Hilferty (1931).
    """
    degrees = max(redundancy, 1)
    variance = 2.0 / (9.0 * degrees)
    return square_sum <= degrees * (1.0 - variance + _LIMIT * math.sqrt(variance)) ** 3


_FEW = 5
"""Number of common points up to which a wrong one among them cannot be distinguished from a wrong scale."""

_NAMED = 8
"""Number of photos that are named one by one."""


def weak_connections(rays: ImageRays, common: IntArray, known_on_ground: BoolArray) -> Iterator[str]:
    """Yield a sentence for each part of a block whose scale depends on a few points.

    Parameters
    ----------
    common : array (photos, photos)
        Numbers of common points.
    known_on_ground : array (number of points,) of bool
        Control: a part that sees two of these points has a scale of its own.
    """
    neighbours = _neighbours(np.asarray(common > _FEW, dtype=bool))
    everyone = (1 << len(neighbours)) - 1
    named: set[int] = set()
    for joint in _possible_joints(neighbours):
        parts = list(_parts(neighbours, everyone & ~(1 << joint)))
        largest = max(parts, key=int.bit_count, default=0)
        for part in parts:
            if part == largest or part in named:
                continue
            members = np.array(list(_places(part)), dtype=np.int64)
            shared, seen = _shared(rays, members, joint)
            known = known_on_ground & seen
            if np.count_nonzero(shared) <= _FEW and np.count_nonzero(known) < 2:
                named.add(part)
                yield _sentence(rays, members, joint, int(np.count_nonzero(shared | known)))


def _neighbours(together: BoolArray) -> list[int]:
    """Return the neighbours of each photo as the bits of a number: sets of some hundred photos at once."""
    rows = np.packbits(together, axis=1, bitorder="little")
    return [int.from_bytes(row.tobytes(), "little") for row in rows]


def _places(photos: int) -> Iterator[int]:
    """Yield the places of the bits of a number, ascending."""
    while photos:
        last = photos & -photos
        yield last.bit_length() - 1
        photos ^= last


def _possible_joints(neighbours: Sequence[int]) -> list[int]:
    """Return the photos, ascending, through which others are reached: the leaves of a spanning tree connect nothing."""
    joints, unreached = set(), (1 << len(neighbours)) - 1
    while unreached:
        root = (unreached & -unreached).bit_length() - 1
        joints.add(root)
        unreached ^= 1 << root
        waiting = deque([root])
        while waiting:
            photo = waiting.popleft()
            if new := neighbours[photo] & unreached:
                joints.add(photo)
                unreached ^= new
                waiting.extend(_places(new))
    return sorted(joints)


def _parts(neighbours: Sequence[int], photos: int) -> Iterator[int]:
    """Yield the connected parts of photos."""
    while photos:
        part = front = photos & -photos
        photos ^= part
        while front:
            photo = front.bit_length() - 1
            new = neighbours[photo] & photos
            front ^= (1 << photo) | new
            photos ^= new
            part |= new
        yield part


def _shared(rays: ImageRays, members: IntArray, joint: int) -> tuple[BoolArray, BoolArray]:
    """Return which points photos share with those outside, the joint excepted, and which points they see."""
    photos = np.zeros(len(rays.photos), dtype=bool)
    photos[members] = True
    inside, outside = np.zeros((2, len(rays.points)), dtype=bool)
    inside[rays.point[photos[rays.photo]]] = True
    photos[joint] = True
    outside[rays.point[~photos[rays.photo]]] = True
    return inside & outside, inside


def _sentence(rays: ImageRays, members: IntArray, joint: int, points: int) -> str:
    photos = f"{agreeing(len(members), 'photo')} {first_names([rays.photos[photo] for photo in members], _NAMED)}"
    only = f"{agreeing(len(members), 'is', 'are')} connected with the others only by photo {rays.photos[joint]}"
    scale = (
        f"{only} and {counted(points, 'point')}, which alone {agreeing(points, 'determines', 'determine')} the scale"
        if points
        else f"{only}, and no point determines the scale"
    )
    return f"{photos} {scale} there: measure more common points, or control"


def found_values(
    measured: MeasuredBlock,
    best: Outcome | None,
    lengths: FloatArray,
    by_models: Route | None,
    *,
    name_weak_connections: bool,
) -> PreliminaryValues:
    """Return the values of the best outcome.

    Parameters
    ----------
    best : Outcome or None
        None where no route oriented a photo.
    lengths : array (n,)
        Its `lengths_of_residuals`.
    by_models : Route or None
        The route by the user's models. Its steps are always listed: what failed there is what the user has to correct.
    name_weak_connections : bool
        Look for parts of the block whose scale depends on few points.
    """
    route = by_models or (best.route if best is not None else Route(()))
    grown = best.grown if best is not None else empty_growing_block(measured.rays)
    findings: tuple[str, ...] = best.findings if best is not None else ()
    if best is not None and not findings and best.reading is None:
        # for a photo that could not be oriented the listing says what is missing
        weak = _weak_connections(measured) if name_weak_connections and grown.oriented.all() else ()
        findings = (*_doubtful_photos(measured, best, lengths), *weak)
    findings = (*_contradicted_rays(measured), *findings)
    on_ground = best is not None and best.on_ground
    return PreliminaryValues(
        route.relative,
        route.bridges,
        route.connections,
        best.absolute if best is not None else None,
        route.failures,
        tuple(_photo(measured, best, grown, photo) for photo in range(len(measured.rays.photos))),
        _points(measured, grown) if on_ground else NO_POINTS,
        findings,
        tuple(_cameras(measured, grown)) if on_ground else (),
        best.reading if best is not None else None,
        best is not None and best.has_arbitrary_datum,
    )


def _contradicted_rays(measured: MeasuredBlock) -> Iterator[str]:
    if number := int(np.count_nonzero(~measured.confirmed)):
        total = counted(len(measured.confirmed), "photo point")
        yield f"{number} of the {total} contradict those of other photos, and were not used to orient the photos"


def _photo(measured: MeasuredBlock, best: Outcome | None, grown: GrowingBlock, photo: int) -> PhotoStart:
    name = measured.rays.photos[photo]
    if best is None or not grown.oriented[photo]:
        return PhotoStart(name, None, None, _why_not_oriented(measured, grown, photo))
    if not best.on_ground:
        how = f"only the relative orientation could be computed, not the absolute one: {best.reason}"
        return PhotoStart(name, None, None, how)
    return PhotoStart(name, grown.rotations[photo], grown.centres[photo], grown.how[photo])


def _why_not_oriented(measured: MeasuredBlock, grown: GrowingBlock, photo: int) -> str:
    """Say why a photo is not oriented: what its control points lack for a resection, and what it shares with others."""
    rays, control = measured.rays.of(np.flatnonzero(measured.rays.photo == photo)), measured.full_control()
    known = rays.of(np.flatnonzero(np.isfinite(control[rays.point]).all(axis=1)))
    shortage = why_not_oriented(measured.rays, measured.index, measured.common, grown, photo)
    if len(known.point) < LEAST_RESECTION:
        return shortage
    found = resect(known.vectors, control[known.point], error_mm=float(np.median(known.error)))
    if not isinstance(found, Unresected):
        return shortage
    alone = f"photo {rays.photos[photo]} sees {len(known.point)} control points, but {found.reason}"
    return alone if len(rays.photos) == 1 else f"{alone}; {shortage}"


def _points(measured: MeasuredBlock, grown: GrowingBlock) -> PointStarts:
    """Return where the rays of all points meet, even of control points, which may be wrong.

    Points whose rays do not meet stay where the block has them.
    """
    rays = grown.corrected(measured.all_rays)
    found = intersect(grown.rotations, grown.centres, grown.oriented, rays.of(measured.confirmed))
    fits = np.zeros(len(rays.photo), dtype=bool)
    fits[measured.confirmed] = found.weight_factors >= 1.0
    doubtful = np.zeros(len(rays.points), dtype=bool)
    doubtful[rays.point[~fits & grown.oriented[rays.photo]]] = True
    coordinates, deviations = found.coordinates, found.deviations
    coordinates = with_consensus(grown.rotations, grown.centres, rays, doubtful, coordinates, found.s0)
    place = measured.block.point_index()
    rows = np.array([place[name] for name in measured.rays.points], dtype=np.int64)
    alone = grown.known & np.isnan(coordinates[rows, 0])
    coordinates[rows[alone]], deviations[rows[alone]] = grown.coordinates[alone], grown.deviations[alone]
    known = np.isfinite(coordinates[:, 0])
    return PointStarts(tuple(compress(rays.points, known)), coordinates[known], deviations[known])


def _cameras(measured: MeasuredBlock, grown: GrowingBlock) -> Iterator[CameraStart]:
    block, of_photo = measured.block, measured.rays.cameras.of_photo
    for unknown, correction in enumerate(grown.corrections):
        camera = block.cameras[block.photo_camera[np.argmax(of_photo == unknown)]]
        yield CameraStart(camera.name, parameters_with(camera, correction))


def _doubtful_photos(measured: MeasuredBlock, best: Outcome, lengths: FloatArray) -> Iterator[str]:
    if best.on_ground:
        yield from doubtful_photos(measured.rays, best.grown, lengths, measured.blunders)


def _weak_connections(measured: MeasuredBlock) -> Iterator[str]:
    known = np.isfinite(measured.full_control()).all(axis=1)
    return weak_connections(measured.rays, measured.common, np.asarray(known, dtype=bool))
