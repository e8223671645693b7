"""`orip archive status`: how far a run is, told from the files that it writes."""

from __future__ import annotations

import time
from pathlib import Path

from msgspec import Struct

from orip.archive.progress import Progress
from orip.errors import LockedError
from orip.files.archive.finished import read_heads
from orip.files.archive.layout import ResultsFolder
from orip.files.archive.plan import ArchivePlan, read_plan
from orip.files.text.own_files import locked


class ArchiveStatus(Struct, frozen=True):
    """How far a run is.

    Parameters
    ----------
    plan : ArchivePlan
    progress : Progress
    is_running : bool
        A program is writing the results.
    wrong : tuple of (str, str)
        Name and message of the projects that are not adjusted.
    """

    plan: ArchivePlan
    progress: Progress
    is_running: bool
    wrong: tuple[tuple[str, str], ...]


def archive_status(folder: Path) -> ArchiveStatus:
    """Return how far the run of an archive is, or was when it ended.

    Raises
    ------
    UsageError
        If the folder holds no results of an archive.
    LockedError
        If a run is starting that will write them.
    InputError
    """
    results = ResultsFolder(folder)
    if not results.plan.exists() and _is_locked(results):
        message = f"a run that writes to '{folder}' is starting its workers; ask again in a few seconds"
        raise LockedError(message)
    plan = read_plan(folder, str(folder))
    names = frozenset(plan.projects)
    progress, wrong, last = Progress(len(names)), [], plan.began
    for head in read_heads(results):
        if head.name not in names or head.settings.split(" ")[0] != plan.settings or head.state == "machine":
            continue
        progress.states[head.state] += 1
        progress.repeated += head.ended < plan.began
        last = max(last, head.ended)
        if head.state != "adjusted":
            wrong.append((head.name, head.message))
    is_running = _is_locked(results)
    progress.seconds = (time.time() if is_running else last) - plan.began
    return ArchiveStatus(plan, progress, is_running, tuple(sorted(wrong)))


def _is_locked(results: ResultsFolder) -> bool:
    if not results.lock.is_file():
        return False
    try:
        with locked(results.lock, str(results.lock), timeout=0.0):
            return False
    except LockedError:
        return True
