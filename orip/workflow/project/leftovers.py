"""What killed runs have left in a project's folder, removed by the next command that writes."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from orip.errors import OripError
from orip.files.stores.contents import exterior, observations
from orip.files.stores.store import Store
from orip.files.stores.transaction import reading, remove_empty
from orip.files.text.leftovers import remove_leftovers
from orip.records.names import record_key
from orip.workflow.project.folder import ProjectFolder


def remove_leftovers_of_kills(project: ProjectFolder) -> None:
    """Remove temporary files whose process has ended, and stores of renamed bundles that are empty now.

    What cannot be removed stays: it has no effect.
    """
    with suppress(OSError, OripError):
        for folder in {project.folder, project.results}:
            if folder.is_dir() and not folder.is_symlink():
                remove_leftovers(folder)
        with reading([project.exterior]) as stores:
            defined = [bundle.record.name for bundle in exterior.read(stores[project.exterior])]
        # orip.toml may still have the old name of a bundle that was renamed
        for path in _stores_of_no_bundle(project, defined):
            remove_empty(path, _has_nothing)


def _stores_of_no_bundle(project: ProjectFolder, bundles: Sequence[str]) -> list[Path]:
    """Return the stores of photo observations that belong to no bundle by their names."""
    keys = {record_key(name) for name in bundles}
    folder = project.observations("").parent
    return [path for path in sorted(folder.glob("*.EXO")) if record_key(path.stem) not in keys]


def _has_nothing(store: Store) -> bool:
    return observations.read(store) is None
