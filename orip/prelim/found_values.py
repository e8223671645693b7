"""What the chain found: preliminary values of photos, points and cameras, and sentences on what is wrong or weak."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import compress

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.growing.growing_block import GrowingBlock, empty_growing_block
from orip.prelim.growing.reasons import doubtful_photos, why_not_oriented
from orip.prelim.intersection.consensus import with_consensus
from orip.prelim.intersection.intersection import intersect
from orip.prelim.measured_block import MeasuredBlock
from orip.prelim.refinement.camera_corrections import parameters_with
from orip.prelim.routes import Route
from orip.prelim.to_ground import Outcome
from orip.prelim.weak_connections import weak_connections
from orip.records.results.preliminary import NO_POINTS, CameraStart, PhotoStart, PointStarts, PreliminaryValues
from orip.wording import counted


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
    measured : MeasuredBlock
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
        why = why_not_oriented(measured.rays, measured.index, measured.common, grown, photo)
        return PhotoStart(name, None, None, why)
    if not best.on_ground:
        how = f"only the relative orientation could be computed, not the absolute one: {best.reason}"
        return PhotoStart(name, None, None, how)
    return PhotoStart(name, grown.rotations[photo], grown.centres[photo], grown.how[photo])


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
