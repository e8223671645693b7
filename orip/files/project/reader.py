"""The project file orip.toml: its text to a checked project definition."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from msgspec import Struct

from orip.errors import Complaint, ProjectWarning
from orip.files.project import checks as antenna_checks
from orip.files.project import checks as project_checks
from orip.files.project import record_checks
from orip.files.project.checks import References
from orip.files.project.records import project_definition
from orip.files.project.source import ProjectSource, project_source
from orip.files.project.tables import Fault
from orip.files.project.toml_lines import KeyPath, NestingError, TomlLines, syntax_complaint, toml_document
from orip.files.text.lines import decode_lines, read_bytes
from orip.files.text.shown import Parsed, printable, shown_token
from orip.records.definition import ProjectDefinition, plan_stages
from orip.records.names import record_key
from orip.wording import counted


def check_rigs(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that a rig has two cameras at least, each defined and on one rig, once, and that errors have values."""
    taken: dict[str, str] = {}
    for rig in source.rigs:
        name = shown_token(rig.record.name)
        place = (*rig.place, "camera")
        if len(rig.record.cameras) < 2:
            message = f"rig '{name}' has one camera; a rig has two at least: give a [[rig.camera]] for each, or none"
            yield (place if rig.record.cameras else rig.place), message
        for index, mounting in enumerate(rig.record.cameras):
            camera, key = shown_token(mounting.name), record_key(mounting.name)
            for message in references.check("camera", mounting.name, f"rig '{name}'"):
                yield (*place, index, "name"), message
            if key in taken:
                where = "twice" if taken[key] == name else f"on rig '{taken[key]}' too"
                yield (*place, index, "name"), f"camera '{camera}' of rig '{name}' is {where}; leave it on one, once"
            taken.setdefault(key, name)
            for what in ("offset", "rotation"):
                is_given = getattr(mounting, what) is not None or index == 0
                if getattr(mounting, f"{what}_error") is not None and not is_given:
                    text = f"camera '{camera}' of rig '{name}' has {what}_error without {what}; give both, or neither"
                    yield (*place, index, f"{what}_error"), text


def check_exposures(source: ProjectSource, references: References) -> Iterator[Fault]:
    """Check that the photos of an exposure are defined, of different cameras of one rig, and of no other exposure.

    A camera on no rig is one fault, whatever the number of its photos.
    """
    rig_of = _rigs_of_cameras(source)
    taken: dict[str, str] = {}
    alone: dict[str, list[tuple[tuple[str | int, ...], str]]] = {}
    for exposure in source.exposures:
        where = f"exposure '{shown_token(exposure.record.name)}'"
        of_rigs: list[tuple[str, str, str]] = []
        if not exposure.record.photos:
            yield (*exposure.place, "photos"), f"{where} has no photo; name those of its instant, or remove it"
        for index, photo in enumerate(exposure.record.photos):
            place, shown = (*exposure.place, "photos", index), f"photo '{shown_token(photo)}' of {where}"
            yield from ((place, message) for message in references.check("photo", photo, where))
            if record_key(photo) in taken:
                again = "comes twice" if taken[record_key(photo)] == where else f"is of {taken[record_key(photo)]} too"
                yield place, f"{shown} {again}; leave it in one, once"
                continue
            taken[record_key(photo)] = where
            located = references.photos.get(record_key(photo))
            if located is None:
                continue
            camera = located.record.camera
            rig = rig_of.get(record_key(camera))
            if rig is None:
                alone.setdefault(camera, []).append((place, shown))
            else:
                yield from ((place, f"{shown} {fault}") for fault in _misfits(of_rigs, rig, camera))
                of_rigs.append((rig, camera, photo))
    for camera, photos in alone.items():
        (place, shown), others = photos[0], len(photos) - 1
        more = f", as {counted(others, 'other photo')}" if others else ""
        text = f"{shown} is of camera '{shown_token(camera)}', which is on no rig{more}; add the camera to a [[rig]]"
        yield place, f"{text}, or take {'them' if others else 'the photo'} out of the exposure{'s' if others else ''}"


def _misfits(before: Sequence[tuple[str, str, str]], rig: str, camera: str) -> Iterator[str]:
    """Yield what is wrong with a photo after others of its exposure, given as rig, camera and photo."""
    for other, _, photo in before[:1]:
        if record_key(other) != record_key(rig):
            others = f"'{shown_token(photo)}' of rig '{shown_token(other)}'"
            yield f"is of rig '{shown_token(rig)}', {others}; give an exposure the photos of one rig"
    same = [photo for _, of, photo in before if record_key(of) == record_key(camera)]
    if len(same) == 1:  # of more the second one has said it
        text = f"is of camera '{shown_token(camera)}' as '{shown_token(same[0])}' is"
        yield f"{text}; a camera has one photo in an exposure: leave that of its instant"


def _rigs_of_cameras(source: ProjectSource) -> dict[str, str]:
    """Return the rig of each camera on one, also of those that photos have in its place in a bundle."""
    found: dict[str, str] = {}
    for rig in source.rigs:
        for mounting in rig.record.cameras:
            found.setdefault(record_key(mounting.name), rig.record.name)
    for bundle in source.bundles:
        for name, other in bundle.record.cameras:
            if record_key(name) in found:
                found.setdefault(record_key(other), found[record_key(name)])
    return found


class RecordLines(Mapping[tuple[str, str], int]):
    """Lines of records, looked for in the text when one is asked for.

    Parameters
    ----------
    places : mapping
        Keys and indices that lead to each record.
    """

    def __init__(self, places: Mapping[tuple[str, str], KeyPath], lines: TomlLines) -> None:
        self._places, self._lines = places, lines

    def __getitem__(self, record: tuple[str, str]) -> int:
        return self._lines.line_of(self._places[record])

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)


class ProjectText(Struct, frozen=True):
    """A project definition and where its records are in the text.

    Parameters
    ----------
    lines : mapping of (section, name) to int
        Line of a record, by ``("photo", record_key(name))``; sections are project (name ``""``), camera, temtick,
        template, photo, bundle, and model with ``"BUNDLE MODEL"``.
    """

    definition: ProjectDefinition
    lines: Mapping[tuple[str, str], int]


def read_project(path: Path, shown: str = "orip.toml") -> Parsed[ProjectText | None]:
    """Read and check a project file; without complaints the definition is complete and consistent.

    Distortion given as ISP parameters or as a curve stays in that form: the polynomial's terms are then 0.
    """
    data, complaints = read_bytes(path, shown)
    if data is None:
        return Parsed(None, complaints)
    decoded = decode_lines(data, shown)
    if decoded.complaints:
        return Parsed(None, decoded.complaints)
    return parse_project("\n".join(decoded.value), shown)


def parse_project(text: str, shown: str = "orip.toml") -> Parsed[ProjectText | None]:
    """Check the text of a project file; see `read_project`."""
    document = _toml_document(text, shown)
    if isinstance(document, Complaint):
        return Parsed(None, (document,))
    lines = TomlLines(text)
    source, faults = checked_tables(document, lines.line_of)
    complaints = {Complaint(printable(message), shown, lines.line_of(place)): None for place, message in faults}
    warnings = tuple(record_checks.similar_marks(source, shown, lines.line_of))
    warnings += tuple(record_checks.directions_without_readout(source, shown, lines.line_of))
    warnings += tuple(record_checks.unit_in_other_words(source, shown, lines.line_of))
    if complaints or source.project is None:
        return Parsed(None, tuple(sorted(complaints, key=lambda complaint: complaint.line or 0)), warnings)
    definition = project_definition(source, source.project)
    record_lines = RecordLines(_record_places(source), lines)
    warnings += tuple(_stage_warnings(definition, record_lines, shown))
    return Parsed(ProjectText(definition, record_lines), (), warnings)


def _toml_document(text: str, shown: str) -> dict[str, Any] | Complaint:
    try:
        return toml_document(text)
    except NestingError as fault:
        return Complaint(f"{fault}; correct the line", shown, fault.line)
    except ValueError as fault:  # TOMLDecodeError is one; so is a whole number of thousands of digits
        return syntax_complaint(str(fault), text, shown)


def checked_tables(document: Mapping[str, Any], line_of: project_checks.LineOf) -> tuple[ProjectSource, list[Fault]]:
    """Return the tables of a document, and everything that is wrong with them.

    Parameters
    ----------
    document : mapping
        As orip.toml is read by `tomllib`.
    line_of : callable
        Gives the number by which messages name the place of keys and indices.
    """
    source = project_source(document)
    return source, [*source.faults, *_check(source, line_of)]


def _check(source: ProjectSource, line_of: project_checks.LineOf) -> Iterator[Fault]:
    references = project_checks.References(source)
    yield from project_checks.check_names(source, line_of)
    if source.project is not None:
        yield from record_checks.check_project(source.project)
    yield from record_checks.check_cameras(source, line_of)
    yield from project_checks.check_lenses(source, references)
    yield from record_checks.check_temticks(source, line_of)
    yield from record_checks.check_photo_parameters(source)
    if source.gnss_network is not None:
        yield from record_checks.check_network(source.gnss_network)
    yield from record_checks.check_bundles(source)
    yield from antenna_checks.check_antennas(source, references)
    yield from check_rigs(source, references)
    yield from check_exposures(source, references)
    yield from project_checks.check_templates(source, references, line_of)
    yield from project_checks.check_photos(source, references, line_of)
    yield from project_checks.check_precision(source, references)
    yield from project_checks.check_models(source, references, line_of)
    yield from project_checks.check_shared(source, references)


def _record_places(source: ProjectSource) -> dict[tuple[str, str], KeyPath]:
    found: dict[tuple[str, str], KeyPath] = {("project", ""): ("project",)}
    bundles = {record.place: record_key(record.name) for record in source.names.get("bundle", [])}
    for section, records in source.names.items():
        for record in records:
            name = record_key(record.name)
            if section == "model":
                name = f"{bundles[record.place[:2]]} {name}"
            found[section, name] = record.place
    return found


def _stage_warnings(
    definition: ProjectDefinition, lines: Mapping[tuple[str, str], int], shown: str
) -> Iterator[ProjectWarning]:
    for bundle in definition.bundles:
        plan = plan_stages(definition.photos, definition.templates, bundle.models)
        for model in bundle.models:
            if model not in plan.unsuited:
                continue
            line = lines["model", f"{record_key(bundle.name)} {record_key(model.name)}"]
            text = (
                f"photos '{model.left}' and '{model.right}' of model '{model.name}' are both on the "
                f"{plan.stages[record_key(model.left)]} stage; set the stages, or print them on different templates"
            )
            yield ProjectWarning("shared-stage", f"{shown}:{line}", text)
