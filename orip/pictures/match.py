"""`orip match`: tie points from the images of a project's photos to a measurement file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.errors import Complaint, InputError, ProjectWarning, UsageError
from orip.files.log.writing import points_header
from orip.files.text.regular_file import beginning, file_digest
from orip.images.image_files import read_eight_bits
from orip.images.images_of_photos import image_fault, origin_of_pixels, paths_of_photos
from orip.images.matching.least_squares import Fate
from orip.pictures.forecast import Forecast, Pace, Work
from orip.pictures.matching.features import DETAIL
from orip.pictures.matching.pairs import expected_pairs
from orip.pictures.matching_cache import MatchingCache
from orip.pictures.tie_points import Picture, TiePoints, TieSettings, features_of, find_tie_points
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Photo, Scan
from orip.structs import replace
from orip.threads import available_threads
from orip.workflow.project.commit import Change
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import is_measurement_file

MEASUREMENTS = "TIES.MEA"
PREFIX = "TP"
"""What the names of tie points begin with."""

_HEAD = "! tie points by orip match: written anew by each run of it\n"
FATE_WORDS = {
    Fate.CORRELATION: "without correlation",
    Fate.NO_CONVERGENCE: "without convergence",
    Fate.DRIFT: "that drifted",
    Fate.DEFORMED: "deformed",
    Fate.WEAK: "of weak texture",
    Fate.ALONE: "left alone",
    Fate.CONTRADICTS: "that contradict others",
}
"""Why rays were rejected."""
_FEW_FEATURES = 50
_SHOWN = 5


class MatchRequest(Struct, frozen=True):
    """What is to be matched.

    Parameters
    ----------
    bundle : str
        Whose measurements the tie points are.
    images : Path or None
        Folder of the images; None: that of the project.
    settings : TieSettings
    replaces : bool
        A file that is no earlier output of matching is replaced, too.
    adjusts : bool
        An adjustment follows: a forecast has it, too.
    """

    bundle: str
    images: Path | None = None
    settings: TieSettings = TieSettings()
    replaces: bool = False
    adjusts: bool = False


class MatchOutcome(Struct, frozen=True):
    """What was matched.

    Parameters
    ----------
    shown : str
        The measurement file.
    photos : tuple of str
        Those with images.
    rays : tuple of int
        Of each of them.
    found : TiePoints
    warnings : tuple of ProjectWarning
    """

    shown: str
    photos: tuple[str, ...]
    rays: tuple[int, ...]
    found: TiePoints
    warnings: tuple[ProjectWarning, ...]


class _Frame(Struct, frozen=True):
    """How a photo is measured: size of its image if known, principal distance in pixels, and the origin of pixels."""

    size: tuple[int, int] | None
    focal: float
    origin: float


def require_packages() -> None:
    """Say what to install where packages for images are missing.

    Raises
    ------
    UsageError
    """
    try:
        import cv2  # noqa: F401
        import PIL  # noqa: F401
        import pycolmap  # noqa: F401
    except ImportError as error:
        message = f"matching needs the package {error.name}, which is not installed: pip install 'orip[images]'"
        raise UsageError(message) from error


def match_photos(
    state: ProjectState, request: MatchRequest, foretell: Callable[[Forecast], None] = lambda _: None
) -> Change[MatchOutcome]:
    """Return the tie points of a project's photos, to be written into a measurement file.

    `foretell` is given how long it will take and how much memory, once the first photos and pairs say so.

    Raises
    ------
    UsageError
        If a package is missing, or another file has the place of the measurement file.
    InputError
        If there are no two photos with images, or no two that show the same.
    """
    require_packages()
    path = state.project.folder / MEASUREMENTS
    shown = state.project.shown(path)
    before = digest_of_text(path)
    if before is not None and not request.replaces and beginning(path, len(_HEAD)) != _HEAD:
        message = f"{shown} is no earlier output of 'orip match': move it away, or give --force to replace it"
        raise UsageError(message)
    photos, frames = _photos_with_frames(state)
    cache = MatchingCache(state.project.folder, f"{DETAIL} {request.settings.features}")
    given, warnings = _pictures(state, photos, frames, request.images)
    pace = Pace(_work(state, photos, given, request), foretell)
    features = []
    pictures = []
    for picture, (of_picture, fault) in zip(given, features_of(given, request.settings, cache, pace), strict=True):
        if of_picture is None:
            warnings.append(_not_used(picture.name, fault))
        else:
            pictures.append(picture)
            features.append(of_picture)
    _require_two(state, request, len(pictures), warnings)
    settings = _with_places(state, [photos[record_key(picture.name)] for picture in pictures], request.settings)
    settings = replace(settings, cameras=_cameras(state, [photos[record_key(p.name)] for p in pictures]))
    found = find_tie_points(pictures, features, settings, cache, pace)
    names = tuple(picture.name for picture in pictures)
    warnings += _weaknesses(names, found)
    if not len(found.tracks):
        raise InputError.single(_nothing_found(found), shown)
    if not is_measurement_file(state.project, path):
        text = f"is not among the measurement_files of {state.project.shown(state.project.text)}: add it there"
        warnings.append(ProjectWarning("not-a-measurement-file", shown, text))
    origins = np.array([frames[record_key(name)].origin for name in names])
    text = _HEAD + "".join(_blocks(request.bundle, names, found, origins))
    rays = tuple(np.bincount(found.tracks.photo, minlength=len(names)).tolist())
    outcome = MatchOutcome(shown, names, rays, found, tuple(warnings))
    return Change(state, outcome, edited_texts=(EditedText(path, before, text, "the file is unchanged"),))


def _photos_with_frames(state: ProjectState) -> tuple[dict[str, Photo], dict[str, _Frame]]:
    """Return the photos of the project, and how they are measured, by the keys of their names."""
    definition = state.project.definition
    photos = {record_key(photo.name): photo for photo in definition.photos} | dict(state.records.photos)
    cameras = {record_key(camera.name): camera for camera in definition.cameras} | dict(state.records.cameras)
    templates = {record_key(t.name): t for t in definition.templates} | dict(state.records.templates)
    frames, complaints = {}, []
    for key, photo in photos.items():
        template = None if photo.template is None else templates.get(record_key(photo.template))
        scan = photo.scan or (None if template is None else template.scan)
        frame = _frame(cameras.get(record_key(photo.camera)), scan)
        if frame is None:
            message = (
                f"photo '{photo.name}' is measured in millimetres: give its camera a sensor, or the photo a scan, "
                "so that pixels can be measured"
            )
            complaints.append(Complaint(message, state.project.shown(state.project.text)))
        else:
            frames[key] = frame
    if complaints:
        raise InputError(complaints)
    return photos, frames


def _cameras(state: ProjectState, photos: Sequence[Photo]) -> tuple[Camera, ...]:
    """Return the cameras of photos."""
    known = {record_key(camera.name): camera for camera in state.project.definition.cameras}
    known |= dict(state.records.cameras)
    return tuple(known[record_key(photo.camera)] for photo in photos)


def _frame(camera: Camera | None, scan: Scan | None) -> _Frame | None:
    origin = origin_of_pixels(camera, scan)
    if camera is None or origin is None:
        return None
    c = camera.parameters[0]
    if camera.sensor is not None:
        size = (camera.sensor.columns, camera.sensor.rows)
        return _Frame(size, c * camera.sensor.columns / camera.sensor.width, origin)
    assert scan is not None, "its pixels have an origin"
    return _Frame(None, c / scan.pixel[0], origin)


def _pictures(
    state: ProjectState, photos: Mapping[str, Photo], frames: Mapping[str, _Frame], images: Path | None
) -> tuple[list[Picture], list[ProjectWarning]]:
    """Return the photos that have images of use, and warnings of the others."""
    project = state.project
    named = {photo.name: photo.image for photo in photos.values()}
    paths, complaints = paths_of_photos(named, project.folder, images)
    if complaints:
        raise InputError(complaints)
    pictures: list[Picture] = []
    warnings: list[ProjectWarning] = []
    if missing := [name for name in named if name not in paths]:
        warnings.append(ProjectWarning("no-image", _listed(missing), "no image of this name was found: not matched"))
    seen: dict[str, str] = {}
    for name, path in paths.items():
        size, fault = image_fault(path, frames[record_key(name)].size)
        if size is None:
            warnings.append(_not_used(name, fault))
            continue
        digest = file_digest(path)
        if digest in seen:
            warnings.append(_not_used(name, f"its image is the same file as that of photo {seen[digest]}"))
            continue
        seen[digest] = name
        pictures.append(Picture(name, digest, size, frames[record_key(name)].focal, partial(read_eight_bits, path)))
    return pictures, warnings


def _work(state: ProjectState, photos: Mapping[str, Photo], pictures: Sequence[Picture], request: MatchRequest) -> Work:
    """Return what is to be done with pictures."""
    settings = _with_places(state, [photos[record_key(picture.name)] for picture in pictures], request.settings)
    pairs = expected_pairs(len(pictures), settings.places, settings.neighbours)
    megapixels = sum(picture.size[0] * picture.size[1] for picture in pictures) / 1e6 / max(len(pictures), 1)
    return Work(len(pictures), megapixels, pairs, settings.points, available_threads(), request.adjusts)


def _not_used(photo: str, fault: str) -> ProjectWarning:
    return ProjectWarning("image-not-used", f"photo {photo}", f"{fault}; it is not matched")


def _require_two(state: ProjectState, request: MatchRequest, count: int, warnings: Sequence[ProjectWarning]) -> None:
    if count >= 2:
        return
    where = str(request.images or state.project.shown(state.project.text))
    message = (
        f"{'only one photo has' if count else 'no photo has'} an image that can be matched, and two are needed: name "
        "the images as the photos (IMG_0012.JPG for photo IMG_0012), and their folder with --images"
    )
    faults = [Complaint(warning.text, warning.where) for warning in warnings]
    raise InputError([Complaint(message, where), *faults])


def _with_places(state: ProjectState, photos: Sequence[Photo], settings: TieSettings) -> TieSettings:
    """Return the settings with the places of the photos, where stations or preliminary values say them."""
    stations = {} if state.texts.control.complaints else {
        record_key(station.photo): station.position for station in state.texts.control.value.stations
    }  # fmt: skip
    places = np.full((len(photos), 3), np.nan)
    for row, photo in enumerate(photos):
        known = stations.get(record_key(photo.name), photo.orientation[:3])
        places[row] = [np.nan if value is None else value for value in known]
    is_known = ~np.isnan(places).any(axis=1)
    if len(photos) <= settings.neighbours or is_known.sum() < 0.8 * len(photos):
        return settings
    return replace(settings, places=places)


def _blocks(
    bundle: str, photos: Sequence[str], found: TiePoints, origins: NDArray[np.float64]
) -> Iterable[str]:  # fmt: skip
    """Yield the measurements of the photos."""
    tracks = found.tracks
    for number, photo in enumerate(photos):
        rays = np.flatnonzero(tracks.photo == number)
        if not rays.size:
            continue
        yield points_header(bundle, photo) + "\n"
        places = found.place[rays] - origins[number]
        errors = np.maximum(found.error[rays], 0.001)
        for track, (x, y), (ex, ey) in zip(tracks.track[rays].tolist(), places.tolist(), errors.tolist(), strict=True):
            yield f"  {PREFIX}{track + 1} {x:.3f} {y:.3f} {ex:.3f}px {ey:.3f}px\n"


def _weaknesses(photos: Sequence[str], found: TiePoints) -> list[ProjectWarning]:
    """Return warnings of photos that matching has not connected, or hardly."""
    warnings = []
    flat = [name for name, count in zip(photos, found.features, strict=True) if count < _FEW_FEATURES]
    if flat:
        text = f"fewer than {_FEW_FEATURES} features were found: the image is blurred, dark or without texture"
        warnings.append(ProjectWarning("few-features", _listed(flat), text))
    group = _groups(found, len(photos))
    if not len(found.tracks):
        return warnings
    alone = [name for name, count in zip(photos, np.bincount(group)[group], strict=True) if count == 1]
    if alone:
        text = "no other photo shows the same: not connected to the block"
        warnings.append(ProjectWarning("photo-not-connected", _listed(alone), text))
    parts = int((np.bincount(group) > 1).sum())
    if parts > 1:
        text = f"the photos fall into {parts} parts that no tie point connects: add photos between them, or control"
        warnings.append(ProjectWarning("block-in-parts", "", text))
    return warnings


def _groups(found: TiePoints, count: int) -> NDArray[np.intp]:
    """Return to which part of the block each photo belongs."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    tracks = found.tracks
    nodes = count + len(tracks)
    graph = coo_matrix((np.ones(len(tracks.track)), (tracks.photo, count + tracks.track)), shape=(nodes, nodes))
    label = connected_components(graph, directed=False)[1][:count]
    group: NDArray[np.intp] = np.unique(label, return_inverse=True)[1].astype(np.intp)
    return group


def _nothing_found(found: TiePoints) -> str:
    if max(found.features) < _FEW_FEATURES:
        return "no photo has features that can be matched: the images are blurred, dark or without texture"
    if not found.pairs:
        return (
            f"no two photos show the same: none of {found.compared} pairs has matches that agree with a relative "
            "orientation; check that the photos overlap"
        )
    rejected = sum(count for fate, count in found.fates.items() if fate != Fate.MATCHED)
    return f"least-squares matching has rejected all rays, {rejected} of them: see what --features finds"


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _SHOWN} more" if len(names) > _SHOWN else ""
    return ", ".join(names[:_SHOWN]) + more
