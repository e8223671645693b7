"""A block without ground coordinates: its datum is arbitrary, that of its first photo."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.geometry.similarity import Similarity
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.rays.image_rays import ImageRays
from orip.records.observations.control import ControlDistance
from orip.wording import counted

_SAME_PLACE = 0.01
"""Of the longest base from the first photo: photos nearer than this were taken from one place, as from a tripod."""


def with_arbitrary_datum(
    grown: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance], reason: str
) -> tuple[GrowingBlock, str]:
    """Transform a block to the system of its first photo, at the scale of measured distances if there are any.

    Parameters
    ----------
    grown : GrowingBlock
        With two photos at least.
    rays : ImageRays
    distances : sequence of ControlDistance
        Ground units; only spatial distances between known points are used. Without any, the scale is such that the
        first base is 1: that from the first photo to the next one at another place.
    reason : str
        Why there is no other datum.

    Returns
    -------
    GrowingBlock
    str
        A sentence that says what the system is.
    """
    first = int(np.flatnonzero(grown.oriented)[0])
    ratios = ratios_of_distances(grown, rays, distances)
    if ratios:
        scale = float(np.median(ratios))
        size = f"its scale comes from {counted(len(ratios), 'distance')}"
    else:
        other, base = _first_base(grown, first)
        scale = 1.0 / base
        size = f"its scale is arbitrary: the base from photo {rays.photos[first]} to photo {rays.photos[other]} is 1"
    to_photo = grown.rotations[first].T
    similarity = Similarity(scale, to_photo, -scale * (to_photo @ grown.centres[first]))
    name = rays.photos[first]
    finding = f"{reason}: origin and axes of the block are those of photo {name}, {size}"
    return grown.transformed(similarity), finding


def ratios_of_distances(grown: GrowingBlock, rays: ImageRays, distances: Sequence[ControlDistance]) -> list[float]:
    """Return given over computed lengths of spatial distances between known points."""
    place = {name: row for row, name in enumerate(rays.points)}
    known = grown.known
    ratios = []
    for distance in distances:
        start, end = place.get(distance.start), place.get(distance.end)
        if distance.code == "XYZ" and distance.error >= 0.0 and start is not None and end is not None:
            length = float(np.linalg.norm(grown.coordinates[end] - grown.coordinates[start]))
            if known[start] and known[end] and length > 0.0:
                ratios.append(distance.distance / length)
    return ratios


def _first_base(grown: GrowingBlock, first: int) -> tuple[int, float]:
    """Return the next photo that was not taken from the place of the first one, and its distance from it."""
    apart = np.where(grown.oriented, np.linalg.norm(grown.centres - grown.centres[first], axis=1), 0.0)
    other = int(np.flatnonzero(apart > _SAME_PLACE * apart.max())[0])
    return other, float(apart[other])
