"""A project as its texts and stores have it, read once by a command.

A command is a function ``command(state, ...) -> Change``: it reads nothing from the stores and writes nothing;
`orip.workflow.project.commit.commit` writes the change. What a command needs of the stores is named when the state is
read, and comes from one reading transaction; texts are read when they are first asked for, and once.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeVar

from msgspec import Struct, field

from orip.files.stores.contents import observations
from orip.files.stores.contents.solution_tables import SolutionHead, read_head
from orip.files.stores.digest import read_inputs
from orip.files.stores.transaction import Stores, reading
from orip.interior.definitions import Definitions
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.structs import replace
from orip.workflow.project.definitions import (
    MeasuredDigests,
    StoredDefinitions,
    digests_of,
    measured_stores,
    read_definitions,
    read_digests,
    read_marks,
    require_initialised,
    runs_of_measurements,
)
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.texts import Digests, ProjectTexts, open_checked_project

if TYPE_CHECKING:
    from orip.interior.in_force import Interior
    from orip.records.results.solution import Solution

Part = Literal["definitions", "marks", "observations", "digests", "replay", "heads", "solutions"]
"""What of the stores is read:

- definitions: the records of all kinds,
- marks: orientations of templates and photos by marks,
- observations: photo observations of the bundles of the state,
- digests: in place of both, what tells them from others,
- replay: which run replayed the measurement log into the stores, and what it replayed,
- heads: run, status and inputs of the last solution of each of these bundles,
- solutions: all of these solutions.
"""

T = TypeVar("T")


class ReplayRecord(Struct, frozen=True):
    """What the stores say of the last replay.

    Parameters
    ----------
    inputs : tuple of (str, str)
        Name and digest of all that was replayed.
    runs : tuple of (str or None)
        The run that wrote each of the `measured_stores`; equal where they belong together.
    """

    inputs: Digests
    runs: tuple[str | None, ...]


class StoredParts(Struct, frozen=True):
    """What stores hold; None: not read, or (in a change) not written.

    Parameters
    ----------
    measured : Measured or None
        Orientations by marks, and photo observations by `record_key` of their bundle.
    heads : mapping by `record_key` of the bundle
    solutions : mapping by `record_key` of the bundle
        None: the bundle has none.
    """

    definitions: StoredDefinitions | None = None
    measured: Measured | None = None
    replay: ReplayRecord | None = None
    digests: MeasuredDigests | None = None
    heads: Mapping[str, SolutionHead | None] = field(default_factory=dict)
    solutions: Mapping[str, Solution | None] = field(default_factory=dict)


class ProjectState(Struct, frozen=True, dict=True):
    """A project as its texts and stores have it.

    Parts that were not asked for raise ValueError: that is a fault of the program.

    Parameters
    ----------
    parts : frozenset of Part
        What was read of the stores.
    bundles : tuple of str
        Those whose observations and solutions were read.
    """

    project: ProjectFolder
    texts: ProjectTexts
    parts: frozenset[Part]
    bundles: tuple[str, ...]
    stored: StoredParts

    @property
    def definitions(self) -> StoredDefinitions:
        """Return the records of the stores, with the text that each came from."""
        return _read(self.stored.definitions, "definitions")

    @property
    def measured(self) -> Measured:
        """Return what is measured."""
        return _read(self.stored.measured, "marks")

    @cached_property
    def digests(self) -> MeasuredDigests:
        """Return what tells what is measured from other measurements."""
        return digests_of(self.measured) if self.stored.digests is None else self.stored.digests

    @property
    def replay(self) -> ReplayRecord:
        """Return which run replayed what."""
        return _read(self.stored.replay, "replay")

    @cached_property
    def records(self) -> Definitions:
        """Return the records of the stores by `record_key` of their names."""
        return self.definitions.by_name()

    @cached_property
    def interior(self) -> Interior:
        """Return the interior orientation in force."""
        from orip.interior.in_force import interior_orientation  # `orip status` does not need it

        return interior_orientation(self.records, self.measured)

    def head(self, bundle: str) -> SolutionHead | None:
        """Return the head of a bundle's last solution; None if there is none."""
        return self.stored.heads[record_key(bundle)]

    def solution(self, bundle: str) -> Solution | None:
        """Return a bundle's last solution; None if there is none."""
        return self.stored.solutions[record_key(bundle)]

    def require_initialised(self) -> None:
        """Raise InputError unless the stores hold all that orip.toml defines, and all that their records refer to."""
        require_initialised(self.project, self.definitions)

    def read_again(self, *parts: Part, bundles: Sequence[str] | None = None) -> ProjectState:
        """Read the stores again, the same parts unless others are named; texts are those that were read."""
        return read_state(
            self.project, parts or self.parts, self.bundles if bundles is None else bundles, texts=self.texts
        )

    def with_stored(self, stored: StoredParts) -> ProjectState:
        """Return the state with other contents of its stores; nothing is written."""
        return replace(self, stored=stored)


def read_state(
    project: ProjectFolder, parts: Collection[Part], bundles: Sequence[str], texts: ProjectTexts | None = None
) -> ProjectState:
    """Read parts of the stores in one transaction.

    Parameters
    ----------
    bundles : sequence of str
        Those whose observations and solutions are read.
    texts : ProjectTexts or None
        Texts that have been read already; None: they are read when asked for.

    Raises
    ------
    InputError
        If a store is damaged.
    LockedError
    """
    wanted = frozenset(parts)
    with reading(_stores_of(project, wanted, bundles)) as stores:
        stored = read_stored(project, stores, wanted, bundles)
    return ProjectState(project, texts or ProjectTexts(project), wanted, tuple(bundles), stored)


def read_project(folder: Path, *parts: Part) -> ProjectState:
    """Read orip.toml of a folder, and parts of the stores: observations and solutions of all bundles of orip.toml.

    Raises
    ------
    InputError
        With everything that is wrong in orip.toml, and then in the folder's other texts too, or if a store is damaged.
    UsageError
        If there is no such folder.
    LockedError
    """
    project = open_checked_project(folder)
    return read_state(project, parts, project.bundle_names)


def read_stored(project: ProjectFolder, stores: Stores, parts: Collection[Part], bundles: Sequence[str]) -> StoredParts:
    """Return parts of stores that are open."""
    with_heads = bundles if "heads" in parts else ()
    with_solutions = bundles if "solutions" in parts else ()
    return StoredParts(
        read_definitions(project, stores) if "definitions" in parts else None,
        _read_measured(project, stores, parts, bundles),
        _read_replay(project, stores) if "replay" in parts else None,
        read_digests(project, stores, bundles) if "digests" in parts else None,
        {record_key(name): read_head(stores[project.exterior], name) for name in with_heads},
        {record_key(name): _read_solution(project, stores, name) for name in with_solutions},
    )


def _read_solution(project: ProjectFolder, stores: Stores, bundle: str) -> Solution | None:
    from orip.files.stores.contents import solutions  # few commands read all of it

    return solutions.read(stores[project.exterior], bundle)


def _stores_of(project: ProjectFolder, parts: frozenset[Part], bundles: Sequence[str]) -> list[Path]:
    paths = [project.exterior] if {"heads", "solutions"} & parts else []
    paths += project.record_stores if "definitions" in parts else ()
    paths += [project.templates, project.photos] if "marks" in parts else ()
    paths += [project.photos] if "digests" in parts else ()
    paths += map(project.observations, bundles) if {"observations", "digests"} & parts else ()
    paths += measured_stores(project) if "replay" in parts else ()
    return list(dict.fromkeys(paths))


def _read_measured(
    project: ProjectFolder, stores: Stores, parts: Collection[Part], bundles: Sequence[str]
) -> Measured | None:
    if "marks" not in parts and "observations" not in parts:
        return None
    found = read_marks(project, stores) if "marks" in parts else Measured()
    if "observations" in parts:
        read = ((name, observations.read(stores[project.observations(name)])) for name in bundles)
        found = replace(
            found, observations={record_key(name): measured for name, measured in read if measured is not None}
        )
    return found


def _read_replay(project: ProjectFolder, stores: Stores) -> ReplayRecord:
    return ReplayRecord(read_inputs(stores[project.photos], "measure"), runs_of_measurements(project, stores))


def _read(part: T | None, name: Part) -> T:
    if part is None:
        message = f"this state was read without its {name}"
        raise ValueError(message)
    return part
