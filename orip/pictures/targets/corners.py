"""Corners of chequers and tags at sub-pixel position: crossings of two edges, by least squares on grey values."""

from __future__ import annotations

from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.pictures.targets.marks import Mark, Rejected

SMALLEST_WINDOW = 3.0
"""Pixels of the radius within which grey values are compared."""

_LARGEST_WINDOW = 14.0
_LOWEST_AMPLITUDE = 8.0
_ITERATIONS = 20
_LARGEST_SHIFT = 2.0
_NO_CORNER = "its grey values are not those of a corner"


def measure_crossing(picture: Any, name: str, start: tuple[float, float], radius: float) -> Mark | Rejected:
    """Measure where four fields of a chequered pattern meet.

    The model is g = mean + gx u + gy v + amplitude · erf(d1 / s) · erf(d2 / s), d1 and d2 the distances from two lines
    through the corner, s the blur times the root of 2. It is symmetric about the corner, so that blur does not move it.

    Parameters
    ----------
    picture : array (rows, columns) of uint8
    start : tuple of 2 float
        Approximate column and row.
    radius : float
        Pixels within which nothing but the four fields is seen.
    """
    radius = min(radius, _LARGEST_WINDOW)
    if radius < SMALLEST_WINDOW:
        return Rejected(*start, "too small", name)
    centre = np.array(start) - 0.5
    low, high = np.floor(centre - radius).astype(int), np.ceil(centre + radius).astype(int) + 1
    if low.min() < 0 or high[0] > picture.shape[1] or high[1] > picture.shape[0]:
        return Rejected(*start, "at the edge of the picture", name)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    at = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    near = np.hypot(*(at - centre).T) <= radius
    values = picture[low[1] : high[1], low[0] : high[0]].astype(float).ravel()[near]
    begin = _begin(at[near] - centre, values, radius)
    if isinstance(begin, str):
        return Rejected(*start, begin, name)
    fitted = _iterate(np.array([*centre, *begin]), at[near], values)
    if fitted is None or np.hypot(*(fitted[0][:2] - centre)) > _LARGEST_SHIFT + 0.2 * radius:
        return Rejected(*start, _NO_CORNER, name)
    unknowns, deviations = fitted
    return Mark(name, float(unknowns[0]) + 0.5, float(unknowns[1]) + 0.5, (float(deviations[0]), float(deviations[1])))


def _begin(away: FloatArray, values: FloatArray, radius: float) -> tuple[float, ...] | str:
    """Return directions of the normals of both lines, mean, its plane, amplitude and blur; or what is wrong.

    The grey values on rings about the corner go twice from dark to light: their second harmonic says where the fields
    are, and the fourth where the lines are between them.
    """
    mean = float(values.mean())
    distance = np.hypot(*away.T)
    outer = distance > 0.4 * radius
    angle = np.arctan2(away[outer, 1], away[outer, 0])
    bins = np.floor(angle / (2.0 * np.pi) * 36.0).astype(int) % 36
    counts = np.bincount(bins, minlength=36)
    if counts.min() == 0:
        return "too small"
    around = np.bincount(bins, weights=values[outer] - mean, minlength=36) / counts
    amplitude = float(np.abs(around).mean())
    if amplitude < _LOWEST_AMPLITUDE:
        return "low contrast"
    half = around.reshape(2, 18).mean(axis=0)  # opposite fields are alike
    is_light = half > 0.5 * (np.sort(half)[:4].mean() + np.sort(half)[-4:].mean())
    changes = np.flatnonzero(is_light != np.roll(is_light, 1))
    if len(changes) != 2:
        return _NO_CORNER
    first, second = changes * (np.pi / 18.0)
    # the light fields begin at the first line or at the second
    return first + 0.5 * np.pi, second + 0.5 * np.pi, mean, 0.0, 0.0, amplitude * (-1) ** int(is_light[changes[0]]), 0.9


def _iterate(unknowns: FloatArray, at: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    for _ in range(_ITERATIONS):
        model, design = _model(unknowns, at)
        residuals = values - model
        normal = design.T @ design
        try:
            step = np.linalg.solve(normal, design.T @ residuals)
        except np.linalg.LinAlgError:
            return None
        length = float(np.hypot(*step[:2]))
        unknowns = unknowns + step * min(1.0, 1.0 / max(length, 1e-12))
        unknowns[8] = min(max(unknowns[8], 0.25), 4.0)
        if not np.isfinite(unknowns).all():
            return None
        if length < 1e-4:
            variance = float(residuals @ residuals) / max(len(values) - 9, 1)
            is_dull = abs(unknowns[7]) < _LOWEST_AMPLITUDE or variance > (0.5 * unknowns[7]) ** 2
            return None if is_dull else (unknowns, np.sqrt(np.diag(np.linalg.inv(normal)) * variance))
    return None


def _model(unknowns: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return grey values (n,) and their partials (n, 9)."""
    from scipy.special import erf

    u, v = (at - unknowns[:2]).T
    mean, along, down, amplitude, blur = unknowns[4:]
    width = np.sqrt(2.0) * blur
    edges, slopes, normals, turned = [], [], [], []
    for angle in unknowns[2:4]:
        normal = np.array([np.cos(angle), np.sin(angle)])
        distance = normal[0] * u + normal[1] * v
        edges.append(erf(distance / width))
        slopes.append(2.0 / np.sqrt(np.pi) / width * np.exp(-((distance / width) ** 2)))
        normals.append((normal, distance))
        turned.append(-normal[1] * u + normal[0] * v)
    first, second = slopes[0] * edges[1], slopes[1] * edges[0]
    design = np.stack(
        [
            *(-amplitude * (first * normals[0][0][i] + second * normals[1][0][i]) - (along, down)[i] for i in (0, 1)),
            amplitude * first * turned[0], amplitude * second * turned[1],
            np.ones_like(u), u, v, edges[0] * edges[1],
            -amplitude * (first * normals[0][1] + second * normals[1][1]) / blur,
        ],
        axis=1,
    )  # fmt: skip
    return mean + along * u + down * v + amplitude * edges[0] * edges[1], design


_PART_OF_EDGE = (0.12, 0.88)
_STEP_ALONG = 1.0
_REACH = 3.5


def measure_tag(picture: Any, name: str, corners: FloatArray) -> list[Mark | Rejected]:
    """Measure the four corners of the dark square of a tag as intersections of its edges.

    Every edge is a line through the places at which profiles across it are steepest; the end parts, where blur rounds
    the corner, are left out. The covariance of an intersection is that of both lines.

    Parameters
    ----------
    picture : array (rows, columns) of uint8
    name : str
        The corners are called name-1 to name-4.
    corners : array (4, 2)
        Approximate columns and rows, clockwise from the upper left one.
    """
    lines = [_edge(picture, corners[place], corners[(place + 1) % 4]) for place in range(4)]
    found: list[Mark | Rejected] = []
    for place in range(4):
        before, after = lines[place - 1], lines[place]
        start = float(corners[place][0]), float(corners[place][1])
        if before is None or after is None:
            found.append(Rejected(*start, "its edges are not straight, too short, or cut", f"{name}-{place + 1}"))
            continue
        design = np.stack([before[0], after[0]])
        inverse = np.linalg.inv(design)
        at = inverse @ np.array([before[1], after[1]])
        # a line's deviation at its end: that of offset and direction there
        deviations = np.sqrt((inverse**2) @ np.array([before[3], after[2]]) ** 2)
        far = np.hypot(*(at - start)) > 2.0 + 0.05 * np.hypot(*(corners[place] - corners[place - 2]))
        found.append(
            Rejected(*start, "its edges do not meet there", f"{name}-{place + 1}")
            if far
            else Mark(f"{name}-{place + 1}", float(at[0]), float(at[1]), (float(deviations[0]), float(deviations[1])))
        )
    return found


def _edge(picture: Any, begin: FloatArray, end: FloatArray) -> tuple[FloatArray, float, float, float] | None:
    """Return the normal and offset of an edge, and the deviations of its offset at both ends, pixels."""
    length = float(np.hypot(*(end - begin)))
    if length < 4.0 * SMALLEST_WINDOW:
        return None
    along = (end - begin) / length
    normal = np.array([along[1], -along[0]])
    reach = min(_REACH, 0.1 * length + 1.0)
    across = np.arange(-reach, reach + 0.01, 0.25)
    parts = np.linspace(*_PART_OF_EDGE, max(int(length * (_PART_OF_EDGE[1] - _PART_OF_EDGE[0]) / _STEP_ALONG), 4))
    at = begin + parts[:, None, None] * (end - begin) + across[:, None] * normal
    values = _interpolated(picture, at)
    if values is None:
        return None
    slope = np.abs(np.gradient(values, axis=1))
    steep = slope.max(axis=1)
    slope = np.where(slope > 0.35 * steep[:, None], slope, 0.0)
    offsets = (slope @ across) / slope.sum(axis=1)
    good = steep > max(0.5 * float(np.median(steep)), 1.0)
    place = parts * length
    for _ in range(3):
        if good.sum() < 4:
            return None
        line = np.polyfit(place[good], offsets[good], 1)
        off = offsets - np.polyval(line, place)
        spread = 1.5 * float(np.median(np.abs(off[good]))) + 0.02
        good &= np.abs(off) < 3.0 * spread
    variance = float(np.sum(off[good] ** 2)) / max(int(good.sum()) - 2, 1)
    if variance > 0.5 or good.mean() < 0.6:
        return None
    design = np.column_stack([place[good], np.ones(int(good.sum()))])
    covariance = np.linalg.inv(design.T @ design) * variance
    ends = [np.sqrt(np.array([x, 1.0]) @ covariance @ np.array([x, 1.0])) for x in (0.0, length)]
    turned = normal - line[0] * along
    turned = turned / np.hypot(*turned)
    through = begin + line[1] * normal
    return turned, float(turned @ through), float(ends[0]), float(ends[1])


def _interpolated(picture: Any, at: FloatArray) -> FloatArray | None:
    """Return grey values at columns and rows (..., 2), bilinear; None where some lie outside."""
    place = at - 0.5
    low = np.floor(place).astype(int)
    if low.min() < 0 or low[..., 0].max() >= picture.shape[1] - 1 or low[..., 1].max() >= picture.shape[0] - 1:
        return None
    part = place - low
    columns, rows = low[..., 0], low[..., 1]
    values = [picture[rows + j, columns + i].astype(float) for j in (0, 1) for i in (0, 1)]
    x, y = part[..., 0], part[..., 1]
    return np.asarray((values[0] * (1 - x) + values[1] * x) * (1 - y) + (values[2] * (1 - x) + values[3] * x) * y)
