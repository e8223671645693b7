"""`orip solve`: the bundle adjustment of one bundle, from the state of the project to what is written of it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from orip.bundle.methods import Method
from orip.bundle.problem import pose_problem
from orip.bundle.results.reliability import suspect_rows
from orip.bundle.solve import SolvedBlock
from orip.images.images_of_photos import paths_of_photos
from orip.records.coded_names import coded
from orip.records.ground import GroundSystem
from orip.records.names import record_key
from orip.records.observation_kinds import PHOTO_POINT
from orip.records.preliminary import PreliminaryValues
from orip.records.results.solution import InteriorSummary, Solution
from orip.records.results.tests import Gate, GateResult
from orip.solving.solve import NOBODY, PLAIN, Pose, SolveWatcher, solve_bundle
from orip.structs import replace
from orip.workflow.adjust.gates import check_solution, project_gates
from orip.workflow.adjust.gathering import block_input
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.commit import Change
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import TextOutput, solution_outputs, superseded_outputs
from orip.workflow.project.run_id import run_id
from orip.workflow.project.state import Part, StoredParts
from orip.workflow.project.texts import Digests

ADJUSTED_FROM: tuple[Part, ...] = ("definitions", "marks", "observations")
"""What an adjustment and preliminary values need of the stores."""


class SolveOutcome(Struct, frozen=True):
    """A solution, the results of gates, the files to write, photos left out, and the worst misfit that is in an image.

    That is a photo and a point; None where there is none.
    """

    project: ProjectFolder
    solution: Solution
    gates: tuple[GateResult, ...]
    files: tuple[Path, ...]
    left_out: tuple[str, ...] = ()
    worst: tuple[str, str] | None = None


def solve(
    bundle: BundleState,
    watcher: SolveWatcher = NOBODY,
    method: Method = PLAIN,
    expressions: Sequence[str] = (),
    pose: Pose = pose_problem,
) -> Change[SolveOutcome]:
    """Adjust one bundle and check its gates against the solution; nothing is written.

    No store is locked while the iterations run. The solution names the digests of what it was computed from, so that a
    change in the meantime shows in `orip status`.

    Parameters
    ----------
    bundle : BundleState
        With `ADJUSTED_FROM`.
    method : Method
        Whether data snooping is used, and whether camera parameters that are not significant are held at zero.
    expressions : sequence of str
        Gates besides those of orip.toml; malformed ones are refused before anything is computed.
    pose : callable
        Returns the problem of a block: as a whole, or divided among the workers of Dask.

    Raises
    ------
    InputError, NotSolvableError, UsageError
    """
    gates = project_gates(bundle.project, expressions)
    # the equations take half of the memory, and are released before anything is written
    adjusted = _adjusted(bundle, watcher, method, pose)[0]
    return _change(bundle, adjusted, gates)


def solve_with_equations(
    bundle: BundleState, watcher: SolveWatcher = NOBODY, method: Method = PLAIN
) -> tuple[Change[SolveOutcome], SolvedBlock]:
    """Adjust one bundle as `solve` does, and return also the adjusted block with its equations."""
    gates = project_gates(bundle.project, ())
    adjusted, solved = _adjusted(bundle, watcher, method, pose_problem)
    return _change(bundle, adjusted, gates), solved


class _Adjusted(Struct, frozen=True):
    """The solution of a project's bundle, and the listing of preliminary values, if they had to be found."""

    solution: Solution
    listed: tuple[TextOutput, ...]


def _adjusted(bundle: BundleState, watcher: SolveWatcher, method: Method, pose: Pose) -> tuple[_Adjusted, SolvedBlock]:
    found: list[PreliminaryValues] = []
    solution, solved = solve_bundle(block_input(bundle), method, _that_keeps(watcher, found), pose)
    listed = tuple(_preliminary_output(bundle, values, solved.block.ground) for values in found)
    return _Adjusted(_of_project(bundle, solution, method), listed), solved


def _change(bundle: BundleState, adjusted: _Adjusted, gates: Sequence[Gate]) -> Change[SolveOutcome]:
    project, solution = bundle.project, adjusted.solution
    files = (*project.outputs(bundle.name).written(solution), *(output.path for output in adjusted.listed))
    return Change(
        bundle.state,
        SolveOutcome(
            project,
            solution,
            check_solution(solution, gates),
            files,
            _left_out(bundle, solution),
            _worst_in_image(bundle, solution),
        ),
        StoredParts(solutions={record_key(bundle.name): solution}),
        locks=(project.exterior,),
        is_compared=False,
        outputs=(*adjusted.listed, *solution_outputs(project, solution, bundle.observations)),
        superseded=superseded_outputs(project, solution),
        restores_outputs=True,
    )


def _that_keeps(watcher: SolveWatcher, found: list[PreliminaryValues]) -> SolveWatcher:
    """Return a watcher that also keeps the preliminary values that had to be found."""

    def oriented(values: PreliminaryValues) -> None:
        found[:] = [values]
        watcher.oriented(values)

    def replaced(values: PreliminaryValues) -> None:
        found[:] = [values]
        watcher.replaced(values)

    return replace(watcher, oriented=oriented, replaced=replaced)


def _worst_in_image(bundle: BundleState, solution: Solution) -> tuple[str, str] | None:
    residuals, folder = solution.residuals, bundle.project.folder
    for row in suspect_rows(solution, bundle.project.definition.test_level).tolist():
        photo = bundle.records.photos.get(record_key(residuals.photo[row]))
        if residuals.kind[row] == PHOTO_POINT.name and photo is not None:
            image = paths_of_photos({photo.name: photo.image}, folder, None)[0].get(photo.name)
            return (photo.name, residuals.point[row]) if image is not None else None
    return None


def _left_out(bundle: BundleState, solution: Solution) -> tuple[str, ...]:
    """Return the photos with photo points that could not be oriented and are not in a solution."""
    solved = set(map(record_key, solution.photos.names))
    measured = coded(bundle.observations.photos).occurring()
    return tuple(name for name in measured if record_key(name) not in solved)


def _of_project(bundle: BundleState, solution: Solution, method: Method) -> Solution:
    """Return a solution with the project that it belongs to, what it was computed from, and the run id."""
    definition = bundle.project.definition
    return replace(
        solution,
        project=definition.name,
        user=definition.user,
        inputs=_inputs(bundle),
        interior=_summaries(bundle),
        run=run_of_solution(bundle, solution, method),
    )


def run_of_solution(bundle: BundleState, solution: Solution, method: Method) -> str:
    """Return the run id of a solution that is computed from a bundle by a method."""
    return run_id("solve", method, solution.status, len(solution.iterations), _inputs(bundle))


def _inputs(bundle: BundleState) -> Digests:
    given = bundle.state.texts.control_input(bundle.name)
    return (*given.value.digests, *bundle.digests, bundle.project.heading_digest)


def _preliminary_output(bundle: BundleState, values: PreliminaryValues, ground: GroundSystem) -> TextOutput:
    from orip.prelim.ground import absolute_in_project
    from orip.workflow.adjust.prelim import listed_values, preliminary_output

    listed = listed_values(absolute_in_project(values, ground), ground)
    return preliminary_output(bundle.project, bundle.name, listed)


def _summaries(bundle: BundleState) -> tuple[InteriorSummary, ...]:
    """Return the interior orientations of the bundle's photos and of the templates they are on."""
    seen = set(map(record_key, coded(bundle.observations.photos).occurring()))
    on = {
        record_key(photo.template)
        for key, photo in bundle.records.photos.items()
        if photo.template is not None and key in seen
    }
    wanted = {"photos": seen, "templates": on}
    summaries = (adjustment.summary for adjustment in bundle.interior.adjustments)
    return tuple(summary for summary in summaries if record_key(summary.name) in wanted[summary.group])
