"""Renaming a bundle: its solution and its preliminary coordinates are renamed, result files of the old name removed.

Its measurements are renamed in `orip.workflow.records.mentions`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from orip.errors import InputError, OripError, ProjectWarning
from orip.files.stores.contents import solutions
from orip.files.stores.transaction import Stores
from orip.files.text.atomic import replace_bytes
from orip.files.text.regular_file import regular_bytes
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.wording import agreeing
from orip.workflow.project.definitions import StoredDefinitions
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.run_id import digest_of_records, run_id
from orip.workflow.project.state import ProjectState
from orip.workflow.records.changes import Renaming


def rename_solution(state: ProjectState, stores: Stores, renaming: Renaming, after: StoredDefinitions) -> None:
    """Give the solution of a bundle its new name.

    It stays as current as it was. Its run id changes, so that the listings of the old name are written again.
    """
    solution, store = state.solution(renaming.old), stores[state.project.exterior]
    if solution is None:
        return
    solutions.delete(store, renaming.old)
    inputs = _renamed_inputs(state.project, solution, renaming, state.definitions, after)
    run = run_id("rename", solution.run, renaming.new)
    solutions.write(store, replace(solution, bundle=renaming.new, inputs=inputs, run=run))


def _renamed_inputs(
    project: ProjectFolder, solution: Solution, renaming: Renaming, before: StoredDefinitions, after: StoredDefinitions
) -> tuple[tuple[str, str], ...]:
    """Return what a solution depends on, with the new names; what has changed since still differs."""
    old, new = renaming.old, renaming.new
    names = {
        project.shown(project.observations(old)): project.shown(project.observations(new)),
        project.shown(project.preliminary(old)): project.shown(project.preliminary(new)),
    }
    digests = {digest_of_records([before.bundle(old)]): digest_of_records([after.bundle(new)])}
    return tuple((names.get(name, name), digests.get(digest, digest)) for name, digest in solution.inputs)


def require_free_file(project: ProjectFolder, renaming: Renaming) -> None:
    """Refuse a name for which preliminary coordinates already exist.

    Raises
    ------
    InputError
    """
    old, new = project.preliminary(renaming.old), project.preliminary(renaming.new)
    if record_key(renaming.old) == record_key(renaming.new) or not new.is_file():
        return
    if not (old.is_file() and regular_bytes(old) == regular_bytes(new)):  # else a run was killed before it had renamed
        message = f"{project.shown(new)} already exists; move it away, or choose another name"
        raise InputError.single(message)


def copy_preliminary(project: ProjectFolder, renaming: Renaming) -> None:
    """Copy BUNDLE.PRE before the commit; the old one is removed after it: its points exist at every instant.

    Raises
    ------
    OripError
        If the file cannot be read or written.
    """
    old = project.preliminary(renaming.old)
    if not old.is_file():
        return
    new = project.preliminary(renaming.new)
    try:
        replace_bytes(new, regular_bytes(old))
    except OSError as error:
        reason = error.strerror or error
        message = f"{project.shown(old)} cannot be copied to {project.shown(new)}: {reason}; nothing was renamed"
        raise OripError(message) from error


def files_of_old_name(
    project: ProjectFolder, renaming: Renaming
) -> tuple[tuple[Path, ...], tuple[ProjectWarning, ...]]:
    """Return the files that are named after a renamed bundle, and a warning about the results in them."""
    if renaming.old == renaming.new:
        return (), ()
    sources = (project.observations(renaming.old), project.preliminary(renaming.old))
    kept = _results(project, renaming.new)
    results = [path for path in _results(project, renaming.old) if path not in kept and path.is_file()]
    if not results:
        return sources, ()
    text = (
        f"{', '.join(map(project.shown, results))} had the old name and {agreeing(len(results), 'is', 'are')} gone; "
        f"as soon as orip.toml has the new one, 'orip init' writes the listings, 'orip prelim', 'orip drive table' and "
        f"'orip report' write the rest"
    )
    return (*sources, *results), (ProjectWarning("renamed-bundle", "", text),)


def _results(project: ProjectFolder, bundle: str) -> Sequence[Path]:
    return (
        *project.outputs(bundle).all,
        project.preliminary_listing(bundle),
        project.report(bundle),
        project.drive_table(bundle),
    )
