"""`orip observations disregard`, `include`, `kill` and `remeasure`: additions to EDITS.MEA, applied at once.

The log is the truth: what is added to it is first replayed with all that stands before it, then written to the text,
then to the stores. A command that is killed between the two leaves a text that the next replay brings into the stores.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.log.edits_text import EditsText, edit_line, read_edits
from orip.files.log.text import read_measurements
from orip.files.stores.provenance import read_inputs
from orip.files.stores.transaction import reading
from orip.files.text.lines import read_lines
from orip.files.text.parsed import Parsed
from orip.interior.definitions import Definitions
from orip.interior.replay import Replayed, replay
from orip.records.measurement import EditRecord, LogRecord, Measured, Place
from orip.records.names import record_key
from orip.workflow.observations.measure import measure_project, measurement_inputs
from orip.workflow.observations.names import Named, chosen_names, edited_owner
from orip.workflow.observations.rays import LeftAlone, left_alone
from orip.workflow.project.definitions import read_definitions, require_initialised
from orip.workflow.project.folder import Project, open_project
from orip.workflow.project.measurements import measured_stores, read_measured
from orip.workflow.project.run_id import digest_of_observations, digest_of_records
from orip.workflow.project.texts import EDITS_FILE, MeasurementLog, measurement_files, raise_complaints, read_log

Action = Literal["DISREGARD", "INCLUDE", "KILL"]
What = Literal["POINT", "MARK", "TICK"]


@dataclass(frozen=True, slots=True)
class Edited:
    """What a command added to EDITS.MEA.

    Parameters
    ----------
    project : Project
    bundle : str or None
        Of edited points; None for marks, ticks, and measurements of any kind.
    lines : tuple of str
        What was (with `is_trial`: would be) appended; none where nothing changes.
    is_trial : bool
        Nothing was written.
    brought_up_to_date : bool
        The stores were behind the log, and hold all of it now.
    left_alone : tuple of LeftAlone
        Points that are left with a single ray or none.
    warnings : tuple of ProjectWarning
    """

    project: Project
    bundle: str | None
    lines: tuple[str, ...]
    is_trial: bool
    brought_up_to_date: bool
    left_alone: tuple[LeftAlone, ...]
    warnings: tuple[ProjectWarning, ...]


@dataclass(frozen=True, slots=True)
class _Before:
    """The log and what it leaves, before anything is added."""

    project: Project
    edits: EditsText
    log: MeasurementLog
    definitions: Definitions
    replayed: Replayed
    warnings: tuple[ProjectWarning, ...]

    def replay_with(self, further: Sequence[LogRecord]) -> Replayed:
        """Replay the log with further records at its end."""
        return replay((*self.log.records, *further), self.definitions, Measured())


def edit_observations(
    folder: Path,
    action: Action,
    what: What,
    owner: str,
    names: Sequence[str],
    *,
    bundle: str | None = None,
    is_trial: bool = False,
) -> Edited:
    """Disregard, include or kill points, marks or ticks, now and whenever the log is replayed.

    Parameters
    ----------
    folder : Path
    action : {"DISREGARD", "INCLUDE", "KILL"}
    what : {"POINT", "MARK", "TICK"}
    owner : str
        The photo (of a tick: template); ``*``: all of them.
    names : sequence of str
        Points, marks or ticks; ``*``: all that are measured.
    bundle : str or None
        Of points; None: the project's only one.
    is_trial : bool
        Look and tell, but write nothing.

    Raises
    ------
    InputError
        If a name is not known, or what is left does not orient a film any more; nothing is written then.
    LockedError, UsageError
    """
    before = _read(folder)
    of_bundle = before.project.bundle_name(bundle) if what == "POINT" else None
    named = Named(what, of_bundle, edited_owner(what, owner, before.definitions))
    chosen = chosen_names(action, named, names, before.log.records, before.definitions, before.replayed.measured)
    first = before.edits.line_count + 1
    records = [
        EditRecord(Place(before.edits.shown, first + row), action, what, of_bundle, named.owner, name)
        for row, name in enumerate(chosen)
    ]
    return _applied(before, of_bundle, records, [edit_line(each) for each in records], is_trial=is_trial)


def remeasure(folder: Path, file: Path, *, is_trial: bool = False) -> Edited:
    """Append a measurement file to EDITS.MEA, so that it counts after all edits that are there already.

    Parameters
    ----------
    folder : Path
    file : Path
        Relative to the project folder.
    is_trial : bool
        Look and tell, but write nothing.

    Raises
    ------
    InputError, LockedError
    """
    before = _read(folder)
    path = before.project.folder / file
    shown = before.project.shown(path)
    found = read_measurements(path, shown)
    raise_complaints(found.complaints)
    if path.resolve() == before.edits.path.resolve():
        message = f"this is {EDITS_FILE} itself; name the file with the new measurements"
        raise InputError.single(message, shown)
    if not found.records:
        message = "there are no measurements in this file; write some, as in any .MEA file"
        raise InputError.single(message, shown)
    lines = [line.rstrip() for line in read_lines(path, shown).records]
    done = _applied(before, None, found.records, [f"! from {shown}", *lines], is_trial=is_trial)
    return replace(done, warnings=(*done.warnings, *_replayed_twice(before, path)))


def _replayed_twice(before: _Before, path: Path) -> list[ProjectWarning]:
    if path.resolve() not in {each.resolve() for each in before.log.files}:
        return []
    text = f"is among the project's measurement files too, and is replayed twice; remove it: {EDITS_FILE} has it all"
    return [ProjectWarning("replayed-twice", before.project.shown(path), text)]


def _read(folder: Path) -> _Before:
    """Read the log and replay it.

    Raises
    ------
    InputError
        If it is at fault already, or the stores hold measurements that a replay would lose.
    """
    project = open_project(folder)
    edits = read_edits(project.folder / EDITS_FILE, EDITS_FILE)
    log = read_log(project)
    raise_complaints(log.complaints)
    bundles = [each.name for each in project.definition.bundles]
    with reading({*project.record_stores, *measured_stores(project)}) as stores:
        definitions = read_definitions(project, stores)
        stored = read_measured(project, stores, bundles)
        inputs = read_inputs(stores[project.photos], "measure")
    require_initialised(project, definitions)
    by_name = definitions.by_name()
    replayed = replay(log.records.records, by_name, Measured())
    raise_complaints(replayed.complaints)
    now = measurement_inputs(project, log.records.digests, definitions)
    _require_no_loss([name for name, _ in inputs if name not in dict(now)], stored, replayed.measured)
    changed = [name for name, digest in now if inputs and dict(inputs).get(name) != digest]
    text = "changed since the last 'orip measure'; all measurement files are replayed into the stores"
    news = (ProjectWarning("all-replayed", ", ".join(changed), text),) if changed else ()
    return _Before(project, edits, log.records, by_name, replayed, news)


def _require_no_loss(gone: Sequence[str], stored: Measured, replayed: Measured) -> None:
    """Raise InputError if the stores hold what came from files that are gone, and that a replay would not give."""
    if gone and not _names(stored) <= _names(replayed):
        message = (
            f"the stores hold measurements from {', '.join(gone)}, and a replay would lose them: add that to "
            "measurement_files in orip.toml, or run 'orip measure' first to do without them"
        )
        raise InputError.single(message)


def _names(measured: Measured) -> set[tuple[str, ...]]:
    """Return all that is measured by name: templates, photos, points in photos of bundles."""
    points = (
        (key, record_key(photo), point)
        for key, found in measured.observations.items()
        for photo, point in zip(found.photos, found.points, strict=True)
    )
    return {*(("template", key) for key in measured.templates), *(("photo", key) for key in measured.photos), *points}


def _applied(
    before: _Before, bundle: str | None, records: Sequence[LogRecord], lines: Sequence[str], *, is_trial: bool
) -> Edited:
    """Append lines to the log and replay it into the stores; a log that says the same anyway stays as it is."""
    after = before.replay_with(records)
    raise_complaints([_of_the_command(each, before) for each in after.complaints])
    if _state(after.measured) == _state(before.replayed.measured):
        records, lines, after = (), (), before.replayed
    alone = left_alone(before.replayed.measured, after.measured)
    news = (each for each in after.warnings if each not in before.replayed.warnings)
    warnings = (*before.warnings, *news)
    edited = Edited(before.project, bundle, tuple(lines), is_trial, False, alone, warnings)
    if is_trial:
        return edited
    append: Callable[[], None] = (lambda: before.edits.append(lines)) if lines else (lambda: None)
    outcome = measure_project(before.project, Parsed(_longer(before, records, lines)), on_top=False, write_log=append)
    return replace(edited, brought_up_to_date=outcome.changed and not lines)


def _longer(before: _Before, records: Sequence[LogRecord], lines: Sequence[str]) -> MeasurementLog:
    """Return the log as it will be read after lines were appended."""
    if not lines:
        return before.log
    edits, log = before.edits, before.log
    digests = [item for item in log.digests if item[0] != edits.shown]
    return MeasurementLog(
        tuple(measurement_files(before.project).records),
        (*log.records, *records),
        (*digests, (edits.shown, edits.digest_with(lines))),
    )


def _of_the_command(complaint: Complaint, before: _Before) -> Complaint:
    """Return a complaint without a line that does not stand in the file yet."""
    if complaint.path == before.edits.shown and (complaint.line or 0) > before.edits.line_count:
        return Complaint(complaint.message)
    return complaint


def _state(measured: Measured) -> tuple[object, ...]:
    """Return what tells one outcome of a replay from another."""
    return (
        digest_of_records(measured.templates.values()),
        digest_of_records(measured.photos.values()),
        digest_of_records([*measured.cameras.values(), *measured.temticks.values()]),
        *((key, digest_of_observations(found)) for key, found in sorted(measured.observations.items())),
    )
