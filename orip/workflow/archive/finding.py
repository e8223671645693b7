"""The projects of an archive: all folders below some folders that hold an orip.toml."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path

from orip.archive.order import ArchiveProject
from orip.errors import UsageError
from orip.files.project.tables import ProjectTable
from orip.files.text.regular_file import regular_bytes
from orip.workflow.project.folder import PROJECT_FILE

_STORE_KEYS = ("camera_file", "temtick_file")


def find_projects(roots: Sequence[Path], results: Path) -> tuple[Path, tuple[ArchiveProject, ...]]:
    """Return the folder from which projects are named, and the projects below some folders, by name.

    Hidden folders and the folder of results are left out; links are not followed.

    Raises
    ------
    UsageError
        If a folder is missing, or there is no project at all.
    """
    missing = [str(root) for root in roots if not root.is_dir()]
    if missing:
        message = f"there is no folder {', '.join(missing)}; name the folders that the projects are in"
        raise UsageError(message)
    tops = [Path(os.path.realpath(root)) for root in roots]
    base = Path(os.path.commonpath(tops))
    avoided = Path(os.path.realpath(results))
    folders = dict.fromkeys(folder for top in tops for folder in _project_folders(top, avoided))
    if not folders:
        named = ", ".join(map(str, roots))
        message = f"there is no project below {named}: no folder there has an {PROJECT_FILE}"
        raise UsageError(message)
    found = (ArchiveProject(_name(folder, base), str(folder), _stores(folder)) for folder in folders)
    return base, tuple(sorted(found, key=lambda project: project.name))


def _project_folders(top: Path, avoided: Path) -> Iterator[Path]:
    for folder, inner, files in os.walk(top):
        inner[:] = sorted(name for name in inner if not name.startswith(".") and Path(folder, name) != avoided)
        if PROJECT_FILE in files:
            yield Path(folder)


def _name(folder: Path, base: Path) -> str:
    return folder.relative_to(base).as_posix() if folder != base else folder.name


def _stores(folder: Path) -> tuple[str, ...]:
    """Return the stores of cameras and tick marks of a project; none where orip.toml cannot be read."""
    try:
        table = tomllib.loads(regular_bytes(folder / PROJECT_FILE).decode("utf-8")).get("project")
    except (OSError, ValueError, RecursionError):
        return ()
    given = table if isinstance(table, dict) else {}
    usual = ProjectTable(name="")
    names = (given.get(key, getattr(usual, key)) for key in _STORE_KEYS)
    return tuple(os.path.realpath(folder / name) for name in names if isinstance(name, str) and "\0" not in name)
