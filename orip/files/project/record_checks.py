"""Rules for a single record of orip.toml, beyond the types of its values."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from orip.errors import ProjectWarning
from orip.files.project.file_names import file_name_fault, fit_file_name, pattern_fault, store_path_fault
from orip.files.project.source import Located, ProjectSource
from orip.files.project.tables import Fault, ProjectTable, instead, nearest_word
from orip.files.project.toml_lines import KeyPath
from orip.files.text.separated import METRES
from orip.files.text.shown import shown_token
from orip.records.camera import CAMERA_PARAMETERS, RADIAL_PARAMETERS, READOUT, Camera, Mark
from orip.records.definition import BundleDefinition
from orip.records.names import look_alikes, name_fault, record_key
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.receivers import NetworkSettings
from orip.units import DEGREES_PER_GON, METRES_PER_GROUND_UNIT

_RADIAL_FORMS = ("distortion_isp", "distortion_curve")
"""What may stand in place of A1, A3, A5, A7, A9 of the key `distortion`, which holds P1, P2, B1, B2 then."""
_LISTING_BASES = ("INTERIOR", "PRELIM")
_LEAST_CURVE_RADII = 4
_ANGLES = PHOTO_PARAMETERS[3:]
_FULL_CIRCLE = 360.0
"""Degrees."""
_LONGEST_READOUT = 1.0
"""Seconds."""
_EXAMPLE_C = 8.595
_LONGEST_C = 1e5
"""Millimetres: the longest telescopes have 60 m."""

LineOf = Callable[[KeyPath], int]


def check_project(table: ProjectTable) -> Iterator[Fault]:
    """Check that the project's name can be printed and its files can be named."""
    for key, text in (("name", table.name), ("user", table.user), ("ground_unit", table.ground_unit)):
        if not text.isprintable() or (text and not text.strip()):
            message = f"{key} '{shown_token(text)}' cannot be printed on the listings; write a text on one line"
            yield ("project", key), message
    yield from _check_base_names(table)
    yield from _check_output_folder(table.output_folder)
    for key, path, extension in (
        ("camera_file", table.camera_file, ".CAM"),
        ("temtick_file", table.temtick_file, ".TIK"),
    ):
        fault = store_path_fault(path, extension)
        if fault is not None:
            yield ("project", key), f"{key} '{shown_token(path)}' {fault}"
    for index, pattern in enumerate(table.measurement_files):
        fault = pattern_fault(pattern)
        if fault is not None:
            yield ("project", "measurement_files", index), f"'{shown_token(pattern)}' of measurement_files {fault}"


def _check_base_names(table: ProjectTable) -> Iterator[Fault]:
    """Check the base names of files, which are the project's name unless they are given."""
    base_names = {"project_files": table.project_files, "control_files": table.control_files}
    for key, given in base_names.items():
        if given is not None and (fault := file_name_fault(given)):
            message = f"{key} '{shown_token(given)}' {fault}; write a base name without folder and extension"
            yield ("project", key), message
    unset = [key for key, given in base_names.items() if given is None]
    if unset and (fault := file_name_fault(table.name)):
        other = fit_file_name(table.name)
        message = (
            f"the project's name '{shown_token(table.name)}' {fault}, so it cannot be used in file names; "
            f'choose another name such as {other}, or set {" and ".join(unset)} to "{other}" in orip.toml'
        )
        yield ("project", "name"), message


def _check_output_folder(name: str | None) -> Iterator[Fault]:
    fault = None if name is None else file_name_fault(name)
    if fault is not None:
        message = f"output_folder '{shown_token(str(name))}' {fault}; write the name of a folder in that of the project"
        yield ("project", "output_folder"), f'{message}, such as "results"'


def check_cameras(source: ProjectSource, line_of: LineOf) -> Iterator[Fault]:
    """Check the distortion's form, sensor against fiducials, and the unknown parameters."""
    for camera in source.cameras:
        where = f"camera '{camera.record.name}'"
        table = camera.record
        yield from _radial_distortion(camera, where)
        if table.same_lens_as is None and "c" not in camera.keys:
            yield camera.place, f"{where} has no c; it is required, write for example c = {_EXAMPLE_C}"
        if table.parameters[0] > _LONGEST_C:
            message = (
                f"{where} has c = {table.parameters[0]:g} mm; no lens has more than {_LONGEST_C:g}: write it in mm"
            )
            yield (*camera.place, "c"), message
        if table.sensor is not None and table.fiducials:
            message = f"{where} has both sensor and fiducials; a sensor is for cameras without fiducials"
            yield (*camera.place, "sensor"), message
        yield from _curve(camera, where)
        yield from _readout(camera, where)
        yield from parameter_names((*camera.place, "unknown"), table.unknown, CAMERA_PARAMETERS, f"unknown of {where}")
        yield from _marks((*camera.place, "fiducials"), table.fiducials, f"fiducial mark of {where}", line_of)


def _radial_distortion(camera: Located[Camera], where: str) -> Iterator[Fault]:
    """Check that the radial distortion is given in one form."""
    given = [form for form in _RADIAL_FORMS if form in camera.keys]
    if len(given) > 1:
        message = f"{where} has {' and '.join(given)}; give the radial distortion in one form"
        yield (*camera.place, given[1]), message
    parameters = dict(zip(CAMERA_PARAMETERS, camera.record.parameters, strict=True))
    radial = [name for name in RADIAL_PARAMETERS if parameters[name] != 0.0]
    if given and radial:
        message = (
            f"{where} has {given[0]} and {', '.join(radial)} of distortion; give the radial distortion in one form: "
            f"beside {given[0]} distortion may have P1, P2, B1 and B2"
        )
        yield (*camera.place, given[0]), message


def _readout(camera: Located[Camera], where: str) -> Iterator[Fault]:
    """Check that a readout time is one, and that the camera has rows."""
    record, readout = camera.record, camera.record.parameters[READOUT]
    if abs(readout) > _LONGEST_READOUT:
        message = (
            f"{where} has readout = {readout:g}; it is in seconds from the first row or column to the last one "
            f"(negative in the other order), {_LONGEST_READOUT:g} at most: if this is in milliseconds, write readout = "
            f"{readout / 1000.0:g}"
        )
        yield (*camera.place, "readout"), message
    elif record.sensor is None and (readout or "READOUT" in record.unknown):
        key = "readout" if readout else "unknown"
        yield (*camera.place, key), f"{where} has a readout, but no sensor whose rows it is of; give its sensor, too"


def unit_in_other_words(source: ProjectSource, shown: str, line_of: LineOf) -> Iterator[ProjectWarning]:
    """Warn of a ground unit that orip would know by another name; what it does not know is a label."""
    given = "m" if source.project is None else source.project.ground_unit
    length = METRES.get(given.strip().casefold())
    if given not in METRES_PER_GROUND_UNIT and length is not None:
        known = next(name for name, metres in METRES_PER_GROUND_UNIT.items() if metres == length)
        text = (
            f"ground_unit '{shown_token(given)}' is only a label: orip does not know its length; write "
            f'ground_unit = "{known}" (known are {", ".join(METRES_PER_GROUND_UNIT)})'
        )
        yield ProjectWarning("unknown-unit", f"{shown}:{line_of(('project', 'ground_unit'))}", text)


def directions_without_readout(source: ProjectSource, shown: str, line_of: LineOf) -> Iterator[ProjectWarning]:
    """Warn of cameras for which the order of their rows is given, but not that these are read one after the other."""
    for camera in source.cameras:
        # what orip writes itself has "down" in every camera
        is_said = camera.record.readout_direction != "down" and "readout" not in camera.keys
        if is_said and not camera.record.is_rolling:
            text = (
                f"camera '{camera.record.name}' has readout_direction, but no readout, so all of its rows are taken "
                'at once; add its readout in seconds, or unknown = ["READOUT"], or remove readout_direction'
            )
            where = f"{shown}:{line_of((*camera.place, 'readout_direction'))}"
            yield ProjectWarning("no-readout", where, text)


def _curve(camera: Located[Camera], where: str) -> Iterator[Fault]:
    curve = camera.record.distortion_curve
    if curve is None:
        return
    place = (*camera.place, "distortion_curve")
    # at radius 0 any polynomial of the distortion is 0: such a point determines nothing
    radii = {abs(radius) for radius, _ in curve} - {0.0}
    if len(radii) < _LEAST_CURVE_RADII:
        least = _LEAST_CURVE_RADII
        message = f"distortion_curve of {where} has {len(radii)} different radii above 0; give at least {least}"
        yield place, message
    for index, (radius, _) in enumerate(curve):
        if radius < 0:
            yield (*place, index), f"distortion_curve of {where} has the radius {radius:g}; write 0 or more (mm)"


def parameter_names(place: KeyPath, given: Sequence[str], known: Sequence[str], where: str) -> Iterator[Fault]:
    """Check the names of parameters in a list."""
    for index, name in enumerate(given):
        if name not in known:
            remedy = instead(nearest_word(name, known), known)
            yield (*place, index), f"{where}: '{shown_token(name)}' is not a parameter; {remedy}"
        elif name in given[:index]:
            yield (*place, index), f"{where}: '{name}' comes twice; name it once"


def check_photo_parameters(source: ProjectSource) -> Iterator[Fault]:
    """Check the angles, and the names of constant orientation elements."""
    for photo in source.photos:
        where = f"photo '{photo.record.name}'"
        for key, angle in zip(_ANGLES, photo.record.orientation[3:], strict=True):
            if angle is not None and abs(angle) > _FULL_CIRCLE:
                yield (*photo.place, key), _beyond_the_circle(f"{where} has {key} = {angle:g}", angle)
        names = photo.record.constant
        yield from parameter_names((*photo.place, "constant"), names, PHOTO_PARAMETERS, f"constant of {where}")


def _beyond_the_circle(what: str, angle: float) -> str:
    """Say that an angle is beyond the full circle, and what was meant if it is within that of gon."""
    gon = angle * DEGREES_PER_GON
    meant = f"; if this is in gon, write {gon:g}" if abs(gon) <= _FULL_CIRCLE else ""
    return f"{what}; angles are in degrees, from -{_FULL_CIRCLE:g} to {_FULL_CIRCLE:g}{meant}"


def check_temticks(source: ProjectSource, line_of: LineOf) -> Iterator[Fault]:
    """Check the names of tick marks."""
    for temtick in source.temticks:
        kind = f"tick mark of temtick '{temtick.record.name}'"
        yield from _marks((*temtick.place, "ticks"), temtick.record.ticks, kind, line_of)


def _marks(place: KeyPath, marks: Sequence[Mark], kind: str, line_of: LineOf) -> Iterator[Fault]:
    first: dict[str, int] = {}
    for index, mark in enumerate(marks):
        at = (*place, index, "name")
        fault = name_fault(mark.name)
        if fault is not None:
            yield at, f"{kind}: {fault}; write one word"
        known = first.setdefault(mark.name, index)
        if known != index:
            line = line_of((*place, known, "name"))
            yield at, f"{kind}: '{shown_token(mark.name)}' is already given on line {line}; rename or remove one"


def similar_marks(source: ProjectSource, shown: str, line_of: LineOf) -> Iterator[ProjectWarning]:
    """Warn of marks of one camera or temtick whose names differ only in case or leading zeros."""
    groups = [((*c.place, "fiducials"), f"camera '{c.record.name}'", c.record.fiducials) for c in source.cameras]
    groups += [((*t.place, "ticks"), f"temtick '{t.record.name}'", t.record.ticks) for t in source.temticks]
    for place, where, marks in groups:
        for names in look_alikes(mark.name for mark in marks):
            listed = " and ".join(f"'{shown_token(name)}'" for name in names)
            text = f"marks {listed} of {where} differ only in case or leading zeros; rename one if they are the same"
            yield ProjectWarning("similar-names", f"{shown}:{line_of(place)}", text)


def check_network(network: NetworkSettings) -> Iterator[Fault]:
    """Check that a mark that is held has both its name and its place."""
    if bool(network.hold) != (network.hold_place is not None):
        given, lacking = ("hold", "hold_place") if network.hold else ("hold_place", "hold")
        message = (
            f"{given} of [gnss_network] stands without {lacking}; write both, the name and the place of the mark that "
            "is held, or neither"
        )
        yield ("gnss_network", given), message


def check_bundles(source: ProjectSource) -> Iterator[Fault]:
    """Check that bundles can name files, and their settings against each other."""
    for bundle in source.bundles:
        table, where = bundle.record, f"bundle '{shown_token(bundle.record.name)}'"
        fault = None if name_fault(table.name) else file_name_fault(table.name)
        if fault is not None:
            yield (*bundle.place, "name"), f"{where} {fault}; its files have the same name, choose another"
        if len(source.bundles) > 1 and record_key(table.name) in _LISTING_BASES:
            message = f"{where} would have the listing {record_key(table.name)}_RESULT.OUT of another step; rename it"
            yield (*bundle.place, "name"), message
        if table.start_down_weight > table.max_iterations:
            message = (
                f"start_down_weight of {where} is {table.start_down_weight}, above its max_iterations "
                f"{table.max_iterations}; write at most that (equal: no down-weighting)"
            )
            yield (*bundle.place, "start_down_weight"), message
        if table.control_files is not None and (fault := file_name_fault(table.control_files)):
            message = f"control_files '{shown_token(table.control_files)}' of {where} {fault}; write a base name"
            yield (*bundle.place, "control_files"), f"{message} without folder and extension"
        yield from _datum_points(bundle, where)


def _datum_points(bundle: Located[BundleDefinition], where: str) -> Iterator[Fault]:
    points = bundle.record.datum_points
    place = (*bundle.place, "datum_points")
    if points and bundle.record.datum != "free":
        yield place, f'{where} has datum_points, but they belong to a free datum; write datum = "free" or remove them'
    for index, name in enumerate(points):
        fault = name_fault(name)
        if fault is not None:
            yield (*place, index), f"datum_points of {where}: {fault}; write the name of a point"
        elif name in points[:index]:
            yield (*place, index), f"datum_points of {where}: '{shown_token(name)}' comes twice; name it once"
