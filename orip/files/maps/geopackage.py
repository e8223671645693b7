"""GeoPackage: layers of points, lines and areas in one SQLite file, made in memory."""

from __future__ import annotations

import math
import re
import sqlite3
import struct
from collections.abc import Iterable
from contextlib import closing

import numpy as np

from orip.arrays import FloatArray
from orip.files.maps.layers import Layer, Shapes

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
