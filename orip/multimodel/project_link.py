"""Commands over the link in the project's coordinates, and the block and points that `orip drive watch` shows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.errors import Complaint, InputError, LinkError, ProjectWarning, UsageError
from orip.files.text.regular_file import file_digest, regular_bytes
from orip.multimodel.link.client import PlateProcessorLink, ProcessorFault, observe_link, open_link
from orip.multimodel.link.messages import ProfilePoint
from orip.multimodel.link.watch import AXES, LOCAL_AXES, Watch
from orip.multimodel.link.watch_processor import LinkedProcessor, OwnProcessor
from orip.multimodel.loaded_table import loaded_digest, table_warnings
from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.multimodel.processor import Loaded
from orip.multimodel.readout import ObjectReadout, PhotoReadout
from orip.multimodel.state import Driven, Position, Status
from orip.multimodel.table import object_ground
from orip.multimodel.table_step import DRIVEN_FROM, DriveTableOutcome, load_drive_table, make_drive_table
from orip.multimodel.table_text import read_drive_table
from orip.records.drive_table import DriveCode, Triple
from orip.records.ground import PLAIN, GroundSystem
from orip.records.names import record_key
from orip.records.results.solution import Solution
from orip.workflow.project.bundle_state import BundleState, read_bundle
from orip.workflow.project.commit import commit
from orip.workflow.project.folder import PROJECT_FILE, ProjectFolder, open_project
from orip.workflow.project.state import read_state

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
    bundles = open_project(folder).bundle_names if bundle is None else (bundle,)
    return table_warnings(folder, bundles, loaded, f"at {link.url}")


def _object_system(folder: Path, bundle: str | None, link: PlateProcessorLink) -> GroundSystem:
    """Return the system of the project's drive table; outside a project coordinates are used as they are."""
    if not (folder / PROJECT_FILE).exists():
        return PLAIN
    project = open_project(folder)
    crs = project.definition.crs
    if crs is None or link.greeting.state == "EMPTY":
        return PLAIN
    name = project.bundle_name(bundle)
    solution = read_state(project, {"solutions"}, [name]).solution(name)
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
    folder : Path
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
    state = read_bundle(folder, bundle, "solutions")
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
    return Watch(loaded.block, plan, processor, AXES if project.definition.crs is None else LOCAL_AXES)


def watch_warnings(folder: Path, bundle: str | None, link: str | None) -> tuple[ProjectWarning, ...]:
    """Return a warning where the table that is shown is older than the last adjustment or mounting."""
    project = open_project(folder)
    name = project.bundle_name(bundle)
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
