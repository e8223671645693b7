"""What two partial blocks have in common: points, and photos, whose projection centres are points as well.

A common photo gives a start of the similarity that takes one block to the other: all but the scale of it.
"""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.compiled import is_compiled, kernels
from orip.prelim.medians import median
from orip.prelim.rays.photo_index import in_both
from orip.prelim.similarity.common_points import LEAST_ERROR, CommonPoints
from orip.prelim.similarity.partial_blocks import STEADY, steady_deviations
from orip.prelim.similarity.start import FITTING, MEDIAN_OF_CHI2, best_start, most_points
from orip.records.results.preliminary import PartialBlock


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
    places : CommonPoints
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
    return (_compiled_places if is_compiled() else _places)(source, target, common)


def _compiled_places(source: PartialBlock, target: PartialBlock, common: InCommon) -> CommonPlaces:
    """Do what `_places` does in the compiled loop."""
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


def _places(source: PartialBlock, target: PartialBlock, common: InCommon) -> CommonPlaces:
    places = CommonPoints(
        np.concatenate([source.coordinates[common.at_source], source.centres[common.photo_source]]),
        np.concatenate([target.coordinates[common.at_target], target.centres[common.photo_target]]),
        _with_centres(steady_deviations(source)[common.at_source], common.photos),
        _with_centres(steady_deviations(target)[common.at_target], common.photos),
        np.arange(common.points + common.photos) >= common.points,
    )
    pairs = zip(common.photo_source.tolist(), common.photo_target.tolist(), strict=True)
    starts = [_start(source, target, pair, places) for pair in pairs]
    return CommonPlaces(places, best_start(places, starts) if starts else None, places.extent)


def _with_centres(deviations: FloatArray, centres: int) -> FloatArray:
    """Return deviations of points and, below them, of projection centres, which get the median of the points."""
    middle = median(deviations) if deviations.size else 0.0
    return np.concatenate([deviations, np.full((centres, 3), middle)])


def _start(source: PartialBlock, target: PartialBlock, photo: tuple[int, int], places: CommonPoints) -> Similarity:
    """Return the similarity that one common photo gives: only its scale comes from the points."""
    at_source, at_target = photo
    rotation = target.rotations[at_target] @ source.rotations[at_source].T
    own, other = source.centres[at_source], target.centres[at_target]
    lengths = np.linalg.norm(places.source - own, axis=1)
    images = np.linalg.norm(places.target - other, axis=1)
    far = lengths > 1e-9 * lengths.max()
    scale = median(images[far] / lengths[far]) if far.any() else 1.0
    return Similarity(scale, rotation, other - scale * (rotation @ own))
