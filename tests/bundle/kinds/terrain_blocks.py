"""Blocks whose points lie on a terrain model, but for errors of its heights of the a-priori size."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from bundle.figure_blocks import figure_block
from support.synthetic_block import SyntheticBlock

from orip.bundle.kinds.terrain_height import with_terrain_heights
from orip.geometry.height_grid import surface_at
from orip.records.ground import HeightGrid, Terrain, TerrainModel
from orip.structs import replace

HEIGHT_ERROR = 0.004
PIXEL = 0.5


def hills() -> HeightGrid:
    """Return heights from -2 to 2 with slopes up to 0.9, in pixels of half a unit from (-12, 10) on."""
    column, row = np.meshgrid(np.arange(48.0), np.arange(40.0))
    x, y = -12.0 + PIXEL * (column + 0.5), 10.0 - PIXEL * (row + 0.5)
    heights = 1.2 * np.sin(0.7 * x) + 0.8 * np.cos(0.5 * y + 0.2 * x)
    return HeightGrid(heights, (1.0 / PIXEL, 0.0, 24.0, 0.0, -1.0 / PIXEL, 20.0))


def terrain_block(
    run: int, *, noise: bool = True, wrong: Mapping[int, float] | None = None, shift: float = 0.0,
    error: float = HEIGHT_ERROR, **settings: object,
) -> SyntheticBlock:  # fmt: skip
    """Return the block of eight convergent photos, its tie points on hills but for the errors of their heights.

    Parameters
    ----------
    run : int
        Seed of the errors.
    noise : bool
    wrong : mapping
        By the number of a point, what it is above its place on the terrain.
    shift : float
        What the whole model is too low.
    error : float
        A-priori error of the heights; their standard deviation is `HEIGHT_ERROR`.
    settings
        Of the bundle adjustment.
    """
    grid, off = hills(), HEIGHT_ERROR * np.random.default_rng([11, run]).normal(size=24) * noise
    for row, size in (wrong or {}).items():
        off[row] += size

    def on_hills(points: np.ndarray) -> np.ndarray:
        return np.column_stack([points[:, :2], surface_at(grid, points[:, :2]).height + off])

    made = figure_block(run, (), noise=noise, moved=on_hills, **settings)
    model = TerrainModel(Terrain("DTM", "dtm.tif", error), replace(grid, heights=grid.heights - shift))
    block, warnings = with_terrain_heights(replace(made.block, terrains=(model,)))
    assert not warnings
    return replace(made, block=block)
