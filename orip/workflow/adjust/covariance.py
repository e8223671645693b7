"""`orip results covariance`: the covariance matrix of the last adjustment.

Stores hold standard deviations and some correlations, not normal equations: the adjustment is computed again, by the
method by which it was made, which its run id tells.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orip.bundle.methods import Method
from orip.bundle.results.covariance import Figures, camera_figures, covariance, photo_figures, point_figures
from orip.bundle.snooping.search import SnoopingSettings
from orip.bundle.solve import SolvedBlock
from orip.errors import InputError, UsageError
from orip.files.result.residuals import CovarianceMatrix, csv_bytes, npz_bytes
from orip.files.text.atomic import replace_bytes, reporting_failure
from orip.records.names import record_key
from orip.records.observations.observation_kinds import unit_of_unknown
from orip.records.project.camera import CAMERA_PARAMETERS
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.workflow.adjust.solve import run_of_solution, solve_with_equations
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.named_output import require_replaceable

MOST_FIGURES = 10_000
"""A matrix of so many figures takes 800 MB."""

_FORMATS = {".npz": npz_bytes, ".csv": csv_bytes}


class _Record(NamedTuple):
    """A camera, photo or point with the names, values and units of its figures."""

    kind: str
    name: str
    row: int
    kinds: tuple[str, ...]
    values: tuple[float, ...]
    figures: Callable[[SolvedBlock, int], Figures]


def covariance_matrix(bundle: BundleState, names: Sequence[str]) -> CovarianceMatrix:
    """Return the covariances of cameras, photos and points; figures that are constant are left out.

    Parameters
    ----------
    bundle : BundleState
        With `ADJUSTED_FROM` and solutions.
    names : sequence of str
        Cameras, photos and points; empty: all.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or what it was adjusted from has changed since.
    UsageError
        If a name is not in the solution, or the matrix would be too large.
    """
    stored = bundle.adjusted
    records = _chosen(list(_records(stored)), names)
    _, solved = solve_with_equations(bundle, method=_method(bundle, stored))
    found = [record.figures(solved, record.row) for record in records]
    matrix = covariance(solved, found, found)
    labels = [f"{record.kind} {record.name}.{kind}" for record in records for kind in record.kinds]
    units = [unit_of_unknown(kind, stored.ground_unit) for record in records for kind in record.kinds]
    values = np.array([value for record in records for value in record.values])
    kept = np.flatnonzero(~(np.diag(matrix) == 0.0))
    return CovarianceMatrix(
        [labels[row] for row in kept], [units[row] for row in kept], values[kept], matrix[np.ix_(kept, kept)],
        stored.sigma0, stored.run,
    )  # fmt: skip


def write_covariance(project: ProjectFolder, matrix: CovarianceMatrix, output: Path, *, force: bool = False) -> None:
    """Write a matrix in the format that the file's name says; with `force` also in the place of another file.

    Raises
    ------
    UsageError
        If it ends in neither .npz nor .csv, or another file would be replaced.
    OripError
        If it cannot be written.
    """
    with reporting_failure(output, "choose another file with --output"):
        data = _FORMATS[output.suffix.lower()](matrix)
        require_replaceable(project, output, force=force, begins=data)
        replace_bytes(output, data)


def require_format(output: Path | None) -> Path:
    """Return the file to write; raise UsageError if there is none, or it ends in neither .npz nor .csv."""
    if output is None or output.suffix.lower() not in _FORMATS:
        message = (
            "name the file of the covariance matrix: --output covariance.npz for NumPy, or --output covariance.csv"
        )
        raise UsageError(message)
    return output


def _records(solution: Solution) -> Iterator[_Record]:
    for row, name in enumerate(solution.cameras.names):
        own = [parameter for parameter in solution.additional if parameter.camera == name]
        kinds = (*CAMERA_PARAMETERS, *(parameter.name for parameter in own))
        values = (*solution.cameras.values[row].tolist(), *(parameter.value for parameter in own))
        yield _Record("camera", name, row, kinds, values, camera_figures)
    for row, name in enumerate(solution.photos.names):
        yield _Record("photo", name, row, PHOTO_PARAMETERS, tuple(solution.photos.values[row].tolist()), photo_figures)
    for row, name in enumerate(solution.points.names):
        yield _Record("point", name, row, ("X", "Y", "Z"), tuple(solution.points.values[row].tolist()), point_figures)


def _chosen(records: list[_Record], names: Sequence[str]) -> list[_Record]:
    if names:
        wanted = {*names, *map(record_key, names)}
        # names of records ignore case, those of points do not
        records = [r for r in records if (r.name if r.kind == "point" else record_key(r.name)) in wanted]
        known = {key for record in records for key in (record.name, record_key(record.name))}
        if missing := [name for name in names if name not in known and record_key(name) not in known]:
            message = f"the solution has no camera, photo or point {', '.join(missing)}"
            raise UsageError(message)
    count = sum(len(record.kinds) for record in records)
    if count > MOST_FIGURES:
        message = (
            f"a matrix of {count} figures is too large, {MOST_FIGURES} are possible; name cameras, photos or points"
        )
        raise UsageError(message)
    return records


def _method(bundle: BundleState, stored: Solution) -> Method:
    """Return the method by which a stored solution was made: with it the run has the same id."""
    snoopings = (None, SnoopingSettings("apriori", None), SnoopingSettings("posteriori", None))
    for snooping, prune, components in itertools.product(snoopings, (False, True), (False, True)):
        method = Method(snooping, prune, components)
        if run_of_solution(bundle, stored, method) == stored.run:
            return method
    message = (
        f"the covariances of bundle {bundle.name} cannot be computed: its project has changed since it was adjusted, "
        "or it was adjusted with --alpha; run 'orip solve', and then this command"
    )
    raise InputError.single(message)
