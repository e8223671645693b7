"""`orip archive status`: how far a run is, told from the files that it writes."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

from msgspec import Struct, field

from orip.archive.run_files import ArchivePlan, ResultsFolder, read_heads, read_plan
from orip.archive.tables import State
from orip.errors import LockedError
from orip.files.text.own_files import locked
from orip.wording import agreeing

_MINUTE, _HOUR = 60.0, 3600.0


class Progress(Struct):
    """How far a run of an archive is.

    Parameters
    ----------
    total : int
        Projects of the archive.
    states : Counter of State
        How many have ended, and how.
    repeated : int
        How many of these were finished before and were not adjusted again.
    seconds : float
        Since the run began.
    """

    total: int
    states: Counter[State] = field(default_factory=Counter)
    repeated: int = 0
    seconds: float = 0.0

    @property
    def ended(self) -> int:
        """Return how many projects have ended."""
        return self.states.total()

    @property
    def rate(self) -> float:
        """Return the projects adjusted a second; those that were finished before take next to no time."""
        computed = self.ended - self.repeated
        return computed / self.seconds if self.seconds > 0.0 else 0.0

    @property
    def seconds_left(self) -> float | None:
        """Return the time that is left at this rate; None while nothing is known."""
        return (self.total - self.ended) / self.rate if self.rate > 0.0 else None

    def __str__(self) -> str:
        """Return ``120 of 5000 projects, 3 wrong; 3.2 a second, 25 min left``."""
        others = [f"{count} {state}" for state, count in sorted(self.states.items()) if state != "adjusted"]
        text = ", ".join([f"{self.ended} of {self.total} {agreeing(self.total, 'project')}", *others])
        if self.repeated:
            text += f", {self.repeated} finished before"
        if self.ended < self.total and self.seconds_left is not None:
            text += f"; {self.rate:.2g} a second, {duration(self.seconds_left)} left"
        return text


def duration(seconds: float) -> str:
    """Return a time as ``40 s``, ``25 min`` or ``3.5 h``."""
    if seconds < 2 * _MINUTE:
        return f"{seconds:.0f} s"
    if seconds < 2 * _HOUR:
        return f"{seconds / _MINUTE:.0f} min"
    return f"{seconds / _HOUR:.1f} h"


class ArchiveStatus(Struct, frozen=True):
    """How far a run is.

    Parameters
    ----------
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
