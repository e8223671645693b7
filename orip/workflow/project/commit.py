"""What a command changes, and the one place where changes are written: first the stores, then the texts."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Generic, Protocol, Self, TypeVar

from msgspec import Struct

from orip.errors import LockedError
from orip.files.stores.contents import solutions
from orip.files.stores.contents.solution_tables import read_head
from orip.files.stores.digest import set_run, write_inputs
from orip.files.stores.store import Store
from orip.files.stores.transaction import Stores, writing
from orip.files.text.atomic import replace_bytes, reporting_failure, require_no_link
from orip.files.text.own_files import locked, remove_file
from orip.files.text.regular_file import regular_bytes
from orip.progress import stage
from orip.records.results.solution import Solution
from orip.workflow.project.definitions import measured_stores, write_definitions, write_measured
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.outputs import (
    EditedText,
    TextOutput,
    digest_of_text,
    remove_leftovers_of_kills,
    rewrite_stale_outputs,
    write_output,
)
from orip.workflow.project.state import Part, ProjectState, ReplayRecord, StoredParts, read_stored


class _State(Protocol):
    """A state of a project or bundle."""

    def read_again(self) -> Self:
        """Read the same parts of the stores again."""


S = TypeVar("S", bound=_State)
T = TypeVar("T")
U = TypeVar("U")

_COMPARED: frozenset[Part] = frozenset({"definitions", "replay", "heads"})
"""The parts that show whether another run has changed the stores: they are cheap to read again."""

_ATTEMPTS = 5

_NOTHING = StoredParts()
_STORES = "the record stores"


class ChangedMeanwhileError(LockedError):
    """Another run has changed what a change was computed from; `what` names it."""

    def __init__(self, what: str) -> None:
        super().__init__(f"another run has changed {what} in the meantime; nothing was written, repeat the command")


class Change(Struct, Generic[T], frozen=True):
    """What a command found out, and what it would write; nothing is written until `commit`.

    Parameters
    ----------
    state : ProjectState
        What it was computed from.
    outcome : T
        What there is to show.
    stored : StoredParts
        What the stores are to hold; parts that are None or not named stay as they are.
    locks : tuple of Path
        Stores that are locked, and made where they are missing; none: the stores are not touched, and edited texts are
        written while orip.toml is locked.
    is_compared : bool
        The change is refused if the stores are no longer as in `state`. False for a solution, which names the digests
        of what it was computed from: a change in the meantime shows in `orip status`.
    edited_texts : tuple of EditedText
        Written while the stores are locked and before they change: a text is ahead of the stores, never behind.
    further : callable or None
        Writes to the locked stores what has no part of its own in `stored`: names of what is measured, moved solutions.
    kept : tuple of (Path, Path)
        Files that an output replaces, and where their content is kept.
    outputs : tuple of TextOutput
        Written after the commit, in this order.
    superseded : tuple of Path
        Files that are removed after the commit, as far as that is possible.
    restores_outputs : bool
        Outputs that are not of the last commit are written again.
    """

    state: ProjectState
    outcome: T
    stored: StoredParts = _NOTHING
    locks: tuple[Path, ...] = ()
    is_compared: bool = True
    edited_texts: tuple[EditedText, ...] = ()
    further: Callable[[Stores], None] | None = None
    kept: tuple[tuple[Path, Path], ...] = ()
    outputs: tuple[TextOutput, ...] = ()
    superseded: tuple[Path, ...] = ()
    restores_outputs: bool = False

    def with_outcome(self, outcome: U) -> Change[U]:
        """Return the same change with something else to show."""
        return Change(
            self.state,
            outcome,
            self.stored,
            self.locks,
            self.is_compared,
            self.edited_texts,
            self.further,
            self.kept,
            self.outputs,
            self.superseded,
            self.restores_outputs,
        )


class Committed(Struct, Generic[T], frozen=True):
    """The outcome of a command whose change is written, and whether that changed the stores."""

    outcome: T
    changed: bool


def commit(change: Change[T]) -> Committed[T]:
    """Write a change: all stores in one transaction, then the texts.

    Killed at any instant, stores are in their old state or in the new one, and every text is whole; outputs that are
    missing then are written by the next command.

    Raises
    ------
    ChangedMeanwhileError
        If another run has changed what the change was computed from; nothing is written then.
    LockedError
        If another run holds a store for too long.
    OripError
        If a file cannot be written.
    """
    project = change.state.project
    changed = _write_stores_and_texts(change)
    for path, backup in change.kept:
        with reporting_failure(project.shown(backup), "nothing was written"):
            replace_bytes(backup, regular_bytes(path))
    if change.outputs:
        with stage("writing the listings"):
            for output in change.outputs:
                write_output(project, output)
    for path in change.superseded:
        with suppress(OSError):  # empty stores, copies, results: useless, but harmless
            remove_file(path, project.folder)
    if change.restores_outputs:
        rewrite_stale_outputs(project)
    if change.locks or change.edited_texts or change.outputs:
        remove_leftovers_of_kills(project)
    return Committed(change.outcome, changed)


def carry_out(state: S, command: Callable[[S], Change[T]]) -> Committed[T]:
    """Compute a change and write it; if another run has written first, compute it again from the new state.

    For commands that are cheap to compute; raises what the command and `commit` do.

    Parameters
    ----------
    command : function of the state
    """
    for _ in range(_ATTEMPTS):
        try:
            return commit(command(state))
        except ChangedMeanwhileError:
            state = state.read_again()
    return commit(command(state))


def _write_stores_and_texts(change: Change[T]) -> bool:
    """Write stores, and the texts that are edited with them; tell whether the stores have changed."""
    project, changed = change.state.project, False
    if change.locks:
        with stage("writing the stores"), writing(change.locks) as stores:
            if change.is_compared:
                _require_unchanged(change.state, stores)
            _write_edited_texts(project, change.edited_texts)
            changed = _write_stores(project, stores, change)
            if change.further is not None:
                change.further(stores)
    elif change.edited_texts:
        with locked(project.folder / PROJECT_FILE, PROJECT_FILE):
            _write_edited_texts(project, change.edited_texts)
    return changed


def _require_unchanged(state: ProjectState, stores: Stores) -> None:
    parts = _COMPARED & state.parts
    now = read_stored(state.project, stores, parts, state.bundles)
    # what was not read is None or empty on both sides
    was, found = ((part.definitions, part.replay, part.heads) for part in (state.stored, now))
    if was != found:
        raise ChangedMeanwhileError(_STORES)


def _write_edited_texts(project: ProjectFolder, texts: tuple[EditedText, ...]) -> None:
    for text in texts:
        if digest_of_text(text.path) != text.before:
            raise ChangedMeanwhileError(project.shown(text.path))
        with reporting_failure(project.shown(text.path), text.remedy):
            require_no_link(text.path)
    for text in texts:
        write_output(project, text.output())


def _write_stores(project: ProjectFolder, stores: Stores, change: Change[T]) -> bool:
    """Write what differs; tell whether anything does."""
    before, after = change.state.stored, change.stored
    changed = False
    if after.definitions is not None and after.definitions != before.definitions:
        write_definitions(project, stores, change.state.definitions, after.definitions)
        changed = True
    if after.measured is not None:
        write_measured(project, stores, after.measured)
        changed = True
    if after.replay is not None:
        _write_replay(project, stores, after.replay)
        changed = True
    for solution in after.solutions.values():
        if solution is not None and not _is_stored(stores[project.exterior], solution):
            solutions.write(stores[project.exterior], solution)
            changed = True
    return changed


def _write_replay(project: ProjectFolder, stores: Stores, replay: ReplayRecord) -> None:
    for path, run in zip(measured_stores(project), replay.runs, strict=True):
        set_run(stores[path], run)
    write_inputs(stores[project.photos], "measure", replay.inputs)


def _is_stored(store: Store, solution: Solution) -> bool:
    head = read_head(store, solution.bundle)
    if head is None or head.run != solution.run:  # then the old one need not be read as a whole
        return False
    return solutions.is_stored(store, solution)
