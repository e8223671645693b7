"""What is kept of a project of an archive: how it ended, and its rows in the tables of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

from msgspec import Struct, field

from orip.archive.tables import Row

State = Literal["adjusted", "wrong", "over limit", "machine"]
"""Adjusted: see the status of its bundles. Wrong: its input. Over limit: of time or memory. Machine: it ended by
something that is not in the project, such as a full disk, and is run again next time."""

Tables = Mapping[str, Sequence[Row]]


class ProjectOutcome(Struct, frozen=True):
    """How a project ended.

    Parameters
    ----------
    name : str
        Of the project in the archive.
    state : State
    message : str
        The first line that a user would see of its error; empty without one.
    texts, steps : str
        Digests of its texts as they were read, and of its steps as `orip status` showed them afterwards.
    tables : Tables
        Rows by table, without those of `runs`.
    run : Row
        Its row of `runs`.
    """

    name: str
    state: State
    message: str = ""
    texts: str = ""
    steps: str = ""
    tables: Tables = field(default_factory=dict)
    run: Row = field(default_factory=dict)


def rows_of_error(name: str, state: State, message: str) -> Tables:
    """Return the rows of a project without a result."""
    return {"projects": [{"project": name, "bundle": "", "state": state, "message": message}]}
