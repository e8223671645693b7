"""A project of another program in orip's conventions: names, cameras, pixels, and the reading of its poses."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray, rows_of_groups
from orip.errors import Complaint, InputError
from orip.exchange.conversion.cameras import FAITHFUL_PX, ConvertedCamera, convert_camera
from orip.exchange.conversion.control_datum import ControlDatum
from orip.exchange.conversion.determined import determined_parameters, unknown_parameters
from orip.exchange.conversion.ground import LocalGround, in_local_ground, local_ground
from orip.exchange.conversion.image_axes import UnsuitableCameraError
from orip.exchange.conversion.poses import orip_poses
from orip.exchange.conversion.reprojection import (
    MOST_COARSE_PX,
    Reprojection,
    fitting_reading,
    said_of_far_rays,
    said_of_reading,
)
from orip.exchange.project.moved import datum_of_control, moved_block, placed_at_control, said_of_datum
from orip.exchange.sources.names import mark_names, photo_names, point_names, unique_names
from orip.geometry.ground_crs import known_crs
from orip.records.exchanged import ExchangedProject
from orip.structs import replace
from orip.wording import counted, counted_names

_CAMERA = "CAMERA"

_VISIBLE_PX = 0.001
"""Differences of cameras that are worth a note."""

_FARTHEST_CONTROL, _KILOMETRE = 100_000.0, 1000.0
"""Metres from the photos to control points beyond which one of their systems is not what the file says."""

_LARGEST_IMAGE, _LARGEST_PLACE = 1e7, 1e12
"""Coordinates in a photo (pixels, mm) and on the ground beyond which a file is damaged."""


class ExchangeSettings(Struct, frozen=True):
    """How a project is imported.

    Parameters
    ----------
    frame : tuple of 2 int, or None
        Columns and rows of cameras whose size no file says.
    corrects_distortion : bool
        Cameras may be fitted however badly: measurements are corrected for what orip's camera cannot represent.
    holds_cameras : bool
        Cameras are not adjusted.
    precision : float or None
        A-priori error of the measurements, pixels; None: as the format says.
    reference : Path or None
        Table of references that count before those of the project.
    reference_columns : str
        Letters of its columns; empty: its heading names them.
    """

    frame: tuple[int, int] | None = None
    corrects_distortion: bool = False
    holds_cameras: bool = False
    precision: float | None = None
    reference: Path | None = None
    reference_columns: str = ""


class ImportedBlock(Struct, frozen=True):
    """What is imported, in orip's conventions; arrays in the order of `project`.

    Parameters
    ----------
    photos, points : tuple of str
        Names that orip gives them.
    marks : mapping of str to str
        Names that orip gives to marks, control points and ends of distances, by those in `project`.
    pixels : array (k, 2)
        Of the rays, as orip counts them.
    deviations : array (k,)
        A-priori errors of the rays, pixels; NaN where the source does not say.
    notes : tuple of str
        What was lost or assumed, a sentence each.
    datum : ControlDatum or None
        How photos and points were moved to the control points; None: they stand as in the source.
    """

    project: ExchangedProject
    cameras: tuple[ConvertedCamera, ...]
    photos: tuple[str, ...]
    points: tuple[str, ...]
    marks: Mapping[str, str]
    pixels: FloatArray
    deviations: FloatArray
    found: Reprojection
    notes: tuple[str, ...]
    datum: ControlDatum | None = None

    @property
    def camera_of_ray(self) -> IntArray:
        """Return the place among the cameras of each ray, array (k,)."""
        return camera_of_ray(self.project)


def camera_of_ray(project: ExchangedProject) -> IntArray:
    """Return the place among the cameras of each ray, array (k,)."""
    of_photo = np.array([photo.camera for photo in project.photos], dtype=np.int64)
    return of_photo[project.rays.photo]


def imported_block(project: ExchangedProject, shown: str, settings: ExchangeSettings) -> ImportedBlock:
    """Return a project in orip's conventions.

    Parameters
    ----------
    shown : str
        Its source, for messages.

    Raises
    ------
    InputError
        If a camera is not one that orip has, or no reading of the poses fits the measurements.
    """
    faults = list(_impossible(project))
    if faults:
        raise InputError([Complaint(fault, shown) for fault in faults])
    is_of_its_own = project.frame.kind == "plain" and bool(project.control_crs) and project.crs is None
    ground = local_ground(project)
    if ground is not None:
        project = _in_ground(project, ground, shown)
    cameras = _cameras(project, shown, settings)
    pixels = _pixels(project, cameras, shown, corrects_distortion=settings.corrects_distortion)
    found, is_declared = fitting_reading(project, cameras, pixels)
    if not found.fits_coarsely:
        raise InputError.single(_misfit(found, settings.frame), shown)
    if is_of_its_own:
        project, found, datum, moved = placed_at_control(project, cameras, pixels, found)
    else:
        datum = datum_of_control(project, cameras, pixels, found)
        moved = [] if datum is None else said_of_datum(datum, project.ground_unit)
        if datum is not None:
            project, found = moved_block(project, found, datum)
    cameras, held = _determined(project, cameras, pixels, found)
    said = said_of_reading(found, is_declared=is_declared)
    coarse = [] if found.fits else [_coarse(found)]
    notes = [
        *project.notes,
        *coarse,
        *said_of_far_rays(project, found),
        *([] if said is None else [f"{said[0].upper()}{said[1:]}."]),
        *moved,
        *_said_of_cameras(cameras),
        *held,
    ]
    marks = mark_names(_names_of_marks(project))
    return ImportedBlock(
        project,
        cameras,
        photo_names([photo.name for photo in project.photos]),
        point_names(project.points, marks),
        marks,
        pixels,
        _deviations(project, cameras),
        found,
        tuple(notes),
        datum,
    )


def _names_of_marks(project: ExchangedProject) -> Iterator[str]:
    """Yield the names of all that is no track, whether it is measured or not."""
    yield from project.points.marks
    yield from (point.name for point in project.control)
    for distance in project.distances:
        yield from (distance.start, distance.end)


def _in_ground(project: ExchangedProject, ground: LocalGround, shown: str) -> ExchangedProject:
    """Return a project in a local system; latitudes that stand before longitudes are exchanged.

    Raises
    ------
    InputError
        If control or observed positions are so far from the photos that their systems cannot be what the files say.
    """
    local = in_local_ground(project, ground)
    control = [point.coordinates for point in local.control]
    named = project.control_named or "the system of the control points"
    apart = _apart(local, control)
    if apart > _FARTHEST_CONTROL and project.control_crs and known_crs(project.control_crs).is_geographic:
        turned = tuple(
            replace(point, coordinates=(point.coordinates[1], point.coordinates[0], point.coordinates[2]))
            for point in project.control
        )
        with contextlib.suppress(InputError):  # no latitude
            other = in_local_ground(replace(project, control=turned), ground)
            if _apart(other, [point.coordinates for point in other.control]) <= _FARTHEST_CONTROL:
                said = "Control points have their latitude before their longitude: they were read so."
                return replace(other, notes=(*other.notes, said))
    if apart <= _FARTHEST_CONTROL:
        named = "the system of the observed positions of the photos"
        apart = _apart(local, [station.position for station in local.stations if station.has_position])
    if apart <= _FARTHEST_CONTROL:
        return local
    message = (
        f"{named} and {project.frame.named} name places {apart / _KILOMETRE:.0f} km apart (hemisphere, zone, or x and "
        f"y exchanged?); correct {named}, or leave these points out, and import again"
    )
    raise InputError.single(message, shown)


def _apart(project: ExchangedProject, places: Sequence[tuple[float | None, ...]]) -> float:
    """Return how far places in the middle are from the photos, metres; 0 where either are nowhere."""
    _, centres = orip_poses(project.photos, project.readings[0])
    centres = centres[np.isfinite(centres).all(axis=1)]
    known = np.array([place for place in places if None not in place], dtype=np.float64).reshape(-1, 3)
    if not len(centres) or not len(known):
        return 0.0
    return float(np.linalg.norm(np.median(known, axis=0) - np.median(centres, axis=0)))


def _impossible(project: ExchangedProject) -> Iterator[str]:
    """Yield what no project can have: a file that says it is damaged, or was read as what it is not."""
    if not project.photos and not project.is_calibration:
        yield "the project has no photos"
    image = ~(np.abs(project.rays.image) <= _LARGEST_IMAGE).all(axis=1)
    if image.any():
        row = int(np.flatnonzero(image)[0])
        of = project.photos[project.rays.photo[row]].name
        point = project.points.names[project.rays.point[row]]
        yield f"{counted(int(image.sum()), 'measurement')} cannot be: point {point} in photo {of} is far off any image"
    far = np.abs(project.points.coordinates) > _LARGEST_PLACE
    if far.any():
        name = project.points.names[int(np.flatnonzero(far.any(axis=1))[0])]
        yield f"{counted(int(far.any(axis=1).sum()), 'point')} cannot be where the file says: {name} first"
    for photo in project.photos:
        if any(not abs(value) <= _LARGEST_PLACE for value in (*photo.position, *photo.rotation)):
            yield f"photo {photo.name} cannot be where the file says"


def _cameras(project: ExchangedProject, shown: str, settings: ExchangeSettings) -> tuple[ConvertedCamera, ...]:
    given = [f"{_CAMERA}{camera.name}" if camera.name.isdigit() else camera.name for camera in project.cameras]
    names = unique_names(given, _CAMERA, ignoring_case=True)
    used = set(camera_of_ray(project).tolist())
    cameras, complaints = [], []
    for number, (camera, name) in enumerate(zip(project.cameras, names, strict=True)):
        source = camera
        if settings.frame is not None and not (camera.columns and camera.rows):
            source = replace(camera, columns=settings.frame[0], rows=settings.frame[1])
        try:
            converted = convert_camera(source, name, accepts_any_fit=settings.corrects_distortion)
        except UnsuitableCameraError as fault:
            complaints.append(Complaint(str(fault), shown))
            continue
        unknown = unknown_parameters(source, is_exact=converted.is_exact)
        if settings.holds_cameras or (number not in used and used):
            unknown = ()
        cameras.append(replace(converted, camera=replace(converted.camera, unknown=unknown)))
    if complaints:
        raise InputError(_at_once(complaints, project, settings, shown))
    return tuple(cameras)


def _determined(
    project: ExchangedProject, cameras: tuple[ConvertedCamera, ...], pixels: FloatArray, found: Reprojection
) -> tuple[tuple[ConvertedCamera, ...], list[str]]:
    """Return cameras without those unknowns that nothing determines, and a sentence that names them."""
    if not project.rays.photo.size:  # nothing is measured yet
        return cameras, []
    known = determined_parameters(project, cameras, pixels, found)
    lost: dict[tuple[str, ...], list[str]] = {}
    for converted, names in zip(cameras, known, strict=True):
        gone = tuple(name for name in converted.camera.unknown if name not in names)
        if gone:
            lost.setdefault(gone, []).append(converted.camera.name)
    said = [
        f"{', '.join(gone)} of {counted_names('camera', names)} held: the photos cannot determine that, as there are "
        "too few measurements or the points are too level."
        for gone, names in lost.items()
    ]
    return tuple(
        replace(converted, camera=replace(converted.camera, unknown=names))
        for converted, names in zip(cameras, known, strict=True)
    ), said


def _at_once(
    complaints: list[Complaint], project: ExchangedProject, settings: ExchangeSettings, shown: str
) -> list[Complaint]:
    """Return complaints; one in their place where they all are that no file says the size of the photos."""
    sizeless = [camera.name for camera in project.cameras if not (camera.columns and camera.rows)]
    if settings.frame is not None or not 1 < len(sizeless) == len(complaints):
        return complaints
    message = (
        f"no file says how many columns and rows the photos of {counted(len(sizeless), 'camera')} have "
        f"({sizeless[0]} first); give it with --frame COLUMNSxROWS"
    )
    return [Complaint(message, shown)]


def _pixels(
    project: ExchangedProject, cameras: tuple[ConvertedCamera, ...], shown: str, *, corrects_distortion: bool
) -> FloatArray:
    """Return the measurements as orip counts them, corrected for what fitted cameras do not hold if that is wanted."""
    pixels = np.array(project.rays.image, dtype=np.float64)
    for converted, rows in zip(cameras, rows_of_groups(camera_of_ray(project), len(cameras)), strict=True):
        pixels[rows] = converted.pixels(pixels[rows])
        if corrects_distortion:
            pixels[rows] = converted.corrected_pixels(pixels[rows])
        elif _is_corrected(converted):
            corrected = converted.corrected_pixels(pixels[rows])
            # far outside the frame the formula of the camera may have no inverse: such measurements are wrong anyway
            pixels[rows] = np.where(np.isfinite(corrected), corrected, pixels[rows])
    lost = int((~np.isfinite(pixels).all(axis=1)).sum())
    if lost:
        message = (
            f"{counted(lost, 'measurement')} cannot be corrected for the distortion: the formula of the camera has no "
            "inverse there; leave these measurements out in the other program"
        )
        raise InputError.single(message, shown)
    return pixels


def _deviations(project: ExchangedProject, cameras: tuple[ConvertedCamera, ...]) -> FloatArray:
    """Return the a-priori errors of the measurements in pixels, whatever unit they have in the source."""
    deviations = np.array(project.rays.deviation, dtype=np.float64)
    for converted, rows in zip(cameras, rows_of_groups(camera_of_ray(project), len(cameras)), strict=True):
        deviations[rows] = converted.pixel_errors(deviations[rows])
    return deviations


def _is_corrected(converted: ConvertedCamera) -> bool:
    """Return whether measurements are corrected for what a camera of orip does not hold, without being asked."""
    return converted.worst_px > FAITHFUL_PX


def _coarse(found: Reprojection) -> str:
    return (
        f"Half of the residuals exceed {found.typical:.0f} px: photos, points and measurements do not belong to "
        "the same adjustment, or many of them are wrong."
    )


def _misfit(found: Reprojection, frame: tuple[int, int] | None) -> str:
    size = "" if frame is None else f"--frame {frame[0]}x{frame[1]} is the size of the images, and that "
    known = found.lengths
    typical = f"{found.typical:.0f} px" if known.size else "nothing, as all points are behind the photos"
    return (
        f"photos and points do not fit the measurements in any reading of the rotations: half of the residuals exceed "
        f"{typical}, where {MOST_COARSE_PX:.0f} px are allowed, and {int(found.is_behind.sum())} of "
        f"{len(found.is_behind)} rays have their point behind the camera; check that {size}all files belong to "
        "the same state of the project and to the same images"
    )


def _said_of_cameras(cameras: tuple[ConvertedCamera, ...]) -> Iterator[str]:
    for converted in cameras:
        if converted.worst_px >= _VISIBLE_PX:
            done = "; measurements are corrected by that" if _is_corrected(converted) else ""
            model = f" ({converted.source.model})" if converted.source.model else ""
            yield (
                f"Camera {converted.camera.name}{model} is fitted: over "
                f"the frame it differs by up to {converted.worst_px:.3f} px, RMS {converted.rms_px:.3f} px{done}."
            )
    assumed = [converted.camera.name for converted in cameras if converted.size_is_assumed]
    if assumed:
        yield (
            f"The size of the sensor is not known ({counted(len(assumed), 'camera')}): its longer side is taken as "
            "36 mm, and millimetres of the camera are relative to that."
        )
