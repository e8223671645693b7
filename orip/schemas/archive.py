"""Documents of archives of projects."""

from __future__ import annotations

from typing import Literal

from orip.schemas.parts import Part


class ArchiveRun(Part, frozen=True):
    """A run of an archive that has come to its end."""

    command: Literal["archive run"]
    projects: int
    states: dict[str, int]
    finished_before: int
    seconds: float
    tables: str
    overview: str


class NotAdjusted(Part, frozen=True):
    """A project that is not adjusted, and why."""

    project: str
    message: str


class ArchiveStatus(Part, frozen=True):
    """How far the run of an archive is."""

    command: Literal["archive status"]
    base: str
    running: bool
    projects: int
    states: dict[str, int]
    projects_a_second: float
    seconds_left: float | None
    dashboard: str
    not_adjusted: list[NotAdjusted]


class ArchiveReport(Part, frozen=True):
    """Tables and overview of an archive that were written; rows by table."""

    command: Literal["archive report"]
    rows: dict[str, int]
    tables: str
    overview: str


class ChangedWord(Part, frozen=True):
    """A result or a gate that is another one."""

    project: str
    bundle: str
    name: str
    before: str
    after: str


class MovedValue(Part, frozen=True):
    """A value that has moved; times its standard deviation, null: it has none."""

    project: str
    bundle: str
    name: str
    before: float
    after: float
    times: float | None


class ArchiveDiff(Part, frozen=True):
    """What differs between two runs of an archive."""

    command: Literal["archive diff"]
    compared: int
    changed: list[ChangedWord]
    moved: list[MovedValue]


class ArchiveSimulate(Part, frozen=True):
    """An archive of simulated projects that was written; faults by kind."""

    command: Literal["archive simulate"]
    folder: str
    projects: int
    faults: dict[str, int]
