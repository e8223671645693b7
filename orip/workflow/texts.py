"""Reading the text files of a project, so that everything that is wrong in them is said at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.control_text import read_control
from orip.files.file_digest import file_digest
from orip.files.measurement_text import read_measurements
from orip.files.natural_order import natural_key
from orip.files.parsed import Parsed
from orip.files.preliminary_text import read_preliminary
from orip.model.control import Control, PreliminaryPoint
from orip.model.measurement import LogRecord
from orip.workflow.project import Project

EDITS_FILE = "EDITS.MEA"
CONTROL_EXTENSIONS = ("PNT", "ELE", "LEN", "DIR")


@dataclass(frozen=True, slots=True)
class MeasurementLog:
    """The log records of some files, in the order of replay."""

    files: tuple[Path, ...]
    records: tuple[LogRecord, ...]


def raise_complaints(outcomes: Iterable[Parsed[Any]]) -> None:
    """Raise one InputError with the complaints of all readers, if there are any."""
    complaints: list[Complaint] = [complaint for outcome in outcomes for complaint in outcome.complaints]
    if complaints:
        raise InputError(complaints)


def control_files(project: Project) -> tuple[Path, ...]:
    """Return the control files that exist."""
    base = project.definition.control_files
    paths = (project.folder / f"{base}.{extension}" for extension in CONTROL_EXTENSIONS)
    return tuple(path for path in paths if path.is_file())


def parse_control(project: Project) -> Parsed[Control]:
    """Read the control files of a project; missing ones are empty."""
    return read_control(project.folder, project.definition.control_files)


def parse_preliminary(project: Project, bundle: str) -> Parsed[tuple[PreliminaryPoint, ...]]:
    """Read a bundle's preliminary coordinates; a missing file is empty."""
    path = project.preliminary(bundle)
    return read_preliminary(path, project.shown(path)) if path.exists() else Parsed(())


def measurement_files(project: Project) -> Parsed[tuple[Path, ...]]:
    """Return the measurement files in the order of replay: as listed, patterns sorted naturally, EDITS.MEA last."""
    found: dict[Path, None] = {}
    complaints: list[Complaint] = []
    for pattern in project.definition.measurement_files:
        if any(mark in pattern for mark in "*?["):
            matches = sorted(project.folder.glob(pattern), key=lambda path: natural_key(project.shown(path)))
            found.update(dict.fromkeys(path for path in matches if path.is_file()))
        elif (project.folder / pattern).is_file():
            found[project.folder / pattern] = None
        else:
            message = f"measurement file '{pattern}' does not exist; correct measurement_files, or make the file"
            complaints.append(Complaint(message, project.shown(project.text), project.lines.get(("project", ""))))
    edits = project.folder / EDITS_FILE
    if edits.is_file():
        found.pop(edits, None)
        found[edits] = None
    return Parsed(tuple(found), tuple(complaints))


def parse_log(project: Project, files: Sequence[Path]) -> Parsed[MeasurementLog]:
    """Read measurement files as one log."""
    outcomes = [read_measurements(path, project.shown(path)) for path in files]
    return Parsed(
        MeasurementLog(tuple(files), tuple(record for outcome in outcomes for record in outcome.records)),
        tuple(complaint for outcome in outcomes for complaint in outcome.complaints),
        tuple(warning for outcome in outcomes for warning in outcome.warnings),
    )


def parse_project_log(project: Project) -> Parsed[MeasurementLog]:
    """Read all measurement files of a project."""
    files = measurement_files(project)
    log = parse_log(project, files.records)
    return Parsed(log.records, files.complaints + log.complaints, log.warnings)


def check_texts(project: Project) -> tuple[ProjectWarning, ...]:
    """Read every text file and return the warnings.

    Raises
    ------
    InputError
        With the complaints of all files.
    """
    outcomes: list[Parsed[Any]] = [parse_control(project), parse_project_log(project)]
    outcomes += [parse_preliminary(project, bundle.name) for bundle in project.definition.bundles]
    raise_complaints(outcomes)
    return tuple(warning for outcome in outcomes for warning in outcome.warnings)


def digests(project: Project, paths: Iterable[Path]) -> tuple[tuple[str, str], ...]:
    """Return (file as shown, SHA-256) of text files."""
    return tuple((project.shown(path), file_digest(path)) for path in paths)
