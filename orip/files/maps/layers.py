"""Layers of points, lines and areas for GIS and CAD, with columns of names and numbers: DXF, GeoJSON and GeoPackage."""

from __future__ import annotations

import json
import math
import re
import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from typing import Literal

import numpy as np
from msgspec import Struct, field

from orip.arrays import FloatArray


class Layer(Struct, frozen=True):
    """A table of places: their names, and numbers (n, k) by columns, the first three of which are coordinates."""

    name: str
    columns: tuple[str, ...]
    names: tuple[str, ...]
    values: FloatArray


class Shapes(Struct, frozen=True):
    """Points, lines or closed areas.

    Parameters
    ----------
    name : str
        With the factor by which they are drawn larger, if they are.
    geometry : {"POINT", "LINESTRING", "POLYGON"}
    places : tuple of arrays (k, 2) or (k, 3)
        Of a point one place; the first of an area is also its last.
    texts : mapping of str to tuple of str
        Columns of names.
    numbers : mapping of str to array
    """

    name: str
    geometry: Literal["POINT", "LINESTRING", "POLYGON"]
    places: tuple[FloatArray, ...]
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, FloatArray] = field(default_factory=dict)

    @property
    def has_height(self) -> bool:
        """Return whether places have three coordinates."""
        return bool(self.places) and self.places[0].shape[1] == 3


Pairs = list[tuple[int, object]]


def drawing(colours: Mapping[str, int], entities: Iterable[tuple[int, object]]) -> bytes:
    """Return a drawing.

    Parameters
    ----------
    colours : mapping of str to int
        Colour numbers of all layers.
    entities : iterable of pairs
        What `labelled_point`, `line` and `polyline` give, joined.
    """
    pairs: Pairs = [(0, "SECTION"), (2, "TABLES"), (0, "TABLE"), (2, "LAYER"), (70, len(colours))]
    for name, colour in colours.items():
        pairs += [(0, "LAYER"), (2, name), (70, 0), (62, colour), (6, "CONTINUOUS")]
    pairs += [(0, "ENDTAB"), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"), *entities, (0, "ENDSEC"), (0, "EOF")]
    return "".join(_lines(pairs)).encode("ascii")


def labelled_point(layer: str, place: list[float], name: str, height: float) -> Pairs:
    """Return a point X, Y, Z with its name, written in that height (ground units)."""
    return [*_place("POINT", layer, place), *_place("TEXT", layer, place), (40, height), (1, _plain(name))]


def line(layer: str, place: FloatArray) -> Pairs:
    """Return a straight line between two places (2, 3)."""
    start, end = place.tolist()
    return [*_place("LINE", layer, start), *zip((11, 21, 31), end, strict=True)]


def polyline(layer: str, place: FloatArray, *, closed: bool) -> Pairs:
    """Return a polyline of places (n, 2 or 3), in space where they have heights; the first of a closed one once."""
    is_in_space = place.shape[1] == 3
    pairs: Pairs = [(0, "POLYLINE"), (8, layer), (66, 1), (70, 8 * is_in_space + closed)]
    for x, y, *z in place.tolist():
        pairs += [*_place("VERTEX", layer, [x, y, *(z or [0.0])]), *([(70, 32)] if is_in_space else [])]
    return [*pairs, (0, "SEQEND"), (8, layer)]


def _place(kind: str, layer: str, place: list[float]) -> Pairs:
    return [(0, kind), (8, layer), *zip((10, 20, 30), place, strict=True)]


def _lines(pairs: Pairs) -> Iterator[str]:
    return (f"{code:3d}\n{repr(value) if isinstance(value, float) else value}\n" for code, value in pairs)


def _plain(name: str) -> str:
    """Return a name in the characters of release 12: others as their numbers, which newer programs show."""
    return "".join(letter if letter.isascii() and letter.isprintable() else f"\\U+{ord(letter):04X}" for letter in name)


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


_APPLICATION, _VERSION = 0x47504B47, 10300
_CARTESIAN = -1
_POINT_Z = 1001
_KINDS = {"POINT": 1, "LINESTRING": 2, "POLYGON": 3}
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


def geopackage(crs: str | None, layers: Iterable[Layer | Shapes]) -> bytes:
    """Return a GeoPackage with layers, in their order.

    Parameters
    ----------
    crs : str or None
        Of the coordinates; what is no EPSG number counts as a plain system.
    layers : iterable of Layer or Shapes
        Their names and columns are names of tables and columns: letters, digits and the like.
    """
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {_VERSION}")
        connection.executescript(_TABLES)
        system = _spatial_system(connection, crs)
        for layer in layers:
            if isinstance(layer, Layer):
                _write_layer(connection, layer, system)
            else:
                _write_shapes(connection, layer, system)
        connection.commit()
        return connection.serialize()


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
    numbers = [values.tolist() for values in drawn.numbers.values()]
    marks = ", ".join("?" * (1 + len(drawn.texts) + len(drawn.numbers)))
    connection.executemany(
        f'INSERT INTO "{drawn.name}" VALUES (NULL, {marks})',
        [
            (
                _geometry(system, kind, _counts(drawn.geometry, len(place)) + place.astype("<f8").tobytes()),
                *(words[n] for words in drawn.texts.values()),
                *(_number_or_none(values[n]) for values in numbers),
            )
            for n, place in enumerate(drawn.places)
        ],
    )


def _counts(geometry: str, places: int) -> bytes:
    """Return what stands before the coordinates of a line or area: its rings, and how many places it has."""
    if geometry == "POINT":
        return b""
    return struct.pack("<I", places) if geometry == "LINESTRING" else struct.pack("<II", 1, places)


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
