"""A project folder: opened, adjusted in memory, and written when a solution is saved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np

from orip.annexes import IMPORTED_PROJECTS, annex
from orip.api.given import ControlPoints, PhotoPoints
from orip.api.method import Sigma0, method_of
from orip.api.solution import Solution
from orip.errors import ProjectWarning
from orip.records.camera import Camera
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.records.results import solution as records
from orip.records.results.solution import IterationPass
from orip.report.report_input import ReportInput
from orip.solving.solve import NOBODY
from orip.solving.starting_values import gather_bundle
from orip.structs import replace
from orip.threads import limited_threads
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.gathering import block_input
from orip.workflow.adjust.solve import ADJUSTED_FROM, SolveOutcome, solve_with_equations
from orip.workflow.observations.measure import MEASURED_FROM, measure
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change, carry_out, commit
from orip.workflow.project.run_id import Step
from orip.workflow.project.state import Part, ProjectState, StoredParts, read_project
from orip.workflow.project.texts import raise_complaints
from orip.workflow.records.initialise import INITIALISED_FROM, initialise
from orip.workflow.status import STATUS_FROM, initialise_step, measure_step, project_status

_READ: frozenset[Part] = frozenset({*INITIALISED_FROM, *MEASURED_FROM, *ADJUSTED_FROM, *STATUS_FROM} - {"digests"})


def open_project(folder: str | PathLike[str]) -> Project:
    """Read a project folder and check all its text files.

    Parameters
    ----------
    folder : str or path

    Returns
    -------
    Project

    Raises
    ------
    InputError
        With everything that is wrong, by file and line.
    UsageError
        If there is no such folder.
    LockedError
        If another run holds the project for too long.
    """
    state = read_project(Path(folder), *_READ)
    raise_complaints(state.texts.faults().complaints)
    return Project(state)


def import_project(
    source: str | PathLike[str],
    folder: str | PathLike[str] | None = None,
    *,
    format: str | None = None,  # noqa: A002 as the command calls it
    frame: tuple[int, int] | None = None,
    precision: float | None = None,
    hold_cameras: bool = False,
    exact_distortion: bool = False,
) -> Project:
    """Make a project folder of a project of another program, as `orip import` does, and open it.

    Parameters
    ----------
    source : str or path
        File or folder of COLMAP, OpenSfM, Metashape, MicMac and others: `orip import --list` shows them.
    folder : str or path, optional
        The new project's folder, new or empty; beside the current one, with the name of the source, if not given.
    format : str, optional
        Its name in that list; it is guessed if not given.
    frame : tuple of 2 int, optional
        Columns and rows of images, where no file says it.
    precision : float, optional
        A-priori error of the measurements, pixels; as the format says if not given.
    hold_cameras : bool
        Do not adjust cameras.
    exact_distortion : bool
        Accept any camera: measurements are corrected by its misfit.

    Returns
    -------
    Project

    Raises
    ------
    UsageError
        If the format is not known or cannot be guessed, or the folder has something in it.
    InputError
        With everything that is wrong in the files, or if poses, points and measurements do not fit one another.
    """
    target = annex(IMPORTED_PROJECTS).import_folder(
        Path(source), None if folder is None else Path(folder), format, frame, precision,
        holds_cameras=hold_cameras, corrects_distortion=exact_distortion,
    )  # fmt: skip
    return open_project(target)


class Project:
    """A project folder as it was when `open_project` read it.

    Where records or measurements have been changed since `orip init` and `orip measure`, or where these have not been
    run yet, they are applied in memory, and written together with a solution that is saved.

    Attributes
    ----------
    folder : Path
    name : str
    ground_unit : str
    crs : str or None
        Coordinate reference system of the ground coordinates.
    bundles : tuple of str
        Names of the bundle adjustments.
    warnings : tuple of ProjectWarning
        What is doubtful in the text files.
    """

    def __init__(self, state: ProjectState) -> None:
        definition = state.project.definition
        self.folder = state.project.folder
        self.name = definition.name
        self.ground_unit = definition.ground_unit
        self.crs = definition.crs
        self.bundles = state.project.bundle_names
        self.warnings: tuple[ProjectWarning, ...] = (*state.project.warnings, *state.texts.faults().warnings)
        self._stored = state
        self._state = _up_to_date(state)

    def __repr__(self) -> str:
        return f"<Project {self.name}: {len(self.photos)} photos, bundles {', '.join(self.bundles)}>"

    @property
    def cameras(self) -> Mapping[str, Camera]:
        """Return the camera records by name."""
        return {camera.name: camera for camera in self._state.records.cameras.values()}

    @property
    def photos(self) -> Mapping[str, Photo]:
        """Return the photo records by name, with the orientations that they start from as far as they are known."""
        return {photo.name: photo for photo in self._state.records.photos.values()}

    @property
    def status(self) -> tuple[Step, ...]:
        """Return the steps of the work as `orip status` shows them: command, state and text of each."""
        return project_status(self._stored).steps

    def photo_points(self, bundle: str | None = None) -> PhotoPoints:
        """Return what is measured in the photos of a bundle, as a `Block` takes it.

        Parameters
        ----------
        bundle : str, optional
            Needed only where the project has several.

        Raises
        ------
        InputError
            If there are no photo points, or they are not fit for an adjustment.
        UsageError
            If there is no such bundle.
        """
        given = self._bundle(bundle)
        found, measured = gather_bundle(block_input(given)).photo_points, given.observations
        pixels = [given.records.camera_of(given.records.photos[record_key(name)]).sensor for name in measured.photos]
        in_pixels = np.array([sensor is not None for sensor in pixels], dtype=np.bool_)[:, None]
        return PhotoPoints(
            measured.photos,
            measured.points,
            np.where(in_pixels, measured.measured, found.xy),
            np.where(found.used, found.error, -found.error),
        )

    def control_points(self) -> ControlPoints:
        """Return control and check points; rejected ones are left out."""
        points = [point for point in self._state.texts.control.value.points if not point.rejected]
        return ControlPoints(
            tuple(point.name for point in points),
            np.array([point.coordinates for point in points], dtype=np.float64).reshape(-1, 3),
            np.array([point.errors for point in points], dtype=np.float64).reshape(-1, 3),
        )

    def solve(
        self,
        bundle: str | None = None,
        *,
        snoop: bool = False,
        sigma0: Sigma0 | None = None,
        alpha: float | None = None,
        prune: bool = False,
        variance_components: bool = False,
        on_iteration: Callable[[IterationPass], None] | None = None,
    ) -> Solution:
        """Adjust a bundle as `orip solve` does; nothing is written before `Solution.save`.

        Parameters
        ----------
        bundle : str, optional
            Needed only where the project has several.
        snoop, sigma0, alpha, prune, variance_components, on_iteration
            See `Block.adjust`.

        Returns
        -------
        Solution

        Raises
        ------
        InputError
            With everything that keeps the bundle from being adjusted.
        NotSolvableError
            If there is no solution, or photos cannot be oriented; probable causes come first.
        UsageError
            If there is no such bundle, or an option is wrong.
        """
        watcher = NOBODY if on_iteration is None else replace(NOBODY, passed=on_iteration)
        method = method_of(snoop, sigma0, alpha, prune, variance_components)
        with limited_threads(None):
            given = self._bundle(bundle)
            change, solved = solve_with_equations(given, watcher, method)
        record = change.outcome.solution
        return Solution(record, solved, partial(self._save, change), partial(_reported, given.state, record))

    def solution(self, bundle: str | None = None) -> Solution:
        """Return the last solution of a bundle that was saved, by a command or by `Solution.save`.

        Parameters
        ----------
        bundle : str, optional
            Needed only where the project has several.

        Raises
        ------
        InputError
            If the bundle has not been adjusted.
        UsageError
            If there is no such bundle.
        """
        from orip.workflow.adjust.report import REPORTED_FROM

        name = self._stored.project.bundle_name(bundle)
        stored = self._stored.read_again("solutions", *REPORTED_FROM, bundles=[name])
        record = BundleState(stored, name).adjusted
        return Solution(record, None, lambda: None, partial(_reported, stored, record))

    def _bundle(self, bundle: str | None) -> BundleState:
        return BundleState(self._state, self._state.project.bundle_name(bundle))

    def _save(self, change: Change[SolveOutcome]) -> None:
        if self._state is not self._stored:
            carry_out(self._stored.read_again(*INITIALISED_FROM), initialise)
            commit(measure(self._stored.read_again(*MEASURED_FROM)))
        commit(change)
        self._state = self._stored = self._stored.read_again()


def _reported(state: ProjectState, record: records.Solution) -> ReportInput:
    """Return what a report of a solution is made from, with the gates of orip.toml."""
    from orip.workflow.adjust.report import report_input

    return report_input(state, record, check_solution(record, project_gates(state.project)))


def _up_to_date(state: ProjectState) -> ProjectState:
    """Return the state that `orip init` and `orip measure` would leave."""
    if initialise_step(state).state != "up to date":
        state = _changed(state, initialise(state).stored)
    if measure_step(state).state != "up to date":
        state = _changed(state, measure(state).stored)
    return state


def _changed(state: ProjectState, stored: StoredParts) -> ProjectState:
    """Return the state with the parts that a change writes."""
    before = state.stored
    return state.with_stored(
        replace(
            before,
            definitions=stored.definitions or before.definitions,
            measured=stored.measured or before.measured,
            replay=stored.replay or before.replay,
        )
    )
