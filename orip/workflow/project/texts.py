"""The text files of a project, each read once, so that everything that is wrong in them is reported at once.

A text's digest is taken before it is read: what is saved while a command runs shows as a change afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

from msgspec import Struct

from orip.errors import Complaint, InputError, NoProjectError, ProjectWarning
from orip.files.control.preliminary_text import read_preliminary
from orip.files.control.reader import in_degrees, read_control
from orip.files.control.stations_text import read_stations
from orip.files.control.text import CONTROL_EXTENSIONS
from orip.files.project.file_names import is_pattern
from orip.files.text.regular_file import DIGEST_OF_NOTHING, file_digest, natural_key
from orip.files.text.shown import Parsed
from orip.records.control import IN_PROJECT, Control, PreliminaryPoint, Station
from orip.records.measurement import LogRecord
from orip.structs import replace
from orip.units import DEGREES_PER_UNIT
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder, open_project

EDITS_FILE = "EDITS.MEA"

MOST_FILES = 10_000
"""Most files that a pattern may find; with more it probably covers the whole disk."""

Digests = tuple[tuple[str, str], ...]
"""(name of an input, SHA-256)."""


class MeasurementLog(Struct, frozen=True):
    """The log records of some files, in the order of replay."""

    files: tuple[Path, ...]
    records: tuple[LogRecord, ...]
    digests: Digests


class ControlInput(Struct, frozen=True):
    """What the text files say of the ground points of one bundle."""

    control: Control
    preliminary: tuple[PreliminaryPoint, ...]
    digests: Digests


class ProjectTexts:
    """All text files of a project except orip.toml; each is read once, when it is first needed."""

    def __init__(self, project: ProjectFolder) -> None:
        self._project = project
        self._control_input: dict[str, Parsed[ControlInput]] = {}
        self._control: dict[str, tuple[Digests, Parsed[Control]]] = {}

    @cached_property
    def measurement_files(self) -> Parsed[tuple[Path, ...]]:
        """Return the measurement files in the order of replay."""
        return measurement_files(self._project)

    @cached_property
    def log(self) -> Parsed[MeasurementLog]:
        """Return the measurement log."""
        return _read_log(self._project, self.measurement_files)

    def _control_with_digests(self, bundle: str | None) -> tuple[Digests, Parsed[Control]]:
        base = self._project.control_base(bundle)
        if base not in self._control:
            self._control[base] = control_digests(self._project, base), read_ground_control(self._project, base)
        return self._control[base]

    @property
    def control(self) -> Parsed[Control]:
        """Return the ground control of the project."""
        return self._control_with_digests(None)[1]

    def control_of(self, bundle: str) -> Control:
        """Return the ground control of a bundle, as far as it could be read."""
        return self._control_with_digests(bundle)[1].value

    @cached_property
    def stations(self) -> Parsed[tuple[Station, ...]]:
        """Return the exposure stations alone, as they are written."""
        base = self._project.definition.control_files
        return read_stations(self._project.folder / f"{base}.STA", f"{base}.STA")

    def control_input(self, bundle: str) -> Parsed[ControlInput]:
        """Return the ground control with a bundle's preliminary coordinates; files that are missing are empty."""
        if bundle not in self._control_input:
            self._control_input[bundle] = self._read_control_input(bundle)
        return self._control_input[bundle]

    def faults(self) -> Parsed[None]:
        """Read all texts; return the complaints and warnings of all of them, each once."""
        of_crs = _of_crs(self._project)
        of_bundles: list[Parsed[Any]] = [self.control_input(name) for name in self._project.bundle_names]
        outcomes: list[Parsed[Any]] = [self.log, *(of_bundles or [self.control])]
        said = {complaint.message for complaint in of_crs}  # by stations of another system, too
        complaints = dict.fromkeys(one for outcome in outcomes for one in outcome.complaints if one.message not in said)
        warnings = dict.fromkeys(warning for outcome in outcomes for warning in outcome.warnings)
        return Parsed(None, (*of_crs, *complaints), tuple(warnings))

    def _read_control_input(self, bundle: str) -> Parsed[ControlInput]:
        path = self._project.preliminary(bundle)
        of_preliminary = _digests(self._project, [path])
        digests, control = self._control_with_digests(bundle)
        preliminary = _read_preliminary(self._project, path)
        return Parsed(
            ControlInput(control.value, preliminary.value, (*digests, *of_preliminary)),
            (*control.complaints, *preliminary.complaints),
            (*control.warnings, *preliminary.warnings),
        )


def open_checked_project(folder: Path) -> ProjectFolder:
    """Read orip.toml; if it is wrong, read all other text files too, to report what is wrong in them.

    Raises
    ------
    InputError
        If orip.toml is missing or wrong; then also with what is wrong in any text file of the folder.
    """
    try:
        return open_project(folder)
    except NoProjectError:
        raise
    except InputError as error:
        others = _faults_in_folder(folder) if (folder / PROJECT_FILE).is_file() else ()
        raise InputError([*error.complaints, *others]) from None


def raise_complaints(complaints: Sequence[Complaint]) -> None:
    """Raise one InputError with all complaints, if there are any."""
    if complaints:
        raise InputError(complaints)


# ground control and preliminary coordinates


def read_ground_control(project: ProjectFolder, base: str) -> Parsed[Control]:
    """Read the control files of a base name; missing ones are empty."""
    control = read_control(project.folder, base)
    misspelt = [_misspelt(project, project.folder / f"{base}.{extension}") for extension in CONTROL_EXTENSIONS]
    complaints = [*_given(misspelt), *control.complaints]
    found = in_degrees(control.value, DEGREES_PER_UNIT[project.definition.angle_unit])
    try:
        found = replace(found, stations=_stations_in_project(project, found), station_reference=IN_PROJECT)
    except InputError as error:
        line = found.station_reference.line
        complaints += [replace(fault, path=f"{base}.STA", line=fault.line or line) for fault in error.complaints]
    return Parsed(found, tuple(complaints), control.warnings)


def _of_crs(project: ProjectFolder) -> tuple[Complaint, ...]:
    """Return the complaints of a `crs` that no block can be adjusted in."""
    definition = project.definition
    if definition.crs is None:
        return ()
    from orip.geometry.other_crs import crs_complaints

    place = project.shown(project.text), project.lines.get(("project", ""))
    faults = crs_complaints(definition.crs, definition.ground_unit)
    return tuple(Complaint(fault.message, *place) for fault in faults)


def _stations_in_project(project: ProjectFolder, control: Control) -> tuple[Station, ...]:
    """Return the stations in the project's coordinates."""
    if control.station_reference == IN_PROJECT:
        return control.stations
    from orip.geometry.other_crs import stations_of_reference

    definition = project.definition
    return stations_of_reference(control.stations, control.station_reference, definition.crs, definition.ground_unit)


def _read_preliminary(project: ProjectFolder, path: Path) -> Parsed[tuple[PreliminaryPoint, ...]]:
    if path.exists():
        return read_preliminary(path, project.shown(path))
    return Parsed((), tuple(_given([_misspelt(project, path)])))


def control_digests(project: ProjectFolder, base: str) -> Digests:
    """Return the digests of the control files of a base name that exist."""
    return _digests(project, [project.folder / f"{base}.{extension}" for extension in CONTROL_EXTENSIONS])


def control_input_digests(project: ProjectFolder, bundle: str) -> Digests:
    """Return the digests of the control files and of a bundle's preliminary coordinates, as far as they exist."""
    of_control = control_digests(project, project.control_base(bundle))
    return (*of_control, *_digests(project, [project.preliminary(bundle)]))


def _misspelt(project: ProjectFolder, path: Path) -> Complaint | None:
    """Return a complaint if a file is missing while one in other letters, or with .txt after its name, is there."""
    if path.exists() or not path.parent.is_dir():
        return None
    shown = project.shown(path)
    if path.is_symlink():
        return Complaint(f"this link points to {path.readlink()}, which does not exist; repair the link", shown)
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


def measurement_files(project: ProjectFolder) -> Parsed[tuple[Path, ...]]:
    """Return the measurement files in the order of replay: as listed, patterns sorted naturally, EDITS.MEA last."""
    found: dict[Path, None] = {}
    complaints: list[Complaint] = []
    for pattern in project.definition.measurement_files:
        if is_pattern(pattern):
            listed = list(islice(project.folder.glob(pattern), MOST_FILES + 1))
            if len(listed) > MOST_FILES:
                message = f"'{pattern}' of measurement_files finds more than {MOST_FILES} files; write a narrower one"
                complaints.append(Complaint(message, project.shown(project.text), project.lines.get(("project", ""))))
                continue
            matches = sorted(listed, key=lambda path: natural_key(project.shown(path)))
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


def _nearly_matching(project: ProjectFolder, pattern: str, matches: Sequence[Path]) -> Iterator[Complaint]:
    """Complain about files that a pattern misses by capitals or, if it finds none at all, by a .txt at the end."""
    suffixes = ("",) if matches else ("", ".txt")
    likely = [f"{pattern}{suffix}".lower() for suffix in suffixes]
    for path in sorted(project.folder.iterdir()):
        if path not in matches and any(fnmatchcase(path.name.lower(), name) for name in likely):
            message = f"this file is not read: measurement files are called {pattern}; rename it, or name it in "
            yield Complaint(f"{message}measurement_files of orip.toml", project.shown(path))


def is_measurement_file(project: ProjectFolder, path: Path) -> bool:
    """Tell whether a file, which need not exist, is among the measurement files of a project by its name."""
    shown = Path(project.shown(path))
    return any(_has_pattern(shown, pattern) for pattern in (*project.definition.measurement_files, EDITS_FILE))


def _has_pattern(shown: Path, pattern: str) -> bool:
    if "**" in pattern:
        return fnmatchcase(str(shown), pattern)
    parts = Path(pattern).parts  # as in a glob, no wildcard stands for several folders
    return len(parts) == len(shown.parts) and all(map(fnmatchcase, shown.parts, parts))


def read_log(project: ProjectFolder, files: Sequence[Path]) -> Parsed[MeasurementLog]:
    """Read measurement files as one log."""
    return _read_log(project, Parsed(tuple(files)))


def _read_log(project: ProjectFolder, listed: Parsed[tuple[Path, ...]]) -> Parsed[MeasurementLog]:
    digests = _digests(project, listed.value)
    from orip.files.log.text import read_measurements  # what looks at digests alone reads no log

    outcomes = [read_measurements(path, project.shown(path)) for path in listed.value]
    return Parsed(
        MeasurementLog(listed.value, tuple(record for outcome in outcomes for record in outcome.value), digests),
        (*listed.complaints, *(complaint for outcome in outcomes for complaint in outcome.complaints)),
        (*(warning for outcome in outcomes for warning in outcome.warnings), *_of_whole_files(digests, outcomes)),
    )


def _of_whole_files(digests: Digests, outcomes: Sequence[Parsed[Any]]) -> Iterator[ProjectWarning]:
    """Yield a warning of each file that is a copy of another one, and of empty ones where nothing is measured."""
    is_empty = not any(outcome.value or outcome.complaints for outcome in outcomes)
    originals: dict[str, str] = {}
    for shown, digest in digests:
        original = originals.setdefault(digest, shown)
        if is_empty and digest == DIGEST_OF_NOTHING:
            text = (
                "nothing is measured in this file; write a line POINTS bundle photo and below it name x y of each point"
            )
            yield ProjectWarning("nothing-measured", shown, text)
        elif original != shown:
            text = f"is the same as {original}: all of it is measured twice; remove one of the two files"
            yield ProjectWarning("same-measurements", shown, text)


def log_digests(project: ProjectFolder, files: Sequence[Path]) -> Digests:
    """Return the digests of measurement files."""
    return _digests(project, files)


def _digests(project: ProjectFolder, paths: Iterable[Path]) -> Digests:
    found = []
    for path in paths:
        with suppress(OSError):  # its reader complains about a file that cannot be read
            if path.is_file():
                found.append((project.shown(path), file_digest(path)))
    return tuple(found)


def _faults_in_folder(folder: Path) -> list[Complaint]:
    """Return what is wrong in the text files of a folder whose orip.toml cannot be read, found by their extensions."""
    files = [path for path in sorted(folder.iterdir()) if path.is_file()]
    bases = dict.fromkeys(path.stem for path in files if path.suffix[1:] in CONTROL_EXTENSIONS)
    outcomes: list[Parsed[Any]] = [read_control(folder, base) for base in bases]
    outcomes += [read_preliminary(path, path.name) for path in files if path.suffix == ".PRE"]
    from orip.files.log.text import read_measurements

    outcomes += [read_measurements(path, path.name) for path in files if path.suffix == ".MEA"]
    return [complaint for outcome in outcomes for complaint in outcome.complaints]
