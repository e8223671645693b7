"""Restituted features as drawings for GIS and CAD: a layer for points, lines and areas each, or for each code."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.files.maps.geopackage import geopackage
from orip.files.maps.layers import Shapes, collection, drawing, drawn_features, labelled_point, polyline
from orip.geometry.other_crs import to_wgs84
from orip.records.measurement import FeatureKind
from orip.restitution.feature import Feature

_TEXT_OF_EXTENT = 0.005
_COLOURS = {"POINT": 1, "LINE": 7, "AREA": 3}
"""Red, white, green."""


def layers(features: Sequence[Feature]) -> Iterator[Shapes]:
    """Yield points, lines and areas, as far as there are any, with codes, names and standard deviations.

    Of a point the standard deviations are its own, of lines and areas the largest of a vertex.
    """
    kinds: tuple[tuple[FeatureKind, str], ...] = (("POINT", "points"), ("LINE", "lines"), ("AREA", "areas"))
    for kind, title in kinds:
        mine = [one for one in features if one.kind == kind]
        if mine:
            yield _points(mine, title) if kind == "POINT" else _outlines(mine, title)


def _points(features: Sequence[Feature], title: str) -> Shapes:
    each = [(feature, vertex) for feature in features for vertex in feature.vertices]
    sd = np.array([vertex.sd or (np.nan,) * 3 for _, vertex in each])
    return Shapes(
        title,
        "POINT",
        tuple(np.array([vertex.xyz]) for _, vertex in each),
        {"code": tuple(feature.code for feature, _ in each), "name": tuple(feature.name for feature, _ in each)},
        _columns(sd),
    )


def _outlines(features: Sequence[Feature], title: str) -> Shapes:
    sd = np.array([_largest(feature) for feature in features])
    return Shapes(
        title,
        "POLYGON" if features[0].kind == "AREA" else "LINESTRING",
        tuple(feature.outline() for feature in features),
        {"code": tuple(feature.code for feature in features), "name": tuple(feature.name for feature in features)},
        _columns(sd),
    )


def _columns(sd: FloatArray) -> Mapping[str, FloatArray]:
    return dict(zip(("sX", "sY", "sZ"), sd.T, strict=True))


def _largest(feature: Feature) -> tuple[float, ...]:
    known = [vertex.sd for vertex in feature.vertices if vertex.sd is not None]
    return tuple(np.max(known, axis=0).tolist()) if known else (np.nan,) * 3


def geojson_bytes(features: Sequence[Feature], name: str, crs: str | None) -> bytes:
    """Return a collection of features, in longitude and latitude where the project has a crs."""
    convert = to_wgs84(crs)
    return collection(name, crs, (one for layer in layers(features) for one in drawn_features(layer, convert)))


def geopackage_bytes(features: Sequence[Feature], _name: str, crs: str | None) -> bytes:
    """Return a GeoPackage with a layer for points, lines and areas each."""
    return geopackage(crs, layers(features))


def dxf_bytes(features: Sequence[Feature], _name: str, _crs: str | None) -> bytes:
    """Return a drawing of release 12 with a layer for each code; points have their names beside them."""
    colours = {_layer(feature): _COLOURS[feature.kind] for feature in features}
    places = np.vstack([feature.coordinates() for feature in features]) if features else np.zeros((1, 3))
    height = _TEXT_OF_EXTENT * (float(np.ptp(places[:, :2], axis=0).max()) or 1.0)
    entities: list[tuple[int, object]] = []
    for feature in features:
        layer, xyz = _layer(feature), feature.coordinates()
        if feature.kind == "POINT":
            for place in xyz.tolist():
                entities += labelled_point(layer, place, feature.name, height)
        else:
            entities += polyline(layer, xyz, closed=feature.kind == "AREA")
    return drawing(colours, entities)


def _layer(feature: Feature) -> str:
    """Return a code in the letters that release 12 allows for layers: others as their numbers."""
    return re.sub(r"[^A-Z0-9_$-]", lambda found: f"_{ord(found[0]):X}", feature.code.upper())


FORMATS: Mapping[str, Callable[[Sequence[Feature], str, str | None], bytes]] = {
    "geojson": geojson_bytes,
    "geopackage": geopackage_bytes,
    "dxf": dxf_bytes,
}
"""By name: functions of features, the project's name and its crs."""
