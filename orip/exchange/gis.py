"""Results for GIS and CAD: tables, GeoPackage, DXF. Coordinates are those of the project."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from orip.arrays import FloatArray
from orip.exchange.format import Conventions, Format
from orip.exchange.sources.names import distinct_names
from orip.files.maps.layers import (
    Conversion,
    Layer,
    Shapes,
    collection,
    drawing,
    drawn_features,
    feature,
    finite_or_none,
    geopackage,
    labelled_point,
    line,
    listed,
    polyline,
)
from orip.geometry.other_crs import to_wgs84
from orip.records.exchanged import ExchangedProject, PoseReading

READING = PoseReading("y_up", "to_ground", "omega_phi_kappa", "degree")
"""Rotations as orip has them."""

POINT_COLUMNS = ("X", "Y", "Z", "sX", "sY", "sZ", "semi_major", "semi_minor", "direction", "residual_px")
PHOTO_COLUMNS = ("X0", "Y0", "Z0", "sX0", "sY0", "sZ0", "OMEGA", "PHI", "KAPPA")

MOST_RAYS = 100_000
"""Of blocks with more, the rays of tie points are not drawn."""

_CORNERS = 36
_OF_EXTENT = 0.01


def point_layer(project: ExchangedProject) -> Layer:
    """Return points; standard deviations in ground units, the direction of the major axis in degrees from X to Y."""
    points = project.points
    nothing = np.full((len(points.names), 3), np.nan)
    deviations = nothing if points.covariance is None else np.sqrt(np.einsum("nii->ni", points.covariance))
    ellipse = nothing if points.ellipse is None else points.ellipse * [1.0, 1.0, 180.0 / math.pi]
    residual = nothing[:, 0] if points.residual is None else points.residual
    return Layer(
        "points",
        POINT_COLUMNS,
        distinct_names(points),
        np.column_stack([points.coordinates, deviations, ellipse, residual]),
    )


def photo_layer(project: ExchangedProject) -> Layer:
    """Return photos that are oriented: projection centres and angles in degrees."""
    photos = [photo for photo in project.photos if photo.position and photo.rotation]
    rows = [[*photo.position, *(photo.position_deviation or [math.nan] * 3), *photo.rotation] for photo in photos]
    values = np.array(rows, dtype=np.float64).reshape(-1, len(PHOTO_COLUMNS))
    return Layer("photos", PHOTO_COLUMNS, tuple(photo.name for photo in photos), values)


def shapes(project: ExchangedProject) -> tuple[Shapes, ...]:
    """Return all lines and areas of a result; error ellipses are always among them."""
    points = point_layer(project)
    return (
        _error_ellipses(points),
        *(drawn for drawn in (_footprints(project), _residual_vectors(project), _rays(project)) if drawn.places),
    )


def point_kinds(project: ExchangedProject) -> tuple[str, ...]:
    """Return what each point is: control, check, rejected or tie."""
    kinds = {point.name: point.kind for point in project.control}
    return tuple(
        "tie" if is_track else kinds.get(name, "tie")
        for name, is_track in zip(project.points.names, project.points.is_track.tolist(), strict=True)
    )


def _footprints(project: ExchangedProject) -> Shapes:
    shown = [photo for photo in project.photos if photo.footprint]
    places = tuple(np.array([*photo.footprint, photo.footprint[0]]) for photo in shown)
    return Shapes("footprints", "POLYGON", places, {"name": tuple(photo.name for photo in shown)})


def _residual_vectors(project: ExchangedProject) -> Shapes:
    """Return lines from given to adjusted places; a coordinate that is not given counts as it was adjusted."""
    place = project.points.marks
    used = [point for point in project.control if point.name in place]
    adjusted = project.points.coordinates[[place[point.name] for point in used]].reshape(-1, 3)
    given = np.array(
        [[np.nan if value is None else value for value in point.coordinates] for point in used], dtype=np.float64
    ).reshape(-1, 3)
    vectors = adjusted - given
    start = np.where(np.isfinite(given), given, adjusted)
    drawn = np.where(np.isfinite(vectors), vectors, 0.0)
    factor = _power_of_ten(np.hypot(drawn[:, 0], drawn[:, 1]), project.points.coordinates)
    lines = tuple(np.stack([start[n], start[n] + factor * drawn[n]]) for n in range(len(used)))
    return Shapes(
        f"residual_vectors_{factor:g}x",
        "LINESTRING",
        lines,
        {"name": tuple(point.name for point in used), "kind": tuple(point.kind for point in used)},
        dict(zip(("vX", "vY", "vZ"), vectors.T, strict=True)),
    )


def _rays(project: ExchangedProject) -> Shapes:
    """Return lines from projection centres to points, those of measurements that are used."""
    rays, points, names = project.rays, project.points, distinct_names(project.points)
    chosen = rays.is_active & np.isfinite(points.coordinates[rays.point]).all(axis=1)
    if chosen.sum() > MOST_RAYS:
        is_tie = np.array([kind == "tie" for kind in point_kinds(project)], dtype=np.bool_)
        chosen &= ~is_tie[rays.point]
    rows = [row for row in np.flatnonzero(chosen).tolist() if project.photos[rays.photo[row]].position]
    return Shapes(
        "rays",
        "LINESTRING",
        tuple(
            np.array([project.photos[rays.photo[row]].position, points.coordinates[rays.point[row]]]) for row in rows
        ),
        {
            "point": tuple(names[rays.point[row]] for row in rows),
            "photo": tuple(project.photos[rays.photo[row]].name for row in rows),
        },
    )


def _power_of_ten(lengths: FloatArray, places: FloatArray) -> float:
    """Return the power of ten that takes the median of lengths to about a hundredth of the extent of places."""
    known = lengths[np.isfinite(lengths) & (lengths > 0.0)]
    if not known.size:
        return 1.0
    extent = float(np.ptp(places[np.isfinite(places).all(axis=1), :2], axis=0).max())
    wanted = _OF_EXTENT * extent / float(np.median(known))
    return 10.0 ** round(math.log10(wanted)) if wanted > 0.0 else 1.0


def _error_ellipses(points: Layer) -> Shapes:
    """Return the outlines (37, 2), closed, of the error ellipses that are known."""
    factor = _power_of_ten(points.values[:, POINT_COLUMNS.index("semi_major")], points.values[:, :3])
    found = _outlines(points, factor)
    return Shapes(
        f"error_ellipses_{factor:g}x",
        "POLYGON",
        tuple(outline for _, outline in found),
        {"name": tuple(name for name, _ in found)},
    )


def _outlines(points: Layer, factor: float) -> list[tuple[str, FloatArray]]:
    angles = np.linspace(0.0, 2.0 * math.pi, _CORNERS + 1)
    found = []
    start = POINT_COLUMNS.index("semi_major")
    for name, row in zip(points.names, points.values, strict=True):
        major, minor, direction = row[start : start + 3]
        if not np.isfinite(major):
            continue
        cosine, sine = math.cos(math.radians(direction)), math.sin(math.radians(direction))
        along, across = factor * major * np.cos(angles), factor * minor * np.sin(angles)
        outline = np.column_stack([along * cosine - across * sine, along * sine + across * cosine]) + row[:2]
        found.append((name, outline))
    return found


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


_DRAWN = Conventions(None, READING, is_cartesian=False, is_drawn=True)

GEOPACKAGE_FORMAT = Format(
    "geopackage",
    "GeoPackage for GIS: points, photos, footprints, error ellipses, residual vectors, rays",
    write=write_geopackage,
    conventions=_DRAWN,
    is_file=True,
)


DXF_FORMAT = Format(
    "dxf",
    "DXF (release 12) for CAD: points, photos, footprints, error ellipses, residual vectors, rays",
    write=write_dxf,
    conventions=_DRAWN,
    is_file=True,
)


GEOJSON_FORMAT = Format(
    "geojson",
    "GeoJSON for maps: the same in longitude and latitude, where the project has a crs",
    write=write_geojson,
    conventions=_DRAWN,
    is_file=True,
)
