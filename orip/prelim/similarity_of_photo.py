"""From a model to the ground by one photo whose orientation is known, where there is no control that suffices.

Position and rotation are those of the photo; scale comes from known coordinates of other projection centres, else from
distances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.geometry.rotation import rotation_from_angles
from orip.geometry.similarity import Similarity
from orip.prelim.ground.arbitrary_datum import ratios_of_distances
from orip.prelim.growing.growing_block import GrowingBlock
from orip.prelim.measured_block import MeasuredBlock
from orip.wording import counted

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
