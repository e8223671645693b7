"""Points, photos and error ellipses as a GeoPackage (OGC 12-128r18): an SQLite file that GIS programs read."""

from __future__ import annotations

import math
import re
import sqlite3
import struct
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path

from orip.arrays import FloatArray
from orip.exchange.gis.layers import Layer, ellipses, magnification, photo_layer, point_layer
from orip.records.exchanged import ExchangedProject

_APPLICATION, _VERSION = 0x47504B47, 10300
_CARTESIAN = -1
_POINT_Z, _POLYGON = 1001, 3

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
    """Return one file with the layers points, photos and error ellipses; these have their magnification in the name."""
    points, photos = point_layer(project), photo_layer(project)
    factor = magnification(points)
    with closing(sqlite3.connect(":memory:")) as connection:
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {_VERSION}")
        connection.executescript(_TABLES)
        system = _spatial_system(connection, project.crs)
        for layer in (points, photos):
            _write_layer(connection, layer, system)
        _write_ellipses(connection, ellipses(points, factor), f"error_ellipses_{factor:g}x", system)
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


def _write_ellipses(
    connection: sqlite3.Connection, outlines: Sequence[tuple[str, FloatArray]], name: str, system: int
) -> None:
    everywhere = [corner for _, outline in outlines for corner in outline.tolist()]
    _register(connection, name, "name TEXT", "POLYGON", system, everywhere, has_z=False)
    rows = [
        (_geometry(system, _POLYGON, struct.pack("<II", 1, len(outline)) + outline.astype("<f8").tobytes()), point)
        for point, outline in outlines
    ]
    connection.executemany(f'INSERT INTO "{name}" VALUES (NULL, ?, ?)', rows)


def _register(
    connection: sqlite3.Connection,
    table: str,
    columns: str,
    geometry: str,
    system: int,
    places: FloatArray | Sequence[Sequence[float]],
    *,
    has_z: bool,
) -> None:
    connection.execute(f'CREATE TABLE "{table}" (fid INTEGER PRIMARY KEY AUTOINCREMENT, geom {geometry}, {columns})')
    x, y = [place[0] for place in places], [place[1] for place in places]
    box = [float(limit(values)) if values else None for limit in (min, max) for values in (x, y)]
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
