"""Why a photo could not be oriented, or is probably in the wrong place, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.growing.misplaced_photos import misplaced_photos, unfit
from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.rays.photo_index import PhotoIndex
from orip.wording import counted

_SHARED_NEEDED, _KNOWN_NEEDED = 5, 3


def why_not_oriented(rays: ImageRays, index: PhotoIndex, common: IntArray, grown: GrowingBlock, photo: int) -> str:
    """Say what is missing for the orientation of a photo, with the numbers (photos, photos) of common points."""
    oriented = grown.oriented
    shared = common[photo].copy()
    shared[photo] = 0
    if oriented.any():
        shared[~oriented] = 0
    most, name = int(shared.max(initial=0)), rays.photos[photo]
    shortage = f"photo {name} shares {counted(most, 'point')} with its neighbours, {_SHARED_NEEDED} are needed"
    if not oriented.any():
        return shortage
    known = int(grown.known[index.points[photo]].sum())
    if most < _SHARED_NEEDED and known < _KNOWN_NEEDED:
        return f"{shortage}; of its points {known} are known, {_KNOWN_NEEDED} are needed"
    return f"photo {name} sees {known} known points and shares {most} with a neighbour, but they do not agree"


def doubtful_photos(rays: ImageRays, grown: GrowingBlock, lengths: FloatArray, blunders: float) -> Iterator[str]:
    """Yield a sentence for each photo that is probably in the wrong place; see `misplaced_photos`."""
    far_off = unfit(lengths)
    for photo in np.flatnonzero(misplaced_photos(rays, grown, lengths, blunders)):
        mine = (rays.photo == photo) & ~np.isnan(lengths)
        count = f"{np.count_nonzero(far_off & mine)} of the {np.count_nonzero(mine)}"
        yield (
            f"photo {rays.photos[photo]} is probably in the wrong place: {count} points that it shares with other "
            "photos do not fit; measure more points in it"
        )
