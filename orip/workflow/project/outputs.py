"""The text outputs: written after the stores have committed, and again if a run was killed in between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from orip.files.listings.identification import run_of_listing
from orip.files.result.identification import run_of_result
from orip.files.stores.digest import run_of
from orip.files.stores.transaction import reading
from orip.files.text.atomic import lines_in_pieces
from orip.files.text.own_files import remove_file
from orip.files.text.regular_file import beginning
from orip.records.observations.measurement import PhotoObservations, no_observations
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.state import read_state
from orip.workflow.project.text_output import TextOutput, write_output

if TYPE_CHECKING:
    from orip.interior.in_force import Interior
    from orip.records.results.solution import Reliability, Solution

_HEAD = 4096
"""Number of characters at the beginning of an output that include its run id."""

_REMEDY = (
    "the results are safe in the record stores: remove the cause, then 'orip init' (or measure, solve, run) writes the "
    "missing outputs"
)


def solution_outputs(project: ProjectFolder, solution: Solution, measured: PhotoObservations) -> tuple[TextOutput, ...]:
    """Return all outputs of a solution; result.json comes last, so that its run id vouches for residuals.csv.

    Parameters
    ----------
    project : ProjectFolder
    solution : Solution
    measured : PhotoObservations
        Those that were adjusted.
    """
    # slow to import, and most commands write no solution
    from orip.bundle.results.misfits import suspect_rows
    from orip.bundle.results.reliability import reliability_of
    from orip.files.listings.bundle import bundle_listing_lines
    from orip.files.listings.errors import error_listing_lines
    from orip.files.result.json_text import result_pieces

    files = project.outputs(solution.bundle)
    found = reliability_of(solution)
    misfits = suspect_rows(solution, project.definition.test_level).tolist()
    return (
        TextOutput(files.residuals_of(solution), lambda: residuals_in_pieces(solution, found), _REMEDY),
        TextOutput(files.listing, lambda: lines_in_pieces(bundle_listing_lines(solution, found, measured)), _REMEDY),
        TextOutput(files.errors, lambda: lines_in_pieces(error_listing_lines(solution, misfits)), _REMEDY),
        TextOutput(files.result, lambda: result_pieces(solution, files.residuals_of(solution).name), _REMEDY),
    )


def superseded_outputs(project: ProjectFolder, solution: Solution) -> tuple[Path, ...]:
    """Return the file of residuals that an earlier solution had in the other form."""
    files = project.outputs(solution.bundle)
    return tuple(path for path in files.all if path not in files.written(solution))


def residuals_in_pieces(solution: Solution, found: Reliability) -> Iterable[str | bytes | memoryview]:
    """Return the residuals of a solution as a text table, or as arrays where they are many."""
    if solution.is_large:
        from orip.files.result.residuals import residuals_npz_pieces

        return residuals_npz_pieces(solution.residuals, found)
    from orip.files.result.residuals import residuals_csv_pieces

    return residuals_csv_pieces(solution.residuals, found)


def interior_output(project: ProjectFolder, interior: Interior, run: str) -> TextOutput:
    """Return INTERIOR_RESULT.OUT."""
    definition = project.definition

    def listing() -> list[str]:
        from orip.files.listings.errors import interior_listing

        return [interior_listing(interior.adjustments, definition.name, definition.user, run)]

    return TextOutput(project.interior_listing, listing, _REMEDY)


def stale_solution_outputs(project: ProjectFolder, bundle: str, run: str) -> tuple[Path, ...]:
    """Return the outputs of a bundle that are missing or not those of the run in the store."""
    files = project.outputs(bundle)
    stale = [path for path in (files.listing, files.errors) if run_of_listing(beginning(path, _HEAD)) != run]
    if run_of_result(beginning(files.result, _HEAD)) != run:
        stale += [files.result, files.residuals]
    elif not (files.residuals.is_file() or files.residual_arrays.is_file()):
        stale.append(files.residuals)
    return tuple(stale)


def is_interior_listing_stale(project: ProjectFolder, run: str) -> bool:
    """Tell whether INTERIOR_RESULT.OUT is missing or not that of the run in the stores."""
    return run_of_listing(beginning(project.interior_listing, _HEAD)) != run


def rewrite_stale_outputs(project: ProjectFolder) -> None:
    """Write again the outputs that do not belong to what is in the stores."""
    _rewrite_interior_listing(project)
    heads = read_state(project, {"heads"}, project.bundle_names)
    for bundle in project.bundle_names:
        head = heads.head(bundle)
        if head is not None and stale_solution_outputs(project, bundle, head.run):
            _rewrite_solution_outputs(project, bundle)


def _rewrite_solution_outputs(project: ProjectFolder, bundle: str) -> None:
    found = BundleState(read_state(project, {"solutions", "observations"}, [bundle]), bundle)
    if found.solution is None:
        return
    path = project.shown(project.observations(bundle))
    is_adjusted = found.is_measured and dict(found.solution.inputs).get(path) == found.digest_of_observations
    # measurements that have changed since do not belong to the listing
    measured = found.observations if is_adjusted else no_observations(bundle)
    for output in solution_outputs(project, found.solution, measured):
        write_output(project, output)
    for other in superseded_outputs(project, found.solution):
        with suppress(OSError):
            remove_file(other, project.folder)


def outputs_of_other_names(project: ProjectFolder) -> Sequence[Path]:
    """Return outputs that were written while the project had one bundle, and now has several, or the reverse."""
    current = {path for bundle in project.bundle_names for path in project.outputs(bundle).all}
    other = (path for bundle in project.bundle_names for path in project.outputs_of_other_name(bundle).all)
    return [path for path in dict.fromkeys(other) if path not in current and path.is_file()]


def _rewrite_interior_listing(project: ProjectFolder) -> None:
    with reading([project.photos]) as stores:
        run = run_of(stores[project.photos])
    if run is not None and is_interior_listing_stale(project, run):
        interior = read_state(project, {"definitions", "marks"}, ()).interior
        write_output(project, interior_output(project, interior, run))
