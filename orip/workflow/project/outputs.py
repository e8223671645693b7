"""The text outputs: written after the stores have committed, and again where a kill came between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from orip.bundle.reliability import reliability
from orip.files.listings.bundle import bundle_listing_lines
from orip.files.listings.errors import error_listing_lines
from orip.files.listings.interior import interior_listing
from orip.files.listings.title import run_of_listing
from orip.files.result.json_text import result_pieces, run_of_result
from orip.files.result.residuals_csv import residuals_csv_pieces
from orip.files.stores import observations, solutions
from orip.files.stores.provenance import run_of
from orip.files.stores.transaction import reading
from orip.files.text.atomic import lines_in_pieces, remove_leftovers, replace_text_in_pieces, reporting_failure
from orip.interior.in_force import Interior, interior_orientation
from orip.progress import stage
from orip.records.measurement import PhotoObservations, no_observations
from orip.records.solution import Solution
from orip.workflow.project.definitions import read_definitions
from orip.workflow.project.folder import Project
from orip.workflow.project.measurements import read_measured
from orip.workflow.project.run_id import digest_of_observations

_HEAD = 4096
"""Characters that hold the run id of any output."""


@stage("writing the listings")
def write_solution_outputs(project: Project, solution: Solution, measured: PhotoObservations) -> tuple[Path, ...]:
    """Write all outputs of a solution; result.json comes last, so that its run id vouches for residuals.csv.

    Parameters
    ----------
    project : Project
    solution : Solution
    measured : PhotoObservations
        Those that were adjusted.
    """
    files = project.outputs(solution.bundle)
    found = reliability(solution.residuals, solution.sigma0 if np.isfinite(solution.sigma0) else 1.0)
    _write(project, files.residuals, residuals_csv_pieces(solution.residuals, found))
    _write(project, files.listing, lines_in_pieces(bundle_listing_lines(solution, found, measured)))
    _write(project, files.errors, lines_in_pieces(error_listing_lines(solution)))
    _write(project, files.result, result_pieces(solution))
    return files.all


def write_interior_listing(project: Project, interior: Interior, run: str) -> None:
    """Write INTERIOR_RESULT.OUT."""
    definition = project.definition
    listing = interior_listing(interior.adjustments, definition.name, definition.user, run)
    _write(project, project.interior_listing, [listing])


def stale_solution_outputs(project: Project, bundle: str, run: str) -> tuple[Path, ...]:
    """Return the outputs of a bundle that are missing or not those of the run in the store."""
    files = project.outputs(bundle)
    stale = [path for path in (files.listing, files.errors) if run_of_listing(_head(path)) != run]
    if run_of_result(_head(files.result)) != run:
        stale += [files.result, files.residuals]
    elif not files.residuals.is_file():
        stale.append(files.residuals)
    return tuple(stale)


def is_interior_listing_stale(project: Project, run: str) -> bool:
    """Tell whether INTERIOR_RESULT.OUT is missing or not that of the run in the stores."""
    return run_of_listing(_head(project.interior_listing)) != run


def rewrite_stale_outputs(project: Project) -> None:
    """Rewrite the outputs that do not belong to what is in the stores, and clear away what killed runs have left."""
    remove_leftovers(project.folder)
    _rewrite_interior_listing(project)
    for bundle in project.definition.bundles:
        with reading([project.exterior]) as stores:
            head = solutions.read_head(stores[project.exterior], bundle.name)
            stale = head is not None and stale_solution_outputs(project, bundle.name, head.run)
            solution = solutions.read(stores[project.exterior], bundle.name) if stale else None
        if solution is not None:
            write_solution_outputs(project, solution, _adjusted_observations(project, solution))


def _adjusted_observations(project: Project, solution: Solution) -> PhotoObservations:
    """Return the photo observations that a solution comes from; none where they have been measured anew since."""
    path = project.observations(solution.bundle)
    with reading([path]) as stores:
        measured = observations.read(stores[path])
    if measured is None or dict(solution.inputs).get(project.shown(path)) != digest_of_observations(measured):
        return no_observations(solution.bundle)
    return measured


def outputs_of_other_names(project: Project) -> Sequence[Path]:
    """Return outputs that were written while the project had one bundle, and now has several, or the reverse."""
    current = {path for bundle in project.definition.bundles for path in project.outputs(bundle.name).all}
    other = (path for bundle in project.definition.bundles for path in project.outputs_of_other_name(bundle.name).all)
    return [path for path in dict.fromkeys(other) if path not in current and path.is_file()]


def _rewrite_interior_listing(project: Project) -> None:
    with reading(project.record_stores) as stores:
        run = run_of(stores[project.photos])
        if run is None or not is_interior_listing_stale(project, run):
            return
        definitions, measured = read_definitions(project, stores), read_measured(project, stores, [])
    write_interior_listing(project, interior_orientation(definitions.by_name(), measured), run)


def _write(project: Project, path: Path, pieces: Iterable[str]) -> None:
    consequence = (
        "the results are safe in the record stores: remove the cause, then 'orip init' (or measure, solve, run) writes "
        "the missing outputs"
    )
    with reporting_failure(project.shown(path), consequence):
        replace_text_in_pieces(path, pieces)


def _head(path: Path) -> str:
    if not path.is_file():
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.read(_HEAD)
