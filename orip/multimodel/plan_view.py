"""The block in plan: the points and the areas of the models, projected onto a plane of two object axes.

The plane is the one in which the points spread over the largest area: X and Y for a block of aerial photos, X and Z or
Y and Z for a cliff or a façade. It is seen from where the cameras are, except that a map is never seen from below.

What is between the points is interpolated from them: a place of the plan is a place of the object with the third
coordinate of the points nearest to it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.multimodel.oriented_block import OrientedBlock
from orip.multimodel.state import inside_model
from orip.records.drive_table import Triple

_NEAREST = 6
"""Number of points from which a third coordinate is interpolated."""

_PLANES = ((0, 1, 2), (0, 2, 1), (1, 2, 0))
"""Axes to the right and up, and the third one; if spreads are equal, the first is taken: the map."""

_FIRST_DIRECTIONS, _DIRECTIONS = 24, 180
_STEPS, _HALVINGS = 16, 16
"""Outlines are computed in directions two degrees apart, to a millionth of the block's extent."""

_MARGIN = 0.25
"""How far outlines go beyond the points, as a part of the extent of these."""


class BlockPoints(NamedTuple):
    """Points of the object: names, kinds, and coordinates (n, 3) in the object system of the drive table."""

    names: tuple[str, ...]
    kinds: Sequence[str]
    xyz: FloatArray


class Plane(NamedTuple):
    """A plane of two object axes (0, 1, 2: X, Y, Z): to the right, up, and the third one.

    Attributes
    ----------
    mirrored : bool
        Seen from the cameras, the first axis runs to the left.
    """

    right: int
    up: int
    third: int
    mirrored: bool


class PlanView(Struct, frozen=True, eq=False):
    """The block in plan.

    Parameters
    ----------
    points : BlockPoints
        Those with all three coordinates.
    outlines : tuple of arrays (m, 2)
        Area of each model in the plan, in the order of the block; empty where it shows none of the points.
    default_third : float
        Third coordinate where there are no points.
    """

    plane: Plane
    points: BlockPoints
    outlines: tuple[FloatArray, ...]
    default_third: float

    def object_places(self, plan: FloatArray) -> FloatArray:
        """Return places (n, 3) of the object for places (n, 2) of the plan."""
        return _interpolation(self.plane, self.points.xyz, self.default_third)(plan)

    def object_place(self, right: float, up: float) -> Triple:
        """Return the place of the object for a place of the plan."""
        x, y, z = self.object_places(np.array([[right, up]]))[0].tolist()
        return x, y, z


def plan_view(block: OrientedBlock, points: BlockPoints) -> PlanView:
    """Project a block on the plane that suits it."""
    finite = np.flatnonzero(np.isfinite(points.xyz).all(axis=1))
    rows = finite.tolist()
    known = BlockPoints(
        tuple(points.names[row] for row in rows), tuple(points.kinds[row] for row in rows), points.xyz[finite]
    )
    viewing = -np.mean([photo.rotation[2::3] for photo in block.photos], axis=0)
    plane = _plane(known.xyz, viewing)
    third = float(block.table.start[plane.third])
    places = _interpolation(plane, known.xyz, third)
    return PlanView(plane, known, tuple(_outlines(block, known.xyz, plane, places)), third)


def _plane(xyz: FloatArray, viewing: FloatArray) -> Plane:
    """Return the plane of the largest spread, seen along the mean viewing direction."""
    right, up, third = max(_PLANES, key=lambda plane: _spread(xyz[:, plane[:2]]))
    # to the right is viewing × up: +X when looking to +Y, −Y when looking to +X
    mirrored = up == 2 and bool(viewing[third] * (1.0 if third == 1 else -1.0) < 0.0)
    return Plane(right, up, third, mirrored)


def _spread(plan: FloatArray) -> float:
    """Return the determinant of the covariance matrix, the square of a measure of area."""
    return float(np.linalg.det(np.cov(plan, rowvar=False))) if len(plan) > 2 else 0.0


def _interpolation(plane: Plane, xyz: FloatArray, default: float) -> Callable[[FloatArray], FloatArray]:
    """Return the function from places (n, 2) of the plan to places (n, 3) of the object.

    Weights are the inverse squares of distances, so that it passes through the points (Shepard, 1968).
    """
    from scipy.spatial import KDTree  # slow to import, and not needed by the processor itself

    axes = (plane.right, plane.up)
    tree = KDTree(xyz[:, axes]) if len(xyz) else None
    count = min(_NEAREST, len(xyz))
    heights = xyz[:, plane.third]

    def places(plan: FloatArray) -> FloatArray:
        found = np.full((len(plan), 3), default)
        found[:, axes] = plan
        if tree is not None:
            distance, nearest = tree.query(plan, k=np.arange(1, count + 1))
            # relative to the nearest point, and bounded: points are reproduced, and no weight overflows
            weights = ((distance[:, :1] + 1e-12) / (distance + 1e-12)) ** 2
            found[:, plane.third] = (weights * heights[nearest]).sum(axis=1) / weights.sum(axis=1)
        return found

    return places


def _outlines(
    block: OrientedBlock, xyz: FloatArray, plane: Plane, places: Callable[[FloatArray], FloatArray]
) -> list[FloatArray]:
    """Return the outline of every model: where along rays from its middle the mark leaves it."""
    if not len(xyz):
        return [np.empty((0, 2)) for _ in block.models]
    plan = xyz[:, (plane.right, plane.up)]
    reach = (1.0 + _MARGIN) * float(np.hypot(*np.ptp(plan, axis=0)))
    surface, found = places(plan), []
    for model in range(len(block.models)):

        def shows(at: FloatArray, model: int = model) -> NDArray[np.bool_]:
            return inside_model(block, model, places(at))

        seen = plan[inside_model(block, model, surface)]
        if not len(seen):
            found.append(np.empty((0, 2)))
            continue
        middle = seen.mean(axis=0)
        if not shows(middle[None])[0]:
            middle = seen[np.argmin(np.hypot(*(seen - middle).T))]
        centroid = _polygon_centroid(_outline(shows, middle, reach, _FIRST_DIRECTIONS))
        found.append(_outline(shows, centroid if shows(centroid[None])[0] else middle, reach, _DIRECTIONS))
    return found


def _outline(
    shows: Callable[[FloatArray], NDArray[np.bool_]], middle: FloatArray, reach: float, directions: int
) -> FloatArray:
    """Return where rays (directions, 2) from the middle leave what is shown, by steps and then by bisection."""
    angles = np.linspace(0.0, 2.0 * np.pi, directions, endpoint=False)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    inner, outer, has_left = np.zeros(directions), np.full(directions, reach), np.zeros(directions, dtype=np.bool_)
    for step in reach * np.arange(1, _STEPS + 1) / _STEPS:
        leaves = ~has_left & ~shows(middle + step * rays)
        has_left |= leaves
        inner, outer = np.where(has_left, inner, step), np.where(leaves, step, outer)
        if has_left.all():
            break
    for _ in range(_HALVINGS):
        half = 0.5 * (inner + outer)
        inside = shows(middle + half[:, None] * rays)
        inner, outer = np.where(inside, half, inner), np.where(inside, outer, half)
    return np.asarray(middle + inner[:, None] * rays)


def _polygon_centroid(polygon: FloatArray) -> FloatArray:
    """Return the centroid of a polygon (n, 2); its mean corner where it has no area."""
    shifted = polygon - polygon[0]  # large coordinates of a national grid would lose digits
    after = np.roll(shifted, -1, axis=0)
    cross = shifted[:, 0] * after[:, 1] - shifted[:, 1] * after[:, 0]
    area = float(cross.sum())
    if abs(area) <= 1e-12 * float(np.abs(shifted).max()) ** 2:
        return np.asarray(polygon.mean(axis=0))
    return np.asarray(polygon[0] + ((shifted + after) * cross[:, None]).sum(axis=0) / (3.0 * area))
