"""GeoJSON: features of layers with longitude, latitude and height, or the coordinates of a project without a crs.

A project without a coordinate reference system has no longitude and latitude: its own coordinates are written, and a
member ``coordinates`` and a note say so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np

from orip.arrays import FloatArray
from orip.files.maps.layers import Shapes

_GEOMETRIES = {"POINT": "Point", "LINESTRING": "LineString", "POLYGON": "Polygon"}
_DIGITS = 10
"""Decimals of a degree: 0.01 mm."""

NOT_GEOGRAPHIC = "those of the project, which has no crs: not longitude and latitude"

Conversion = Callable[[FloatArray], FloatArray]


def collection(name: str, crs: str | None, features: Iterable[Mapping[str, object]]) -> bytes:
    """Return a collection of features.

    Parameters
    ----------
    crs : str or None
        Of the project; None: the coordinates are its own.
    features : iterable of mappings
        As `feature` gives them.
    """
    said = {} if crs is not None else {"coordinates": NOT_GEOGRAPHIC}
    head = {"type": "FeatureCollection", "name": name, **said, "project_crs": crs}
    lines = ",\n".join(json.dumps(one, ensure_ascii=False, allow_nan=False) for one in features)
    return f'{json.dumps(head, ensure_ascii=False)[:-1]}, "features": [\n{lines}\n]}}\n'.encode()


def drawn_features(drawn: Shapes, convert: Conversion) -> Iterator[dict[str, object]]:
    """Yield a layer's points, lines or areas; `convert` takes places (n, 3) to longitude, latitude and height."""
    if not drawn.places:
        return
    borders = np.cumsum([len(place) for place in drawn.places])[:-1]
    everywhere = np.concatenate(drawn.places)
    if not drawn.has_height:
        everywhere = np.column_stack([everywhere, np.zeros(len(everywhere))])
    converted = np.split(convert(everywhere)[:, : 3 if drawn.has_height else 2], borders)
    numbers = {name: values.tolist() for name, values in drawn.numbers.items()}
    for n, place in enumerate(converted):
        properties = {name: words[n] for name, words in drawn.texts.items()}
        yield feature(
            drawn.name,
            _GEOMETRIES[drawn.geometry],
            _coordinates(drawn.geometry, place),
            {**properties, **{name: finite_or_none(values[n]) for name, values in numbers.items()}},
        )


def _coordinates(geometry: str, place: FloatArray) -> object:
    if geometry == "POINT":
        return listed(place)[0]
    if geometry == "LINESTRING":
        return listed(place)
    # RFC 7946: the outer ring of a polygon runs counter-clockwise
    return [listed(place if _area(place) > 0.0 else place[::-1])]


def feature(layer: str, kind: str, coordinates: object, properties: Mapping[str, object]) -> dict[str, object]:
    """Return one feature, with the name of its layer among its properties."""
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"layer": layer, **properties},
    }


def _area(ring: FloatArray) -> float:
    """Return twice the area (signed) of a closed ring (k, 2 or 3)."""
    x, y = (ring[:, :2] - ring[0, :2]).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def listed(places: FloatArray) -> list[list[float]]:
    """Return places (n, 2 or 3) as they are written."""
    return np.round(places, _DIGITS).tolist()  # type: ignore[no-any-return]


def finite_or_none(value: float) -> float | None:
    """Return a number, or None for what is not known."""
    return value if math.isfinite(value) else None
