"""`orip archive diff`: two runs of an archive compared, from their tables."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from msgspec import Struct

from orip.archive.differences import OUTCOME, Changed, Moved, changed_outcomes, changed_words, moved_values
from orip.archive.tables import NAME_COLUMN, Cell, Row
from orip.errors import UsageError
from orip.files.archive.dataset import read_shard
from orip.files.archive.layout import SHARDS, ResultsFolder
from orip.files.archive.plan import read_plan
from orip.progress import stage
from orip.workflow.archive.packages import require_dask


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
