"""`orip observations disregard`, `include`, `kill`, `rename` and `remeasure`: additions to EDITS.MEA, applied at once.

The log is authoritative: what is added to it is first replayed with everything before it, then written to the text,
then to the stores. A command that is killed between the two leaves a text that the next replay brings into the stores.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.log.text import read_measurements
from orip.files.log.writing import EditsText, edit_line, read_edits
from orip.files.text.lines import field_name_fault, read_lines
from orip.files.text.regular_file import file_of
from orip.files.text.shown import Parsed, shown_token
from orip.interior.replay import Replayed, replay
from orip.records.measurement import EditRecord, LogRecord, Measured, TextPlace
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.observations.listed import LeftAlone, left_alone
from orip.workflow.observations.measure import MEASURED_ON_TOP, replay_log
from orip.workflow.observations.todo import Named, chosen_names, edited_owner
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText
from orip.workflow.project.run_id import digest_of_observations, digest_of_records
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import EDITS_FILE, MeasurementLog, raise_complaints
from orip.workflow.status import measurement_inputs

EDITED_FROM = MEASURED_ON_TOP
"""What an edit needs of the stores."""

Action = Literal["DISREGARD", "INCLUDE", "KILL"]
What = Literal["POINT", "MARK", "TICK"]


class AddedEdits(Struct, frozen=True):
    """What a command added to EDITS.MEA.

    Parameters
    ----------
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
    """

    project: ProjectFolder
    bundle: str | None
    lines: tuple[str, ...]
    is_trial: bool
    brought_up_to_date: bool
    left_alone: tuple[LeftAlone, ...]
    warnings: tuple[ProjectWarning, ...]


class ReplayedLog(Struct, frozen=True):
    """The log of a project, replayed, before anything is added to it."""

    state: ProjectState
    edits: EditsText
    log: MeasurementLog
    replayed: Replayed
    warnings: tuple[ProjectWarning, ...]

    def replay_with(self, further: Sequence[LogRecord]) -> Replayed:
        """Replay the log with further records at its end."""
        return replay((*self.log.records, *further), self.state.records, Measured())


def edit_observations(
    state: ProjectState,
    action: Action,
    what: What,
    owner: str,
    names: Sequence[str],
    *,
    bundle: str | None = None,
    is_trial: bool = False,
) -> Change[AddedEdits]:
    """Disregard, include or kill points, marks or ticks, now and whenever the log is replayed.

    Parameters
    ----------
    state : ProjectState
        With `EDITED_FROM`.
    action : {"DISREGARD", "INCLUDE", "KILL"}
    what : {"POINT", "MARK", "TICK"}
    owner : str
        The photo (of a tick: template); ``*``: all of them.
    names : sequence of str
        Points, marks or ticks; ``*``: all that are measured.
    bundle : str or None
        Of points; None: the project's only one.
    is_trial : bool
        The change writes nothing.

    Raises
    ------
    InputError
        If a name is not known, or the remaining marks no longer orient a film.
    UsageError
    """
    before = replayed_log(state)
    of_bundle = state.project.bundle_name(bundle) if what == "POINT" else None
    named = Named(what, of_bundle, edited_owner(what, owner, state.records))
    chosen = chosen_names(action, named, names, before.log.records, state.records, before.replayed.measured)
    first = before.edits.line_count + 1
    records = [
        EditRecord(TextPlace(before.edits.shown, first + row), action, what, of_bundle, named.owner, name)
        for row, name in enumerate(chosen)
    ]
    return applied(before, of_bundle, records, [edit_line(record) for record in records], is_trial=is_trial)


def rename_observation(
    state: ProjectState, owner: str, name: str, new_name: str, *, bundle: str | None = None, is_trial: bool = False
) -> Change[AddedEdits]:
    """Give a point another name in a photo, now and whenever the log is replayed.

    Parameters
    ----------
    state : ProjectState
        With `EDITED_FROM`.
    owner : str
        The photo; ``*``: all of them.
    bundle : str or None
        None: the project's only one.
    is_trial : bool
        The change writes nothing.

    Raises
    ------
    InputError
        If the point is not measured there, or one of the new name is.
    UsageError
    """
    before = replayed_log(state)
    of_bundle = state.project.bundle_name(bundle)
    named = Named("POINT", of_bundle, edited_owner("POINT", owner, state.records))
    chosen_names("DISREGARD", named, [name], before.log.records, state.records, before.replayed.measured)
    fault = field_name_fault(new_name)
    if fault is not None or "*" in (name, new_name):
        message = (
            f"'{shown_token(new_name)}' cannot be the name of a point: {fault or 'one point is renamed at a time'}"
        )
        raise InputError.single(message)
    place = TextPlace(before.edits.shown, before.edits.line_count + 1)
    record = EditRecord(place, "RENAME", "POINT", of_bundle, named.owner, name, new_name)
    return applied(before, of_bundle, [record], [edit_line(record)], is_trial=is_trial)


def remeasure(state: ProjectState, file: Path, *, is_trial: bool = False) -> Change[AddedEdits]:
    """Append a measurement file to EDITS.MEA, so that it counts after all edits that already exist.

    Parameters
    ----------
    state : ProjectState
        With `EDITED_FROM`.
    file : Path
        Relative to the project folder.
    is_trial : bool
        The change writes nothing.

    Raises
    ------
    InputError
    """
    before, project = replayed_log(state), state.project
    path = project.folder / file
    shown = project.shown(path)
    found = read_measurements(path, shown)
    raise_complaints(found.complaints)
    if file_of(path) == file_of(before.edits.path):
        message = f"this is {EDITS_FILE} itself; name the file with the new measurements"
        raise InputError.single(message, shown)
    if not found.value:
        message = "there are no measurements in this file; write some, as in any .MEA file"
        raise InputError.single(message, shown)
    lines = [line.rstrip() for line in read_lines(path, shown).value]
    change = applied(before, None, found.value, [f"! from {shown}", *lines], is_trial=is_trial)
    warnings = (*change.outcome.warnings, *_replayed_twice(before, path))
    return replace(change, outcome=replace(change.outcome, warnings=warnings))


def _replayed_twice(before: ReplayedLog, path: Path) -> list[ProjectWarning]:
    if file_of(path) not in {file_of(file) for file in before.log.files}:
        return []
    text = f"is among the project's measurement files too, and is replayed twice; remove it: {EDITS_FILE} has it all"
    return [ProjectWarning("replayed-twice", before.state.project.shown(path), text)]


def replayed_log(state: ProjectState) -> ReplayedLog:
    """Replay the log of a project.

    Raises
    ------
    InputError
        If it has faults already, or the stores hold measurements that a replay would lose.
    """
    project = state.project
    edits = read_edits(project.folder / EDITS_FILE, EDITS_FILE)
    log = state.texts.log
    raise_complaints(log.complaints)
    state.require_initialised()
    replayed = replay(log.value.records, state.records, Measured())
    raise_complaints(replayed.complaints)
    inputs = dict(state.replay.inputs)
    now = dict(measurement_inputs(project, log.value.digests, state.definitions))
    _require_no_loss([name for name in inputs if name not in now], state.measured, replayed.measured)
    changed = [name for name, digest in now.items() if inputs and inputs.get(name) != digest]
    text = "changed since the last 'orip measure'; all measurement files are replayed into the stores"
    news = (ProjectWarning("all-replayed", ", ".join(changed), text),) if changed else ()
    return ReplayedLog(state, edits, log.value, replayed, news)


def _require_no_loss(gone: Sequence[str], stored: Measured, replayed: Measured) -> None:
    """Raise InputError if the stores hold measurements from files that are gone, which a replay would lose."""
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


def applied(
    before: ReplayedLog, bundle: str | None, records: Sequence[LogRecord], lines: Sequence[str], *, is_trial: bool
) -> Change[AddedEdits]:
    """Append lines to the log and replay it; lines that change nothing of what is measured are not appended."""
    after = before.replay_with(records)
    raise_complaints([_of_the_command(complaint, before) for complaint in after.complaints])
    if _state(after.measured) == _state(before.replayed.measured):
        records, lines, after = (), (), before.replayed
    alone = left_alone(before.replayed.measured, after.measured)
    news = (warning for warning in after.warnings if warning not in before.replayed.warnings)
    edited = AddedEdits(before.state.project, bundle, tuple(lines), is_trial, False, alone, (*before.warnings, *news))
    if is_trial:
        return Change(before.state, edited)
    measured = replay_log(before.state, Parsed(_longer(before, records, lines)))
    texts = (_edited_text(before.edits, lines),) if lines else ()
    is_behind = bool(measured.locks) and not lines
    return replace(measured, edited_texts=texts).with_outcome(replace(edited, brought_up_to_date=is_behind))


def _edited_text(edits: EditsText, lines: Sequence[str]) -> EditedText:
    remedy = "it is unchanged, and so are the stores"
    return EditedText(edits.path, edits.digest, edits.text_with(lines), remedy)


def _longer(before: ReplayedLog, records: Sequence[LogRecord], lines: Sequence[str]) -> MeasurementLog:
    """Return the log as it will be read after lines were appended."""
    if not lines:
        return before.log
    edits, log = before.edits, before.log
    files = [path for path in log.files if path != edits.path]
    digests = [item for item in log.digests if item[0] != edits.shown]
    return MeasurementLog(
        (*files, edits.path), (*log.records, *records), (*digests, (edits.shown, edits.digest_with(lines)))
    )


def _of_the_command(complaint: Complaint, before: ReplayedLog) -> Complaint:
    """Return a complaint without the number of a line that is not in the file yet."""
    if complaint.path == before.edits.shown and (complaint.line or 0) > before.edits.line_count:
        return Complaint(complaint.message)
    return complaint


def _state(measured: Measured) -> tuple[object, ...]:
    """Return what distinguishes one outcome of a replay from another."""
    return (
        digest_of_records(measured.templates.values()),
        digest_of_records(measured.photos.values()),
        digest_of_records([*measured.cameras.values(), *measured.temticks.values()]),
        *((key, digest_of_observations(found)) for key, found in sorted(measured.observations.items())),
    )
