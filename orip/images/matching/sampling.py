"""Grey values and gradients between the pixels of many small windows: cubic B-splines."""

from __future__ import annotations

from typing import Any

import numpy as np
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
