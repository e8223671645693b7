"""`orip stations import`: positions and attitudes of other programs to a .STA file, and photos to orip.toml."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from msgspec import Struct, field

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.control.editing import ControlLines, read_control_lines
from orip.files.control.stations_text import is_heading, parse_stations, stations_text
from orip.files.exif import ENDINGS, image_files, read_images
from orip.files.project.reader import parse_project
from orip.files.project.toml_text import toml_table
from orip.files.text.lines import read_bytes
from orip.files.text.shown import Parsed
from orip.records.control import Station
from orip.records.epochs import Epochs, epochs
from orip.records.names import record_key
from orip.stations.exposures import Matching, Sources, find_exposures
from orip.stations.gnss.receiver_data import is_receiver_file, read_events
from orip.stations.in_project import Exposures, stations_in_project
from orip.stations.receiver_files import read_dji_mrk, read_rtklib_pos, read_sbet
from orip.stations.table import read_station_table
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE
from orip.wording import counted_names, first_names
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState
from orip.workflow.records.mentions import is_written

_FAR = 10.0
"""Multiples of the extent of all others, beyond which they are far away from 0."""

_SBET_ENDINGS = (".sbet", ".out")


def read_epochs(
    path: Path,
    shown: str,
    columns: Mapping[str, str] | None = None,
    deviations: Path | None = None,
    ground_unit: str = "",
) -> Parsed[Epochs]:
    """Read a file, or the image files of a folder, by the ending of its name.

    ``.pos`` is RTKLIB, ``.mrk`` an image log of DJI, ``.sbet`` and ``.out`` an SBET, an image its own metadata. Of
    observations the events are read; everything else is a table with a heading.

    Parameters
    ----------
    columns : mapping of str to str, optional
        Headings of a table by key.
    deviations : Path, optional
        SMRMSG file beside an SBET.
    ground_unit : str
        The project's, for X, Y and Z of a table.
    """
    ending = path.suffix.lower()
    if path.is_dir():
        try:
            images = image_files(path)
        except OSError as error:
            fault = Complaint(f"the folder cannot be read ({error.strerror})", shown)
            return Parsed(epochs(shown, np.zeros(0, dtype=np.int64)), (fault,))
        return read_images(images, shown)
    if ending in ENDINGS:
        return read_images([path], shown)
    if ending == ".pos":
        return read_rtklib_pos(path, shown)
    if ending == ".mrk":
        return read_dji_mrk(path, shown)
    if ending in _SBET_ENDINGS:
        return read_sbet(path, shown, deviations, "" if deviations is None else deviations.name)
    if is_receiver_file(path):
        return _receiver_events(path, shown)
    return read_station_table(path, shown, columns, ground_unit)


def _receiver_events(path: Path, shown: str) -> Parsed[Epochs]:
    times = read_events(path, shown)
    if isinstance(times, Complaint):
        return Parsed(epochs(shown, np.zeros(0, dtype=np.int64)), (times,))
    return Parsed(epochs(shown, np.arange(1, len(times) + 1), time=times))


class ImportFiles(Struct, frozen=True):
    """The files that stations are imported from; relative to the project folder.

    Parameters
    ----------
    source : Path
        Positions: of events, or a trajectory.
    events : Path or None
        When the photos were taken, if `source` is a trajectory.
    photo_times : Path or None
        Names and times of photos: a table, or a folder of image files.
    deviations : Path or None
        SMRMSG file of an SBET.
    columns : mapping of str to str
        Headings of a table by key.
    mount : {"body", "gimbal"} or None
        What roll, pitch and heading turn; None: as usual for the format.
    """

    source: Path
    events: Path | None = None
    photo_times: Path | None = None
    deviations: Path | None = None
    columns: Mapping[str, str] = field(default_factory=dict)
    mount: Literal["body", "gimbal"] | None = None


class ImportSettings(Struct, frozen=True):
    """How stations are imported.

    Parameters
    ----------
    matching : Matching
    position_error : tuple of 3 float
        East, north, up, where the file has none, m.
    angle_error : float
        Where the file has none, degrees.
    camera : str or None
        Of new photos; None: the only one of the project.
    replaces : bool
        Stations that the .STA file has already are replaced.
    """

    matching: Matching
    position_error: tuple[float, float, float] = (0.03, 0.03, 0.05)
    angle_error: float = 0.5
    camera: str | None = None
    replaces: bool = False


class ImportedStations(Struct, frozen=True):
    """What was imported, or would be (`dry_run`).

    Parameters
    ----------
    project : ProjectFolder
    shown : str
        The .STA file.
    stations : tuple of Station
    replaced : int
        Stations that were in the file before.
    photos : tuple of str
        Photos that are new in orip.toml.
    warnings : tuple of ProjectWarning
    dry_run : bool
    """

    project: ProjectFolder
    shown: str
    stations: tuple[Station, ...]
    replaced: int
    photos: tuple[str, ...]
    warnings: tuple[ProjectWarning, ...]
    dry_run: bool


def import_stations(
    state: ProjectState, files: ImportFiles, settings: ImportSettings, *, dry_run: bool = False
) -> Change[ImportedStations]:
    """Return the stations of photos, to be written into the .STA file, and photos that orip.toml lacks.

    Raises
    ------
    InputError
        With everything that is wrong in the files; nothing is written then.
    """
    project = state.project
    exposures, warnings = find_exposures(_read(project, files, known_photos(state)), settings.matching)
    if not exposures.photo:
        raise InputError([Complaint("no photo has an event", files.source.name), *_as_complaints(warnings)])
    stations, more = stations_in_project(
        with_wanted_motions(exposures, project),
        project.definition.crs,
        project.definition.ground_unit,
        settings.position_error,
        settings.angle_error * RADIANS_PER_DEGREE,
    )
    return written_stations(state, stations, (*warnings, *more), settings, dry_run=dry_run)


def has_rolling_shutter(project: ProjectFolder) -> bool:
    """Return whether a camera of the project is read row by row: motions of its stations are wanted."""
    return any(camera.is_rolling for camera in project.definition.cameras)


def with_wanted_motions(exposures: Exposures, project: ProjectFolder) -> Exposures:
    """Return exposures with motions where a camera of the project is read row by row, else without."""
    return exposures if has_rolling_shutter(project) else replace(exposures, motions=None)


def written_stations(
    state: ProjectState,
    stations: tuple[Station, ...],
    warnings: tuple[ProjectWarning, ...],
    settings: ImportSettings,
    more: tuple[EditedText, ...] = (),
    *,
    dry_run: bool,
) -> Change[ImportedStations]:
    """Return the change that writes stations, photos that are new, and more texts.

    Raises
    ------
    InputError
        If the .STA file has stations of these photos, and they are not to be replaced.
    """
    project = state.project
    path = project.folder / f"{project.definition.control_files}.STA"
    control, replaced = with_stations(path, project.shown(path), stations, settings.replaces)
    keys = set(map(record_key, known_photos(state)))
    photos = tuple(station.photo for station in stations if record_key(station.photo) not in keys)
    if photos and keys and len(photos) == len(stations):
        known = first_names(known_photos(state), 2)
        text = (
            f"{counted_names('photo', photos)} are not in the project, which has {known}: they are added to orip.toml; "
            "if they are the same ones, remove them there, and rename them in the file"
        )
        warnings = (*warnings, ProjectWarning("new-photos", "", text))
    of_photos = (with_photos(project, photos, settings.camera),) if photos else ()
    outcome = ImportedStations(project, project.shown(path), stations, replaced, photos, warnings, dry_run)
    if dry_run:
        return Change(state, outcome)
    lock = project.exterior
    locks = (lock,) if is_written(lock) else ()
    return Change(state, outcome, locks=locks, is_compared=False, edited_texts=(control, *of_photos, *more))


def known_photos(state: ProjectState) -> list[str]:
    """Return the names of the photos of stores and of orip.toml."""
    known = [photo.name for photo in state.records.photos.values()]
    return known + [
        photo.name for photo in state.project.definition.photos if record_key(photo.name) not in state.records.photos
    ]


def _read(project: ProjectFolder, files: ImportFiles, photos: Sequence[str]) -> Sources:
    def read(path: Path) -> Parsed[Epochs]:
        there = project.folder / path
        deviations = None if files.deviations is None else project.folder / files.deviations
        unit = project.definition.ground_unit
        return read_epochs(there, project.shown(there), files.columns, deviations, unit)

    source = read(files.source)
    events = None if files.events is None else read(files.events)
    times = None if files.photo_times is None else read(files.photo_times)
    found: list[Parsed[Epochs]] = [parsed for parsed in (source, events, times) if parsed is not None]
    complaints = [complaint for parsed in found for complaint in parsed.complaints]
    complaints += [
        Complaint(_nothing_in(project.folder / parsed.value.shown), parsed.value.shown)
        for parsed in found
        if not len(parsed.value) and not parsed.complaints
    ]
    if complaints:
        raise InputError(complaints)
    solution = source.value
    if files.mount is not None and solution.mount != "photo":
        solution = replace(solution, mount=files.mount)
    if events is None:
        solution = _without_places_at_zero(solution)
    return Sources(solution, None if events is None else events.value, None if times is None else times.value, photos)


def _nothing_in(path: Path) -> str:
    if path.is_dir():
        return "there are no images in this folder; name the folder of the photos, or a file of their positions"
    return "there are no epochs in this file; give one with rows below its heading"


def _without_places_at_zero(found: Epochs) -> Epochs:
    """Return epochs without places at 0, 0: receivers and cameras without a fix write that.

    Coordinates of a plain system are such ones only if all others lie far away.
    """
    at_zero = (found.place[:, :2] == 0.0).all(axis=1)
    if not at_zero.any():
        return found
    others = found.place[np.isfinite(found.place[:, :2]).all(axis=1) & ~at_zero, :2]
    if not found.is_geographic:
        extent = np.ptp(others, axis=0) if len(others) else np.inf
        if not (np.abs(others).min(axis=0, initial=np.inf) > _FAR * extent).any():
            return found
    return replace(found, place=np.where(at_zero[:, None], np.nan, found.place))


def _as_complaints(warnings: Iterable[ProjectWarning]) -> Iterator[Complaint]:
    return (Complaint(warning.text, warning.where) for warning in warnings)


def with_stations(path: Path, shown: str, stations: Sequence[Station], replaces: bool) -> tuple[EditedText, int]:
    """Return the .STA file with stations, and how many of them it had before."""
    digest = digest_of_text(path)
    lines: ControlLines = read_control_lines(path, shown)
    keys = {record_key(station.photo) for station in stations}
    if heads := [line for line in lines.records() if is_heading(line)]:
        message = (
            f"the file has {heads[0].fields[0].text} for all its stations, but imported ones are in the project's "
            "coordinates; move it away, or give its stations in the project's coordinates"
        )
        raise InputError.single(message, shown, heads[0].number)
    there = [line for line in lines.records() if record_key(line.fields[0].text) in keys]
    if there and not replaces:
        raise InputError(
            [
                Complaint(
                    f"photo '{line.fields[0].text}' has a station already; give --replace to put the new one in its "
                    "place",
                    shown,
                    line.number,
                )
                for line in there
            ]
        )
    text = lines.without_lines(line.number for line in there).text
    if text and not text.endswith("\n"):
        text += "\n"
    new = text + stations_text(stations)
    parsed = parse_stations(Parsed(new.removeprefix("\ufeff").splitlines()), shown)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    return EditedText(path, digest, new, "the file is unchanged"), len(there)


def with_photos(project: ProjectFolder, photos: Sequence[str], camera: str | None) -> EditedText:
    """Return orip.toml with records of photos at its end."""
    cameras = [record.name for record in project.definition.cameras]
    if camera is None and len(cameras) != 1:
        message = f"{len(photos)} photos are new, {photos[0]} first; name their camera with --camera"
        raise InputError.single(message, project.shown(project.text))
    shown = project.shown(project.text)
    data, complaints = read_bytes(project.text, shown)
    if data is None:
        raise InputError(complaints)
    text = data.decode("utf-8")
    text += "" if text.endswith("\n") else "\n"
    for photo in photos:
        text += "\n" + toml_table("[[photo]]", {"name": photo, "camera": camera or cameras[0]})
    parsed = parse_project(text, shown)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    return EditedText(project.text, digest_of_text(project.text), text, "the file is unchanged")
