"""`orip archive diff`: values that differ between two runs of an archive by more than their standard deviations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from msgspec import Struct

from orip.archive.cluster.connection import require_dask
from orip.archive.results import read_shard
from orip.archive.run_files import SHARDS, ResultsFolder, read_plan
from orip.archive.tables import NAME_COLUMN, VALUES, Cell, Row
from orip.errors import UsageError
from orip.progress import stage

ANGLES = frozenset({"omega", "phi", "kappa"})
_CIRCLE = 360.0

OUTCOME = "outcome"
"""Name of the word that tells how a whole project ended."""

Key = tuple[Cell, ...]


class Moved(Struct, frozen=True):
    """A value that has moved by more than its standard deviation.

    Parameters
    ----------
    name : str
        What it is a value of: ``photo 101 X0``.
    times : float
        The difference in standard deviations, the larger of the two; infinite where neither run has one.
    """

    project: str
    bundle: str
    name: str
    before: float
    after: float
    times: float


class Changed(Struct, frozen=True):
    """A word that is another one: how a project ended, its status, a gate; empty where one of the runs has none."""

    project: str
    bundle: str
    name: str
    before: str
    after: str


def moved_values(table: str, before: Iterable[Row], after: Iterable[Row], limit: float) -> Iterator[Moved]:
    """Yield the values of a table that differ by more than `limit` standard deviations, and those without one.

    Parameters
    ----------
    table : {"cameras", "photos", "points"}
    """
    name_column = NAME_COLUMN[table]
    old, new = _by_key(before, name_column), _by_key(after, name_column)
    for key in old.keys() & new.keys():
        one, other = old[key], new[key]
        for column in VALUES[table]:
            times, was, is_now = _times(column, one, other)
            if times > limit:
                yield Moved(str(key[0]), str(key[1]), f"{name_column} {key[2]} {column}", was, is_now, times)


def _times(column: str, one: Row, other: Row) -> tuple[float, float, float]:
    """Return the difference in standard deviations, and the two values."""
    was, is_now = _number(one[column]), _number(other[column])
    difference = abs(was - is_now)
    if column in ANGLES:
        difference = min(difference % _CIRCLE, _CIRCLE - difference % _CIRCLE)
    if not difference > 0.0:
        return 0.0, was, is_now
    deviations = [_number(row[f"sd_{column}"]) for row in (one, other)]
    largest = max((value for value in deviations if not math.isnan(value)), default=0.0)
    return (difference / largest if largest > 0.0 else math.inf), was, is_now


def changed_outcomes(before: Sequence[Row], after: Sequence[Row]) -> Iterator[Changed]:
    """Yield how projects ended otherwise, or were in one of the runs alone; of those adjusted in both, their bundles.

    Parameters
    ----------
    before, after : sequences of Row
        Of the table of projects.
    """
    old, new = _by_project(before), _by_project(after)
    adjusted = set()
    for project in sorted(old.keys() | new.keys()):
        one, other = _outcome(old.get(project, ())), _outcome(new.get(project, ()))
        if one != other:
            yield Changed(project, "", OUTCOME, one, other)
        else:
            adjusted.add(project)
    old_rows, new_rows = ([row for row in rows if row["project"] in adjusted] for rows in (before, after))
    yield from changed_words(old_rows, new_rows, None, ("state", "status", "message"))


def _by_project(rows: Iterable[Row]) -> Mapping[str, list[Row]]:
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(str(row["project"]), []).append(row)
    return found


def _outcome(rows: Sequence[Row]) -> str:
    """Return how a project ended; a project without a bundle has one row, with its error."""
    if not rows:
        return ""
    failed = [f"{row['state']}: {row['message']}" for row in rows if not row["bundle"]]
    return failed[0] if failed else "adjusted"


def changed_words(
    before: Iterable[Row], after: Iterable[Row], name_column: str | None, columns: Sequence[str]
) -> Iterator[Changed]:
    """Yield the words that differ, and rows that one of the runs has alone.

    Parameters
    ----------
    name_column : str or None
        The column that names a row besides project and bundle; None: there is none.
    columns : sequence of str
        Those that are compared.
    """
    old, new = _by_key(before, name_column), _by_key(after, name_column)
    for key in sorted(old.keys() | new.keys(), key=str):
        one, other = old.get(key), new.get(key)
        for column in columns:
            words = _word(one, column), _word(other, column)
            if words[0] != words[1]:
                name = str(key[2]) if name_column else column
                yield Changed(str(key[0]), str(key[1]), name, *words)


def _by_key(rows: Iterable[Row], name_column: str | None) -> Mapping[Key, Row]:
    columns = ("project", "bundle", *([name_column] if name_column else []))
    return {tuple(row[column] for column in columns): row for row in rows}


def _word(row: Row | None, column: str) -> str:
    cell = None if row is None else row[column]
    if isinstance(cell, bool):
        return "pass" if cell else "FAIL"
    return "" if cell is None else str(cell)


def _number(cell: Cell) -> float:
    return float(cell) if isinstance(cell, int | float) else math.nan


class ArchiveDifferences(Struct, frozen=True):
    """What differs between two runs.

    Parameters
    ----------
    compared : int
        Projects (with their bundles) that both have.
    changed : tuple of Changed
        How they ended; gates.
    moved : tuple of Moved
        Values, the largest first.
    """

    compared: int
    changed: tuple[Changed, ...]
    moved: tuple[Moved, ...]

    @property
    def is_equal(self) -> bool:
        """Tell whether there is nothing to show."""
        return not (self.changed or self.moved)


def archive_differences(before: Path, after: Path, sigma: float) -> ArchiveDifferences:
    """Compare two runs, shard by shard, so that memory does not grow with the archive.

    Parameters
    ----------
    before, after : Path
        Their folders of results.
    sigma : float
        Values that differ by no more than so many standard deviations are equal.

    Raises
    ------
    UsageError, InputError
    """
    require_dask()
    folders = tuple(ResultsFolder(folder) for folder in (before, after) if read_plan(folder, str(folder)))
    for results in folders:
        if not results.dataset.is_dir():
            message = f"'{results.folder}' has no tables yet; 'orip archive report {results.folder}' writes them"
            raise UsageError(message)
    compared, changed, moved = 0, list[Changed](), list[Moved]()
    with stage("diff", len(SHARDS)) as advance:
        for done, shard in enumerate(SHARDS, start=1):
            old, new = (read_shard(results, "projects", shard) for results in folders)
            compared += len(_keys(old) & _keys(new))
            outcomes = list(changed_outcomes(old, new))
            elsewhere = {word.project for word in outcomes if word.name == OUTCOME}
            old, new = (read_shard(results, "gates", shard) for results in folders)
            gates = changed_words(old, new, "gate", ("passed",))
            # a project that was not adjusted has no gates
            changed += [*outcomes, *(word for word in gates if word.project not in elsewhere)]
            moved += _moved(folders, shard, sigma)
            advance(done)
    moved.sort(key=lambda value: (-value.times, value.project, value.bundle, value.name))
    changed.sort(key=lambda word: (word.project, word.bundle, word.name))
    return ArchiveDifferences(compared, tuple(changed), tuple(moved))


def _moved(folders: tuple[ResultsFolder, ...], shard: str, sigma: float) -> Iterator[Moved]:
    for table in NAME_COLUMN:
        old, new = (read_shard(results, table, shard) for results in folders)
        yield from moved_values(table, old, new, sigma)


def _keys(rows: Iterable[Row]) -> set[tuple[Cell, Cell]]:
    return {(row["project"], row["bundle"]) for row in rows}
