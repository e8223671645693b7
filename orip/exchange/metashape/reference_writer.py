"""Reference tables (CSV) of Metashape: what was given of cameras and markers, and what the adjustment made of it.

The given coordinates are those that *Import Reference* reads; the estimates, as Metashape's own export has them, may be
chosen there instead, with their standard deviations as accuracies.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np

from orip.arrays import FloatArray
from orip.records.exchanged import ExchangedProject

CAMERAS, MARKERS = "reference_cameras.csv", "reference_markers.csv"

_HEADING: Final[tuple[str, ...]] = (
    "#Label", "X/East", "Y/North", "Z/Altitude", "Accuracy_X_(m)", "Accuracy_Y_(m)", "Accuracy_Z_(m)", "Enable",
    "X_est", "Y_est", "Z_est", "SD_X_(m)", "SD_Y_(m)", "SD_Z_(m)",
)  # fmt: skip

_ANGLES: Final[tuple[str, ...]] = (
    "Yaw", "Pitch", "Roll", "Accuracy_Yaw_(deg)", "Accuracy_Pitch_(deg)", "Accuracy_Roll_(deg)"
)  # fmt: skip

_Given = tuple[Sequence[float | None], Sequence[float | None]]
"""Coordinates, and their errors, negative where they are not used."""


def reference_files(project: ExchangedProject) -> Mapping[str, bytes]:
    """Return the tables of cameras and, where there are some, of markers."""
    stations: dict[str, _Given] = {one.photo: (one.position, one.position_error) for one in project.stations}
    oriented = [row for row, photo in enumerate(project.photos) if photo.position]
    photos = np.full((len(project.photos), 3), np.nan)
    photos[oriented] = [project.photos[row].position for row in oriented]
    nothing = (np.nan, np.nan, np.nan)
    deviations = np.array([photo.position_deviation or nothing for photo in project.photos]).reshape(-1, 3)
    places = photos if project.mapped is None else project.mapped.photos
    names = [photo.name for photo in project.photos]
    angles = _angles(project)
    table = [
        [*row, *angles.get(row[0], [""] * len(_ANGLES) * bool(angles))]
        for row in _rows(names, stations, places, deviations)
    ]
    files = {CAMERAS: _table(project.control_crs, table, _ANGLES if angles else ())}
    rows = np.flatnonzero(~project.points.is_track)
    if not rows.size:
        return files
    control: dict[str, _Given] = {one.name: (one.coordinates, one.errors) for one in project.control}
    covariance = project.points.covariance
    if covariance is None:
        covariance = np.full((len(project.points.names), 3, 3), np.nan)
    deviations = np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0))
    places = project.points.coordinates if project.mapped is None else project.mapped.points
    marked = [project.points.names[row] for row in rows.tolist()]
    return files | {MARKERS: _table(project.control_crs, _rows(marked, control, places[rows], deviations[rows]))}


def _angles(project: ExchangedProject) -> dict[str, list[str]]:
    """Return yaw, pitch and roll of photos with their accuracies, degrees; those that are only compared have none."""
    found = {}
    for station in project.stations if project.station_reference.navigation else ():
        if station.has_angles:
            given = np.degrees(station.angles[::-1]).tolist()
            errors = np.degrees(station.angle_error[::-1]).tolist()
            found[station.photo] = [*_words(given), *_words(error if error >= 0.0 else None for error in errors)]
    return found


def _rows(
    names: Sequence[str], given: Mapping[str, _Given], places: FloatArray, deviations: FloatArray
) -> Iterable[list[str]]:
    for name, place, deviation in zip(names, places.tolist(), deviations.tolist(), strict=True):
        coordinates, errors = given.get(name, ((None,) * 3, (None,) * 3))
        is_used = not all(error is None or error < 0.0 for error in errors)
        accuracies = [None if error is None else abs(error) for error in errors]
        enabled = "" if name not in given else "1" if is_used else "0"
        yield [name, *_words(coordinates), *_words(accuracies), enabled, *_words(place), *_words(deviation)]


def _words(values: Iterable[float | None]) -> list[str]:
    return ["" if value is None or not np.isfinite(value) else repr(float(value)) for value in values]


def _table(crs: str, rows: Iterable[list[str]], further: tuple[str, ...] = ()) -> bytes:
    text = io.StringIO()
    if crs:
        text.write(f"# CoordinateSystem: {' '.join(crs.split())}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow((*_HEADING, *further))
    writer.writerows(rows)
    return text.getvalue().encode()
