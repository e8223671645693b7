"""Heights of a vertical system to heights above the ellipsoid, and the refusal where that cannot be done.

Where a geoid grid is missing PROJ silently leaves heights unchanged, even when asked for the best transformation only.
Only a transformation group tells which transformation would be possible with all grids, and which grids are installed.
"""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

from orip.errors import InputError
from orip.wording import agreeing

if TYPE_CHECKING:
    import pyproj
    from pyproj.transformer import TransformerGroup

_AROUND_PLACE = 0.1
"""Degrees around the place in which a transformation must be valid: the size of a block."""

WITHOUT_HEIGHTS = (
    "Else name other heights, or the projected crs alone if Z may be taken as height above the ellipsoid "
    "(10 m of geoid height then change lengths by 1.6 mm per km)"
)
"""What to do about heights that cannot be had."""


def heights_to_ellipsoid(
    whole: pyproj.CRS, spatial: pyproj.CRS, shown: str, longitude: float, latitude: float
) -> pyproj.Transformer:
    """Return the best transformation of a compound system to ellipsoidal coordinates.

    Parameters
    ----------
    whole : pyproj.CRS
        Compound: projected and vertical.
    spatial : pyproj.CRS
        Longitude, latitude and height on the datum of its projected part.
    shown : str
        What the user calls it.
    longitude, latitude : float
        From Greenwich, degrees: the place that counts.

    Raises
    ------
    InputError
        If the best transformation lacks a grid, or there is none but a "ballpark" one, which leaves heights unchanged.
    """
    from pyproj.transformer import AreaOfInterest, TransformerGroup

    area = AreaOfInterest(
        max(longitude - _AROUND_PLACE, -180.0),
        max(latitude - _AROUND_PLACE, -90.0),
        min(longitude + _AROUND_PLACE, 180.0),
        min(latitude + _AROUND_PLACE, 90.0),
    )
    with warnings.catch_warnings():
        # said as an error below
        warnings.filterwarnings("ignore", message="Best transformation is not available")
        group = TransformerGroup(whole, spatial, always_xy=True, allow_ballpark=False, area_of_interest=area)
    if not group.best_available or not group.transformers:
        raise InputError.single(_refusal(group, shown, whole.sub_crs_list[1].name if whole.is_compound else whole.name))
    return group.transformers[0]


def _refusal(group: TransformerGroup, shown: str, heights: str) -> str:
    """Return what to install for the best transformation that PROJ knows of."""
    # documented there, but not in its __all__
    from pyproj.datadir import get_user_data_dir  # type: ignore[attr-defined]

    start = f"crs {shown}: Z in {heights} cannot be taken to the ellipsoid:"
    best = group.unavailable_operations[:1]
    missing = [grid for operation in best for grid in operation.grids if not grid.available]
    if not missing:
        return f"{start} PROJ knows no transformation for it at this place. {WITHOUT_HEIGHTS}"
    steps = [
        f"run 'pyproj sync --file {grid.short_name}'"
        if grid.url and grid.direct_download
        else f"get {grid.short_name} from its publisher and copy it into {get_user_data_dir()}"
        for grid in missing
    ]
    names = ", ".join(grid.short_name for grid in missing)
    what = f"{agreeing(len(missing), 'grid')} {names} {agreeing(len(missing), 'is', 'are')}"
    return (
        f"{start} the {what} not installed, and PROJ would silently leave heights unchanged. "
        f"To install, {' and '.join(steps)}. {WITHOUT_HEIGHTS}"
    )
