"""`orip control`: lines of the control texts and of preliminary coordinates, edited in place."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

from msgspec import Struct

from orip.errors import Complaint, InputError, ProjectWarning, UsageError
from orip.files.control.editing import (
    FORMS,
    REJECTED,
    UNKNOWN,
    ControlForm,
    ControlKind,
    ControlLines,
    Fields,
    read_control_lines,
    with_words,
)
from orip.files.text.decimal_numbers import is_number, parse_number
from orip.files.text.lines import TextLine
from orip.files.text.shown import Parsed, shown_token
from orip.wording import listed_names
from orip.workflow.observations.control_names import unknown_name_warnings
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState
from orip.workflow.records.mentions import is_written

Weighting = Literal["disregard", "include", "reject"]


class LineChange(Struct, frozen=True):
    """A line before and after an edit, without line ends; None: added, or deleted."""

    action: Literal["added", "changed", "killed"]
    line: int
    old: str | None
    new: str | None


class ControlOutcome(Struct, frozen=True):
    """What a command did to a control text, or would do (`dry_run`); no changes: the text has these values already."""

    project: ProjectFolder
    shown: str
    changes: tuple[LineChange, ...]
    warnings: tuple[ProjectWarning, ...]
    dry_run: bool


class ControlTable(Struct, frozen=True):
    """The records of a control text: line number, fields by key, and whether a point is rejected."""

    shown: str
    form: ControlForm
    rows: tuple[tuple[int, Fields, bool], ...]

    def records(self) -> list[dict[str, str | float | int | bool | None]]:
        """Return the records with numbers as numbers; None: not known, or not given."""
        return [
            {**dict(self._values(fields)), **({"rejected": rejected} if self.form.rejects else {}), "line": line}
            for line, fields, rejected in self.rows
        ]

    def _values(self, fields: Fields) -> Iterator[tuple[str, str | float | None]]:
        for index, (key, text) in enumerate(zip(self.form.keys, fields, strict=True)):
            known = None if text == UNKNOWN and key in self.form.dashes else text
            is_text = index < self.form.identity or key in self.form.texts
            yield key, known if is_text or known is None else parse_number(known)


class _File(Struct, frozen=True):
    """A control text of a project."""

    state: ProjectState
    kind: ControlKind
    path: Path
    bundle: str | None

    @property
    def project(self) -> ProjectFolder:
        return self.state.project

    @property
    def form(self) -> ControlForm:
        return FORMS[self.kind]

    @property
    def shown(self) -> str:
        return self.project.shown(self.path)


_Edit = Callable[[_File, ControlLines], ControlLines]


def list_control(state: ProjectState, kind: ControlKind, bundle: str | None = None) -> ControlTable:
    """Return the records of a control text.

    Raises
    ------
    InputError
        With everything that is wrong in it.
    UsageError
        If it is not clear which bundle's preliminary coordinates are meant.
    """
    file = _file(state, kind, bundle)
    lines = _read(file)
    _check(file, lines)
    rows = tuple(
        (line.number, file.form.fields_of(line), file.form.is_rejected(line)) for line in file.form.records(lines)
    )
    return ControlTable(file.shown, file.form, rows)


def add_control(
    state: ProjectState,
    kind: ControlKind,
    name: str,
    words: Sequence[str],
    *,
    before: str | None = None,
    bundle: str | None = None,
    dry_run: bool = False,
) -> Change[ControlOutcome]:
    """Add a line with values given as KEY=VALUE, at the end or before another one.

    Raises
    ------
    InputError
        With everything that is or would be wrong in the text; nothing is written then.
    UsageError
        If a named record does not exist, or there are several.
    """

    def edit(file: _File, lines: ControlLines) -> ControlLines:
        form = file.form
        fields, faults = with_words(form, [name, *[None] * (len(form.keys) - 1)], words)
        _raise(faults)
        for line in file.form.records(lines):
            known = form.fields_of(line)
            if form.identity_of(known) == form.identity_of(fields):
                return _known(file, lines, line, fields)
        number = None if before is None else _find(file, lines, before).number
        return lines.with_record([text for text in fields if text is not None], number, form.identity)

    return _change(_file(state, kind, bundle), edit, dry_run=dry_run)


def edit_control(
    state: ProjectState,
    kind: ControlKind,
    name: str,
    words: Sequence[str],
    *,
    bundle: str | None = None,
    dry_run: bool = False,
) -> Change[ControlOutcome]:
    """Change values of a line, its name as well; raises what `add_control` does.

    `name` is the record's name, or as many of its first fields as distinguish it from others, separated by blanks.
    """

    def edit(file: _File, lines: ControlLines) -> ControlLines:
        line = _find(file, lines, name)
        fields, faults = with_words(file.form, file.form.fields_of(line), words)
        _raise(faults)
        return _with_fields(file.form, lines, line, fields)

    return _change(_file(state, kind, bundle), edit, dry_run=dry_run)


def kill_control(
    state: ProjectState, kind: ControlKind, names: Sequence[str], *, bundle: str | None = None, dry_run: bool = False
) -> Change[ControlOutcome]:
    """Delete the named lines, or all if none is named; comments on lines of their own stay; raises as `add_control`."""

    def edit(file: _File, lines: ControlLines) -> ControlLines:
        found = [_find(file, lines, name) for name in names] if names else file.form.records(lines)
        return lines.without_lines(line.number for line in found)

    return _change(_file(state, kind, bundle), edit, dry_run=dry_run)


def weight_control(
    state: ProjectState, kind: ControlKind, weighting: Weighting, names: Sequence[str], *, dry_run: bool = False
) -> Change[ControlOutcome]:
    """Disregard records (a-priori errors become negative), include them again, or reject control points altogether.

    Raises
    ------
    InputError
        If an a-priori error is 0, which has no sign; else what `add_control` raises.
    UsageError
    """

    def edit(file: _File, lines: ControlLines) -> ControlLines:
        faults: list[str] = []
        for name in names:
            lines = _weighted(file, lines, _find(file, lines, name), weighting, faults)
        _raise(faults)
        return lines

    return _change(_file(state, kind, None), edit, dry_run=dry_run)


# one line


def _find(file: _File, lines: ControlLines, name: str) -> TextLine:
    form = file.form
    found = [line for line in file.form.records(lines) if form.is_meant(name, form.fields_of(line))]
    if len(found) == 1:
        return found[0]
    if not found:
        known = listed_names(dict.fromkeys(line.fields[0].text for line in file.form.records(lines)))
        message = f"{file.shown} has no {form.singular} '{shown_token(name)}'; known are: {known}"
    else:
        listed = ", ".join(f"'{' '.join(field.text for field in line.fields[: form.identity])}'" for line in found)
        message = f"{file.shown} has {len(found)} of the name '{shown_token(name)}'; write one of {listed}, in quotes"
    raise UsageError(message)


def _known(file: _File, lines: ControlLines, line: TextLine, fields: Fields) -> ControlLines:
    """Return the lines as they are if a record that is to be added is there with the same values."""
    known = file.form.fields_of(line)
    words = [f"{key}={text or ''}" for key, text in zip(file.form.keys, fields, strict=True)]
    same, _ = with_words(file.form, known, words)
    if same[file.form.identity :] == known[file.form.identity :] and not file.form.is_rejected(line):
        return lines
    name = " ".join(field.text for field in line.fields[: file.form.identity])
    message = f"{file.form.singular} {name} already exists with other values; change it with 'edit'"
    raise InputError.single(message, file.shown, line.number)


def _with_fields(form: ControlForm, lines: ControlLines, line: TextLine, fields: Fields) -> ControlLines:
    old = form.fields_of(line)
    new = {index: text for index, text in enumerate(fields) if text is not None and text != old[index]}
    count, before = fields.index(None) if None in fields else len(fields), form.count(line)
    if count != before:
        lines = lines.without_fields(line.number, min(count, before))
    lines = lines.with_fields(line.number, new)
    return lines.with_fields(line.number, {count: REJECTED}) if count != before and form.is_rejected(line) else lines


def _weighted(
    file: _File, lines: ControlLines, line: TextLine, weighting: Weighting, faults: list[str]
) -> ControlLines:
    form = file.form
    if weighting == "reject":
        return lines if form.is_rejected(line) else lines.with_fields(line.number, {len(line.fields): REJECTED})
    fields = form.fields_of(line)
    for index, key in enumerate(form.keys):
        text = fields[index]
        if key not in form.errors or text is None or text == UNKNOWN or not is_number(text):
            continue
        if weighting == "disregard" and parse_number(text) == 0.0:
            faults.append(
                f"{form.singular} {fields[0]}: {key} is 0 (constant), which has no sign; give it an a-priori error "
                f"{'or reject the point' if form.rejects else 'or kill the line'}"
            )
        fields[index] = text.lstrip("+-") if weighting == "include" else f"-{text.lstrip('+-')}"
    lines = _with_fields(form, lines, line, fields)
    rejected = weighting == "include" and form.is_rejected(line)
    return lines.without_fields(line.number, form.count(line)) if rejected else lines


# the file


def _file(state: ProjectState, kind: ControlKind, bundle: str | None) -> _File:
    project = state.project
    if kind == "preliminary":
        name = project.bundle_name(bundle)
        return _File(state, kind, project.preliminary(name), name)
    path = project.folder / f"{project.definition.control_files}.{FORMS[kind].extension}"
    return _File(state, kind, path, None)


def _read(file: _File) -> ControlLines:
    """Return the lines of the file; a file whose name differs only in case is an error."""
    if not file.path.exists():
        texts = file.state.texts
        found: Parsed[Any] = texts.control if file.bundle is None else texts.control_input(file.bundle)
        same = [complaint for complaint in found.complaints if complaint.path.lower() == file.shown.lower()]
        if same:
            raise InputError(same)
    return read_control_lines(file.path, file.shown)


def _change(file: _File, edit: _Edit, *, dry_run: bool) -> Change[ControlOutcome]:
    digest = digest_of_text(file.path)
    old = _read(file)
    new = edit(file, old)
    changes = tuple(_changes(old, new))
    warnings = _check(file, new) if changes else ()
    known = {warning.text for warning in file.form.parse(old.parsed, file.shown).warnings}
    touched = [change.line for change in changes if change.new is not None]
    names = unknown_name_warnings(file.state, file.kind, file.shown, new, touched)
    warnings = (*(warning for warning in warnings if warning.text not in known), *names)
    outcome = ControlOutcome(file.project, file.shown, changes, warnings, dry_run)
    if dry_run or not changes:
        return Change(file.state, outcome)
    # another run that edits the same text at the same time waits, as for a store
    lock = file.project.exterior
    text = EditedText(file.path, digest, new.text, "the file is unchanged")
    locks = (lock,) if is_written(lock) else ()
    return Change(file.state, outcome, locks=locks, is_compared=False, edited_texts=(text,))


def _check(file: _File, lines: ControlLines) -> tuple[ProjectWarning, ...]:
    parsed = file.form.parse(lines.parsed, file.shown)
    if parsed.complaints:
        raise InputError(parsed.complaints)
    return parsed.warnings


def _changes(old: ControlLines, new: ControlLines) -> Iterator[LineChange]:
    """Compare line by line: an edit adds one line, deletes some, or changes some."""
    before, after = old.parsed.value, new.parsed.value
    if len(after) > len(before):
        first = next((n for n, (was, now) in enumerate(zip(before, after, strict=False)) if was != now), len(before))
        yield LineChange("added", first + 1, None, after[first])
    elif len(after) < len(before):
        kept = iter([*after, None])
        waiting = next(kept)
        for number, line in enumerate(before, start=1):
            if line == waiting:
                waiting = next(kept)
            else:
                yield LineChange("killed", number, line, None)
    else:
        for number, (was, now) in enumerate(zip(before, after, strict=True), start=1):
            if was != now:
                yield LineChange("changed", number, was, now)


def _raise(faults: Sequence[str]) -> None:
    if faults:
        raise InputError([Complaint(fault) for fault in faults])
