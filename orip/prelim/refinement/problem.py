"""Photos and points that are refined together, and approximate corrections of the cameras' interior orientation."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import rotation_about_axes
from orip.prelim.least_squares import LARGEST_TURN
from orip.prelim.rays import CAMERA_CORRECTIONS, ImageRays
from orip.records.camera import Camera
from orip.structs import replace

# An interior orientation that is to be estimated may be off by per cent. Photos that are adjusted without correcting it
# do not fit, and seem to be in the wrong place. A few corrections per camera prevent that: C' = C exp(s),
# x' = x + C b + k (r / C)² x, and y alike. The bundle adjustment starts the camera with them.

EXPECTED = np.array([0.03, 0.02, 0.02, 0.1])
"""A-priori standard deviations of the corrections: they bound what a block does not determine."""


def no_corrections(rays: ImageRays) -> FloatArray:
    """Return corrections of all unknown cameras, array (cameras, `CAMERA_CORRECTIONS`), that are 0."""
    return np.zeros(rays.cameras.unknown.shape)


def corrected(rays: ImageRays, corrections: FloatArray) -> ImageRays:
    """Return the rays with corrected image vectors.

    Parameters
    ----------
    rays : ImageRays
    corrections : array (cameras, `CAMERA_CORRECTIONS`)
    """
    if not corrections.any():
        return rays
    # the last row, index -1, is that of known cameras
    scale, right, up, radial = np.vstack([corrections, np.zeros(CAMERA_CORRECTIONS)])[camera_of(rays)].T
    x, y, z = rays.vectors.T
    factor = 1.0 + radial * (x * x + y * y) / (z * z)
    vectors = np.column_stack([factor * x - right * z, factor * y - up * z, z * np.exp(scale)])
    return replace(rays, vectors=vectors)


def parameters_with(camera: Camera, correction: FloatArray) -> tuple[float, ...]:
    """Return the parameters of a camera whose image vectors are the corrected ones, to first order.

    Parameters
    ----------
    camera : Camera
    correction : array (`CAMERA_CORRECTIONS`,)
    """
    c, dx, dy, a1, a3, *others = camera.parameters
    scale, x, y, radial = correction.tolist()
    return (c * math.exp(scale), dx - c * x, dy - c * y, a1, a3 - radial / (c * c), *others)


def camera_of(rays: ImageRays) -> IntArray:
    """Return the unknown camera (n,) of each ray, -1 for a known one; an empty array where all are known."""
    of_photo = rays.cameras.of_photo
    return of_photo[rays.photo] if len(of_photo) else of_photo


def by_corrections(rays: ImageRays) -> FloatArray:
    """Return the partials (n, 2, `CAMERA_CORRECTIONS`) of residuals, computed minus measured, by corrections.

    Those by the first are the computed coordinates themselves; the factor 1 is returned for them. 0 for corrections
    that are known; an empty array where all cameras are known.
    """
    camera = camera_of(rays)
    partials = np.zeros((len(camera), 2, CAMERA_CORRECTIONS))
    if len(camera):
        x, y, z = rays.vectors.T
        radial = (x * x + y * y) / (z * z)
        partials[:, :, 0] = 1.0
        partials[:, 0, 1] = partials[:, 1, 2] = z
        partials[:, 0, 3], partials[:, 1, 3] = -radial * x, -radial * y
        # the last row is that of known cameras
        unknown = np.vstack([rays.cameras.unknown, np.zeros(CAMERA_CORRECTIONS, dtype=bool)])
        partials *= unknown[camera, None, :]
    return partials


MEDIAN_LENGTH = math.sqrt(2.0 * math.log(2.0))
"""Median length of a residual with two normal components of standard deviation 1."""

SQUARE_BEHIND = 1e6
"""Squared standard residual that a ray has whose point lies behind the photo."""


class RefinementState(Struct, frozen=True):
    """Rotations (p, 3, 3) and centres (p, 3) of photos, points (q, 3), and corrections of k cameras (k, 4)."""

    rotations: FloatArray
    centres: FloatArray
    points: FloatArray
    corrections: FloatArray

    @property
    def of_cameras(self) -> float:
        """Return the square sum of the cameras' corrections over their a-priori standard deviations."""
        return float(((self.corrections / EXPECTED) ** 2).sum())

    def moved(self, by_photos: FloatArray, by_points: FloatArray, by_cameras: FloatArray) -> RefinementState:
        """Return the state after turns and shifts (p, 6) of photos, shifts of points, and changes of corrections."""
        largest = float(np.linalg.norm(by_photos[:, :3], axis=1).max(initial=0.0))
        factor = min(1.0, LARGEST_TURN / max(largest, 1e-300))
        return RefinementState(
            rotation_about_axes(factor * by_photos[:, :3]) @ self.rotations,
            self.centres + factor * by_photos[:, 3:],
            self.points + factor * by_points,
            self.corrections + factor * by_cameras,
        )


class RayResiduals(NamedTuple):
    """Squares (m,) and lengths (m,) of the residuals of m rays over their a-priori errors.

    Of points behind the photo the squares are `SQUARE_BEHIND`, and the lengths infinite. `of_cameras` is what the
    corrections of the cameras add to the square sum.
    """

    squares: FloatArray
    lengths: FloatArray
    of_cameras: float


class RefinementProblem(Struct, frozen=True, dict=True):
    """Which rays take part, point by point, and which photos and points are unknown.

    Parameters
    ----------
    rays : ImageRays
        m of them.
    photo_free, point_free : arrays (p,), (q,) of bool
    """

    rays: ImageRays
    photo_free: BoolArray
    point_free: BoolArray

    @cached_property
    def redundancy(self) -> int:
        """Return twice the number of rays minus the number of unknowns."""
        return 2 * len(self.rays.photo) - 6 * int(self.photo_free.sum()) - 3 * int(self.point_free.sum())

    @cached_property
    def median_length(self) -> float:
        """Return the median of the lengths of residuals that are as large as expected; 0 without redundancy."""
        share = self.redundancy / (2 * len(self.rays.photo)) if len(self.rays.photo) else 0.0
        return MEDIAN_LENGTH * math.sqrt(share) if share > 0.0 else 0.0
