"""`orip observations edit`: a photo point gets other coordinates, or another name, by a correction in EDITS.MEA."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orip.errors import InputError, UsageError
from orip.files.log.writing import edit_line, measurement_line, points_header
from orip.files.text.decimal_numbers import parse_number
from orip.files.text.lines import field_name_fault
from orip.files.text.shown import shown_token
from orip.records.measurement import EditRecord, LogRecord, PointsRecord, TextPlace
from orip.records.names import record_key
from orip.workflow.observations.edits import AddedEdits, ReplayedLog, applied, replayed_log
from orip.workflow.observations.todo import Named, chosen_names, edited_owner
from orip.workflow.project.commit import Change
from orip.workflow.project.state import ProjectState

_KEYS = "x=..., y=... and name=..."


def edit_point(
    state: ProjectState, photo: str, name: str, words: Sequence[str], *, bundle: str | None, is_trial: bool
) -> Change[AddedEdits]:
    """Correct what was measured of a point in a photo, now and whenever the log is replayed.

    What was measured before is deleted, so that the correction counts whatever `repeated_points` says; a point that is
    disregarded stays so.

    Parameters
    ----------
    state : ProjectState
        With `EDITED_FROM`.
    words : sequence of str
        ``x=35.2310 y=180.0040`` in plate millimetres or pixels, as in a measurement file, and ``name=NEW_NAME``.
    bundle : str or None
        None: the project's only one.
    is_trial : bool
        The change writes nothing.

    Raises
    ------
    UsageError
        If the words are something else.
    InputError
        If the point is not measured there, or one of the new name is.
    """
    xy, new_name = _correction(words)
    before = replayed_log(state)
    of_bundle = state.project.bundle_name(bundle)
    named = Named("POINT", of_bundle, edited_owner("POINT", photo, state.records))
    if "*" in (photo, name):
        message = "one point in one photo is corrected at a time; name both"
        raise UsageError(message)
    chosen_names("DISREGARD", named, [name], before.log.records, state.records, before.replayed.measured)
    shown, line = before.edits.shown, before.edits.line_count
    records: list[LogRecord] = []
    lines: list[str] = []

    def edit(action: str, *more: str) -> None:
        place = TextPlace(shown, line + len(lines) + 1)
        record = EditRecord(place, action, "POINT", of_bundle, named.owner, name, *more)  # type: ignore[arg-type]
        records.append(record)
        lines.append(edit_line(record))

    if xy is not None:
        is_disregarded = _is_disregarded(before, of_bundle, photo, name)
        edit("KILL")
        records.append(_measured(shown, line + len(lines) + 1, (of_bundle, named.owner, name), xy, is_disregarded))
        lines += [points_header(of_bundle, named.owner), measurement_line(name, xy, is_disregarded=is_disregarded)]
    if new_name is not None:
        edit("RENAME", new_name)
    return applied(before, of_bundle, records, lines, is_trial=is_trial)


def _correction(words: Sequence[str]) -> tuple[tuple[float, float] | None, str | None]:
    given: dict[str, str] = {}
    for word in words:
        key, equals, text = word.partition("=")
        if key not in ("x", "y", "name") or not equals or not text or key in given:
            message = f"'{shown_token(word)}' corrects nothing; write {_KEYS}, each once"
            raise UsageError(message)
        given[key] = text
    if not given or ("x" in given) != ("y" in given):
        message = f"give x=... and y=... together, or name=..., or all: {_KEYS}"
        raise UsageError(message)
    if "name" in given and (fault := field_name_fault(given["name"])) is not None:
        message = f"'{shown_token(given['name'])}' cannot be the name of a point: {fault}"
        raise InputError.single(message)
    return (_number(given["x"]), _number(given["y"])) if "x" in given else None, given.get("name")


def _number(text: str) -> float:
    try:
        value = parse_number(text)
    except ValueError:
        value = math.nan
    # the log has four decimals
    if not abs(value) <= 1e6:
        message = f"'{shown_token(text)}' is no coordinate; write plate millimetres or pixels, such as 35.2310"
        raise UsageError(message)
    return value


def _is_disregarded(before: ReplayedLog, bundle: str, photo: str, name: str) -> bool:
    found = before.replayed.measured.observations.get(record_key(bundle))
    if found is None:
        return False
    rows = [
        row
        for row, (of_photo, point) in enumerate(zip(found.photos, found.points, strict=True))
        if point == name and record_key(of_photo) == record_key(photo)
    ]
    return bool(rows) and bool(found.disregarded[rows].all())


def _measured(
    shown: str, line: int, names: tuple[str, str, str], xy: tuple[float, float], is_disregarded: bool
) -> PointsRecord:
    bundle, photo, name = names
    return PointsRecord(
        place=TextPlace(shown, line),
        bundle=bundle,
        photo=photo,
        names=(name,),
        # as it will be read: the log has as many decimals as it needs
        measured=np.array([[float(word) for word in measurement_line(name, xy).split()[1:3]]]),
        errors=np.full((1, 2), np.nan),
        errors_in_pixels=np.zeros((1, 2), dtype=np.bool_),
        disregarded=np.array([is_disregarded]),
        lines=np.array([line + 1]),
    )
