"""Eastings and northings of one zone or map grid in another: UTM, and Gauss-Krüger with the zone as first digit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.arrays import FloatArray

_SHORT, _LONG = (1e4, 1e6), (1e6, 6e6)
"""Metres: eastings of UTM, and of Gauss-Krüger with its zones 1 to 5."""

_ZONE, _MIDDLE = 1e6, 5e5
"""Metres: what a zone of Gauss-Krüger adds to the easting, and the easting of any central meridian."""

_UTM_ZONES = 60

_NEXT = (1, -1, 2, -2)
"""Zones of UTM that an area is given in by mistake, from its own."""

_DHDN = "+ellps=bessel +towgs84=598.1,73.7,418.2,0.202,0.045,-2.455,6.7"
"""Datum of the German system; those of its neighbours differ by some hundred metres."""


def readings_in_another_grid(xy: FloatArray, others: FloatArray) -> Iterator[tuple[FloatArray, str, str]]:
    """Yield coordinates as they are in a grid that others may have, and what both then are.

    Parameters
    ----------
    xy, others : arrays (n, 2), (m, 2)
        Easting and northing, metres.

    Yields
    ------
    array (n, 2), str, str
        `xy` in the other grid; what `xy` is given in, and what the others are.
    """
    own, other = (float(np.median(of[:, 0])) for of in (xy, others))
    if _is_long(own) and _SHORT[0] < other < _SHORT[1]:
        yield from _in_utm(xy, int(own // _ZONE))
    elif _is_long(own) and _is_long(other) and own // _ZONE != other // _ZONE:
        zones = int(own // _ZONE), int(other // _ZONE)
        for width in (3, 6):
            source, target = (_gauss_krueger(zone, width) for zone in zones)
            own_zone, other_zone = (f"Gauss-Krüger coordinates of zone {zone}" for zone in zones)
            yield _transformed(xy, source, target), own_zone, other_zone
    elif all(_SHORT[0] < easting < _SHORT[1] for easting in (own, other)):
        for step in _NEXT:
            for side in ("", " +south"):
                source, target = (f"+proj=utm +zone={zone} +ellps=GRS80{side}" for zone in (30, 30 + step))
                sides = ("western", "eastern") if step > 0 else ("eastern", "western")
                own_zone, other_zone = (f"UTM coordinates of the {side} of two zones" for side in sides)
                yield _transformed(xy, source, target), own_zone, other_zone


def _is_long(easting: float) -> bool:
    return bool(_LONG[0] < easting < _LONG[1] and abs(easting % _ZONE - _MIDDLE) < 0.8 * _MIDDLE)


def _gauss_krueger(zone: int, width: int) -> str:
    meridian = 3 * zone if width == 3 else 6 * zone - 3
    return f"+proj=tmerc +lon_0={meridian} +k=1 +x_0={_MIDDLE + zone * _ZONE} {_DHDN}"


def _in_utm(xy: FloatArray, zone: int) -> Iterator[tuple[FloatArray, str, str]]:
    for width in (3, 6):
        source = _gauss_krueger(zone, width)
        longitude = float(_transformed(xy[:1], source, "+proj=longlat +ellps=GRS80")[0, 0])
        if not np.isfinite(longitude):
            continue
        natural = int((longitude + 180.0) // 6.0)
        for utm in ((natural + step) % _UTM_ZONES + 1 for step in (0, -1, 1)):
            target = f"+proj=utm +zone={utm} +ellps=GRS80"
            yield (
                _transformed(xy, source, target),
                f"Gauss-Krüger coordinates of zone {zone}",
                f"UTM coordinates of zone {utm}",
            )


def _transformed(xy: FloatArray, source: str, target: str) -> FloatArray:
    """Return coordinates (n, 2) in another system of PROJ, infinite where it has no such place."""
    import pyproj

    transformer = pyproj.Transformer.from_crs(f"{source} +type=crs", f"{target} +type=crs", always_xy=True)
    return np.column_stack(transformer.transform(xy[:, 0], xy[:, 1])).astype(np.float64)
