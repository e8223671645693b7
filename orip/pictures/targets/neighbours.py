"""Points of a plane in a picture, predicted by their neighbours: distortion adds up nowhere."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.geometry.plane import homography

_FITTING = 0.12
"""How far from the place that all its neighbours predict a point may be, in distances of neighbouring points."""

_NEIGHBOURS = 12
_LEAST_KEPT = 6


def spacing_in_plane(xy: FloatArray) -> float:
    """Return the median distance of a point (n, 2) to the one nearest to it."""
    away = np.hypot(*(xy[:, None] - xy).transpose(2, 0, 1))
    np.fill_diagonal(away, np.inf)
    return float(np.median(away.min(axis=1)))


def affinity(plane: FloatArray, image: FloatArray, away: FloatArray | None = None) -> tuple[FloatArray, int]:
    """Return the affinity (3, 2) of points, near ones with more weight, and its rank."""
    weight = np.ones(len(plane)) if away is None else 1.0 / np.maximum(away, 1e-12)
    weight = (weight / weight.max())[:, None]
    scale = np.ptp(plane, axis=0).max()
    design = np.column_stack([plane / scale, np.ones(len(plane))])
    matrix, _, rank, _ = np.linalg.lstsq(design * weight, image * weight, rcond=1e-3)
    return matrix / np.array([[scale], [scale], [1.0]]), int(rank)


def with_one(xy: FloatArray) -> FloatArray:
    """Return homogeneous coordinates (n, 3)."""
    return np.column_stack([xy, np.ones(len(xy))])


def through(matrix: FloatArray, xy: FloatArray) -> FloatArray:
    """Return points (n, 2) mapped by a homography."""
    mapped = with_one(xy) @ matrix.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def smallest_scale(matrix: FloatArray) -> float:
    """Return pixels per unit of the plane in the direction in which an affinity has fewest."""
    return float(np.linalg.svd(matrix[:2])[1][1])


def consistent(xy: FloatArray, places: FloatArray) -> IntArray:
    """Return which points are where their neighbours predict them, the worst taken out one by one.

    Parameters
    ----------
    xy, places : arrays (n, 2)
        In the plane and in the picture.
    """
    kept = np.arange(len(xy))
    spacing = spacing_in_plane(xy) if len(xy) > 1 else 0.0
    while len(kept) > _LEAST_KEPT:
        off = [_misfit(int(place), kept, xy, places, spacing) for place in kept]
        worst = int(np.argmax(off))
        if off[worst] < _FITTING:
            break
        kept = np.delete(kept, worst)
    return kept


def _misfit(point: int, kept: IntArray, xy: FloatArray, places: FloatArray, spacing: float) -> float:
    """Return how far a point is from where its neighbours' homography predicts it, in distances of neighbours."""
    known = kept[kept != point]
    near = known[np.argsort(np.hypot(*(xy[known] - xy[point]).T), kind="stable")[:_NEIGHBOURS]]
    matrix, rank = affinity(xy[near], places[near])
    if rank < 3:
        return 0.0
    try:
        predicted = through(homography(xy[near], places[near]), xy[[point]])[0]
    except ValueError:  # all but one on a line
        return 0.0
    return float(np.hypot(*(predicted - places[point]))) / max(smallest_scale(matrix) * spacing, 1e-12)


def eccentricity(plane_to_image: FloatArray, centres: FloatArray, radius: float) -> FloatArray:
    """Return the centre of the ellipse less the image of the circle's centre, of circles in a plane, pixels (n, 2).

    With C the conic of the circle and H the homography from the plane to the picture, the ellipse is H^-T C H^-1, and
    its centre the pole of the line at infinity: H C^-1 H^T (0, 0, 1). Heikkilä (2000), Geometric camera calibration
    using circular control points, IEEE PAMI 22(10); Ahn, Warnecke, Kotowski (1999), PFG 1999(6).

    Parameters
    ----------
    plane_to_image : array (3, 3)
        Distortion is left out: over a dot it is nearly linear.
    centres : array (n, 2)
        Of the circles, in the plane.
    radius : float
        In the same unit.
    """
    dual = np.zeros((len(centres), 3, 3))
    dual[:, :2, :2] = np.eye(2) * radius**2 - centres[:, :, None] * centres[:, None, :]
    dual[:, :2, 2] = dual[:, 2, :2] = -centres
    dual[:, 2, 2] = -1.0
    pole = plane_to_image @ dual @ plane_to_image.T @ np.array([0.0, 0.0, 1.0])
    return np.asarray(pole[:, :2] / pole[:, 2:] - through(plane_to_image, centres))
