"""The rays that preliminary values are computed from: all photo points of a block that are measured in full."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.interior.image_vectors import image_vectors, suit_plane_image
from orip.records.block import Block
from orip.records.observations.repeated import measured_before
from orip.structs import replace

CAMERA_CORRECTIONS = 4
"""Logarithm of the principal distance, shifts in x and y as parts of it, radial distortion at 45 degrees."""


class UnknownCameras(Struct, frozen=True):
    """Cameras whose interior orientation the adjustment will estimate, in full or in part.

    Parameters
    ----------
    of_photo : array (number of photos,) of int
        -1 for a photo of a camera that is known; empty where all are.
    unknown : array (cameras, `CAMERA_CORRECTIONS`) of bool
    """

    of_photo: IntArray
    unknown: BoolArray


ALL_KNOWN = UnknownCameras(np.empty(0, dtype=np.int64), np.empty((0, CAMERA_CORRECTIONS), dtype=np.bool_))


class ImageRays(Struct, frozen=True):
    """n measured photo points freed of distortion.

    Parameters
    ----------
    photos, points : tuples of str
    photo, point : arrays (n,) of int
        Indices into `photos` and `points`.
    xy : array (n, 2)
        Measured photo coordinates, fiducial system, mm.
    vectors : array (n, 3)
        See `image_vectors`, mm.
    error : array (n,)
        A-priori error of a photo coordinate, mm.
    cameras : UnknownCameras
    """

    photos: tuple[str, ...]
    points: tuple[str, ...]
    photo: IntArray
    point: IntArray
    xy: FloatArray
    vectors: FloatArray
    error: FloatArray
    cameras: UnknownCameras = ALL_KNOWN

    def of(self, rows: IntArray | BoolArray) -> ImageRays:
        """Return some of the rays, or all in another order; photos and points keep their indices."""
        return ImageRays(
            self.photos,
            self.points,
            self.photo[rows],
            self.point[rows],
            self.xy[rows],
            self.vectors[rows],
            self.error[rows],
            self.cameras,
        )

    def order_by_point(self) -> IntArray | slice:
        """Return the order (n,) in which rays come point by point; where they do, a slice of all."""
        ordered = bool((self.point[1:] >= self.point[:-1]).all())
        return slice(None) if ordered else np.argsort(self.point, kind="stable")

    def point_starts(self) -> IntArray:
        """Return where the rays of each point begin in that order, and where the last ones end (points + 1,)."""
        starts = np.zeros(len(self.points) + 1, dtype=np.int64)
        np.cumsum(np.bincount(self.point, minlength=len(self.points)), out=starts[1:])
        return starts


_CORRECTED = "C", "DX", "DY", "A3"
"""Parameters of a camera that the `CAMERA_CORRECTIONS` stand for."""


def image_rays(block: Block) -> ImageRays:
    """Return the rays of a block, point by point; indices of photos and points are the block's.

    Points of which a coordinate is disregarded, or whose distortion cannot be removed, give no ray. Of a point that is
    measured in a photo more than once the first measurement does.
    """
    points = block.photo_points
    vectors = image_vectors(block)
    rows = np.flatnonzero(points.in_use & np.isfinite(vectors).all(axis=1))
    rows = rows[measured_before(points.photo[rows], points.point[rows]) == 0]
    rows = rows[np.argsort(points.point[rows], kind="stable")]
    return ImageRays(
        photos=tuple(photo.name for photo in block.photos),
        points=block.point_names,
        photo=points.photo[rows],
        point=points.point[rows],
        xy=points.xy[rows],
        vectors=vectors[rows],
        error=np.sqrt(np.mean(points.error[rows] ** 2, axis=1)),
        cameras=_unknown_cameras(block),
    )


def rays_of_plane_images(block: Block, rays: ImageRays) -> ImageRays:
    """Return the rays of a block by which its photos can be oriented like photos with a plane image.

    Of equidistant cameras those are left out that are far from the axis. The others keep their vectors: each is
    compared in a plane of its own, at its component along the axis, where errors are larger by up to 1 / cos theta.
    """
    cameras = np.array([camera.projection == "equidistant" for camera in block.cameras], dtype=bool)
    if not cameras.any():
        return rays
    is_equidistant = cameras[block.photo_camera[rays.photo]]
    cosine = np.where(is_equidistant, -rays.vectors[:, 2] / np.linalg.norm(rays.vectors, axis=1), 1.0)
    near = np.flatnonzero(suit_plane_image(rays.vectors, is_equidistant))
    return replace(rays.of(near), error=rays.error[near] / cosine[near])


def _unknown_cameras(block: Block) -> UnknownCameras:
    # the corrections are those of a plane image
    unknown = np.array(
        [
            [name in camera.unknown and camera.projection == "perspective" for name in _CORRECTED]
            for camera in block.cameras
        ]
    )
    rows = np.flatnonzero(unknown.any(axis=1))
    if not len(rows):
        return ALL_KNOWN
    place = np.full(len(block.cameras), -1)
    place[rows] = np.arange(len(rows))
    return UnknownCameras(place[block.photo_camera], unknown[rows])
