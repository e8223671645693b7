"""The known points of a photo: how well orientations agree with them, and whether they are placed to determine one."""

from __future__ import annotations

import math
from functools import cached_property
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray

FEW_BLUNDERS, MANY_BLUNDERS = 0.35, 0.7
"""Largest part of the points that may be blunders: of measured points, and of tracks, in which the known points may be
wrong, too."""


class Orientations(NamedTuple):
    """Rotations (k, 3, 3), photo to ground, and projection centres (k, 3)."""

    rotations: FloatArray
    centres: FloatArray

    def of(self, rows: IntArray | BoolArray | slice) -> Orientations:
        """Return some of them."""
        return Orientations(self.rotations[rows], self.centres[rows])

    def joined(self, others: Orientations) -> Orientations:
        """Return these followed by others."""
        return Orientations(
            np.concatenate([self.rotations, others.rotations]), np.concatenate([self.centres, others.centres])
        )


class KnownPoints(Struct, frozen=True, dict=True):
    """n known points of a photo, from their centroid and in units of their spread: all ground systems are then alike.

    Parameters
    ----------
    vectors : array (n, 3)
        Image vectors (x, y, -C), mm.
    coordinates : array (n, 3)
    deviations : array (n,)
        Standard deviation of a coordinate.
    error_mm : float
        A-priori error of a photo coordinate.
    blunders : float
        Largest part of the points that may be blunders.
    """

    vectors: FloatArray
    coordinates: FloatArray
    deviations: FloatArray
    error_mm: float
    blunders: float = FEW_BLUNDERS

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.coordinates)

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return vectors, coordinates and deviations, as the compiled loops take them."""
        return tuple(map(np.ascontiguousarray, (self.vectors, self.coordinates, self.deviations)))  # type: ignore[return-value]

    @property
    def variance_of_least(self) -> float:
        """Return the variance of unit weight over the sum of the smallest squared residuals that have to fit.

        The mean of the smallest part q of exponentially distributed squares is 1 + (1 - q) ln(1 - q) / q times that of
        all of them.
        """
        count, least = len(self), self.least
        left_out = 1.0 - least / count
        share = 1.0 + (left_out * math.log(left_out) / (1.0 - left_out) if left_out > 0.0 else 0.0)
        return count / max(count - 3, 1) / (2.0 * least * share)

    @cached_property
    def least(self) -> int:
        """Return the number of points that have to fit."""
        return number_that_fits(len(self), self.blunders)

    def squares(self, at: Orientations) -> FloatArray:
        """Return squared standardised residuals (k, n) of orientations; infinite behind the photo."""
        in_photo = self.coordinates @ at.rotations - at.centres[:, None] @ at.rotations
        ahead = np.where(in_photo[:, :, 2] < 0.0, -in_photo[:, :, 2], np.inf)
        scale = -self.vectors[:, 2] / ahead
        residual = in_photo[:, :, :2] * scale[:, :, None] - self.vectors[:, :2]
        variance = self.error_mm**2 + (scale * self.deviations) ** 2
        return np.where(np.isfinite(ahead), np.sum(residual**2, axis=2) / variance, np.inf)


def number_that_fits(count: int, blunders: float) -> int:
    """Return how many of `count` points have to fit if such a part of them may be blunders."""
    return max(count - int(blunders * count), min(count, 4))


_POINTS_OF_ORIENTATION = 3

SURE = 10.0
"""Logarithm of the factor by which points have to agree better than by chance."""


def fits_beyond_chance(xy: FloatArray, residuals: FloatArray, fitting: BoolArray) -> bool:
    """Tell whether more points fit an orientation of the photo than would if the others were anywhere.

    Parameters
    ----------
    xy : array (n, 2)
        Measured photo coordinates, mm.
    residuals : array (n, 2)
        mm.
    fitting : array (n,) of bool
        The points that fit.

    Notes
    -----
    A-contrario (Moisan and Stival 2004): m of n points have residuals up to r by chance in (n - 3) C(n, m) C(m, 3)
    p^(m - 3) sets, with the probability p of a place within r in the extent of the points.
    """
    n, m = len(xy), int(np.count_nonzero(fitting))
    if m <= _POINTS_OF_ORIENTATION:
        return False
    extent = float(np.prod(np.ptp(xy, axis=0)))
    largest = float((residuals[fitting] ** 2).sum(axis=1).max())
    chance = min(math.pi * largest / max(extent, 1e-300), 1.0)
    if chance <= 0.0:
        return True
    sets = math.log(n - _POINTS_OF_ORIENTATION) + math.log(math.comb(n, m)) + math.log(math.comb(m, 3))
    return sets + (m - _POINTS_OF_ORIENTATION) * math.log(chance) < -SURE


SMALLEST_AREA = 0.05
"""Part of the image that the known points should span (the test of the on-line triangulation system OLTRIS)."""

ONE_LINE = 1e-3
"""Width over length below which points count as lying on one line, as for the marks of a plane transformation: some
0.2 mm over 230 mm, too little for a perspective that could be measured."""


class Configuration(Struct, frozen=True):
    """How image points are spread.

    Parameters
    ----------
    area_share : float
        Area of their convex hull over that of the image; or of a part of the hull, if that is enough already.
    """

    area_share: float
    on_one_line: bool

    @property
    def shortcoming(self) -> str | None:
        """Return what is short, as a sentence; None: nothing."""
        if self.on_one_line:
            return "the known points lie on one line in the photo"
        if self.area_share < SMALLEST_AREA:
            return (
                f"the known points span {self.area_share:.1%} of the photo, {SMALLEST_AREA:.0%} are wanted: "
                "measure more known points, farther apart"
            )
        return None


def image_configuration(xy: FloatArray, frame: tuple[float, float] | None, measured: FloatArray) -> Configuration:
    """Return how the known points of a photo are spread.

    Parameters
    ----------
    xy : array (n, 2)
        Photo coordinates of the known points, mm.
    frame : tuple (x, y) or None
        Size of the photo, mm; None: not known.
    measured : array (m, 2)
        Photo coordinates of all points of the photo: where the frame is not known, their extent stands for it.
    """
    width, height = frame if frame is not None else measured.max(axis=0) - measured.min(axis=0)
    image = float(width * height)
    # the quadrilateral of the extreme points, no larger than the hull, is mostly large enough and quicker to compute
    area = _area_of_extremes(xy)
    if area <= SMALLEST_AREA * image:
        area = hull_area(xy)
    share = area / image if image > 0.0 else 0.0
    return Configuration(share, share < SMALLEST_AREA and on_one_line(xy))


def on_one_line(points: FloatArray) -> bool:
    """Return whether points (n, 2) or (n, 3) lie on one line, or in one place, as far as coordinates can tell."""
    offset = points - points.sum(axis=0) / len(points)
    moments = offset.T @ offset
    # sum and sum of squares of the squared extents along the axes: twice the product of length and width is left
    total = float(np.trace(moments)) ** 2
    return bool(total - np.vdot(moments, moments) <= 2.0 * ONE_LINE**2 * total)


def hull_area(xy: FloatArray) -> float:
    """Return the area of the convex hull of points (n, 2), n >= 1."""
    ordered = xy[np.lexsort((xy[:, 1], xy[:, 0]))].tolist()
    return _area(np.array(_chain(ordered) + _chain(ordered[::-1])))


def _area_of_extremes(xy: FloatArray) -> float:
    """Return the area of the quadrilateral of the extreme points, half the product of its diagonals as vectors."""
    (across_x, across_y), (up_x, up_y) = (xy[xy.argmax(axis=0)] - xy[xy.argmin(axis=0)]).tolist()
    return 0.5 * abs(float(across_x * up_y - across_y * up_x))


def _area(polygon: FloatArray) -> float:
    x, y = (polygon - polygon[0]).T
    return float(0.5 * np.abs(x[:-1] @ y[1:] - y[:-1] @ x[1:]))


def _chain(ordered: list[list[float]]) -> list[list[float]]:
    """Return one side of the hull without its end (Andrew 1979)."""
    chain: list[list[float]] = []
    for x, y in ordered:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], x, y) <= 0.0:
            chain.pop()
        chain.append([x, y])
    return chain[:-1] if len(chain) > 1 else chain


def _turn(a: list[float], b: list[float], x: float, y: float) -> float:
    return (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])
