"""The text outputs of solutions: written after the stores have committed, and again where a kill came between."""

from __future__ import annotations

from pathlib import Path

from orip.files.atomic_text import remove_leftovers, replace_text
from orip.files.bundle_listing import bundle_listing
from orip.files.error_listing import error_listing
from orip.files.listing_title import run_of_listing
from orip.files.residuals_csv import residuals_csv
from orip.files.result_json import result_text, run_of_result
from orip.files.stores import solutions
from orip.files.stores.transaction import reading
from orip.model.solution import Solution
from orip.workflow.project import Project

_HEAD = 4096
"""Characters that hold the run id of any output."""


def write_outputs(project: Project, solution: Solution) -> tuple[Path, ...]:
    """Write all outputs of a solution; result.json comes last, so that its run id vouches for the others."""
    files = project.outputs(solution.bundle)
    replace_text(files.residuals, residuals_csv(solution.residuals))
    replace_text(files.listing, bundle_listing(solution))
    replace_text(files.errors, error_listing(solution))
    replace_text(files.result, result_text(solution))
    return files.listing, files.errors, files.result, files.residuals


def stale_outputs(project: Project, bundle: str, run: str) -> tuple[Path, ...]:
    """Return the outputs of a bundle that are missing or not those of the run in the store."""
    files = project.outputs(bundle)
    stale = [path for path in (files.listing, files.errors) if run_of_listing(_head(path)) != run]
    if run_of_result(_head(files.result)) != run:
        stale += [files.result, files.residuals]
    elif not files.residuals.is_file():
        stale.append(files.residuals)
    return tuple(stale)


def rewrite_stale_outputs(project: Project) -> tuple[Path, ...]:
    """Rewrite the outputs that do not belong to the solutions in the store; return them."""
    remove_leftovers(project.folder)
    rewritten: list[Path] = []
    for bundle in project.definition.bundles:
        with reading([project.exterior]) as stores:
            head = solutions.read_head(stores[project.exterior], bundle.name)
            stale = stale_outputs(project, bundle.name, head.run) if head is not None else ()
            solution = solutions.read(stores[project.exterior], bundle.name) if stale else None
        if solution is not None:
            write_outputs(project, solution)
            rewritten += stale
    return tuple(rewritten)


def _head(path: Path) -> str:
    if not path.is_file():
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.read(_HEAD)
