"""A block with nothing known on the ground: it stays in a system of its own, that of its first photo."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from orip.arrays import FloatArray
from orip.geometry.similarity import Similarity
from orip.prelim.growing_block import GrowingBlock
from orip.records.control import ControlDistance
from orip.records.preliminary import ImageRays


def with_arbitrary_datum(
    placed: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance]
) -> tuple[GrowingBlock, str]:
    """Take a block to the system of its first photo, at the scale of measured distances if there are any.

    Parameters
    ----------
    placed : GrowingBlock
        With two photos at least.
    rays : ImageRays
    distances : sequence of ControlDistance
        Those in space between placed points count, in ground units. Without any the scale is such that the mean
        distance from a photo to the nearest other one is 1.

    Returns
    -------
    GrowingBlock
    str
        A sentence that says what the system is.
    """
    first = int(np.flatnonzero(placed.oriented)[0])
    ratios = _ratios(placed, rays, distances)
    if ratios:
        scale = float(np.median(ratios))
        size = f"its scale comes from {len(ratios)} distance{'' if len(ratios) == 1 else 's'}"
    else:
        scale = 1.0 / _usual_base(placed.centres[placed.oriented])
        size = "its scale is arbitrary: photos are 1 from the next one in the mean"
    to_photo = placed.rotations[first].T
    similarity = Similarity(scale, to_photo, -scale * (to_photo @ placed.centres[first]))
    moved = replace(
        placed,
        rotations=similarity.rotation @ placed.rotations,
        centres=similarity.apply(placed.centres),
        coordinates=similarity.apply(placed.coordinates),
        deviations=scale * placed.deviations,
    )
    name = rays.photos[first]
    return moved, f"nothing is known on the ground: origin and axes of the block are those of photo {name}, {size}"


def _ratios(placed: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance]) -> list[float]:
    """Return given over computed lengths."""
    place = {name: row for row, name in enumerate(rays.points)}
    known = placed.known
    ratios = []
    for each in distances:
        start, end = place.get(each.start), place.get(each.end)
        if each.code == "XYZ" and each.error >= 0.0 and start is not None and end is not None:
            length = float(np.linalg.norm(placed.coordinates[end] - placed.coordinates[start]))
            if known[start] and known[end] and length > 0.0:
                ratios.append(each.distance / length)
    return ratios


def _usual_base(centres: FloatArray) -> float:
    apart = np.linalg.norm(centres[:, None] - centres, axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(apart.min(axis=1).mean())
