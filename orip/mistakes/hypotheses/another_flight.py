"""Photos that fit each other and not the others although they share numbers of points: those of another flight."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.bundle.antennas import without_photos
from orip.mistakes.hypotheses.free_network import free_network
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.structs import replace
from orip.wording import counted_names

_FEWEST, _FEWEST_SHARED = 2, 8
"""Photos that can fit each other, and points of the others that they share: with fewer they are not connected."""


def another_flight(block: Block, not_oriented: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield the photos that could not be oriented in the block as a free network of their own.

    Parameters
    ----------
    block : Block
    not_oriented : sequence of str
        Names of these photos.
    """
    others = np.array([photo.name not in not_oriented for photo in block.photos])
    if not _FEWEST <= np.count_nonzero(~others) < np.count_nonzero(others):
        return
    points = block.photo_points
    of_others = np.unique(points.point[others[points.photo]])
    shared = np.intersect1d(of_others, np.unique(points.point[~others[points.photo]]))
    if len(shared) < _FEWEST_SHARED:
        return
    own = without_photos(block, others)
    cameras = tuple(replace(camera, unknown=()) for camera in own.cameras)
    free = free_network(replace(own, cameras=cameras))
    text = (
        f"they fit each other, but not the other photos, although they share {len(shared)} numbers of points with "
        "them: they seem to be of another flight or object whose numbers were used again; give its points other "
        "numbers, or leave its photos out"
    )
    yield Hypothesis(free, finding("another-flight", counted_names("photo", list(not_oriented)), text))
