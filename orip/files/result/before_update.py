"""before_update.json: what `orip update` replaced, for `orip update --undo`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec

from orip.errors import InputError
from orip.files.text.lines import sound_text
from orip.records.results.stations import BeforeUpdate, Kept, RecordBefore, TextBefore

SCHEMA = "orip.before_update/1"
_WHAT = ("cameras", "photos", "points")
_FIELDS = {
    "cameras": {"parameters", "distortion_isp", "distortion_curve"},
    "photos": {"orientation"},
    "points": set[str](),
}
"""The fields that an update of each kind may change."""


def before_update_text(before: BeforeUpdate) -> str:
    """Return the text of the file."""
    return json.dumps({"schema": SCHEMA, **msgspec.to_builtins(before)}, indent=1) + "\n"


def read_before_update(path: Path, shown: str) -> BeforeUpdate:
    """Read the file.

    Raises
    ------
    InputError
        If it is missing, or not as `orip update` has written it.
    """
    if not path.exists():
        message = "there is no update to undo: only the last one can be, and once"
        raise InputError.single(message)
    text = sound_text(path, shown)
    try:
        return _before_update(json.loads(text))
    except (KeyError, TypeError, ValueError, RecursionError) as fault:
        message = "this is not what 'orip update' wrote: the update cannot be undone; delete the file"
        raise InputError.single(message, shown) from fault


def _before_update(document: Any) -> BeforeUpdate:
    if document["schema"] != SCHEMA or document["what"] not in _WHAT:
        raise ValueError(document["schema"])
    text = document["text"]
    return BeforeUpdate(
        document["what"],
        _string(document["bundle"]),
        _string(document["run"]),
        tuple(_record(row, _FIELDS[document["what"]]) for row in document["records"]),
        None if text is None else TextBefore(text["text"] and _string(text["text"]), _string(text["updated"])),
    )


def _record(row: Any, known: set[str]) -> RecordBefore:
    fields = tuple((_string(name), _value(value)) for name, value in row["fields"])
    if not {name for name, _ in fields} <= known:
        raise ValueError(fields)
    return RecordBefore(_string(row["name"]), fields, _string(row["updated"]))


def _value(value: Any) -> Kept:
    if value is None:
        return None
    return tuple(map(_value, value)) if isinstance(value, list) else float(value)


def _string(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value
