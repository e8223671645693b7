"""Round targets: dark dots on a light ground, found by thresholds, measured by least squares on grey values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.pictures.targets.marks import Rejected, opencv

SMALLEST_RADIUS = 2.5
"""Pixels of the minor semi-axis: below, the grey values do not separate size from blur."""

FLATTEST = 5.0
"""Ratio of the axes: a dot seen at less than 12 degrees from its plane is not measured."""

LOWEST_CONTRAST = 15.0
"""Grey values of 255 between dot and ground."""

_WINDOWS = (45, 150)
"""Parts of the larger side of the picture that a window of the local threshold has, thousandths."""

_ROUNDNESS = 0.12
"""Mean distance of the outline from its ellipse, in units of the minor semi-axis."""

_ITERATIONS = 12
_MARGIN = 1.45
"""Size of what is compared, in semi-axes, besides some pixels."""


class Dot(Struct, frozen=True):
    """The image of a round target: an ellipse.

    Parameters
    ----------
    column, row : float
        Centre of the ellipse, pixels.
    deviation : tuple of 2 float
        Standard deviations of the centre in column and row, from the residuals of the grey values, pixels.
    shape : array (2, 2)
        Upper triangular; takes what is relative to the centre (pixels) to the unit circle.
    contrast : float
        Ground less dot, grey values.
    ground : float
        Grey value of the ground.
    """

    column: float
    row: float
    deviation: tuple[float, float]
    shape: FloatArray
    contrast: float
    ground: float

    @property
    def radius(self) -> float:
        """Geometric mean of the semi-axes, pixels."""
        return float(abs(self.shape[0, 0] * self.shape[1, 1]) ** -0.5)


class FoundDots(Struct, frozen=True):
    """The round targets of a picture, and what was rejected."""

    dots: tuple[Dot, ...]
    rejected: tuple[Rejected, ...]


def find_dots(grey: Any, reach: float = np.inf) -> FoundDots:
    """Find and measure the dark dots of a picture.

    Parameters
    ----------
    grey : array (rows, columns) of uint8 or uint16
    reach : float
        In radii of a dot: what is farther away from it is something else.

    Notes
    -----
    Outlines come from local thresholds with two sizes of window. A dot's centre is then that of the grey-value model
    of `measure_dot`.
    """
    picture = as_bytes(grey)
    dots: list[Dot] = []
    rejected: list[Rejected] = []
    for outline in _outlines(picture):
        start = _ellipse_of(outline, picture.shape)
        found = start if isinstance(start, Rejected) else measure_dot(picture, *start, reach)
        if isinstance(found, Rejected):
            rejected.append(found)
        else:
            dots.append(found)
    kept = _without_repeated(dots)
    return FoundDots(kept, _elsewhere(rejected, kept))


def as_bytes(grey: Any) -> Any:
    """Return a picture with eight bits a pixel; 16 bits lose what is far below their noise."""
    picture = np.asarray(grey)
    if picture.dtype == np.uint8:
        return np.ascontiguousarray(picture)
    low, high = float(picture.min()), float(picture.max())
    return np.asarray((picture - low) * (255.0 / max(high - low, 1.0)) + 0.5, dtype=np.uint8)


def _outlines(picture: Any) -> Iterator[FloatArray]:
    cv2 = opencv()
    for window in _WINDOWS:
        size = max(picture.shape) * window // 1000 | 1
        dark = cv2.adaptiveThreshold(
            picture, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV, max(size, 15), LOWEST_CONTRAST / 2.0
        )
        for outline in cv2.findContours(dark, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
            if len(outline) >= 8:
                yield outline[:, 0, :].astype(float)


def _ellipse_of(outline: FloatArray, extent: tuple[int, int]) -> tuple[FloatArray, FloatArray] | Rejected:
    """Return centre (indices of pixels) and shape of an outline from its moments, or why it is no dot."""
    low, high = outline.min(axis=0), outline.max(axis=0)
    column, row = (0.5 * (low + high) + 0.5).tolist()
    if (high - low).min() < 1.6 * SMALLEST_RADIUS - 1.0:  # most of what a textured picture has
        return Rejected(column, row, "too small")
    moments = opencv().moments(outline.astype(np.float32))
    area = moments["m00"]
    if area < 0.4 * float(np.prod(high - low)):  # pi / 4 of an ellipse's box, half of it when it is slanted and flat
        return Rejected(column, row, "not round")
    centre = np.array([moments["m10"], moments["m01"]]) / area
    second = np.array([[moments["mu20"], moments["mu11"]], [moments["mu11"], moments["mu02"]]]) * (4.0 / area)
    axes = np.sqrt(np.maximum(np.linalg.eigvalsh(second), 1e-12)) + 0.5  # an outline runs along the outermost pixels

    def rejected(reason: str) -> Rejected:
        return Rejected(float(centre[0]) + 0.5, float(centre[1]) + 0.5, reason)

    if axes[0] < 0.8 * SMALLEST_RADIUS:
        return rejected("too small")
    if axes[1] > FLATTEST * axes[0]:
        return rejected("not round")
    shape = np.linalg.cholesky(np.linalg.inv(second + np.eye(2) * axes[0])).T
    distances = np.linalg.norm((outline - centre) @ shape.T, axis=1)
    if np.abs(distances / np.mean(distances) - 1.0).mean() > _ROUNDNESS:
        return rejected("not round")
    rows, columns = extent
    if low.min() < 2 or high[0] > columns - 3 or high[1] > rows - 3:
        return rejected("at the edge of the picture")
    return centre, shape


def measure_dot(picture: Any, centre: FloatArray, shape: FloatArray, reach: float = np.inf) -> Dot | Rejected:
    """Measure a dot by least squares on its grey values.

    The model is an ellipse of one grey value on a ground with a plane of grey values, with an edge blurred by a normal
    distribution: g = ground + gx u + gy v - contrast · Phi(-d / blur), d the distance from the ellipse to first order,
    (q - 1) / |grad q|, with q = |L u| for the position u relative to the centre. The ten unknowns are the centre, L
    (three), the ground (three), contrast and blur; their covariance is that of the residuals.

    Parameters
    ----------
    picture : array (rows, columns) of uint8
    centre : array (2,)
        Approximate, indices of pixels (column, row).
    shape : array (2, 2)
        Upper triangular, approximate.
    reach : float
        In radii of the dot: what is farther away is something else.
    """
    fitted = _fit(picture, centre, shape, reach)
    if isinstance(fitted, str):
        return Rejected(float(centre[0]) + 0.5, float(centre[1]) + 0.5, fitted)
    unknowns, deviations = fitted
    found = np.array([[unknowns[2], unknowns[3]], [0.0, unknowns[4]]])
    dot = Dot(
        float(unknowns[0]) + 0.5, float(unknowns[1]) + 0.5, (float(deviations[0]), float(deviations[1])), found,
        float(unknowns[8]), float(unknowns[5]),
    )  # fmt: skip
    reason = _fault(dot, centre)
    return dot if reason is None else Rejected(dot.column, dot.row, reason)


def _fault(dot: Dot, start: FloatArray) -> str | None:
    axes = 1.0 / np.linalg.svd(dot.shape)[1]
    if dot.contrast < LOWEST_CONTRAST:
        return "low contrast"
    if axes.min() < SMALLEST_RADIUS:
        return "too small"
    if axes.max() > FLATTEST * axes.min():
        return "not round"
    if np.hypot(dot.column - 0.5 - start[0], dot.row - 0.5 - start[1]) > 1.0 + 0.3 * dot.radius:
        return "its grey values are not those of a dot"
    # the residuals of a dot with dirt on it or something beside it move its centre
    return "its grey values are not those of a dot" if max(dot.deviation) > 0.01 * dot.radius + 0.05 else None


def _fit(picture: Any, centre: FloatArray, shape: FloatArray, reach: float) -> tuple[FloatArray, FloatArray] | str:
    half = np.sqrt(np.diag(np.linalg.inv(shape.T @ shape))) * _MARGIN + 4.0
    low = np.maximum(np.floor(centre - half).astype(int), 0)
    high = np.minimum(np.ceil(centre + half).astype(int) + 1, picture.shape[::-1])
    window = picture[low[1] : high[1], low[0] : high[0]].astype(float)
    columns, rows = np.meshgrid(np.arange(low[0], high[0]), np.arange(low[1], high[1]))
    at = np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)
    distance = np.linalg.norm((at - centre) @ shape.T, axis=1)
    blurred = 4.0 * np.sqrt(abs(np.linalg.det(shape)))
    near = distance < min(_MARGIN + blurred, reach)
    at, values = at[near], window.ravel()[near]
    distance = distance[near]
    if not (distance < 0.7).any() or not (distance > 1.2).any():
        return "too small"
    inside, outside = np.median(values[distance < 0.7]), np.median(values[distance > 1.2])
    unknowns = np.array([*centre, shape[0, 0], shape[0, 1], shape[1, 1], outside, 0.0, 0.0, outside - inside, 0.8])
    if unknowns[8] < LOWEST_CONTRAST:
        return "low contrast"
    return _iterate(unknowns, at, values)


def _iterate(unknowns: FloatArray, at: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray] | str:
    for _ in range(_ITERATIONS):
        model, design = _model(unknowns, at)
        residuals = values - model
        normal = design.T @ design
        try:
            step = np.linalg.solve(normal, design.T @ residuals)
        except np.linalg.LinAlgError:
            return "its grey values are not those of a dot"
        unknowns = unknowns + step
        unknowns[9] = min(max(unknowns[9], 0.25), 4.0)
        if not np.isfinite(unknowns).all() or min(abs(unknowns[2]), abs(unknowns[4])) < 1e-6:
            return "its grey values are not those of a dot"
        if np.abs(step[:2]).max() < 1e-4:
            variance = float(residuals @ residuals) / max(len(values) - 10, 1)
            return unknowns, np.sqrt(np.diag(np.linalg.inv(normal)) * variance)
    return "its grey values are not those of a dot"


def _model(unknowns: FloatArray, at: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return grey values (n,) and their partials (n, 10)."""
    from scipy.special import ndtr

    a, b, c = unknowns[2:5]
    ground, along, down, contrast, blur = unknowns[5:]
    u, v = (at - unknowns[:2]).T
    w0, w1 = a * u + b * v, c * v
    q = np.maximum(np.hypot(w0, w1), 1e-3)
    du, dv = a * w0 / q, (b * w0 + c * w1) / q
    steepness = np.maximum(np.hypot(du, dv), 1e-9)
    distance = (q - 1.0) / steepness
    covered = ndtr(-distance / blur)
    edge = contrast * np.exp(-0.5 * (distance / blur) ** 2) / (np.sqrt(2.0 * np.pi) * blur)
    moved = edge / steepness
    design = np.stack(
        [
            -moved * du - along, -moved * dv - down, moved * w0 * u / q, moved * w0 * v / q, moved * w1 * v / q,
            np.ones_like(u), u, v, -covered, -edge * distance / blur,
        ],
        axis=1,
    )  # fmt: skip
    return ground + along * u + down * v - contrast * covered, design


def _without_repeated(dots: list[Dot]) -> tuple[Dot, ...]:
    """Return each dot once; both windows find most of them."""
    kept: list[Dot] = []
    places = np.zeros((0, 2))
    for dot in dots:
        if not len(places) or np.hypot(*(places - (dot.column, dot.row)).T).min() > 0.5 * dot.radius:
            kept.append(dot)
            places = np.vstack([places, [dot.column, dot.row]])
    return tuple(kept)


def _elsewhere(rejected: list[Rejected], dots: tuple[Dot, ...]) -> tuple[Rejected, ...]:
    """Return what was rejected and not found as a dot with the other window, each place once."""
    from scipy.spatial import cKDTree

    if not rejected:
        return ()
    places = np.array([[item.column, item.row] for item in rejected])
    _, first = np.unique(np.rint(places / SMALLEST_RADIUS), axis=0, return_index=True)
    if dots:
        away, _ = cKDTree([[dot.column, dot.row] for dot in dots]).query(places[first])
        first = first[away > SMALLEST_RADIUS]
    return tuple(rejected[place] for place in np.sort(first))
