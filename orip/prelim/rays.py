"""The rays of a block: all photo points measured in full, sorted by photo, thinned where many; their intersection."""

from __future__ import annotations

from itertools import compress

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import LEAST_WEIGHT, LIMIT_OF_TWO_COMPONENTS
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rays import OF_TWO
from orip.interior.image_coordinates import image_vectors, suit_plane_image
from orip.prelim.compiled import kernels
from orip.prelim.sampling import median
from orip.records.block import Block
from orip.records.observation_kinds import measured_before
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
    photo, point : arrays (n,) of int
        Indices into `photos` and `points`.
    xy : array (n, 2)
        Measured photo coordinates, fiducial system, mm.
    vectors : array (n, 3)
        See `image_vectors`, mm.
    error : array (n,)
        A-priori error of a photo coordinate, mm.
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


class PhotoIndex(Struct, frozen=True):
    """Rows of `ImageRays` by photo.

    Parameters
    ----------
    rows : tuple of arrays of int
        For each photo its rows, by ascending point.
    points : tuple of arrays of int
        For each photo the points of these rows.
    """

    rows: tuple[IntArray, ...]
    points: tuple[IntArray, ...]

    def common_points(self, left: int, right: int) -> tuple[IntArray, IntArray]:
        """Return the rows of the points common to two photos: those of the left and those of the right photo."""
        in_left, in_right = in_both(self.points[left], self.points[right])
        return self.rows[left][in_left], self.rows[right][in_right]


def in_both(one: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
    """Return the places, in each of two ascending lists of indices, of those that occur in both."""
    place = other.searchsorted(one)
    in_one = (place < other.searchsorted(one, side="right")).nonzero()[0]
    return in_one, place[in_one]


def photo_index(rays: ImageRays) -> PhotoIndex:
    """Sort rays by photo; a photo has at most one ray of a point."""
    order = np.lexsort((rays.point, rays.photo))
    starts = np.searchsorted(rays.photo[order], np.arange(1, len(rays.photos)))
    rows = tuple(np.split(order, starts)) if rays.photos else ()
    return PhotoIndex(rows, tuple(rays.point[of_photo] for of_photo in rows))


_HOLDING = 4
"""Least number of points kept of those that connect two photos."""

_MANY = 1.5
"""Multiple of the points that are enough: if the median photo has fewer, all points are kept."""


def thinned(rays: ImageRays, kept: BoolArray, enough: int) -> ImageRays:
    """Return rays of enough points for each photo; points that are left out have no index.

    In each photo, and in each two photos that are neighbours in the list of photos of a point, those points are kept
    that are in most other photos, since they connect the block; equal ones in the order of a fixed shuffle, as
    neighbours in a list of names are often neighbours on the ground.

    Parameters
    ----------
    kept : array (number of points,) of bool
        Points that are always kept: those that are known on the ground.
    enough : int
        Least number of points kept in a photo, if it has as many.
    """
    per_photo = np.bincount(rays.photo, minlength=len(rays.photos))
    if len(per_photo) == 0 or median(per_photo.astype(np.float64)) <= _MANY * enough:
        return rays
    rays = rays.of(np.lexsort((rays.photo, rays.point)))
    number = np.bincount(rays.point, minlength=len(rays.points))
    shuffle = np.random.default_rng(0).permutation(len(rays.points))
    worth = np.empty(len(shuffle), dtype=np.int64)
    worth[np.lexsort((shuffle, -number))] = np.arange(len(shuffle))
    chosen = kept & (number > 0)
    shared = np.flatnonzero(number[rays.point] > 1)
    chosen[_first_of_each(rays.photo[shared], rays.point[shared], worth, enough)] = True
    of_joint = np.flatnonzero(rays.point[1:] == rays.point[:-1])
    joint = rays.photo[of_joint] * len(rays.photos) + rays.photo[of_joint + 1]
    chosen[_first_of_each(joint, rays.point[of_joint], worth, _HOLDING)] = True
    part = rays.of(chosen[rays.point])
    place = np.cumsum(chosen) - 1
    return replace(part, points=tuple(compress(rays.points, chosen)), point=place[part.point])


def _first_of_each(group: IntArray, point: IntArray, worth: IntArray, most: int) -> IntArray:
    """Return at most `most` points of each group, those with the lowest rank in `worth` (number of points,) first."""
    order = np.lexsort((worth[point], group))
    ordered = group[order]
    first = np.flatnonzero(np.concatenate([[True], ordered[1:] != ordered[:-1]])) if len(order) else order
    rank = np.arange(len(order)) - np.repeat(first, np.diff(np.append(first, len(order))))
    return point[order[rank < most]]


def with_consensus(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    """Return the coordinates of points, the doubtful ones moved to where most of their rays meet.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
        NaN for photos that are not oriented.
    doubtful : array (q,) of bool
    start : array (q, 3)
        Where the points are; NaN where not known.
    scale : float
        Of the residuals, in a-priori errors.

    Returns
    -------
    array (q, 3)
    """
    return _with_consensus(rotations, centres, rays, doubtful, start, scale)


def _with_consensus(
    rotations: FloatArray, centres: FloatArray, rays: ImageRays, doubtful: BoolArray, start: FloatArray, scale: float
) -> FloatArray:
    order, starts = rays.order_by_point(), rays.point_starts()
    arrays = rays.photo[order], starts, rays.vectors[order], rays.error[order], rotations, centres
    oriented, found = np.isfinite(centres[:, 0]), np.array(start)
    limit = (OF_TWO * LIMIT_OF_TWO_COMPONENTS) ** 2
    kernels.consensus(*map(np.ascontiguousarray, (*arrays, oriented, doubtful)), found, scale, limit)
    return found


SMALLEST_ANGLE = np.radians(0.5)
"""Angle below which the depth of an intersection is wrong by some hundred times the error across the rays."""

MANY = 8
"""From this number of rays, least absolute residuals find a wrong one as surely as leaving out one after the other."""

KEPT = 0.5
"""Least weight factor with which a ray counts for the angle and for lying in front."""

ABSOLUTE_ITERATIONS = 10
DANISH_ITERATIONS = 4

QUANTILE = 0.4
LENGTH_AT_QUANTILE = np.sqrt(-2.0 * np.log(1.0 - QUANTILE))
"""Quantile of the length of a residual with two normal components of standard deviation 1; below the median, since a
wrong ray also enlarges the residuals of the other rays of its point."""


class Intersected(Struct, frozen=True):
    """q points from n rays.

    Parameters
    ----------
    coordinates : array (q, 3)
        NaN where a point is not determined: fewer than two rays left, rays nearly parallel, or behind the photos.
    deviations : array (q, 3)
        Standard deviations of the coordinates; NaN likewise.
    weight_factors : array (n,)
        Of the rays; 0 for the ray of a photo that is not oriented, of a point behind it or not determined.
    angles : array (q,)
        Largest angle at which rays of the point meet, radians; 0 with fewer than two rays.
    s0 : float
        Scale of the residuals against the a-priori errors, at least 1.
    """

    coordinates: FloatArray
    deviations: FloatArray
    weight_factors: FloatArray
    angles: FloatArray
    s0: float


def intersect(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    """Intersect the rays of every point.

    Parameters
    ----------
    rotations : array (p, 3, 3)
        Photo to ground.
    centres : array (p, 3)
    oriented : array (p,) of bool
        The rays of other photos are left out.

    Notes
    -----
    The sum of squared distances of a point from its rays, each over its distance from the projection centre and thus an
    angle, is least. Where rays of a point do not fit, one is left out if all others fit without it. If that does not
    help, or if it is not clear which, weights follow the Danish method (Krarup, Juhl and Kubik 1980), begun with least
    absolute residuals.
    """
    return _intersected(rotations, centres, oriented, rays)


def _intersected(rotations: FloatArray, centres: FloatArray, oriented: BoolArray, rays: ImageRays) -> Intersected:
    points = len(rays.points)
    coordinates, deviations, angles = np.empty((points, 3)), np.empty((points, 3)), np.empty(points)
    factors = np.empty(len(rays.photo))
    of_rays = rays.photo, rays.point, rays.vectors, rays.error, rotations, centres, oriented
    s0 = kernels.intersect(
        *map(np.ascontiguousarray, of_rays), coordinates, deviations, factors, angles,
        QUANTILE, LENGTH_AT_QUANTILE, SMALLEST_ANGLE, LIMIT_OF_TWO_COMPONENTS, LEAST_WEIGHT, KEPT, MANY,
        ABSOLUTE_ITERATIONS, DANISH_ITERATIONS,
    )  # fmt: skip
    return Intersected(coordinates, deviations, factors, angles, s0)
