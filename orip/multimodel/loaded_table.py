"""Which drive table the plate processor has: that of the project as it is measured now, or an older one.

A template that was mounted again, a photo whose marks were measured again or an adjustment changes where every point is
on the plates. Until the table is loaded again, the plate processor drives to where points were before.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from orip.errors import InputError, LinkError, ProjectWarning
from orip.files.text.regular_file import file_digest
from orip.multimodel.link.client import ProcessorFault, observe_link
from orip.multimodel.table_step import DRIVEN_FROM, DriveTableOutcome, make_drive_table
from orip.multimodel.table_text import drive_table_text
from orip.records.drive_table import DriveCode
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import commit
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import ProjectState
from orip.workflow.project.texts import EDITS_FILE

_DOWNLOAD = "run 'orip measure' and 'orip drive download'"

_REPLY_S = 2.0
"""`orip status` waits no longer for a plate processor."""


class TableHolder(Protocol):
    """The part of a plate processor that concerns its drive table."""

    def digest(self) -> str:
        """Return the SHA-256 of the table that is loaded."""

    def download(self, table: bytes) -> str:
        """Load a table."""


def loaded_digest(processor: TableHolder) -> str | None:
    """Return the digest of the table that is loaded; None where there is none."""
    try:
        return processor.digest()
    except ProcessorFault as fault:
        if fault.code != DriveCode.NO_TABLE:
            raise
        return None


def table_fault(folder: Path, bundles: Sequence[str], loaded: str) -> str | None:
    """Say in what a loaded table differs from those of the project; None: it is one of them.

    Parameters
    ----------
    folder : Path
    bundles : sequence of str
        Those that may be meant.
    loaded : str
        Digest of the table that is loaded.
    """
    try:
        state = mounted_films(folder, Path(EDITS_FILE), *DRIVEN_FROM).state
        made = [table for name in bundles if (table := _table(state, name)) is not None]
    except InputError as error:
        return f"cannot be compared with the project's: {error.complaints[0]}"
    if any(hashlib.sha256(table).hexdigest() == loaded for table in made):
        return None
    if not made:
        return "is not one of this project: none of its bundles can be driven in"
    return (
        "is not the one that the last adjustment, mounting and measurement of marks give: points are driven to where "
        "they were before"
    )


def table_warnings(
    folder: Path,
    bundles: Sequence[str],
    loaded: str,
    where: str,
    remedy: str = "run 'orip measure' and 'orip drive download'",
) -> tuple[ProjectWarning, ...]:
    """Return a warning where another table is loaded than the project has, with what mends it."""
    fault = table_fault(folder, bundles, loaded)
    if fault is None:
        return ()
    return (ProjectWarning("stale-table", f"the drive table {where}", f"{fault}; {remedy}"),)


def download_step(state: ProjectState, url: str) -> Step | ProjectWarning:
    """Return whether the plate processor has a table of the project; a warning: it is not reached."""
    project = state.project
    command = "orip drive download"
    try:
        with observe_link(url, timeout_s=_REPLY_S, retries=0) as link:
            loaded = loaded_digest(link)
    except LinkError as error:
        return ProjectWarning("no-processor", "", str(error))
    if loaded is None:
        return Step(command, "missing", f"no drive table is loaded at {url}")
    fault = table_fault(project.folder, project.bundle_names, loaded)
    if fault is None:
        return Step(command, "up to date", f"the plate processor at {url} has the table")
    return Step(command, "out of date", f"the drive table at {url} {fault}")


def load_again(folder: Path, log: Path, processor: TableHolder) -> str | None:
    """Load the table of the project again where the plate processor has an older one of it; return the bundle's name.

    Parameters
    ----------
    folder : Path
    log : Path
        With what has just been measured.
    processor : TableHolder

    Raises
    ------
    InputError
        If no table can be made.
    LinkError
        If the plate processor refuses it.
    """
    loaded = loaded_digest(processor)
    if loaded is None:
        return None
    state = mounted_films(folder, log, *DRIVEN_FROM).state
    for name in state.project.bundle_names:
        if _was_of_project(state.project, [name], loaded):
            change = make_drive_table(BundleState(state, name))
            commit(change)
            processor.download(_text(change.outcome))
            return name
    return None


def _text(outcome: DriveTableOutcome) -> bytes:
    return drive_table_text(outcome.table).encode("ascii")


def _table(state: ProjectState, name: str) -> bytes | None:
    """Return the table of a bundle; None where it has none."""
    try:
        return _text(make_drive_table(BundleState(state, name)).outcome)
    except InputError:
        return None


def _was_of_project(project: ProjectFolder, bundles: Sequence[str], loaded: str) -> bool:
    """Tell whether a loaded table is one that was written for the project: then only its values can be old."""
    paths = [project.drive_table(name) for name in bundles]
    return any(path.is_file() and file_digest(path) == loaded for path in paths)
