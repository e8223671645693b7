"""Lines, planes and cylinders that fit points: by orthogonal distances, and so that some of the points may be wrong.

Lines and planes are those of least square sum of distances, the axes of the points' scatter (Pearson 1901). Where
points may be wrong, that of the figures through two or three points is taken for which the median distance is least
(Rousseeuw 1984), and fitted again to the points near it. The axis of a cylinder is looked for in all directions, its
circle through three points as they are seen along the axis.
"""

from __future__ import annotations

from itertools import combinations, combinations_with_replacement
from math import comb
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import rotation_about_axes

_MOST_TRIALS = 300
"""Selections of points that are tried for lines and planes; of more some are."""

_DIRECTIONS = 500
"""Directions of an axis that are tried: 6 degrees apart."""

_MOST_CIRCLES, _MOST_SEEN = 40, 40
"""Circles that are tried for each direction, and points that they are compared with."""

_NEAR = 3.0 * 1.4826
"""Median distances within which a point belongs to a figure: three standard deviations of normal errors."""

_STEPS, _STEADY, _LONGEST_TURN = 30, 1e-12, 0.2
_ROUNDING = 1e-9


class Fitted(NamedTuple):
    """A figure: its origin (3,), its axes (3, 3) as columns, and its radius; 0 for one that has none."""

    origin: FloatArray
    axes: FloatArray
    radius: float


def axes_about(direction: FloatArray) -> FloatArray:
    """Return right-handed axes (..., 3, 3) as columns, the third along directions (..., 3), the first horizontal.

    A direction is reversed where its largest component is negative. About a vertical one the first axis is X.
    """
    third = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    largest = np.take_along_axis(third, np.abs(third).argmax(axis=-1)[..., None], axis=-1)
    third = third * np.sign(largest)
    first = np.zeros_like(third)
    first[..., 0], first[..., 1] = -third[..., 1], third[..., 0]
    length = np.linalg.norm(first, axis=-1, keepdims=True)
    vertical = length < 1e-6
    first = np.where(vertical, [1.0, 0.0, 0.0], first / np.where(vertical, 1.0, length))
    second = np.cross(third, first)
    second /= np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([np.cross(second, third), second, third], axis=-1)


def scatter_axes(points: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the centre (3,) of points (n, 3), their root mean square sizes (3,) along the axes, and these, as rows.

    The largest comes first.
    """
    centre = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(np.vstack([points - centre, np.zeros((3, 3))]), full_matrices=False)
    return centre, sizes / np.sqrt(len(points)), axes


def fitted_line(points: FloatArray) -> Fitted:
    """Return the line that fits points (n, 3), most of them right."""
    some = points[_selections(len(points), 2)]
    along = axes_about(_or_up(some[:, 1] - some[:, 0]))[:, :, :2]
    centre, _, axes = scatter_axes(points[_agreeing(points, some[:, 0], along, 2)])
    return Fitted(centre, axes_about(axes[0]), 0.0)


def fitted_plane(points: FloatArray) -> Fitted:
    """Return the plane that fits points (n, 3), most of them right."""
    some = points[_selections(len(points), 3)]
    normal = axes_about(_or_up(np.cross(some[:, 1] - some[:, 0], some[:, 2] - some[:, 0])))[:, :, 2:]
    centre, _, axes = scatter_axes(points[_agreeing(points, some[:, 0], normal, 3)])
    return Fitted(centre, axes_about(axes[2]), 0.0)


def fitted_cylinder(points: FloatArray) -> Fitted:
    """Return the cylinder that fits points (n, 3), most of them right."""
    centre = points.mean(axis=0)
    few = points[np.linspace(0, len(points) - 1, min(len(points), _MOST_SEEN)).astype(np.int64)] - centre
    axes = axes_about(_half_sphere())
    middle, radius, size = _circles(np.einsum("ni,kij->knj", few, axes[:, :, :2]))
    best = int(size.argmin())
    found = Fitted(centre + axes[best][:, :2] @ middle[best], axes[best], float(radius[best]))
    for _ in range(3):
        distance = np.abs(distances_from_cylinder(points, found))
        near = distance <= _NEAR * float(np.median(distance)) + _ROUNDING * found.radius
        found = _refined(points[near] if np.count_nonzero(near) > 5 else points, found)
    return found


def distances_from_cylinder(points: FloatArray, cylinder: Fitted) -> FloatArray:
    """Return the signed distances (n,) of points (n, 3) from the surface, positive outside."""
    across = (points - cylinder.origin) @ cylinder.axes[:, :2]
    return np.asarray(np.linalg.norm(across, axis=1) - cylinder.radius)


def _or_up(directions: FloatArray) -> FloatArray:
    """Return the directions (k, 3), and Z for those of length zero."""
    return np.where((directions == 0.0).all(axis=1, keepdims=True), [0.0, 0.0, 1.0], directions)


def _selections(count: int, least: int, most: int = _MOST_TRIALS) -> IntArray:
    """Return selections (k, least) of rows: all, or some of them that are the same each time; fewer rows: once all."""
    if count < least:
        return np.arange(least, dtype=np.int64)[None] % max(count, 1)
    if comb(count, least) <= most:
        return np.array(list(combinations(range(count), least)), dtype=np.int64)
    random = np.random.default_rng(count)
    return np.argsort(random.random((most, count)), axis=1)[:, :least]


def _agreeing(points: FloatArray, through: FloatArray, across: FloatArray, least: int) -> BoolArray:
    """Return which points (n,) lie near the one of k figures that most are nearest to.

    The figures go through places (k, 3); distances from them are along directions (k, 3, j).
    """
    offset = points[None] - through[:, None]
    distance = np.linalg.norm(np.einsum("kni,kij->knj", offset, across), axis=2)
    typical = np.sort(distance, axis=1)[:, min((len(points) + least) // 2, len(points) - 1)]
    best = int(typical.argmin())
    return np.asarray(distance[best] <= max(_NEAR * float(typical[best]), _ROUNDING * float(np.abs(offset).max())))


def _half_sphere() -> FloatArray:
    """Return directions (k, 3) spread evenly over half a sphere, by the golden angle."""
    number = np.arange(_DIRECTIONS) + 0.5
    height, turn = number / _DIRECTIONS, np.pi * (3.0 - np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - height**2)
    return np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)


def _circles(seen: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centres (k, 2), radii (k,) and median distances (k,) of circles through three of n points (k, n, 2)."""
    trios = seen[:, _selections(seen.shape[1], 3, _MOST_CIRCLES)]
    p, q = trios[:, :, 1] - trios[:, :, 0], trios[:, :, 2] - trios[:, :, 0]
    twice = 2.0 * (p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0])
    pp, qq = (p * p).sum(axis=-1), (q * q).sum(axis=-1)
    flat = np.abs(twice) <= 1e-6 * np.sqrt(pp * qq) + 1e-300
    offset = np.stack([q[..., 1] * pp - p[..., 1] * qq, p[..., 0] * qq - q[..., 0] * pp], axis=-1)
    offset /= np.where(flat, 1.0, twice)[..., None]
    middle, radius = trios[:, :, 0] + offset, np.linalg.norm(offset, axis=-1)
    distance = np.abs(np.linalg.norm(seen[:, None] - middle[:, :, None], axis=-1) - radius[..., None])
    place = min((seen.shape[1] + 3) // 2, seen.shape[1] - 1)
    typical = np.where(flat, np.inf, np.partition(distance, place, axis=-1)[..., place])
    best = typical.argmin(axis=1)
    at = np.arange(len(seen)), best
    return middle[at], radius[at], typical[at]


def _refined(points: FloatArray, cylinder: Fitted) -> Fitted:
    """Return the cylinder with the least square sum of distances of points (n, 3) near a first one (Gauss-Newton)."""
    origin, axes, radius = cylinder
    for _ in range(_STEPS):
        r = (points - origin) @ axes
        rho = np.maximum(np.linalg.norm(r[:, :2], axis=1), 1e-300)
        x, y, z = r[:, 0] / rho, r[:, 1] / rho, r[:, 2]
        design = np.stack([-x, -y, y * z, -x * z, -np.ones_like(x)], axis=1)
        size = np.maximum(np.linalg.norm(design, axis=0), 1e-300)
        step = np.linalg.lstsq(design / size, radius - rho, rcond=_ROUNDING)[0] / size
        step *= _LONGEST_TURN / max(_LONGEST_TURN, float(np.abs(step[2:4]).max()))
        origin = origin + axes[:, :2] @ step[:2]
        axes = axes @ rotation_about_axes(np.array([step[2], step[3], 0.0]))
        radius += float(step[4])
        if float(np.abs(step).max()) <= _STEADY * max(radius, 1.0):
            break
    along = axes[:, 2] * float(((points - origin) @ axes[:, 2]).mean())
    return Fitted(origin + along, axes_about(axes[:, 2]), abs(radius))


class FittedPlanes(NamedTuple):
    """The planes of k groups of points, from which the square sum of distances is least; those of no points are at 0.

    Attributes
    ----------
    number : array (k,) of int
        Points of each group.
    middle, normal : arrays (k, 3)
    extent : array (k, 3)
        Root mean square distances of the points from their middle along the normal and the two axes of the plane, in
        ascending order.
    """

    number: IntArray
    middle: FloatArray
    normal: FloatArray
    extent: FloatArray

    def beside(self, places: FloatArray, group: int | slice = slice(None)) -> FloatArray:
        """Return the distances (n,) of places (n, 3) from the plane of a group, or each from that of its own."""
        return np.asarray(np.sum((places - self.middle[group]) * self.normal[group], axis=1))


def fitted_planes(points: FloatArray, group: IntArray, count: int) -> FittedPlanes:
    """Return the planes of `count` groups of points (n, 3), given the group (n,) of each."""
    number = np.bincount(group, minlength=count)
    divisor = np.maximum(number, 1)

    def means(values: FloatArray) -> FloatArray:
        return np.bincount(group, values, count) / divisor

    apart = np.array(points.T, order="C")
    middle = np.stack([means(values) for values in apart], axis=1)
    apart -= middle.T[:, group]
    squares = np.empty((count, 3, 3))
    for a, b in combinations_with_replacement(range(3), 2):
        squares[:, a, b] = squares[:, b, a] = means(apart[a] * apart[b])
    values, axes = np.linalg.eigh(squares)  # ascending
    return FittedPlanes(number, middle, axes[:, :, 0], np.sqrt(np.maximum(values, 0.0)))
