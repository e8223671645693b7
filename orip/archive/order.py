"""The order in which the projects of an archive are adjusted: cameras are defined before others use them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import PurePath

from msgspec import Struct


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
