"""Heights of a terrain model out of a GeoTIFF, or another raster that rasterio reads."""

from __future__ import annotations

from pathlib import Path
from warnings import catch_warnings

import numpy as np

from orip.errors import InputError, UsageError
from orip.files.text.lines import read_bytes
from orip.records.ground import HeightGrid

_FEWEST = 4
"""Rows and columns that heights between them are interpolated from."""


def read_height_raster(path: Path, shown: str) -> HeightGrid:
    """Return the first band of a raster.

    Raises
    ------
    InputError
        If it cannot be read, is smaller than 4 by 4 pixels, has no place on the ground or no height at all.
    UsageError
        Without rasterio.
    """
    try:
        import rasterio
    except ImportError:
        message = "a GeoTIFF is read by rasterio: pip install 'orip[terrain]'"
        raise UsageError(message) from None
    data, complaints = read_bytes(path, shown)
    if data is None:
        raise InputError(complaints)
    try:
        # what has no place is said below
        with catch_warnings(action="ignore"), rasterio.MemoryFile(data) as memory, memory.open() as source:
            band = source.read(1, masked=True)
            kind = np.promote_types(band.dtype, np.float32)
            heights = band.astype(kind).filled(np.nan)
            if (scale := (source.scales[0], source.offsets[0])) != (1.0, 0.0):
                heights = heights * scale[0] + scale[1]
            a, b, c, d, e, f = tuple(~source.transform)[:6]
            is_placed = not source.transform.is_identity
            crs = source.crs.to_wkt() if source.crs else None
    except rasterio.errors.RasterioError:
        message = "this is no raster that can be read; give a GeoTIFF of heights"
        raise InputError.single(message, shown) from None
    if not is_placed:
        message = "the raster does not say where it lies on the ground; give a GeoTIFF with its geotransformation"
        raise InputError.single(message, shown)
    if min(heights.shape) < _FEWEST or not np.isfinite(heights).any():
        rows, columns = heights.shape
        message = (
            f"the raster has {columns} by {rows} pixels, {np.count_nonzero(np.isfinite(heights))} of them with a "
            f"height; give a GeoTIFF of heights with {_FEWEST} by {_FEWEST} pixels at least"
        )
        raise InputError.single(message, shown)
    return HeightGrid(heights, (a, b, c, d, e, f), crs)
