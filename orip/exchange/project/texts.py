"""The texts of a project folder that holds what was imported."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, rows_of_groups
from orip.exchange.conversion.cameras import ConvertedCamera
from orip.exchange.conversion.poses import described_reading
from orip.exchange.project.block import ImportedBlock
from orip.exchange.project.kept_rays import KeptRays, rays_kept
from orip.exchange.project.rigs import imported_rigs
from orip.exchange.sources.names import NAMES_FILE, TRACK_MARK, is_named_as_track, names_text, unique_names
from orip.files.control.preliminary_text import coordinates_text
from orip.files.control.stations_text import stations_text
from orip.files.control.text import distances_text, points_text
from orip.files.log.text import points_blocks
from orip.files.project.file_names import fit_file_name
from orip.files.project.records import project_document, project_text
from orip.geometry.ground_crs import known_crs
from orip.geometry.rotation import angles_from_rotation
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.control import ControlDistance, ControlPoint
from orip.records.definition import Antenna, BundleDefinition, Precision, ProjectDefinition
from orip.records.photo import Photo
from orip.structs import replace
from orip.wording import counted

BUNDLE = "MAIN"
README_FILE = "README.md"

_LONGEST_TITLE = 20
_MOST_ITERATIONS = 100
"""Positions of some metres hold a small block so weakly that its steps stay short; others need no more than before."""

_ANTENNA = "GNSS"
_HEIGHT_STEP, _NO_STEP = 200.0, 0.001
"""A-priori errors of the common error of positions, ground units: of heights with another origin, and of X and Y."""

_PIXEL, _WORST_PIXELS = 1.0, 10.0
"""A-priori errors of measurements, pixels, between which residuals decide."""

_CONTROL_ERROR = 0.02
"""A-priori error of control where no file has one, ground units."""


class ImportSource(Struct, frozen=True):
    """What a project was imported from.

    Parameters
    ----------
    format : str
        Its name.
    name : str
        Of the file or folder.
    title : str
        Of the new project.
    is_written : bool
        Results are written in the format, too.
    """

    format: str
    name: str
    title: str
    is_written: bool = True


class ImportedTexts(Struct, frozen=True):
    """Texts of a project folder by their names, orip.toml last, and sentences about what was left out.

    The place of the original is not among them, as it depends on the folder.
    """

    texts: dict[str, str]
    notes: tuple[str, ...]


def imported_texts(block: ImportedBlock, source: ImportSource, precision: float | None) -> ImportedTexts:
    """Return the texts of a new project.

    Parameters
    ----------
    precision : float or None
        A-priori error of the measurements, pixels; None: as the format says.
    """
    notes: list[str] = []
    control = _control(block, notes)
    kept = rays_kept(block, control, notes)
    definition = _definition(block, source, _precision(block, notes) if precision is None else precision, control, kept)
    texts = {f"{BUNDLE}.MEA": _measurements(block, source, kept.rows)}
    texts[f"{BUNDLE}.PRE"] = _preliminary(block, control, kept.rows)
    base = definition.control_files
    if control:
        texts[f"{base}.PNT"] = points_text(control)
    if block.project.distances:
        texts[f"{base}.LEN"] = distances_text(_renamed_distances(block))
    texts |= _stations(block, base, notes)
    texts[NAMES_FILE] = _names(block)
    all_notes = (*block.notes, *notes)
    texts[README_FILE] = _readme(block, source, all_notes)
    texts["orip.toml"] = project_text(project_document(definition))
    return ImportedTexts(texts, all_notes)


def _definition(
    block: ImportedBlock, source: ImportSource, precision: float, control: Sequence[ControlPoint], kept: KeptRays
) -> ProjectDefinition:
    title = project_title(source.title)
    is_free = not any(point.kind == "control" for point in control) and not _usable_stations(block)
    bundle = BundleDefinition(
        BUNDLE,
        Precision(precision, "px"),
        max_iterations=_MOST_ITERATIONS,
        # a block that stands at its control is near its minimum; weights taken at the start would only lead it away
        early_weights="scaled" if block.datum is None else "full",
        datum="free" if is_free else "control",
        repeated_points="both" if kept.has_repetitions else "replace",
    )
    return ProjectDefinition(
        name=title,
        user="",
        camera_file="CAMERAS.CAM",
        temtick_file="TEMTICKS.TIK",
        project_files=title,
        control_files=title,
        measurement_files=("*.MEA",),
        ground_unit=block.project.ground_unit,
        crs=block.project.crs,
        cameras=tuple(converted.camera for converted in block.cameras),
        photos=tuple(_photos(block)),
        bundles=(bundle,),
        antennas=_antennas(block),
        rigs=imported_rigs(block),
    )


def _precision(block: ImportedBlock, notes: list[str]) -> float:
    """Return the a-priori error of measurements; where no file says it that of the residuals, and a pixel at least."""
    if block.project.precision is not None:
        return block.project.precision
    rays = block.project.rays
    found = block.found.measurement_error(rays.photo, rays.point)
    if not np.isnan(block.deviations).any() or not _PIXEL < found < _WORST_PIXELS:
        return _PIXEL
    rounded = float(f"{found:.2g}")
    notes.append(
        f"The source states no measurement precision: {rounded:g} px was estimated from the reprojection residuals; "
        "override it with --precision."
    )
    return rounded


def _antennas(block: ImportedBlock) -> tuple[Antenna, ...]:
    """Return the antenna whose heights have another origin than the control points; X and Y are held."""
    if block.datum is None or not block.datum.height_step:
        return ()
    return (Antenna(_ANTENNA, shift="session", shift_error=(_NO_STEP, _NO_STEP, _HEIGHT_STEP)),)


def project_title(title: str) -> str:
    """Return the name of a project, which its files have too, nearest to the title of what is imported."""
    fit = "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-_") else "_" for letter in title)
    return fit_file_name(fit.strip("_")[:_LONGEST_TITLE] or "imported")


def _photos(block: ImportedBlock) -> Iterable[Photo]:
    degrees = np.degrees(angles_from_rotation(block.found.rotations))
    elements = np.column_stack([block.found.centres, degrees]).tolist()
    for photo, name, values in zip(block.project.photos, block.photos, elements, strict=True):
        camera = block.cameras[photo.camera].camera.name
        yield Photo(name, camera, orientation=tuple(None if value != value else value for value in values))


def _control(block: ImportedBlock, notes: list[str]) -> tuple[ControlPoint, ...]:
    """Return control by the names that orip gives the points, with errors where there are none."""
    control, assumed = [], 0
    for point in block.project.control:
        if any(
            value is not None and error is None for value, error in zip(point.coordinates, point.errors, strict=True)
        ):
            assumed += 1
        sign = -1.0 if point.name in block.project.checks else 1.0
        first, second, third = (
            None if value is None else sign * _CONTROL_ERROR if error is None else error
            for value, error in zip(point.coordinates, point.errors, strict=True)
        )
        control.append(replace(point, name=block.marks[point.name], errors=(first, second, third)))
    if assumed:
        notes.append(
            f"{counted(assumed, 'control point')} had no a-priori errors: {_CONTROL_ERROR} {block.project.ground_unit} "
            "were assumed; write what is known into the .PNT file."
        )
    return tuple(control)


def _measurements(block: ImportedBlock, source: ImportSource, kept: BoolArray) -> str:
    rays = block.project.rays
    names = np.array(block.points, dtype=object)
    order = np.flatnonzero(kept)
    order = order[np.argsort(rays.photo[order], kind="stable")]
    bounds = np.searchsorted(rays.photo[order], np.arange(len(block.photos) + 1))
    pieces = [f"! imported from {source.format}: {source.name}\n"]
    if _is_corrected(block):
        pieces.append(
            "! The measurements are corrected for distortion that the camera of orip cannot represent: these are not "
            "the pixels that were measured.\n"
        )
    for number, photo in enumerate(block.photos):
        rows = order[bounds[number] : bounds[number + 1]]
        if rows.size:
            pieces.append(
                points_blocks(
                    BUNDLE,
                    photo,
                    names[rays.point[rows]].tolist(),
                    block.pixels[rows],
                    block.deviations[rows],
                    rays.is_active[rows],
                )
            )
    return "".join(pieces)


def _is_corrected(block: ImportedBlock) -> bool:
    rows_of_cameras = rows_of_groups(block.camera_of_ray, len(block.cameras))
    return any(
        not converted.is_exact
        and not np.array_equal(converted.pixels(block.project.rays.image[rows]), block.pixels[rows])
        for converted, rows in zip(block.cameras, rows_of_cameras, strict=True)
    )


def _preliminary(block: ImportedBlock, control: Sequence[ControlPoint], kept: BoolArray) -> str:
    coordinates = block.project.points.coordinates
    measured = np.zeros(len(block.points), dtype=np.bool_)
    measured[block.project.rays.point[kept]] = True
    given = {point.name for point in control}
    wanted = measured & np.isfinite(coordinates).all(axis=1)
    rows = [row for row in np.flatnonzero(wanted).tolist() if block.points[row] not in given]
    return coordinates_text([block.points[row] for row in rows], coordinates[rows])


def _usable_stations(block: ImportedBlock) -> bool:
    """Tell whether stations can fix the ground system: they are in the project's coordinates, and some have weight."""
    project = block.project
    is_placed = not project.station_reference.crs or project.crs is not None
    return is_placed and any(station.position_error[0] > 0.0 for station in project.stations)


def _stations(block: ImportedBlock, base: str, notes: list[str]) -> dict[str, str]:
    project = block.project
    if not project.stations:
        return {}
    if project.station_reference.crs and project.crs is None:
        notes.append(
            f"{counted(len(project.stations), 'position')} of photos in {project.station_reference.crs} left out: the "
            "project has no crs."
        )
        return {}
    names = {photo.name: name for photo, name in zip(project.photos, block.photos, strict=True)}
    stations = [replace(station, photo=names[station.photo]) for station in project.stations if station.photo in names]
    reference = project.station_reference
    head = f"CRS {reference.crs}\n" if reference.crs else ""
    head += "ANGLES ROLL PITCH HEADING\n" if reference.navigation else ""
    is_geographic = bool(reference.crs) and known_crs(reference.crs).is_geographic
    return {f"{base}.STA": head + stations_text(stations, is_geographic=is_geographic)} if stations else {}


def _renamed_distances(block: ImportedBlock) -> list[ControlDistance]:
    names = unique_names([one.name for one in block.project.distances], "distance", ignoring_case=True)
    return [
        replace(one, name=name, start=block.marks[one.start], end=block.marks[one.end])
        for name, one in zip(names, block.project.distances, strict=True)
    ]


def _names(block: ImportedBlock) -> str:
    """Return the table of names that are not the original ones; a track is T and its number unless it is listed."""
    points = block.project.points
    rows = [("camera", converted.camera.name, converted.source.name) for converted in block.cameras]
    rows += [("photo", name, photo.name) for name, photo in zip(block.photos, block.project.photos, strict=True)]
    rows += [
        ("point", name, original)
        for original, name in block.marks.items()
        if name != original or is_named_as_track(original)
    ]
    rows += [
        ("track", name, original)
        for original, name in ((original, block.points[place]) for original, place in points.tracks.items())
        if name != TRACK_MARK + original or not is_named_as_track(name)
    ]
    return names_text(rows)


def summary_lines(block: ImportedBlock) -> list[str]:
    """Return what was imported and how it fits, a line each."""
    project, found = block.project, block.found
    counts = [(len(project.photos), "photo"), (len(project.points.names), "point"), (len(project.rays.photo), "ray")]
    counts += [(len(project.rigs), "rig")] if project.rigs else []
    lines = [", ".join(counted(number, noun) for number, noun in counts)]
    if found.lengths.size:
        lines.append(f"reprojection RMS {found.rms:.4g} px{_stated(block)}")
        lines.append(f"rotations read as: {described_reading(found.reading)}")
    return [*lines, _said_of_unknowns(block)] if project.rays.photo.size else lines


def _said_of_unknowns(block: ImportedBlock) -> str:
    """Return which cameras are adjusted, and what of them."""
    free = [converted.camera.unknown for converted in block.cameras if converted.camera.unknown]
    if not free:
        return f"{counted(len(block.cameras), 'camera')} held"
    every = [name for name in CAMERA_PARAMETERS if any(name in unknown for unknown in free)]
    held = len(block.cameras) - len(free)
    also = f"; {held} held" if held else ""
    return f"{counted(len(free), 'camera')} adjusted ({', '.join(every)}){also}"


def _said_of_camera(converted: ConvertedCamera) -> str:
    """Return what of a camera is adjusted, and why nothing is."""
    if converted.camera.unknown:
        return f"adjusted: {', '.join(converted.camera.unknown)}"
    return "held" if converted.source.free else "held, as the source held it or does not say that it has estimated it"


def what_to_write(block: ImportedBlock) -> str:
    """Return what the project needs before it can be adjusted; empty where it has everything."""
    if block.project.is_calibration:
        return "write photos of the camera into orip.toml, and measurements into a .MEA file"
    if not block.project.rays.photo.size:
        return f"write measurements into a .MEA file ('POINTS {BUNDLE} PHOTO', then lines of point and coordinates)"
    return ""


def _stated(block: ImportedBlock) -> str:
    stated = block.project.stated
    if stated is None:
        return ""
    own, words = {
        "rms": (block.found.rms, "RMS"),
        "mean": (block.found.mean, "mean length"),
        "mean_of_points": (block.found.mean_of_points(block.project.rays.point), "mean length over points"),
    }[stated.of]
    also = "" if stated.of == "rms" else f"; {words} {own:.4g} px"
    return f"{also} (the file says: {words} {stated.value:.4g} px)"


def _readme(block: ImportedBlock, source: ImportSource, notes: Sequence[str]) -> str:
    lines = [f"# {project_title(source.title)}", "", f"Imported from {source.format}: `{source.name}`.", ""]
    lines += [f"- {line}" for line in summary_lines(block)]
    back = f"; write the result back with `orip export {source.format} DIR`" if source.is_written else ""
    first = what_to_write(block)
    lines += ["", f"{first[0].upper()}{first[1:]}; then `orip run`." if first else f"Adjust it with `orip run`{back}."]
    lines += ["", "## Cameras", ""]
    for converted in block.cameras:
        sensor = converted.camera.sensor
        size = "" if sensor is None else f"{sensor.columns} × {sensor.rows} px"
        kind = "exact" if converted.is_exact else f"fitted, up to {converted.worst_px:.3f} px off"
        model = f"{converted.source.model}, " if converted.source.model else ""
        lines.append(f"- {converted.camera.name}: {model}{size}; {kind}; {_said_of_camera(converted)}")
    lines += ["", "What the other program has estimated is adjusted; `unknown` in `orip.toml` changes that."]
    lines += ["", "## What was lost, and what was assumed", ""]
    lines += [f"- {note}" for note in notes] or ["- Nothing."]
    lines += ["", f"Names that are not the original ones are in `{NAMES_FILE}`; tie point {TRACK_MARK}17 is track 17."]
    return "\n".join(lines) + "\n"
