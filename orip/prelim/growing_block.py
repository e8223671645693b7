"""Growing a block photo by photo: the block as it grows, misplaced photos, and why a photo was not oriented."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.compiled import kernels
from orip.prelim.rays import SMALLEST_ANGLE, ImageRays, PhotoIndex
from orip.prelim.refinement import corrected, no_corrections
from orip.prelim.relative.orientation import OrientedPair
from orip.prelim.sampling import median
from orip.prelim.similarity.joining import Joined
from orip.records.preliminary import NotOriented, PartialBlock
from orip.structs import replace
from orip.wording import counted


class GrowingBlock(Struct, frozen=True):
    """All photos and points of a block, as far as they are oriented in one system.

    Parameters
    ----------
    name : str
        Of the system's first model.
    rotations : array (number of photos, 3, 3)
        Photo to system; NaN where not oriented.
    centres : array (number of photos, 3)
    coordinates, deviations : arrays (number of points, 3)
        NaN where not known.
    corrections : array (cameras, 4)
        Of the unknown cameras; see `orip.prelim.refinement`.
    how : tuple of str, one a photo
        How it was oriented, as a sentence; "" where it was not.
    """

    name: str
    rotations: FloatArray
    centres: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    corrections: FloatArray
    how: tuple[str, ...]

    @property
    def oriented(self) -> BoolArray:
        """Return which photos are oriented, array (number of photos,)."""
        return np.isfinite(self.centres[:, 0])

    @property
    def known(self) -> BoolArray:
        """Return which points are known, array (number of points,)."""
        return np.isfinite(self.coordinates[:, 0])

    def corrected(self, rays: ImageRays) -> ImageRays:
        """Return rays with the cameras corrected as estimated in the system."""
        return corrected(rays, self.corrections)

    def with_photo(self, photo: int, rotation: FloatArray, centre: FloatArray, how: str) -> GrowingBlock:
        """Return the system with one more photo."""
        rotations, centres, sentences = self.rotations.copy(), self.centres.copy(), list(self.how)
        rotations[photo], centres[photo], sentences[photo] = rotation, centre, how
        return replace(self, rotations=rotations, centres=centres, how=tuple(sentences))

    def with_photos_of(self, other: GrowingBlock, joined: Joined) -> GrowingBlock:
        """Return the system with more photos of another one, which was joined to it."""
        block, current = joined.block, self
        points = counted(len(joined.step.points), "known point")
        for photo, rotation, centre in zip(block.photos, block.rotations, block.centres, strict=True):
            if not current.oriented[photo]:
                how = f"{other.how[photo]}; connected by {points}"
                current = current.with_photo(int(photo), rotation, centre, how)
        return current

    def without_photos(self, photos: BoolArray) -> GrowingBlock:
        """Return the system without some of its photos."""
        rotations, centres = self.rotations.copy(), self.centres.copy()
        rotations[photos], centres[photos] = np.nan, np.nan
        how = tuple("" if out else sentence for out, sentence in zip(photos, self.how, strict=True))
        return replace(self, rotations=rotations, centres=centres, how=how)

    def transformed(self, similarity: Similarity) -> GrowingBlock:
        """Return the block in the target system of a similarity."""
        return replace(
            self,
            rotations=similarity.rotation @ self.rotations,
            centres=similarity.apply(self.centres),
            coordinates=similarity.apply(self.coordinates),
            deviations=similarity.scale * self.deviations,
        )

    def partial_block(self) -> PartialBlock:
        """Return the oriented photos and known points."""
        photos, points = np.flatnonzero(self.oriented), np.flatnonzero(self.known)
        return PartialBlock(
            self.name,
            photos,
            self.rotations[photos],
            self.centres[photos],
            points,
            self.coordinates[points],
            _without_nan(self.deviations[points]),
        )

    def part(self, photo: int, points: IntArray) -> PartialBlock:
        """Return one oriented photo, with those of some points that are known."""
        known = points[self.known[points]]
        return PartialBlock(
            self.name,
            np.array([photo]),
            self.rotations[[photo]],
            self.centres[[photo]],
            known,
            self.coordinates[known],
            _without_nan(self.deviations[known]),
        )


def _without_nan(deviations: FloatArray) -> FloatArray:
    return np.where(np.isnan(deviations), 0.0, deviations)


def empty_growing_block(rays: ImageRays, name: str = "") -> GrowingBlock:
    """Return a system without photos and points."""
    photos, points = len(rays.photos), len(rays.points)
    return GrowingBlock(
        name,
        np.full((photos, 3, 3), np.nan),
        np.full((photos, 3), np.nan),
        np.full((points, 3), np.nan),
        np.full((points, 3), np.nan),
        no_corrections(rays),
        ("",) * photos,
    )


def growing_block_of(rays: ImageRays, block: PartialBlock, how: str) -> GrowingBlock:
    """Return a system with the photos, all oriented in one way, and the points of a partial block."""
    empty = empty_growing_block(rays, block.name)
    sentences = list(empty.how)
    for photo in block.photos:
        sentences[photo] = how
    for target, values, rows in (
        (empty.rotations, block.rotations, block.photos),
        (empty.centres, block.centres, block.photos),
        (empty.coordinates, block.coordinates, block.points),
        (empty.deviations, block.deviations, block.points),
    ):
        target[rows] = values
    return replace(empty, how=tuple(sentences))


MISFIT = 5.0
"""Ratio of a residual to the median of all above which a point does not fit its photo."""

_FEWEST = 3
"""Number of points that do not fit from which a photo is doubted: fewer may be blunders."""

_OUT_OF_PLACE = 0.2
"""Part of its points that do not fit above which a photo is in the wrong place, if few may be wrong."""


def residual_lengths(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    """Return the lengths (n,) of the residuals of rays, as the system shows them, over their a-priori errors.

    Infinite for a point behind the photo, and for one that is in several oriented photos but not determined; NaN where
    the photo is not oriented, is the only one with the point, or all rays of the point are nearly parallel.
    """
    lengths = _residual_lengths(rays, grown)
    lost = np.flatnonzero(np.isinf(lengths) & ~grown.known[rays.point])
    if len(lost):
        lengths[lost[_are_parallel(rays.of(lost), grown)]] = np.nan
    return lengths


def _are_parallel(rays: ImageRays, grown: GrowingBlock) -> BoolArray:
    """Return which rays (n,) are those of points none of whose rays is far from the mean direction."""
    directions = np.einsum("nij,nj->ni", grown.rotations[rays.photo], rays.vectors)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    mean = np.zeros((len(rays.points), 3))
    np.add.at(mean, rays.point, directions)
    apart = np.linalg.norm(np.cross(directions, mean[rays.point]), axis=1)
    far = apart > 0.5 * SMALLEST_ANGLE * np.einsum("ni,ni->n", directions, mean[rays.point])
    return np.asarray(np.bincount(rays.point[far], minlength=len(rays.points))[rays.point] == 0)


def _residual_lengths(rays: ImageRays, grown: GrowingBlock) -> FloatArray:
    lengths = np.empty(len(rays.photo))
    of_rays = rays.photo, rays.point, rays.vectors, rays.error, grown.rotations, grown.centres, grown.coordinates
    kernels.residual_lengths(*map(np.ascontiguousarray, of_rays), lengths)
    return lengths


def unfit(lengths: FloatArray) -> BoolArray:
    """Return which of `residual_lengths` (n,) are far larger than usual; NaN is not among them."""
    judged = ~np.isnan(lengths)
    overall = median(lengths[judged]) if judged.any() else np.inf
    return np.asarray(lengths > MISFIT * max(overall, 1.0))


def misplaced_photos(rays: ImageRays, grown: GrowingBlock, lengths: FloatArray, blunders: float) -> BoolArray:
    """Return which oriented photos (number of photos,) do not fit their points: too many residuals are far too large.

    A photo none of whose points is seen by another one is among them.

    Parameters
    ----------
    lengths : array (n,)
        The system's `residual_lengths`.
    blunders : float
        Largest part of the known points of a photo that may be wrong.
    """
    # a point is wrong by its other rays as well, a ray by itself half as often
    part = max(_OUT_OF_PLACE, 0.5 * blunders)
    count = len(rays.photos)
    number = np.bincount(rays.photo[~np.isnan(lengths)], minlength=count)
    misfits = np.bincount(rays.photo[unfit(lengths)], minlength=count)
    return np.asarray(grown.oriented & (misfits >= np.maximum(part * number, np.minimum(_FEWEST, number))))


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


class FromModels(Struct, frozen=True):
    """Models of the rays of a block, and blocks grown from them.

    Routes that begin with different pairs of photos come to the same parts, and a part that cannot be connected is
    tried again when the block has grown.

    Parameters
    ----------
    models : dict
        Relative orientations by pairs of photos.
    blocks : dict
        Blocks by the pair that they began with and all else that they depend on.
    earlier : mapping
        Models of other rays of the block: where a pair has kept its points, it is not oriented again.
    """

    models: dict[tuple[int, int], OrientedPair | NotOriented] = field(default_factory=dict)
    blocks: dict[tuple[int, int, bool, bytes, bytes], GrowingBlock] = field(default_factory=dict)
    earlier: Mapping[tuple[int, int], OrientedPair | NotOriented] = field(default_factory=dict)

    def of_other_rays(self) -> FromModels:
        """Return what other rays of the same block begin with."""
        return FromModels(earlier={**self.earlier, **self.models})
