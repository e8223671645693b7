"""Patches of photos under affine transformations: their grid, what cubic B-splines sample there, and its partials."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

MARGIN = 2
"""Pixels at the edge of a window between which nothing is interpolated: a spline reaches as far."""


def spline_coefficients(windows: NDArray[np.uint8 | np.float32], smoothing: float) -> NDArray[np.float32]:
    """Return the coefficients of the splines through the pixels of windows.

    Parameters
    ----------
    windows : ndarray (n, rows, columns)
    smoothing : float
        Standard deviation of a Gaussian, pixels, that the windows are smoothed with before; 0: none. It makes the
        noise of interpolated values nearly the same between pixels as on them: without it matches are drawn towards
        the middle between pixels, where interpolation has averaged more noise away.

    Returns
    -------
    ndarray (n, rows, columns)
    """
    from scipy.ndimage import gaussian_filter1d, spline_filter1d

    found = windows.astype(np.float32)
    for axis in (1, 2):
        if smoothing > 0.0:
            found = gaussian_filter1d(found, smoothing, axis=axis, mode="nearest", truncate=3.5)
        found = spline_filter1d(found, order=3, axis=axis, output=np.float32, mode="mirror")
    return found


def sample(
    coefficients: NDArray[np.float32], columns: NDArray[np.float64], rows: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
    """Return values of splines and their partials by column and row.

    Parameters
    ----------
    coefficients : ndarray (n, rows, columns)
        Of `spline_coefficients`.
    columns, rows : ndarray (n, m)
        Where, in pixels from the centre of the first one; moved into the window where outside of it.

    Returns
    -------
    value, by_column, by_row : ndarray (n, m)
    """
    count, height, width = coefficients.shape
    column, x = _split(columns, width)
    row, y = _split(rows, height)
    first = (np.arange(count)[:, None] * height + row - 1) * width + column - 1
    across, across_slope = _weights(x)
    down, down_slope = _weights(y)
    flat = coefficients.reshape(-1)
    value, by_column, by_row = (np.zeros(columns.shape, dtype=np.float32) for _ in range(3))
    for j in range(4):
        line, slope = (np.zeros(columns.shape, dtype=np.float32) for _ in range(2))
        for i in range(4):
            taken = flat.take(first + (j * width + i))
            line += across[i] * taken
            slope += across_slope[i] * taken
        value += down[j] * line
        by_row += down_slope[j] * line
        by_column += down[j] * slope
    return value, by_column, by_row


def _split(places: NDArray[np.float64], size: int) -> tuple[NDArray[np.intp], NDArray[np.float32]]:
    inside = np.clip(places, 1.0, size - 2.001)
    whole = np.floor(inside)
    return whole.astype(np.intp), (inside - whole).astype(np.float32)


def _weights(t: NDArray[np.float32]) -> tuple[list[Any], list[Any]]:
    """Return the four values of the cubic B-spline at distances 1 + t, t, 1 - t, 2 - t, and their slopes."""
    s, t2 = 1 - t, t * t
    s2 = s * s
    values = [s2 * s / 6, (3 * t2 * t - 6 * t2 + 4) / 6, (3 * s2 * s - 6 * s2 + 4) / 6, t2 * t / 6]
    slopes = [-s2 / 2, (3 * t2 - 4 * t) / 2, -(3 * s2 - 4 * s) / 2, t2 / 2]
    return values, slopes


PARAMETERS = 8
"""Four of the shape, two of the position, gain and offset."""


class PatchGrid(Struct, frozen=True):
    """The grid of a square patch, row by row.

    Parameters
    ----------
    u, v : ndarray (m,)
        From the middle of the patch, to the right and down.
    weight : ndarray (m,)
        A Gaussian: what is near the middle counts more, as a surface is plane only nearby.
    side : int
    half : float
        Half the patch's width.
    """

    u: NDArray[np.float64]
    v: NDArray[np.float64]
    weight: NDArray[np.float32]
    side: int
    half: float


def patch_grid(half: int, step: float) -> PatchGrid:
    """Return the grid of 2 `half` + 1 times as many places, `step` apart."""
    places = np.arange(-half, half + 1) * step
    v, u = (part.ravel() for part in np.meshgrid(places, places, indexing="ij"))
    reach = half * step
    weight = np.exp(-(u * u + v * v) / (reach * reach)).astype(np.float32)
    return PatchGrid(u, v, weight, 2 * half + 1, reach)


class Sampled(Struct, frozen=True):
    """Patches of rays as they are sampled, brought to a mean of zero and a standard deviation of one.

    Parameters
    ----------
    value : ndarray (r, m)
    by_u, by_v : ndarray (r, m)
        Partials along the patch.
    weight : ndarray (r, m)
        Zero outside of the window.
    contrast : ndarray (r,)
        Standard deviation of the grey values.
    """

    value: NDArray[np.float32]
    by_u: NDArray[np.float32]
    by_v: NDArray[np.float32]
    weight: NDArray[np.float32]
    contrast: NDArray[np.float32]


def sample_patches(
    coefficients: NDArray[np.float32], affine: NDArray[np.float64], centre: NDArray[np.float64], grid: PatchGrid
) -> Sampled:
    """Return patches of windows.

    Parameters
    ----------
    coefficients : ndarray (r, rows, columns)
        Of `spline_coefficients`.
    affine : ndarray (r, 2, 2)
        From the patch to pixels.
    centre : ndarray (r, 2)
        Column and row of the patch's middle in the window.
    """
    columns = centre[:, :1] + affine[:, 0, :1] * grid.u + affine[:, 0, 1:] * grid.v
    rows = centre[:, 1:] + affine[:, 1, :1] * grid.u + affine[:, 1, 1:] * grid.v
    height, width = coefficients.shape[1:]
    inside = (columns >= MARGIN) & (columns <= width - 1 - MARGIN) & (rows >= MARGIN) & (rows <= height - 1 - MARGIN)
    weight = grid.weight * inside.astype(np.float32)
    value, by_column, by_row = sample(coefficients, columns, rows)
    total = np.maximum(weight.sum(axis=1, keepdims=True), 1e-6)
    value -= (weight * value).sum(axis=1, keepdims=True) / total
    contrast = np.sqrt((weight * value * value).sum(axis=1, keepdims=True) / total) + np.float32(1e-3)
    shape = affine.astype(np.float32)[..., None]
    by_u = (by_column * shape[:, 0, 0] + by_row * shape[:, 1, 0]) / contrast
    by_v = (by_column * shape[:, 0, 1] + by_row * shape[:, 1, 1]) / contrast
    return Sampled(value / contrast, by_u, by_v, weight, contrast[:, 0])


class Template(Struct, frozen=True):
    """What all photos of a point show: the mean of its patches, for each ray of the point.

    Parameters
    ----------
    value, by_u, by_v : ndarray (r, m)
    """

    value: NDArray[np.float32]
    by_u: NDArray[np.float32]
    by_v: NDArray[np.float32]


def mean_patch(sampled: Sampled, share: NDArray[np.float32], point: NDArray[np.intp]) -> Template:
    """Return the mean of the patches of each point.

    Parameters
    ----------
    share : ndarray (r,)
        Weights of the rays in the mean.
    point : ndarray (r,)
        Ascending, from 0 without gaps.
    """
    first = np.flatnonzero(np.diff(point, prepend=-1))
    total = np.maximum(np.add.reduceat(share, first), np.float32(1e-9))[:, None]

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        found = (np.add.reduceat(values * share[:, None], first, axis=0) / total)[point]
        return np.asarray(found, dtype=np.float32)

    return Template(mean(sampled.value), mean(sampled.by_u), mean(sampled.by_v))


def partials(template: Template, affine: NDArray[np.float64], grid: PatchGrid) -> NDArray[np.float32]:
    """Return the partials of the grey values by the parameters of the rays.

    The parameters are the elements of the affine transformation, times half the patch's width, row by row; the
    position, pixels; gain and offset.

    Returns
    -------
    ndarray (r, 8, m)
    """
    inverse = np.linalg.inv(affine).astype(np.float32)[..., None]
    by_x = inverse[:, 0, 0] * template.by_u + inverse[:, 1, 0] * template.by_v
    by_y = inverse[:, 0, 1] * template.by_u + inverse[:, 1, 1] * template.by_v
    u, v = ((part / grid.half).astype(np.float32) for part in (grid.u, grid.v))
    found = np.empty((len(affine), PARAMETERS, len(u)), dtype=np.float32)
    for row, values in enumerate((by_x * u, by_x * v, by_y * u, by_y * v, by_x, by_y)):
        found[:, row] = values
    found[:, 6] = -template.value
    found[:, 7] = -1.0
    return found
