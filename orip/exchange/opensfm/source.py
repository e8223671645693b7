"""Which files make up a project of OpenSfM or OpenDroneMap, and the project that they give together."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.errors import Complaint
from orip.exchange.opensfm.control_marks import (
    MarkedPoint,
    PlaceList,
    marked_points_of_document,
    marked_points_of_list,
    read_control_list,
    read_place_list,
)
from orip.exchange.opensfm.reconstruction import (
    READING,
    Reconstruction,
    is_shots_geojson,
    largest_reconstruction,
    read_shots_geojson,
)
from orip.exchange.opensfm.tracks import Features, Settings, read_features, read_settings
from orip.exchange.sources.collected import CollectedPoints, CollectedRays, PhotoNames
from orip.exchange.sources.json_tree import read_json
from orip.exchange.sources.text import Faults
from orip.files.text.shown import Parsed
from orip.records.control import IN_PROJECT, ControlPoint, Station, StationReference
from orip.records.exchanged import ExchangedCamera, ExchangedProject
from orip.structs import replace
from orip.wording import counted

_RECONSTRUCTIONS = (
    "opensfm/reconstruction.topocentric.json",
    "opensfm/reconstruction.json",
    "reconstruction.topocentric.json",
    "reconstruction.json",
)
"""In a folder, the adjusted one first: OpenDroneMap changes reconstruction.json after the adjustment."""

_UNKNOWN_ACCURACY = 10.0
"""Metres that OpenDroneMap takes for the position of a photo where nothing is known."""


_ANGLE_ERROR = 5.0
"""Degrees; drones write the angles of a gimbal, or of the aircraft, by a magnetic compass."""

_ANGLE_ERRORS = (math.radians(_ANGLE_ERROR),) * 3


class _Files(Struct, frozen=True):
    """Paths of the files of a project; None where there is none."""

    reconstruction: Path
    tracks: Path | None
    control_document: Path | None
    control_list: Path | None
    places: Path | None
    settings: Path | None


def reconstruction_file(source: Path) -> Path | None:
    """Return the reconstruction of a project's folder, or the file itself; None if there is none."""
    if source.is_file():
        return source
    return next((source / name for name in _RECONSTRUCTIONS if (source / name).is_file()), None)


def is_opensfm(source: Path) -> bool:
    """Return whether a folder has a reconstruction, or a file is one, or the shots of a report, by its name."""
    return (
        is_shots_geojson(source)
        or (source.is_dir() and reconstruction_file(source) is not None)
        or (source.suffix == ".json" and source.name.startswith("reconstruction"))
    )


def read_opensfm(source: Path, shown: str) -> Parsed[ExchangedProject | None]:
    """Read a project: the folder of OpenSfM or OpenDroneMap, its reconstruction file, or the shots of its report.

    Parameters
    ----------
    shown : str
        The source as the user would name it.
    """
    if is_shots_geojson(source):
        return read_shots_geojson(source, shown)
    found = reconstruction_file(source)
    if found is None:
        message = f"there is no reconstruction here; name the folder that has one of {', '.join(_RECONSTRUCTIONS)}"
        return Parsed(None, (Complaint(message, shown),))
    files = _files(found, source)
    complaints: list[Complaint] = []

    def faults_of(path: Path) -> Faults:
        return Faults(_shown(path, source, shown))

    faults = faults_of(found)
    document = read_json(found, faults)
    reconstruction = None if document is None else largest_reconstruction(document)
    complaints += faults.complaints
    if reconstruction is None:
        return Parsed(None, tuple(complaints))
    project = _project(reconstruction, files, faults_of, complaints)
    return Parsed(None if complaints else project, tuple(complaints))


def _shown(path: Path, source: Path, shown: str) -> str:
    if path == source:
        return shown
    folder = source if source.is_dir() else source.parent
    named = Path(shown) if source.is_dir() else Path(shown).parent
    return str(named / path.relative_to(folder)) if path.is_relative_to(folder) else str(path)


def _files(reconstruction: Path, source: Path) -> _Files:
    folders = [reconstruction.parent]
    if reconstruction.parent.name == "opensfm" and source.is_dir():
        folders.append(reconstruction.parent.parent)
    stem = reconstruction.name.removeprefix("reconstruction").removesuffix(".json").replace(".topocentric", "")

    def first(*names: str) -> Path | None:
        return next((path for folder in folders for name in names if (path := folder / name).is_file()), None)

    return _Files(
        reconstruction,
        first(f"tracks{stem}.csv", "tracks.csv"),
        first("ground_control_points.json"),
        first("gcp_list.txt", "gcp/gcp_list.txt"),
        first("geo.txt"),
        first("config.yaml"),
    )


def _project(
    reconstruction: Reconstruction,
    files: _Files,
    faults_of: Callable[[Path], Faults],
    complaints: list[Complaint],
) -> ExchangedProject:
    points, rays = CollectedPoints(), CollectedRays()
    notes = list(reconstruction.notes)
    points.add_tracks(reconstruction.points)
    photos = {photo.name: place for place, photo in enumerate(reconstruction.photos)}
    if files.tracks is None:
        notes.append("There is no tracks.csv beside the reconstruction: tie points have no measurements.")
    else:
        faults = faults_of(files.tracks)
        features = read_features(files.tracks, faults, photos, points.tracks)
        notes += _add_features(features, reconstruction, rays)
        if not len(features.photo) and not faults.complaints:
            notes.append("tracks.csv is empty: tie points have no measurements.")
        complaints += faults.complaints
    control, crs = _add_control(files, faults_of, complaints, reconstruction, points, rays, notes)
    stations, reference = reconstruction.stations, IN_PROJECT
    if files.places is not None:
        faults = faults_of(files.places)
        places = read_place_list(files.places, faults)
        complaints += faults.complaints
        notes += [] if places.places else [f"{files.places.name} has a heading alone: no position was read."]
        stations = _stations(places, reconstruction, notes)
        has_angles = any(station.has_angles for station in stations)
        reference = StationReference(places.crs, navigation=has_angles)
        if has_angles:
            notes.append(
                "Yaw, pitch and roll of geo.txt are observed attitudes; no file says how good they are: "
                f"{_ANGLE_ERROR:g}° was assumed."
            )
    settings = Settings()
    if files.settings is not None:
        faults = faults_of(files.settings)
        settings = read_settings(files.settings, faults)
        complaints += faults.complaints
    larger = max((max(camera.columns, camera.rows) for camera in reconstruction.cameras), default=0)
    precision = settings.feature_precision(larger)
    if precision is not None and precision > 1.0:
        notes.append(
            f"Features were found in smaller images: their a-priori error is one pixel there, {precision:.1f} px."
        )
    return ExchangedProject(
        name="",
        cameras=tuple(
            replace(camera, free=()) if settings.holds_cameras else camera for camera in reconstruction.cameras
        ),
        photos=reconstruction.photos,
        points=points.points(),
        rays=rays.rays(),
        readings=(READING,),
        control=control,
        control_crs=crs,
        control_named=f"the header of {files.control_list.name}" if files.control_list is not None else "",
        stations=stations,
        station_reference=reference,
        ground_unit="m",
        frame=reconstruction.frame,
        precision=precision,
        rigs=reconstruction.rigs,
        exposures=reconstruction.exposures,
        notes=tuple(notes),
    )


def _pixel(camera: ExchangedCamera, x: float, y: float) -> tuple[float, float]:
    """Return column and row, from the outer corner, of normalised coordinates."""
    longer = max(camera.columns, camera.rows)
    return x * longer + camera.columns / 2.0, y * longer + camera.rows / 2.0


def _add_features(features: Features, reconstruction: Reconstruction, rays: CollectedRays) -> list[str]:
    """Add the rays of tracks that have a point, in photos that are oriented; return what is left out."""
    used = (features.photo >= 0) & (features.point >= 0)
    photo = features.photo[used]
    cameras = [reconstruction.cameras[item.camera] for item in reconstruction.photos]
    size = np.array([(camera.columns, camera.rows) for camera in cameras], dtype=np.float64).reshape(-1, 2)
    of_ray = size[photo]
    image = features.coordinates[used] * of_ray.max(axis=1, initial=0.0)[:, None] + of_ray / 2.0
    rays.extend(photo, features.point[used], image)
    lost = len(used) - int(used.sum())
    return (
        [f"{counted(lost, 'feature')} of tracks without a point, or in photos not oriented, left out."] if lost else []
    )


def _add_control(
    files: _Files,
    faults_of: Callable[[Path], Faults],
    complaints: list[Complaint],
    reconstruction: Reconstruction,
    points: CollectedPoints,
    rays: CollectedRays,
    notes: list[str],
) -> tuple[tuple[ControlPoint, ...], str]:
    """Add the marks of control points; return the control points and what their coordinates refer to."""
    marked: Sequence[MarkedPoint] = ()
    crs, in_pixels = "", False
    if files.control_list is not None:
        faults = faults_of(files.control_list)
        control_list = read_control_list(files.control_list, faults)
        marked, crs, in_pixels = marked_points_of_list(control_list), control_list.crs, True
        complaints += faults.complaints
        notes += [] if control_list.marks else [f"{files.control_list.name} has a heading alone: no control was read."]
    elif files.control_document is not None:
        faults = faults_of(files.control_document)
        document = read_json(files.control_document, faults)
        marked, crs = () if document is None else marked_points_of_document(document), "EPSG:4979"
        complaints += faults.complaints
    names = PhotoNames(photo.name for photo in reconstruction.photos)
    for item in marked:
        _add_marks(item, names, reconstruction, points, rays, in_pixels=in_pixels)
    if marked:
        file = files.control_list or files.control_document
        notes += names.notes("" if file is None else file.name, "mark")
    nothing = (None, None, None)
    return tuple(
        ControlPoint(item.name, item.coordinates, nothing, line=item.line)
        for item in marked
        if item.coordinates is not None
    ), crs


def _add_marks(
    item: MarkedPoint,
    names: PhotoNames,
    reconstruction: Reconstruction,
    points: CollectedPoints,
    rays: CollectedRays,
    *,
    in_pixels: bool,
) -> None:
    point = points.add(item.name)
    for name, (x, y) in item.marks:
        photo = names.place(name)
        if photo is not None:
            camera = reconstruction.cameras[reconstruction.photos[photo].camera]
            rays.add(photo, point, (x + 0.5, y + 0.5) if in_pixels else _pixel(camera, x, y))


def _stations(places: PlaceList, reconstruction: Reconstruction, notes: list[str]) -> tuple[Station, ...]:
    """Return positions, with attitudes where there are any; angles that are 0 in all photos say nothing."""
    names = PhotoNames(photo.name for photo in reconstruction.photos)
    has_angles = any(any(place.angles or ()) for place in places.places)
    found = []
    for place in places.places:
        photo = names.place(place.photo)
        if photo is not None and place.coordinates[2] == place.coordinates[2]:  # not NaN
            horizontal, vertical = place.accuracy or (_UNKNOWN_ACCURACY, _UNKNOWN_ACCURACY)
            name = reconstruction.photos[photo].name
            station = Station(name, place.coordinates, (horizontal, horizontal, vertical), line=place.line)
            if has_angles and place.angles is not None:
                yaw, pitch, roll = (math.radians(angle) for angle in place.angles)
                station = replace(station, angles=(roll, pitch, yaw), angle_error=_ANGLE_ERRORS)
            found.append(station)
    notes += names.notes("geo.txt", "place")
    return tuple(found)
