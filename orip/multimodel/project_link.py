"""Commands over the link in the project's coordinates, and which drive table the plate processor has."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, LinkError, ProjectWarning, UsageError
from orip.files.text.regular_file import file_digest, regular_bytes
from orip.multimodel.link.client import PlateProcessorLink, ProcessorFault, observe_link, open_link
from orip.multimodel.link.messages import ProfilePoint
from orip.multimodel.link.watch import AXES, LOCAL_AXES, Watch
from orip.multimodel.link.watch_processor import LinkedProcessor, OwnProcessor
from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.multimodel.plate_pictures import plate_pictures
from orip.multimodel.processor import Loaded
from orip.multimodel.readout import ObjectReadout, PhotoReadout
from orip.multimodel.state import Driven, Position, Status
from orip.multimodel.table import object_ground
from orip.multimodel.table_step import DRIVEN_FROM, DriveTableOutcome, load_drive_table, make_drive_table
from orip.multimodel.table_text import drive_table_text, read_drive_table
from orip.records.drive_table import DriveCode, Triple
from orip.records.ground import PLAIN, GroundSystem
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.bundle_state import BundleState, read_bundle
from orip.workflow.project.commit import commit
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import ProjectState, read_project
from orip.workflow.project.texts import EDITS_FILE

# A template that was mounted again, a photo whose marks were measured again or an adjustment changes where every point
# is on the plates. Until the table is loaded again, the plate processor drives to where points were before.


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
    log : Path
        With what has just been measured.

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


# The plate processor drives in the object system of its drive table. With a `crs` that is a local frame, which only the
# project's solution knows; the project's table then has to be the one that is loaded.

_NEAR = 10.0
"""Ground units; origins of object systems lie 100 apart or more, adjusted photos do not move as far."""

_NO_PLACE = frozenset({DriveCode.NO_TABLE, DriveCode.BEHIND_CAMERA, DriveCode.NOT_INVERTIBLE, DriveCode.PARALLEL_RAYS})


class Downloaded(NamedTuple):
    """A table as it was written and loaded, and the digest that both ends have."""

    table: DriveTableOutcome
    digest: str


class WhereMark(NamedTuple):
    """Where the measuring mark is; `ground` in the project's coordinates, None where the rays do not meet."""

    status: Status
    ground: ObjectReadout | None
    plates: tuple[Position, Position]
    photos: tuple[PhotoReadout, ...]


class DrivenProject(Struct, frozen=True):
    """A link, the system that the project's coordinates are driven in, and warnings of what is out of date."""

    link: PlateProcessorLink
    ground: GroundSystem
    warnings: tuple[ProjectWarning, ...] = ()

    def goto(self, xyz: Triple) -> Driven:
        """Drive to a point of the project."""
        return self.link.drive_object(*self._to_local(xyz))

    def profile(self, start: Triple, end: Triple, step: float) -> list[ProfilePoint]:
        """Drive along the straight line between two points of the project."""
        points = self.link.profile(self._to_local(start), self._to_local(end), step)
        return [point._replace(xyz=self.to_project(point.xyz)) for point in points]

    def where(self) -> WhereMark:
        """Ask where the measuring mark is."""
        status, plates, photos = self.link.status(), self.link.position("PLATE"), ()
        if self.link.greeting.state == "EMPTY":
            return WhereMark(status, None, plates, photos)
        try:
            found = self.link.position("OBJECT")
        except ProcessorFault as fault:
            if fault.code not in _NO_PLACE:
                raise
            return WhereMark(status, None, plates, self.link.position("PHOTO"))
        ground = found._replace(xyz=self.to_project(found.xyz))
        return WhereMark(status, ground, plates, self.link.position("PHOTO"))

    def to_project(self, xyz: Triple) -> Triple:
        """Return the project's coordinates of a point of the object system."""
        x, y, z = self.ground.to_project(np.array([xyz]))[0].tolist()
        return x, y, z

    def _to_local(self, xyz: Triple) -> Triple:
        x, y, z = self.ground.to_local(np.array([xyz]))[0].tolist()
        if not np.isfinite([x, y, z]).all():
            message = f"the project's crs has no place {' '.join(f'{value:g}' for value in xyz)}; correct X Y Z"
            raise UsageError(message)
        return x, y, z


def download(folder: Path, bundle: str | None, url: str) -> Downloaded:
    """Write the drive table if it is missing or out of date, and load it into the plate processor.

    Raises
    ------
    InputError
        If no table can be made; see `orip.multimodel.table_step.make_drive_table`.
    LinkError
        If the plate processor is missing or busy, or refuses the table.
    """
    outcome = commit(make_drive_table(read_bundle(folder, bundle, *DRIVEN_FROM))).outcome
    with open_link(url) as link:
        link.download(regular_bytes(outcome.path))
        return Downloaded(outcome, link.digest())


@contextmanager
def operating(folder: Path, bundle: str | None, url: str) -> Iterator[DrivenProject]:
    """Open a link as the operator, to drive in the project's coordinates."""
    with open_link(url) as link:
        yield _driven_project(folder, bundle, link)


@contextmanager
def observing(folder: Path, bundle: str | None, url: str) -> Iterator[DrivenProject]:
    """Open a link to read in the project's coordinates."""
    with observe_link(url) as link:
        yield _driven_project(folder, bundle, link)


def _driven_project(folder: Path, bundle: str | None, link: PlateProcessorLink) -> DrivenProject:
    return DrivenProject(link, _object_system(folder, bundle, link), stale_table_warnings(folder, bundle, link))


def stale_table_warnings(folder: Path, bundle: str | None, link: PlateProcessorLink) -> tuple[ProjectWarning, ...]:
    """Return a warning where the table that is loaded is not the project's; none outside a project."""
    loaded = loaded_digest(link)
    if loaded is None or not (folder / PROJECT_FILE).exists():
        return ()
    bundles = read_project(folder).bundles if bundle is None else (bundle,)
    return table_warnings(folder, bundles, loaded, f"at {link.url}")


def _object_system(folder: Path, bundle: str | None, link: PlateProcessorLink) -> GroundSystem:
    """Return the system of the project's drive table; outside a project coordinates are used as they are."""
    if not (folder / PROJECT_FILE).exists():
        return PLAIN
    state = read_project(folder)
    project, crs = state.project, state.project.definition.crs
    if crs is None or link.greeting.state == "EMPTY":
        return PLAIN
    name = project.bundle_name(bundle)
    solution = state.read_again("solutions", bundles=[name]).solution(name)
    if solution is not None:
        ground = object_ground(crs, solution.ground_unit, solution)
        if _is_loaded(project, name, link) and _is_in_system(project, name, solution, ground):
            return ground
    message = (
        f"the plate processor at {link.url} has a table other than that of bundle {name} of this project, so that "
        f"coordinates in {crs} cannot be driven to; run 'orip drive download' first"
    )
    raise LinkError(message)


def _is_loaded(project: ProjectFolder, name: str, link: PlateProcessorLink) -> bool:
    path = project.drive_table(name)
    return path.is_file() and file_digest(path) == link.digest()


def _is_in_system(project: ProjectFolder, name: str, solution: Solution, ground: GroundSystem) -> bool:
    """Tell whether a table is in the object system of the solution: a later adjustment may have another origin."""
    table = read_drive_table(regular_bytes(project.drive_table(name))).table
    if table is None:
        return False
    rows = {record_key(photo): row for row, photo in enumerate(solution.photos.names)}
    photos = [photo for photo in table.photos if photo.name in rows]
    centres = ground.to_local(solution.photos.values[[rows[photo.name] for photo in photos], :3])
    return bool(np.abs(centres - [photo.centre for photo in photos]).max(initial=0.0) < _NEAR)


def open_watch(folder: Path, bundle: str | None, link: str | None) -> Watch:
    """Open a plate processor to be watched, with the drive table of a bundle; it is made where there is none.

    Parameters
    ----------
    bundle : str or None
        None: the project's only one.
    link : str or None
        URL of a plate processor that has this table loaded; None: one in this process.

    Raises
    ------
    InputError
        If there is no drive table and none can be made, or it is damaged.
    LinkError
        If the plate processor cannot be reached, or has another table.
    """
    state = read_bundle(folder, bundle, "solutions", "definitions")
    project = state.project
    path = project.drive_table(state.name)
    if not path.is_file():
        commit(make_drive_table(read_bundle(folder, bundle, *DRIVEN_FROM)))
    data = regular_bytes(path)
    loaded = load_drive_table(data)
    if not isinstance(loaded, Loaded):
        remedy = "run 'orip drive table' to make it again"
        raise InputError([Complaint(f"{fault.text}; {remedy}", project.shown(path)) for fault in loaded])
    plan = plan_view(loaded.block, _points(state))
    processor = OwnProcessor(loaded) if link is None else LinkedProcessor(link, hashlib.sha256(data).hexdigest())
    axes = AXES if project.definition.crs is None else LOCAL_AXES
    pictures = plate_pictures(state.state, [photo.name for photo in loaded.block.photos])
    return Watch(loaded.block, plan, processor, axes, pictures)


def watch_warnings(folder: Path, bundle: str | None, link: str | None) -> tuple[ProjectWarning, ...]:
    """Return a warning where the table that is shown is older than the last adjustment or mounting."""
    state = read_bundle(folder, bundle)
    project, name = state.project, state.name
    path = project.drive_table(name)
    command = "table" if link is None else "download"
    remedy = f"run 'orip measure' and 'orip drive {command}'"
    return table_warnings(folder, [name], file_digest(path), project.shown(path), remedy)


def _points(bundle: BundleState) -> BlockPoints:
    """Return the adjusted points in the object system of the drive table; none without a solution."""
    solution = bundle.solution
    if solution is None:
        return BlockPoints((), (), np.empty((0, 3)))
    ground = object_ground(bundle.project.definition.crs, solution.ground_unit, solution)
    return BlockPoints(solution.points.names, solution.point_kinds, ground.to_local(solution.points.values))
