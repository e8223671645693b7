"""Results for GIS and CAD: tables, GeoPackage, DXF. Coordinates are those of the project."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from orip.exchange.gis_layers import photo_layer, point_kinds, point_layer, shapes
from orip.files.maps.dxf import drawing, labelled_point, line, polyline
from orip.files.maps.geojson import Conversion, collection, drawn_features, feature, finite_or_none, listed
from orip.files.maps.geopackage import geopackage
from orip.files.maps.layers import Layer, Shapes
from orip.geometry.other_crs import to_wgs84
from orip.records.exchanged import ExchangedProject


def write_tables(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return points.csv and photos.csv."""
    return {f"{layer.name}.csv": _table(layer) for layer in (point_layer(project), photo_layer(project))}


def _table(layer: Layer) -> bytes:
    stream = io.StringIO()
    rows = csv.writer(stream, lineterminator="\n")
    rows.writerow(["name", *layer.columns])
    for name, values in zip(layer.names, layer.values.tolist(), strict=True):
        rows.writerow([name, *("" if math.isnan(value) else repr(value) for value in values)])
    return stream.getvalue().encode("utf-8")


_TEXT_OF_EXTENT = 0.005
_COLOURS = {"error": 1, "footprints": 4, "residual": 2, "rays": 8}
"""By the first word of a layer's name: red, cyan, yellow, grey."""


def write_dxf(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one drawing; the names of layers say how much larger ellipses and vectors are drawn."""
    points, photos = point_layer(project), photo_layer(project)
    drawn = shapes(project)
    extent = max((float(values.max() - values.min()) for values in points.values[:, :2].T if values.size), default=1.0)
    colours = {"POINTS": 7, "PHOTOS": 5, **{_layer(one): _COLOURS[one.name.split("_")[0]] for one in drawn}}
    height = _TEXT_OF_EXTENT * (extent or 1.0)
    entities: list[tuple[int, object]] = []
    for layer, labelled in (("POINTS", points), ("PHOTOS", photos)):
        for name, row in zip(labelled.names, labelled.values[:, :3].tolist(), strict=True):
            entities += labelled_point(layer, row, name, height)
    for one in drawn:
        for place in one.places:
            is_line = one.geometry == "LINESTRING"
            entities += line(_layer(one), place) if is_line else polyline(_layer(one), place[:-1], closed=True)
    return {"orip.dxf": drawing(colours, entities)}


def _layer(drawn: Shapes) -> str:
    """Return a name in the letters that release 12 allows for layers."""
    return drawn.name.upper().replace("ERROR_", "").replace(".", "_").replace("+", "")


def write_geojson(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one collection of features, each with the name of its layer.

    Raises
    ------
    InputError
        If the project's system is not known, or has no longitude and latitude at its places.
    """
    convert = to_wgs84(project.crs)
    return {"orip.geojson": collection(project.name, project.crs, _all(project, convert))}


def _all(project: ExchangedProject, convert: Conversion) -> Iterator[dict[str, object]]:
    kinds = point_kinds(project)
    rays = np.bincount(project.rays.point[project.rays.is_active], minlength=len(kinds)).tolist()
    more = [{"kind": kind, "rays": count} for kind, count in zip(kinds, rays, strict=True)]
    yield from _places(point_layer(project), convert, more)
    photos = photo_layer(project)
    yield from _places(photos, convert, [{}] * len(photos.names))
    for drawn in shapes(project):
        yield from drawn_features(drawn, convert)


def _places(layer: Layer, convert: Conversion, more: list[dict[str, object]]) -> Iterator[dict[str, object]]:
    places = listed(convert(layer.values[:, :3])) if len(layer.names) else []
    for name, place, row, others in zip(layer.names, places, layer.values.tolist(), more, strict=True):
        numbers = {column: finite_or_none(value) for column, value in zip(layer.columns, row, strict=True)}
        yield feature(layer.name, "Point", place, {"name": name, **others, **numbers})


def write_geopackage(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one file with a layer for all of a kind; names say how much larger ellipses and vectors are drawn."""
    layers: tuple[Layer | Shapes, ...] = (point_layer(project), photo_layer(project), *shapes(project))
    return {"orip.gpkg": geopackage(project.crs, layers)}
