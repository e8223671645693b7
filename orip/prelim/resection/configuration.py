"""Whether the image points of a photo are placed so that a space resection can succeed."""

from __future__ import annotations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray

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
    on_one_line : bool
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

    Returns
    -------
    Configuration
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
