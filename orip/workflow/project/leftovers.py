"""What killed runs have left in a project's folder, removed by the next command that writes."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from orip.errors import OripError
from orip.files.stores.contents import observations
from orip.files.stores.store import Store
from orip.files.stores.transaction import reading, remove_empty
from orip.files.text.leftovers import remove_leftovers
from orip.records.names import record_key
from orip.workflow.project.definitions import read_definitions
from orip.workflow.project.folder import ProjectFolder


def remove_leftovers_of_kills(project: ProjectFolder) -> None:
    """Remove temporary files whose process has ended, and stores of renamed bundles that are empty now.

    What cannot be removed stays: it has no effect.
    """
    with suppress(OSError, OripError):
        for folder in {project.folder, project.results}:
            if folder.is_dir() and not folder.is_symlink():
                remove_leftovers(folder)
        strange = _stores_of_no_bundle(project, project.bundle_names)
        if strange:
            with reading(project.record_stores) as stores:
                defined = [bundle.record.name for bundle in read_definitions(project, stores).bundles]
            for path in _stores_of_no_bundle(project, (*project.bundle_names, *defined)):
                remove_empty(path, _has_nothing)


def _stores_of_no_bundle(project: ProjectFolder, bundles: tuple[str, ...]) -> list[Path]:
    """Return the stores of photo observations that belong to no bundle by their names."""
    keys = {record_key(name) for name in bundles}
    folder = project.observations("").parent
    return [path for path in sorted(folder.glob("*.EXO")) if record_key(path.stem) not in keys]


def _has_nothing(store: Store) -> bool:
    return observations.read(store) is None
