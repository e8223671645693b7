"""`orip drive watch`: the block of a drive table with the points of its project, and the plate processor to show."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np

from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.text.regular_file import file_digest, regular_bytes
from orip.link.watch import AXES, LOCAL_AXES, Watch
from orip.link.watch_processor import LinkedProcessor, OwnProcessor
from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.multimodel.processor import Loaded
from orip.multimodel.table import object_ground
from orip.workflow.drive.loaded_table import table_warnings
from orip.workflow.drive.table import DRIVEN_FROM, load_drive_table, make_drive_table
from orip.workflow.project.bundle_state import BundleState, read_bundle
from orip.workflow.project.commit import commit
from orip.workflow.project.folder import open_project


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
