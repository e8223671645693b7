"""Results for GIS and CAD: tables, GeoPackage, DXF. Coordinates are those of the project."""

from __future__ import annotations

import csv
import io
import json
import math
import re
import sqlite3
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.errors import InputError
from orip.exchange.gis_layers import Layer, Shapes, photo_layer, point_kinds, point_layer, shapes
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
    pairs: list[tuple[int, object]] = [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(colours))]
    for name, colour in colours.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES")]
    height = _TEXT_OF_EXTENT * (extent or 1.0)
    for layer, labelled in (("POINTS", points), ("PHOTOS", photos)):
        for name, row in zip(labelled.names, labelled.values[:, :3].tolist(), strict=True):
            pairs += _place("POINT", layer, row)
            pairs += [*_place("TEXT", layer, row), (40, height), (1, _plain(name))]
    for one in drawn:
        for place in one.places:
            pairs += _line(_layer(one), place) if one.geometry == "LINESTRING" else _outline(_layer(one), place)
    pairs += [(0, "ENDSEC"), (0, "EOF")]
    return {"orip.dxf": "".join(_lines(pairs)).encode("ascii")}


def _layer(drawn: Shapes) -> str:
    """Return a name in the letters that release 12 allows for layers."""
    return drawn.name.upper().replace("ERROR_", "").replace(".", "_").replace("+", "")


def _line(layer: str, place: FloatArray) -> list[tuple[int, object]]:
    start, end = place.tolist()
    return [*_place("LINE", layer, start), *zip((11, 21, 31), end, strict=True)]


def _outline(layer: str, place: FloatArray) -> list[tuple[int, object]]:
    """Return a closed polyline, in space where places have heights."""
    is_in_space = place.shape[1] == 3
    pairs: list[tuple[int, object]] = [(0, "POLYLINE"), (8, layer), (66, 1), (70, 9 if is_in_space else 1)]
    for x, y, *z in place[:-1].tolist():
        pairs += [*_place("VERTEX", layer, [x, y, *(z or [0.0])]), *([(70, 32)] if is_in_space else [])]
    return [*pairs, (0, "SEQEND"), (8, layer)]


def _place(kind: str, layer: str, place: list[float]) -> list[tuple[int, object]]:
    return [(0, kind), (8, layer), *zip((10, 20, 30), place, strict=True)]


def _lines(pairs: list[tuple[int, object]]) -> Iterator[str]:
    return (f"{code:3d}\n{repr(value) if isinstance(value, float) else value}\n" for code, value in pairs)


def _plain(name: str) -> str:
    """Return a name in the characters of release 12: others as their numbers, which newer programs show."""
    return "".join(letter if letter.isascii() and letter.isprintable() else f"\\U+{ord(letter):04X}" for letter in name)


# A project without a coordinate reference system has no longitude and latitude: its own coordinates are written, and a
# member ``coordinates`` and a note say so.

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
        numbers = {column: _finite_or_none(value) for column, value in zip(layer.columns, row, strict=True)}
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
            {**properties, **{name: _finite_or_none(values[n]) for name, values in numbers.items()}},
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


def _finite_or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


_APPLICATION, _VERSION = 0x47504B47, 10300
_CARTESIAN = -1
_POINT_Z = 1001
_KINDS = {"LINESTRING": 2, "POLYGON": 3}
_WITH_Z = 1000

_TABLES = """
CREATE TABLE gpkg_spatial_ref_sys (srs_name TEXT NOT NULL, srs_id INTEGER PRIMARY KEY, organization TEXT NOT NULL,
  organization_coordsys_id INTEGER NOT NULL, definition TEXT NOT NULL, description TEXT);
CREATE TABLE gpkg_contents (table_name TEXT NOT NULL PRIMARY KEY, data_type TEXT NOT NULL, identifier TEXT UNIQUE,
  description TEXT DEFAULT '', last_change DATETIME NOT NULL, min_x DOUBLE, min_y DOUBLE, max_x DOUBLE, max_y DOUBLE,
  srs_id INTEGER REFERENCES gpkg_spatial_ref_sys(srs_id));
CREATE TABLE gpkg_geometry_columns (table_name TEXT NOT NULL UNIQUE REFERENCES gpkg_contents(table_name),
  column_name TEXT NOT NULL, geometry_type_name TEXT NOT NULL,
  srs_id INTEGER NOT NULL REFERENCES gpkg_spatial_ref_sys(srs_id), z TINYINT NOT NULL, m TINYINT NOT NULL,
  PRIMARY KEY (table_name, column_name));
"""
_WGS84 = (
    'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
    'UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]'
)
_NO_TIME = "1970-01-01T00:00:00.000Z"
"""Equal results give equal files."""


def write_geopackage(project: ExchangedProject, _original: Path | None) -> Mapping[str, bytes]:
    """Return one file with a layer for all of a kind; names say how much larger ellipses and vectors are drawn."""
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {_VERSION}")
        connection.executescript(_TABLES)
        system = _spatial_system(connection, project.crs)
        for layer in (point_layer(project), photo_layer(project)):
            _write_layer(connection, layer, system)
        for drawn in shapes(project):
            _write_shapes(connection, drawn, system)
        connection.commit()
        return {"orip.gpkg": connection.serialize()}


def _spatial_system(connection: sqlite3.Connection, crs: str | None) -> int:
    """Write the reference systems that every file has and the project's, and return the number of the latter."""
    rows = [
        ("Undefined Cartesian", -1, "NONE", -1, "undefined", None),
        ("Undefined geographic", 0, "NONE", 0, "undefined", None),
        ("WGS 84", 4326, "EPSG", 4326, _WGS84, None),
    ]
    match = re.fullmatch(r"EPSG:([0-9]{4,6})(?:\+[0-9]+)?", crs or "", re.IGNORECASE)
    system = int(match[1]) if match else _CARTESIAN
    if match and system != 4326:
        rows.append((f"EPSG:{system}", system, "EPSG", system, "undefined", None))
    connection.executemany("INSERT INTO gpkg_spatial_ref_sys VALUES (?, ?, ?, ?, ?, ?)", rows)
    return system


def _write_layer(connection: sqlite3.Connection, layer: Layer, system: int) -> None:
    columns = ", ".join(f'"{name}" DOUBLE' for name in layer.columns[3:])
    _register(connection, layer.name, f"name TEXT, {columns}", "POINT", system, layer.values[:, :2], has_z=True)
    marks = ", ".join("?" * (len(layer.columns) - 3 + 2))
    connection.executemany(
        f'INSERT INTO "{layer.name}" VALUES (NULL, {marks})',
        [
            (
                _geometry(system, _POINT_Z, struct.pack("<3d", *row[:3])),
                name,
                *(_number_or_none(value) for value in row[3:]),
            )
            for name, row in zip(layer.names, layer.values.tolist(), strict=True)
        ],
    )


def _write_shapes(connection: sqlite3.Connection, drawn: Shapes, system: int) -> None:
    everywhere = np.concatenate([place[:, :2] for place in drawn.places]) if drawn.places else np.zeros((0, 2))
    columns = ", ".join([*(f'"{name}" TEXT' for name in drawn.texts), *(f'"{name}" DOUBLE' for name in drawn.numbers)])
    _register(connection, drawn.name, columns, drawn.geometry, system, everywhere, has_z=drawn.has_height)
    kind = _KINDS[drawn.geometry] + (_WITH_Z if drawn.has_height else 0)
    rings = b"" if drawn.geometry == "LINESTRING" else struct.pack("<I", 1)
    numbers = [values.tolist() for values in drawn.numbers.values()]
    marks = ", ".join("?" * (1 + len(drawn.texts) + len(drawn.numbers)))
    connection.executemany(
        f'INSERT INTO "{drawn.name}" VALUES (NULL, {marks})',
        [
            (
                _geometry(system, kind, rings + struct.pack("<I", len(place)) + place.astype("<f8").tobytes()),
                *(words[n] for words in drawn.texts.values()),
                *(_number_or_none(values[n]) for values in numbers),
            )
            for n, place in enumerate(drawn.places)
        ],
    )


def _register(
    connection: sqlite3.Connection,
    table: str,
    columns: str,
    geometry: str,
    system: int,
    places: FloatArray,
    *,
    has_z: bool,
) -> None:
    connection.execute(f'CREATE TABLE "{table}" (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {geometry}, {columns})')
    box = [float(value) for limit in (np.min, np.max) for value in limit(places, axis=0)] if len(places) else [None] * 4
    connection.execute(
        "INSERT INTO gpkg_contents VALUES (?, 'features', ?, '', ?, ?, ?, ?, ?, ?)",
        (table, table, _NO_TIME, *box, system),
    )
    connection.execute(
        "INSERT INTO gpkg_geometry_columns VALUES (?, 'geom', ?, ?, ?, 0)", (table, geometry, system, int(has_z))
    )


def _geometry(system: int, kind: int, coordinates: bytes) -> bytes:
    """Return a geometry without envelope: the header of GeoPackage, and well-known binary, little-endian."""
    return struct.pack("<2sBBi", b"GP", 0, 1, system) + struct.pack("<BI", 1, kind) + coordinates


def _number_or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
