"""Photos and points of a block that are oriented in one system, while it grows."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.similarity import Similarity
from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.refinement.camera_corrections import corrected, no_corrections
from orip.prelim.similarity.joining import Joined
from orip.records.results.preliminary import PartialBlock
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
        Of the unknown cameras; see `orip.prelim.refinement.camera_corrections`.
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
