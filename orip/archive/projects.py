"""The projects of an archive, below some folders, and their order: cameras are defined before others use them."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from graphlib import CycleError, TopologicalSorter
from pathlib import Path, PurePath

from msgspec import Struct

from orip.errors import UsageError
from orip.files.project.tables import ProjectTable
from orip.files.project.toml_lines import toml_document
from orip.files.text.regular_file import regular_bytes
from orip.workflow.project.folder import PROJECT_FILE


class ArchiveProject(Struct, frozen=True):
    """A project of an archive.

    Parameters
    ----------
    name : str
        Its folder from the top of the archive, with slashes; unique in the archive.
    folder : str
        Its folder, absolute.
    stores : tuple of str
        Paths of the stores of cameras and tick marks that it uses, absolute.
    """

    name: str
    folder: str
    stores: tuple[str, ...] = ()


def in_order(projects: Iterable[ArchiveProject]) -> tuple[tuple[ArchiveProject, tuple[str, ...]], ...]:
    """Return the projects so that each comes after those that it waits for, whose names are beside it.

    A project waits for the one in whose folder a store of its cameras or tick marks lies. Where a store lies in the
    folder of none of its projects, all wait for the first of them by name, which makes the store. Projects that would
    wait for each other are taken by name.
    """
    named = {project.name: project for project in sorted(projects, key=lambda project: project.name)}
    waits = _without_circles(_waits(named))
    order = TopologicalSorter(waits).static_order()
    return tuple((named[name], tuple(sorted(waits[name]))) for name in order)


def _waits(named: Mapping[str, ArchiveProject]) -> dict[str, set[str]]:
    users: dict[str, list[str]] = defaultdict(list)
    for project in named.values():
        for store in dict.fromkeys(project.stores):
            users[store].append(project.name)
    waits: dict[str, set[str]] = {name: set() for name in named}
    for store, names in users.items():
        owners = [name for name in names if PurePath(store).parent == PurePath(named[name].folder)]
        first = owners[0] if owners else names[0]
        for name in names:
            if name != first:
                waits[name].add(first)
    return waits


def _without_circles(waits: dict[str, set[str]]) -> dict[str, set[str]]:
    while True:
        try:
            TopologicalSorter(waits).prepare()
        except CycleError as error:
            circle: list[str] = error.args[1]
            # each name of the circle is waited for by the next one: the first by name no longer waits
            place = circle.index(min(circle[1:]), 1)
            waits[circle[place]].discard(circle[place - 1])
        else:
            return waits


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
        table = toml_document(regular_bytes(folder / PROJECT_FILE).decode("utf-8")).get("project")
    except (OSError, ValueError):
        return ()
    given = table if isinstance(table, dict) else {}
    usual = ProjectTable(name="")
    names = (given.get(key, getattr(usual, key)) for key in _STORE_KEYS)
    return tuple(os.path.realpath(folder / name) for name in names if isinstance(name, str) and "\0" not in name)
