"""What is kept of a finished project: a file of two lines of JSON, its head and its rows.

Both have a SHA-256 in the head: what is read is what was written. The head alone says whether the project has to be
adjusted again; reading five thousand heads is quick.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from msgspec import Struct, ValidationError, convert

from orip.archive.outcome import ProjectOutcome, State
from orip.archive.tables import SCHEMA
from orip.errors import InputError
from orip.files.archive.layout import SHARDS, ResultsFolder
from orip.files.text.atomic import replace_text
from orip.files.text.own_files import make_folder
from orip.files.text.regular_file import open_regular, regular_bytes


class FinishedHead(Struct, frozen=True):
    """The head of a finished project; see `orip.archive.outcome.ProjectOutcome`.

    `settings` is the digest of method, gates and version of orip; `ended` is the clock, seconds since 1970;
    `rows` is the digest of the rows.
    """

    name: str
    state: State
    message: str
    settings: str
    texts: str
    steps: str
    ended: float
    rows: str


def write_finished(results: ResultsFolder, outcome: ProjectOutcome, settings: str, ended: float) -> None:
    """Write what is kept of a project; it is whole at any instant.

    Raises
    ------
    OSError
    """
    path = results.project(outcome.name)
    make_folder(path.parent, results.folder)
    head = {
        "schema": SCHEMA,
        "project": outcome.name,
        "state": outcome.state,
        "message": outcome.message,
        "settings": settings,
        "texts": outcome.texts,
        "steps": outcome.steps,
        "ended": ended,
    }
    rows = _json({**outcome.tables, "runs": [outcome.run] if outcome.run else []})
    head["rows"] = _digest(rows)
    head["head"] = _digest(_json(head))
    replace_text(path, f"{_json(head)}\n{rows}\n")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("ascii", "replace")).hexdigest()


def _json(content: object) -> str:
    return json.dumps(content, ensure_ascii=True, separators=(",", ":"))


def read_head(results: ResultsFolder, name: str) -> FinishedHead | None:
    """Return the head of a project; None if there is none, or one of another schema."""
    return _head(results.project(name))


def read_heads(results: ResultsFolder) -> Iterator[FinishedHead]:
    """Yield the heads of all projects that are finished."""
    for path in _files(results, SHARDS):
        head = _head(path)
        if head is not None:
            yield head


def read_rows(results: ResultsFolder, shard: str) -> Iterator[tuple[FinishedHead, dict[str, list[dict[str, Any]]]]]:
    """Yield heads and rows by table of the projects of a shard, by their names.

    Raises
    ------
    InputError
        If a file has a head, and no rows.
    """
    found = []
    for path in _files(results, shard):
        head = _head(path)
        if head is not None:
            found.append((head.name, path, head))
    for _, path, head in sorted(found, key=lambda item: item[0]):
        rows = _rows(path, head)
        if rows is None:
            message = "is damaged; remove it, and 'orip archive run' adjusts its project again"
            raise InputError.single(message, str(path))
        yield head, rows


def _rows(path: Path, head: FinishedHead) -> dict[str, list[dict[str, Any]]] | None:
    """Return the rows of a project; None if they are not what was written with the head."""
    try:
        line = regular_bytes(path).split(b"\n")[1]
        found = convert(json.loads(line), dict[str, list[dict[str, Any]]])
    except (OSError, ValueError, IndexError, RecursionError, ValidationError):
        return None
    return found if hashlib.sha256(line).hexdigest() == head.rows else None


def _files(results: ResultsFolder, shards: str) -> Iterator[Path]:
    for shard in shards:
        folder = results.shard(shard)
        if folder.is_dir():
            yield from sorted(path for path in folder.iterdir() if path.suffix == ".json")


def _head(path: Path) -> FinishedHead | None:
    try:
        with open_regular(path) as stream:
            found = json.loads(stream.readline())
        if found["schema"] != SCHEMA or found.pop("head") != _digest(_json(found)):
            return None
        return convert({**found, "name": found["project"]}, FinishedHead)
    except (
        OSError,
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        RecursionError,
        ValidationError,
    ):  # none, or not what this version writes: adjusted again
        return None
