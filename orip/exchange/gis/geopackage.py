"""Points, photos, lines and areas as a GeoPackage (OGC 12-128r18): an SQLite file that GIS programs read."""

from __future__ import annotations

import math
import re
import sqlite3
import struct
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.gis.layers import Layer, Shapes, photo_layer, point_layer, shapes
from orip.records.exchanged import ExchangedProject

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
            (_geometry(system, _POINT_Z, struct.pack("<3d", *row[:3])), name, *(_known(value) for value in row[3:]))
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
                *(_known(values[n]) for values in numbers),
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


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value
