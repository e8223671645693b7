"""Points, photos, lines and areas as GeoJSON (RFC 7946): longitude and latitude on WGS 84, ellipsoidal heights.

A project without a coordinate reference system has no longitude and latitude: its own coordinates are written, and a
member ``coordinates`` and a note say so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.gis.layers import Layer, Shapes, photo_layer, point_kinds, point_layer, shapes
from orip.records.exchanged import ExchangedProject

_GEOMETRIES = {"LINESTRING": "LineString", "POLYGON": "Polygon"}
_DIGITS = 10
"""Decimals of a degree: 0.01 mm."""

NOT_GEOGRAPHIC = "those of the project, which has no crs: not longitude and latitude"

_Conversion = Callable[[FloatArray], FloatArray]


def write_geojson(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one collection of features, each with the name of its layer.

    Raises
    ------
    InputError
        If the project's system is not known, or has no longitude and latitude at its places.
    """
    convert = _own if project.crs is None else _to_wgs84(project.crs)
    said = {} if project.crs is not None else {"coordinates": NOT_GEOGRAPHIC}
    head = {"type": "FeatureCollection", "name": project.name, **said, "project_crs": project.crs}
    lines = (json.dumps(feature, ensure_ascii=False, allow_nan=False) for feature in _all(project, convert))
    features = ",\n".join(lines)
    text = f'{json.dumps(head, ensure_ascii=False)[:-1]}, "features": [\n{features}\n]}}\n'
    return {"orip.geojson": text.encode()}


def _all(project: ExchangedProject, convert: _Conversion) -> Iterator[dict[str, object]]:
    kinds = point_kinds(project)
    rays = np.bincount(project.rays.point[project.rays.is_active], minlength=len(kinds)).tolist()
    more = [{"kind": kind, "rays": count} for kind, count in zip(kinds, rays, strict=True)]
    yield from _places(point_layer(project), convert, more)
    photos = photo_layer(project)
    yield from _places(photos, convert, [{}] * len(photos.names))
    for drawn in shapes(project):
        yield from _drawn(drawn, convert)


def _places(layer: Layer, convert: _Conversion, more: list[dict[str, object]]) -> Iterator[dict[str, object]]:
    places = _listed(convert(layer.values[:, :3])) if len(layer.names) else []
    for name, place, row, others in zip(layer.names, places, layer.values.tolist(), more, strict=True):
        numbers = {column: _known(value) for column, value in zip(layer.columns, row, strict=True)}
        yield _feature(layer.name, "Point", place, {"name": name, **others, **numbers})


def _drawn(drawn: Shapes, convert: _Conversion) -> Iterator[dict[str, object]]:
    if not drawn.places:
        return
    borders = np.cumsum([len(place) for place in drawn.places])[:-1]
    everywhere = np.concatenate(drawn.places)
    if not drawn.has_height:
        everywhere = np.column_stack([everywhere, np.zeros(len(everywhere))])
    converted = np.split(convert(everywhere)[:, : 3 if drawn.has_height else 2], borders)
    numbers = {name: values.tolist() for name, values in drawn.numbers.items()}
    for n, place in enumerate(converted):
        # RFC 7946: the outer ring of a polygon runs counter-clockwise
        ring = place if drawn.geometry == "LINESTRING" or _area(place) > 0.0 else place[::-1]
        coordinates = _listed(ring) if drawn.geometry == "LINESTRING" else [_listed(ring)]
        properties = {name: words[n] for name, words in drawn.texts.items()}
        yield _feature(
            drawn.name,
            _GEOMETRIES[drawn.geometry],
            coordinates,
            {**properties, **{name: _known(values[n]) for name, values in numbers.items()}},
        )


def _feature(layer: str, kind: str, coordinates: object, properties: Mapping[str, object]) -> dict[str, object]:
    return {
        "type": "Feature",
        "geometry": {"type": kind, "coordinates": coordinates},
        "properties": {"layer": layer, **properties},
    }


def _area(ring: FloatArray) -> float:
    """Return twice the area (signed) of a closed ring (k, 2 or 3)."""
    x, y = (ring[:, :2] - ring[0, :2]).T
    return float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def _own(xyz: FloatArray) -> FloatArray:
    return xyz


def _to_wgs84(crs: str) -> _Conversion:
    from pyproj import CRS, Transformer
    from pyproj.exceptions import CRSError, ProjError

    try:
        whole = CRS.from_user_input(crs)
        metres = 1.0
        if len(whole.axis_info) == 2:  # heights are in the unit of the map then, above the ellipsoid
            metres = whole.axis_info[0].unit_conversion_factor
            whole = whole.to_3d()
        transformer = Transformer.from_crs(whole, CRS.from_epsg(4979), always_xy=True)
    except (CRSError, ProjError) as fault:
        message = f"crs {crs}: {fault}; correct it in orip.toml"
        raise InputError.single(message) from fault

    def convert(xyz: FloatArray) -> FloatArray:
        found = np.column_stack(transformer.transform(xyz[:, 0], xyz[:, 1], xyz[:, 2] * metres)).astype(np.float64)
        if not np.isfinite(found).all():
            x, y, _ = xyz[int(np.flatnonzero(~np.isfinite(found).all(axis=1))[0])].tolist()
            message = f"crs {crs} has no longitude and latitude at {x:.3f}, {y:.3f}; check crs in orip.toml"
            raise InputError.single(message)
        return found

    return convert


def _listed(places: FloatArray) -> list[list[float]]:
    return np.round(places, _DIGITS).tolist()  # type: ignore[no-any-return]


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
