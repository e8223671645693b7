"""Heights and slopes of a terrain model, and whether its system is that of the project.

Between the pixels heights are interpolated by cubic convolution (Keys 1981, IEEE Transactions on Acoustics, Speech and
Signal Processing 29), whose slopes have no steps: exact for a plane, and for second-degree surfaces away from the
border. Beyond the outermost middles of pixels the surface goes on straight.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.records.ground import HeightGrid

if TYPE_CHECKING:
    from pyproj import CRS

_NODES = 4

_ROUNDING = 1e-9
"""Part of a pixel beyond the border up to which a place is on it."""


class Surface(NamedTuple):
    """Heights (n,), slopes (n, 2) along X and Y, and which places have them (n,); zero elsewhere."""

    height: FloatArray
    slope: FloatArray
    known: BoolArray


def surface_at(grid: HeightGrid, places: FloatArray) -> Surface:
    """Return the terrain at places (n, 2), X and Y; none outside the raster, and within two pixels of a hole."""
    a, b, c, d, e, f = grid.to_pixels
    # pixels are areas: a height is that of the middle of its pixel
    column = a * places[:, 0] + b * places[:, 1] + c - 0.5
    row = d * places[:, 0] + e * places[:, 1] + f - 0.5
    inside = _is_inside(column, grid.heights.shape[1]) & _is_inside(row, grid.heights.shape[0])
    first_column, across, by_column = _weights(np.where(inside, column, 0.0), grid.heights.shape[1])
    first_row, down, by_row = _weights(np.where(inside, row, 0.0), grid.heights.shape[0])
    nodes = np.arange(_NODES)
    around = grid.heights[first_row[:, None, None] + nodes[:, None], first_column[:, None, None] + nodes]
    around = around.astype(np.float64)
    known = inside & np.isfinite(around).all(axis=(1, 2))
    around[~known] = 0.0
    height = np.einsum("ni,nij,nj->n", down, around, across)
    along_column = np.einsum("ni,nij,nj->n", down, around, by_column)
    along_row = np.einsum("ni,nij,nj->n", by_row, around, across)
    slope = np.stack([a * along_column + d * along_row, b * along_column + e * along_row], axis=1)
    return Surface(height, slope, known)


def _is_inside(at: FloatArray, size: int) -> BoolArray:
    return np.asarray((at >= -0.5 - _ROUNDING) & (at <= size - 0.5 + _ROUNDING))


def _weights(at: FloatArray, size: int) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the first of four nodes (n,), their weights (n, 4), and the derivatives of these by the place."""
    left = np.clip(np.floor(at), -1, size - 1).astype(np.int64)
    t = at - left
    keys = [((-0.5 * t + 1.0) * t - 0.5) * t, (1.5 * t - 2.5) * t * t + 1.0,
            ((-1.5 * t + 2.0) * t + 0.5) * t, (0.5 * t - 0.5) * t * t]  # fmt: skip
    slopes = [(-1.5 * t + 2.0) * t - 0.5, (4.5 * t - 5.0) * t, (-4.5 * t + 4.0) * t + 0.5, (1.5 * t - 1.0) * t]
    first, rows = np.clip(left - 1, 0, size - _NODES), np.arange(len(at))
    found = np.zeros((2, len(at), _NODES))
    for place in range(_NODES):
        node = left - 1 + place
        within = np.clip(node, 0, size - 1)
        beyond = node - within  # a node outside lies on the straight line through the last two
        for one, weight in zip(found, (keys[place], slopes[place]), strict=True):
            one[rows, within - first] += weight * (1 + np.abs(beyond))
            one[rows, within - np.sign(beyond) - first] -= weight * np.abs(beyond)
    return first, found[0], found[1]


def other_system(grid: HeightGrid, crs: str | None) -> str | None:
    """Return how the system of a terrain model differs from the project's; None: it does not, or one is not known."""
    if grid.crs is None or crs is None:
        return None
    from pyproj import CRS

    own, wanted = CRS.from_wkt(grid.crs), CRS.from_user_input(crs)
    if not _plan(own).equals(_plan(wanted), ignore_axis_order=True):
        return f"its coordinates are in {_plan(own).name}, those of the project in {_plan(wanted).name}"
    heights = _heights(own)
    if heights is not None and heights != _heights(wanted):
        return f"its heights are in {heights}, those of the project {_in_words(_heights(wanted))}"
    return None


def _plan(crs: CRS) -> CRS:
    return (crs.sub_crs_list[0] if crs.is_compound else crs).to_2d()


def _heights(crs: CRS) -> str | None:
    return crs.sub_crs_list[1].name if crs.is_compound else None


def _in_words(heights: str | None) -> str:
    return "above the ellipsoid" if heights is None else f"in {heights}"
