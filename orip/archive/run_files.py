"""The files of an archive's run: where they are, its plan, and what is kept of each finished project."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from msgspec import Struct, ValidationError, convert
from msgspec.structs import asdict

from orip.archive.tables import SCHEMA, ProjectOutcome, State
from orip.errors import InputError, UsageError
from orip.files.text.atomic import replace_text, reporting_failure
from orip.files.text.own_files import make_folder, make_named_folder
from orip.files.text.regular_file import NoRegularFileError, open_regular, regular_bytes
from orip.files.text.shown import shown_token

SHARDS = "0123456789abcdef"
"""Parts of each table: the first digit of the digest of the project's name."""

_DIGITS = 20


class ResultsFolder(Struct, frozen=True):
    """The folder of an archive's results."""

    folder: Path

    @property
    def plan(self) -> Path:
        """Return the file that says what is run."""
        return self.folder / "archive.json"

    @property
    def lock(self) -> Path:
        """Return the file that the running program holds locked."""
        return self.folder / "archive.lock"

    @property
    def finished(self) -> Path:
        """Return the folder of what is kept of each project."""
        return self.folder / "finished"

    @property
    def dataset(self) -> Path:
        """Return the folder of the tables."""
        return self.folder / "tables"

    @property
    def overview(self) -> Path:
        """Return the overview page."""
        return self.folder / "index.html"

    def project(self, name: str) -> Path:
        """Return the file that is kept of a project."""
        return self.shard(name_digest(name)[0]) / f"{name_digest(name)}.json"

    def shard(self, shard: str) -> Path:
        """Return the folder of the projects of a shard."""
        return self.finished / shard

    def table(self, table: str, shard: str) -> Path:
        """Return the file with the rows of a table that are those of a shard."""
        return self.dataset / table / f"shard={shard}" / "rows.parquet"


def name_digest(name: str) -> str:
    """Return the digits by which the files of a project are named: folders have names that files cannot have."""
    return hashlib.sha256(name.encode("utf-8", "surrogatepass")).hexdigest()[:_DIGITS]


class ArchivePlan(Struct, frozen=True):
    """What a run of an archive does.

    Parameters
    ----------
    base : str
        The folder from which projects are named, absolute.
    projects : tuple of str
        Their names.
    settings : str
        Digest of method, gates and version of orip.
    method : str
        The method in words.
    orip : str
        Version of orip.
    dashboard : str
        Address of Dask's dashboard; empty where orip has started the workers, which have none.
    began : float
        Seconds since 1970.
    """

    base: str
    projects: tuple[str, ...]
    settings: str
    method: str
    orip: str
    dashboard: str
    began: float


def write_plan(results: ResultsFolder, plan: ArchivePlan) -> None:
    """Write the plan.

    Raises
    ------
    OripError
        If the folder or the disk refuses.
    """
    with reporting_failure(results.plan, "remove the cause, or name another folder with --out"):
        make_named_folder(results.folder)
        replace_text(results.plan, json.dumps({"schema": SCHEMA, **asdict(plan)}, indent=1) + "\n")


def read_plan(folder: Path, shown: str) -> ArchivePlan:
    """Read the plan of a results folder.

    Raises
    ------
    UsageError
        If the folder holds no results of an archive.
    InputError
        If the plan is damaged, no file, or of another schema.
    """
    results = ResultsFolder(folder)
    at = f"{shown}/{results.plan.name}"
    try:
        found = json.loads(regular_bytes(results.plan))
        schema = found.pop("schema")
        if schema == SCHEMA:
            return convert(found, ArchivePlan)
    except NoRegularFileError as error:
        message = f"is {error.kind}, not a file; remove it, and 'orip archive run' writes one"
        raise InputError.single(message, at) from None
    except OSError:
        message = (
            f"'{shown}' holds no results of an archive: there is no {results.plan.name}; 'orip archive run' makes it"
        )
        raise UsageError(message) from None
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError, ValidationError):
        schema = "something else"
    message = f"holds {shown_token(str(schema))} where this version reads {SCHEMA}; 'orip archive run' writes it again"
    raise InputError.single(message, at)


# Both have a SHA-256 in the head: what is read is what was written. The head alone says whether the project has to be
# adjusted again; reading five thousand heads is quick.


class FinishedHead(Struct, frozen=True):
    """The head of a finished project; see `orip.archive.tables.ProjectOutcome`.

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
