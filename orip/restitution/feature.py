"""Restituted points, lines and areas, how vertices snap to those there, and features as text (.GEO) and drawings."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint
from orip.files.log.stereo import lines_by_feature, read_header, repeated_features
from orip.files.maps.layers import Shapes, collection, drawing, drawn_features, geopackage, labelled_point, polyline
from orip.files.text.lines import FieldReader, field_lines, read_lines
from orip.files.text.shown import Parsed
from orip.geometry.other_crs import to_wgs84
from orip.records.measurement import LEAST_VERTICES, FeatureKind
from orip.records.names import record_key
from orip.structs import replace

Triple = tuple[float, float, float]


class Stereo(NamedTuple):
    """Where a vertex was measured: left and right photo, and the y-parallax that it left, mm in the photo."""

    left: str
    right: str
    y_parallax: float


class Vertex(Struct, frozen=True):
    """A restituted vertex.

    Parameters
    ----------
    xyz : tuple (X, Y, Z)
        Ground units, in the project.
    sd : tuple (sX, sY, sZ) or None
        Standard deviations, ground units; None: not known.
    stereo : Stereo or None
        None: it was not measured in photos.
    """

    xyz: Triple
    sd: Triple | None = None
    stereo: Stereo | None = None


class Feature(Struct, frozen=True):
    """A point, line or area; of a point the vertices are points of one name, of an area its outline, not closed.

    Parameters
    ----------
    kind : {"POINT", "LINE", "AREA"}
    code, name : str
        Together they are unique in a file.
    lines : tuple (first, last)
        Where it stands in its file; zeros: not yet.
    """

    kind: FeatureKind
    code: str
    name: str
    vertices: tuple[Vertex, ...]
    lines: tuple[int, int] = (0, 0)

    @property
    def key(self) -> tuple[str, str]:
        """Return what the feature is known by."""
        return record_key(self.code), self.name

    def coordinates(self) -> FloatArray:
        """Return the vertices (n, 3)."""
        return np.array([vertex.xyz for vertex in self.vertices], dtype=np.float64).reshape(-1, 3)

    def outline(self) -> FloatArray:
        """Return the vertices (n, 3), those of an area closed."""
        xyz = self.coordinates()
        return np.vstack([xyz, xyz[:1]]) if self.kind == "AREA" else xyz


def length_of(feature: Feature) -> float:
    """Return the length in space of a line or of the outline of an area, ground units; 0 of a point."""
    if feature.kind == "POINT":
        return 0.0
    return float(np.linalg.norm(np.diff(feature.outline(), axis=0), axis=1).sum())


def area_of(feature: Feature) -> float:
    """Return the area in the XY plane, ground units squared; 0 of what is none."""
    if feature.kind != "AREA":
        return 0.0
    x, y = (feature.outline()[:, :2] - feature.coordinates()[0, :2]).T
    return abs(float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))) / 2.0


def snapped(there: Sequence[Feature], new: Sequence[Feature], within: float) -> tuple[tuple[Feature, ...], int]:
    """Return new features whose vertices take the place of a vertex that is near, and how many do.

    A vertex snaps to the nearest vertex in space of what is there and of the new features before it, and the end of a
    line to its own start. It becomes that vertex, with its standard deviations.

    Parameters
    ----------
    there, new : sequences of Feature
        What has the code and name of a new one is replaced by it, and nothing snaps to it.
    within : float
        Ground units; 0: nothing snaps.
    """
    keys = {feature.key for feature in new}
    known = [vertex for feature in there if feature.key not in keys for vertex in feature.vertices]
    found, count = [], 0
    for feature in new:
        vertices = [_nearest(vertex, known, within) or vertex for vertex in feature.vertices]
        if feature.kind == "LINE" and len(vertices) > 3:
            vertices[-1] = _nearest(vertices[-1], vertices[:1], within) or vertices[-1]
        count += sum(old is not after for old, after in zip(feature.vertices, vertices, strict=True))
        known += vertices
        found.append(replace(feature, vertices=tuple(vertices)))
    return tuple(found), count


def _nearest(vertex: Vertex, known: Sequence[Vertex], within: float) -> Vertex | None:
    if not known or not within > 0.0:
        return None
    distances = np.linalg.norm(np.array([one.xyz for one in known]) - vertex.xyz, axis=1)
    nearest = int(distances.argmin())
    return known[nearest] if distances[nearest] <= within else None


# LINE ROAD 17
#   X Y Z  sX sY sZ  left right py
#
# A vertex has its coordinates, then its standard deviations, then where it was measured, as far as that is known.

ENDING = ".GEO"

_COUNTS = (3, 6, 9)
_FORM = "X Y Z, then sX sY sZ, then left photo, right photo and y-parallax, as far as known"
_DECIMALS = 6
_HEADING = "! Restituted by orip: X Y Z  sX sY sZ (ground units)  left and right photo, y-parallax (mm)\n"


def read_features(path: Path, shown: str) -> Parsed[tuple[Feature, ...]]:
    """Read restituted features; a file that is absent has none.

    Parameters
    ----------
    shown : str
        The file as the user would name it.
    """
    text = read_lines(path, shown, may_be_absent=True)
    complaints: list[Complaint] = list(text.complaints)
    features: list[Feature] = []
    for lines in lines_by_feature(field_lines(text.value)):
        head = FieldReader(lines[0], shown)
        found = read_header(head)
        if found is not None:
            rows = [(reader, _read_vertex(reader)) for reader in (FieldReader(line, shown) for line in lines[1:])]
            vertices = tuple(vertex for _, vertex in rows if vertex is not None)
            least = LEAST_VERTICES[found.kind]
            if len(rows) < least:
                head.complain(f"this {found.kind} has {len(rows)} of at least {least} vertices; write the others")
            complaints += [complaint for reader, _ in rows for complaint in reader.complaints]
            place = lines[0].number, lines[-1].number
            features.append(Feature(found.kind, found.code, found.name, vertices, place))
        complaints += head.complaints
    complaints += repeated_features([(one.code, one.name, one.lines[0]) for one in features], shown)
    return Parsed(tuple(features), tuple(complaints))


def text_with(before: str | None, there: Sequence[Feature], new: Sequence[Feature]) -> str:
    """Return a text with new features, each in the place of the one with its code and name, else at the end.

    Parameters
    ----------
    before : str or None
        The text as it is; None: there is none yet.
    there : sequence of Feature
        As they were read from it.
    """
    lines = (before or _HEADING).splitlines(keepends=True)
    if lines and not lines[-1].endswith(("\n", "\r")):
        lines[-1] += "\n"
    replaced = {feature.key: feature.lines for feature in there}
    lines += [line for feature in new if feature.key not in replaced for line in _lines(feature)]
    for feature in sorted(new, key=lambda one: replaced.get(one.key, (0, 0)), reverse=True):
        if feature.key in replaced:
            first, last = replaced[feature.key]
            lines[first - 1 : last] = _lines(feature)
    return "".join(lines)


def _read_vertex(reader: FieldReader) -> Vertex | None:
    if not reader.has_fields(_COUNTS, _FORM):
        return None
    xyz = _triple(reader, 0)
    sd = _triple(reader, 3) if reader.count > _COUNTS[0] else None
    for index, value in enumerate(sd or (), start=3):
        if value < 0.0:
            reader.complain("a standard deviation is not below 0", index)
    stereo = None
    if reader.count == _COUNTS[2]:
        stereo = Stereo(reader.name(6), reader.name(7), reader.decimal(8))
    return Vertex(xyz, sd, stereo)


def _triple(reader: FieldReader, first: int) -> Triple:
    x, y, z = (reader.decimal(index) for index in range(first, first + 3))
    return x, y, z


def _lines(feature: Feature) -> Iterator[str]:
    yield f"{feature.kind} {feature.code} {feature.name}\n"
    for vertex in feature.vertices:
        cells = [f"{value:z14.{_DECIMALS}f}" for value in vertex.xyz]
        if vertex.sd is not None and all(map(math.isfinite, vertex.sd)):
            cells += [f"{value:10.{_DECIMALS}f}" for value in vertex.sd]
            if vertex.stereo is not None:
                cells += [f"{vertex.stereo.left:>8}", f"{vertex.stereo.right:>8}", f"{vertex.stereo.y_parallax:z9.4f}"]
        yield "  " + " ".join(cells) + "\n"


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
