"""Photos and points that are refined together: which are unknown, their state, and their residuals."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray
from orip.geometry.rotation import rotation_about_axes
from orip.prelim.least_squares import LARGEST_TURN
from orip.prelim.rays.image_rays import ImageRays
from orip.prelim.refinement.camera_corrections import EXPECTED

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
