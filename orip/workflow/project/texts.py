"""Reading the text files of a project, so that everything that is wrong in them is said at once.

A text's digest is taken before it is read: whatever is saved meanwhile shows as a change later.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from orip.errors import Complaint, InputError
from orip.files.control.preliminary_text import read_preliminary
from orip.files.control.text import read_control
from orip.files.log.text import read_measurements
from orip.files.text.digest import file_digest
from orip.files.text.natural_order import natural_key
from orip.files.text.parsed import Parsed
from orip.records.control import Control, PreliminaryPoint
from orip.records.measurement import LogRecord
from orip.workflow.project.folder import PROJECT_FILE, Project, open_project

EDITS_FILE = "EDITS.MEA"
CONTROL_EXTENSIONS = ("PNT", "ELE", "LEN", "DIR")

Digests = tuple[tuple[str, str], ...]
"""(name of an input, SHA-256)."""


@dataclass(frozen=True, slots=True)
class MeasurementLog:
    """The log records of some files, in the order of replay."""

    files: tuple[Path, ...]
    records: tuple[LogRecord, ...]
    digests: Digests


@dataclass(frozen=True, slots=True)
class GroundTexts:
    """What the text files say of the ground points of one bundle."""

    control: Control
    preliminary: tuple[PreliminaryPoint, ...]
    digests: Digests


@dataclass(frozen=True, slots=True)
class Texts:
    """All text files of a project but orip.toml; `ground` by bundle name."""

    log: MeasurementLog
    ground: Mapping[str, Parsed[GroundTexts]]


def open_project_with_texts(folder: Path) -> tuple[Project, Parsed[Texts]]:
    """Read orip.toml and all other text files.

    Raises
    ------
    InputError
        If orip.toml is missing or wrong; then also with what is wrong in any text file of the folder.
    """
    try:
        project = open_project(folder)
    except InputError as error:
        others = _faults_in_folder(folder) if (folder / PROJECT_FILE).is_file() else ()
        raise InputError([*error.complaints, *others]) from None
    return project, read_texts(project)


def read_texts(project: Project) -> Parsed[Texts]:
    """Read every text file of a project but orip.toml, with the complaints and warnings of all."""
    log = read_log(project)
    ground = {bundle.name: read_ground(project, bundle.name) for bundle in project.definition.bundles}
    outcomes: list[Parsed[Any]] = [log, *(ground.values() or [read_ground_control(project)])]
    complaints = dict.fromkeys(complaint for outcome in outcomes for complaint in outcome.complaints)
    warnings = dict.fromkeys(warning for outcome in outcomes for warning in outcome.warnings)
    return Parsed(Texts(log.records, ground), tuple(complaints), tuple(warnings))


def raise_complaints(complaints: Sequence[Complaint]) -> None:
    """Raise one InputError with all complaints, if there are any."""
    if complaints:
        raise InputError(complaints)


# ground control and preliminary coordinates


def read_ground_control(project: Project) -> Parsed[Control]:
    """Read the control files of a project; missing ones are empty."""
    base = project.definition.control_files
    control = read_control(project.folder, base)
    misspelt = [_misspelt(project, project.folder / f"{base}.{extension}") for extension in CONTROL_EXTENSIONS]
    return Parsed(control.records, (*_given(misspelt), *control.complaints), control.warnings)


def read_ground(project: Project, bundle: str) -> Parsed[GroundTexts]:
    """Read the control files and a bundle's preliminary coordinates; missing ones are empty."""
    digests = ground_digests(project, bundle)
    control = read_ground_control(project)
    path = project.preliminary(bundle)
    preliminary: Parsed[tuple[PreliminaryPoint, ...]] = (
        read_preliminary(path, project.shown(path))
        if path.exists()
        else Parsed((), tuple(_given([_misspelt(project, path)])))
    )
    return Parsed(
        GroundTexts(control.records, preliminary.records, digests),
        (*control.complaints, *preliminary.complaints),
        (*control.warnings, *preliminary.warnings),
    )


def ground_digests(project: Project, bundle: str) -> Digests:
    """Return the digests of the control files and of a bundle's preliminary coordinates, as far as they exist."""
    base = project.definition.control_files
    paths = [project.folder / f"{base}.{extension}" for extension in CONTROL_EXTENSIONS]
    return _digests(project, [*paths, project.preliminary(bundle)])


def _misspelt(project: Project, path: Path) -> Complaint | None:
    """Return a complaint if a file is missing while one in other letters, or with .txt after its name, is there."""
    if path.exists() or not path.parent.is_dir():
        return None
    shown = project.shown(path)
    if path.is_symlink():
        return Complaint(f"this link leads to {path.readlink()}, which is not there; mend the link", shown)
    likely = {path.name.lower(), f"{path.name}.txt".lower()}
    for other in sorted(path.parent.iterdir()):
        if other.name.lower() in likely:
            return Complaint(
                f"this file is not read: the project's file is called {shown}; rename it", project.shown(other)
            )
    return None


def _given(complaints: Iterable[Complaint | None]) -> Iterator[Complaint]:
    return (complaint for complaint in complaints if complaint is not None)


# measurements


def measurement_files(project: Project) -> Parsed[tuple[Path, ...]]:
    """Return the measurement files in the order of replay: as listed, patterns sorted naturally, EDITS.MEA last."""
    found: dict[Path, None] = {}
    complaints: list[Complaint] = []
    for pattern in project.definition.measurement_files:
        if any(mark in pattern for mark in "*?["):
            matches = sorted(project.folder.glob(pattern), key=lambda path: natural_key(project.shown(path)))
            found.update(dict.fromkeys(matches))
            complaints += _nearly_matching(project, pattern, matches)
        elif (project.folder / pattern).exists():
            found[project.folder / pattern] = None
        else:
            message = f"measurement file '{pattern}' does not exist; correct measurement_files, or make the file"
            complaints.append(Complaint(message, project.shown(project.text), project.lines.get(("project", ""))))
    edits = project.folder / EDITS_FILE
    if edits.is_file():
        found.pop(edits, None)
        found[edits] = None
    return Parsed(tuple(found), tuple(complaints))


def _nearly_matching(project: Project, pattern: str, matches: Sequence[Path]) -> Iterator[Complaint]:
    """Complain of files that a pattern misses by their capitals, or, if it finds none at all, by a .txt at the end."""
    suffixes = ("",) if matches else ("", ".txt")
    likely = [f"{pattern}{suffix}".lower() for suffix in suffixes]
    for path in sorted(project.folder.iterdir()):
        if path not in matches and any(fnmatchcase(path.name.lower(), each) for each in likely):
            message = f"this file is not read: measurement files are called {pattern}; rename it, or name it in "
            yield Complaint(f"{message}measurement_files of orip.toml", project.shown(path))


def read_log(project: Project, files: Sequence[Path] = ()) -> Parsed[MeasurementLog]:
    """Read measurement files as one log; none: those of the project."""
    listed = Parsed(tuple(files)) if files else measurement_files(project)
    digests = _digests(project, listed.records)
    outcomes = [read_measurements(path, project.shown(path)) for path in listed.records]
    return Parsed(
        MeasurementLog(listed.records, tuple(record for outcome in outcomes for record in outcome.records), digests),
        (*listed.complaints, *(complaint for outcome in outcomes for complaint in outcome.complaints)),
        tuple(warning for outcome in outcomes for warning in outcome.warnings),
    )


def log_digests(project: Project) -> Digests:
    """Return the digests of the project's measurement files."""
    return _digests(project, measurement_files(project).records)


def _digests(project: Project, paths: Iterable[Path]) -> Digests:
    found = []
    for path in paths:
        with suppress(OSError):  # a file that cannot be read is complained of by its reader
            if path.is_file():
                found.append((project.shown(path), file_digest(path)))
    return tuple(found)


def _faults_in_folder(folder: Path) -> list[Complaint]:
    """Return what is wrong in the text files of a folder whose orip.toml cannot be read: they are told by extension."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    bases = dict.fromkeys(path.stem for path in files if path.suffix[1:] in CONTROL_EXTENSIONS)
    outcomes: list[Parsed[Any]] = [read_control(folder, base) for base in bases]
    outcomes += [read_preliminary(path, path.name) for path in files if path.suffix == ".PRE"]
    outcomes += [read_measurements(path, path.name) for path in files if path.suffix == ".MEA"]
    return [complaint for outcome in outcomes for complaint in outcome.complaints]
