"""Partial blocks: what two of them have in common, transformed to another system, assembled into one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.compiled import kernels
from orip.prelim.rays import in_both
from orip.prelim.sampling import median, medians
from orip.prelim.similarity.adjustment import LEAST_ERROR, CommonPoints
from orip.prelim.similarity.start import FITTING, MEDIAN_OF_CHI2, most_points
from orip.records.preliminary import PartialBlock
from orip.structs import replace

STEADY = 0.3
"""Least deviation, as a part of the median: the spread of two determinations that agree by chance is no precision."""


def transformed(block: PartialBlock, similarity: Similarity) -> PartialBlock:
    """Return a partial block in the target system of a similarity; deviations are propagated from axis to axis."""
    variances = similarity.scale**2 * (block.deviations**2 @ (similarity.rotation**2).T)
    return replace(
        block,
        rotations=similarity.rotation @ block.rotations,
        centres=similarity.apply(block.centres),
        coordinates=similarity.apply(block.coordinates),
        deviations=np.sqrt(variances),
    )


def assembled(blocks: Sequence[PartialBlock]) -> PartialBlock:
    """Return several partial blocks of one system as one.

    A point that occurs more than once has the weighted mean of its determinations, and their root mean square spread
    as its deviation. A photo that occurs more than once is as in the first.

    Parameters
    ----------
    blocks : sequence of PartialBlock
        One at least; the first gives the name.

    Returns
    -------
    PartialBlock
        Photos and points of several in ascending order; of one as they are.
    """
    if len(blocks) == 1:
        return blocks[0]
    return _assembled(blocks)


def _assembled(blocks: Sequence[PartialBlock]) -> PartialBlock:
    points, photos = [block.points for block in blocks], [block.photos for block in blocks]
    given = (
        np.concatenate(points),
        np.concatenate(photos),
        np.concatenate([block.coordinates for block in blocks]),
        np.concatenate([block.deviations for block in blocks]),
        np.concatenate([block.rotations for block in blocks]),
        np.concatenate([block.centres for block in blocks]),
    )
    whole = tuple(map(np.empty_like, given))
    starts = np.array([0, *accumulate(map(len, points))])
    seen, known = kernels.assemble(*given, starts, *whole, STEADY)
    return PartialBlock(
        blocks[0].name, whole[1][:seen], whole[4][:seen], whole[5][:seen], whole[0][:known], whole[2][:known],
        whole[3][:known],
    )  # fmt: skip


def steady_deviations(block: PartialBlock) -> FloatArray:
    """Return the deviations of a partial block as weights need them: none far below the median of its axis.

    An unknown one counts as the median; all count as 0 where none is known.
    """
    known = np.isfinite(block.deviations)
    if known.all() and known.size:
        return np.maximum(block.deviations, STEADY * medians(block.deviations))
    middle = np.array(
        [median(column[has]) if has.any() else 0.0 for column, has in zip(block.deviations.T, known.T, strict=True)]
    )
    return np.maximum(np.where(known, block.deviations, middle), STEADY * middle)


# A common photo gives a start of the similarity that takes one block to the other: all but the scale of it.


class InCommon(Struct, frozen=True):
    """Where the common points and photos are.

    Parameters
    ----------
    at_source, at_target : arrays (n,) of int
        The common points, as rows of the points of each block.
    photo_source, photo_target : arrays (p,) of int
        The common photos, as rows of the photos of each block.
    """

    at_source: IntArray
    at_target: IntArray
    photo_source: IntArray
    photo_target: IntArray

    @property
    def points(self) -> int:
        """Return the number of common points."""
        return len(self.at_source)

    @property
    def photos(self) -> int:
        """Return the number of common photos."""
        return len(self.photo_source)


class CommonPlaces(Struct, frozen=True):
    """Common points and, below them, the projection centres of common photos; and the start that these photos give.

    Parameters
    ----------
    start : Similarity or None
        None without a common photo.
    extent : float
        As `CommonPoints.extent`.
    """

    places: CommonPoints
    start: Similarity | None
    extent: float


def in_common(source: PartialBlock, target: PartialBlock) -> InCommon:
    """Return where the points and photos are that occur in both of two blocks."""
    at_source, at_target = in_both(source.points, target.points)
    of_source, of_target = np.nonzero(source.photos[:, None] == target.photos)
    return InCommon(at_source, at_target, np.ascontiguousarray(of_source), np.ascontiguousarray(of_target))


def common_places(source: PartialBlock, target: PartialBlock, common: InCommon) -> CommonPlaces:
    """Return the coordinates of what two blocks have in common, and the best start by their common photos."""
    return _places(source, target, common)


def _places(source: PartialBlock, target: PartialBlock, common: InCommon) -> CommonPlaces:
    count = common.points + common.photos
    (own, other, own_deviation, other_deviation), start = np.empty((4, count, 3)), np.empty(13)
    extent = kernels.common_places(
        *_arrays(source), *_arrays(target),
        common.at_source, common.photo_source, common.at_target, common.photo_target,
        own, other, own_deviation, other_deviation, start,
        STEADY, most_points(count), LEAST_ERROR, MEDIAN_OF_CHI2, FITTING,
    )  # fmt: skip
    found = Similarity(float(start[0]), start[1:10].reshape(3, 3), start[10:]) if common.photos else None
    places = CommonPoints(own, other, own_deviation, other_deviation, np.arange(count) >= common.points)
    return CommonPlaces(places, found, extent)


def _arrays(block: PartialBlock) -> tuple[FloatArray, ...]:
    return tuple(map(np.ascontiguousarray, (block.coordinates, block.deviations, block.rotations, block.centres)))
