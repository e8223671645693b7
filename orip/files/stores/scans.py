"""The columns that say that film was scanned: photos and templates both have them."""

from __future__ import annotations

from typing import Any, Literal, get_args

from orip.files.stores.store import Row
from orip.files.stores.table import all_or_none, real, text
from orip.records.photo import Scan

SCAN_COLUMNS = (
    real("scan_pixel_x", "none", "scan_pixel_x > 0"),
    real("scan_pixel_y", "none", "scan_pixel_y > 0"),
    text("scan_origin", get_args(Literal["corner", "centre"]), optional=True),
)
SCAN_CHECK = all_or_none(*(column.name for column in SCAN_COLUMNS))


def scan_values(scan: Scan | None) -> Row:
    """Return the values of `SCAN_COLUMNS`."""
    return (*scan.pixel, scan.origin) if scan else (None, None, None)


def scan_of(pixel_x: float | None, pixel_y: float | None, origin: Any) -> Scan | None:
    """Return the scan that the values of `SCAN_COLUMNS` describe."""
    if pixel_x is None or pixel_y is None:
        return None
    return Scan((pixel_x, pixel_y), origin)
