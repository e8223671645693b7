"""`orip results` and `orip check`: the last adjustment in tables, its covariances and normals, gates checked."""

from __future__ import annotations

import io
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.bundle.methods import Method
from orip.bundle.results.covariance import (
    Figures,
    camera_figures,
    covariance,
    normal_equations,
    photo_figures,
    point_figures,
)
from orip.bundle.results.figures import AngleSystem, AngleUnit, with_angles
from orip.bundle.results.reliability import reliability_of
from orip.bundle.snooping.search import SnoopingSettings
from orip.bundle.solve import SolvedBlock
from orip.errors import InputError, UnknownNameError, UsageError
from orip.files.listings.bundle_estimates import (
    camera_lines,
    figure_lines,
    photo_lines,
    point_lines,
    zero_direction_lines,
)
from orip.files.listings.bundle_residuals import component_columns
from orip.files.result.json_text import points_by_name, result_document
from orip.files.result.residuals import (
    CovarianceMatrix,
    csv_bytes,
    npz_bytes,
    residuals_csv_pieces,
    residuals_npz_pieces,
)
from orip.files.text.atomic import replace_bytes, replace_in_pieces, reporting_failure
from orip.files.text.table import table_lines
from orip.records.camera import CAMERA_PARAMETERS
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.observation_kinds import unit_of_unknown
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Estimates, Reliability, Residuals, Solution
from orip.solving.solve import adjust_bundle
from orip.structs import replace
from orip.workflow.adjust.gathering import block_input
from orip.workflow.adjust.solve import run_of_solution
from orip.workflow.project.bundle_state import BundleState
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.outputs import first_bytes, require_replaceable

What = Literal["cameras", "photos", "points", "theodolites", "figures", "residuals"]


class Results(Struct, frozen=True):
    """The part of a solution that was asked for, as text and as a JSON document."""

    text: str
    document: dict[str, Any]


def photo_angles(solution: Solution, names: Sequence[str], system: AngleSystem, unit: AngleUnit) -> Results:
    """Return photos with their rotations by other angles, or in another unit; see `with_angles`."""
    chosen = with_angles(_chosen(solution, "photos", names), system, unit)
    angles = tuple(system.upper().split("-"))
    elements = (*PHOTO_PARAMETERS[:3], *angles)
    shown = {"degree": "degrees", "gon": "gon", "radian": "radians"}[unit]
    lines = photo_lines(chosen, elements, shown, 2 if unit == "radian" else 0)
    rows = zip(chosen.photos.names, chosen.photos.values.tolist(), chosen.photos.sd.tolist(), strict=True)
    document = {
        name: {
            element: {"value": value, "sd": sd if np.isfinite(sd) else "singular" if np.isinf(sd) else None}
            for element, value, sd in zip(elements, values, deviations, strict=True)
        }
        for name, values, deviations in rows
    }
    return Results("\n".join(lines) + "\n", {"run": solution.run, "angle_unit": unit, "photo_angles": document})


def results(solution: Solution, what: What, names: Sequence[str]) -> Results:
    """Return part of a solution.

    Parameters
    ----------
    what : {"cameras", "photos", "points", "theodolites", "figures", "residuals"}
    names : sequence of str
        Cameras, photos, points, sets of directions or figures to show; for residuals photos or points. Empty: all.

    Raises
    ------
    UsageError
        If a name is not in the solution.
    """
    if what == "residuals":
        return _residuals(solution, names)
    chosen = _chosen(solution, what, names)
    lines = {
        "cameras": lambda: camera_lines(chosen)[1:],
        "photos": lambda: photo_lines(chosen),
        "points": lambda: list(point_lines(chosen)),
        "theodolites": lambda: zero_direction_lines(chosen),
        "figures": lambda: figure_lines(chosen),
    }[what]()
    part = points_by_name(chosen) if what == "points" else result_document(chosen)[what]
    return Results("\n".join(lines) + "\n", {"run": solution.run, what: part})


def _chosen(
    solution: Solution, what: Literal["cameras", "photos", "points", "theodolites", "figures"], names: Sequence[str]
) -> Solution:
    """Return the solution with only some cameras, photos, points, sets of directions or figures."""
    if what == "figures":
        figures = solution.figures
        rows = _rows([figure.name for figure in figures], what, names)
        return replace(solution, figures=tuple(figures[row] for row in rows))
    if what == "theodolites":
        known = solution.zero_directions
        rows = _rows([direction.set for direction in known], what, names)
        return replace(solution, zero_directions=tuple(known[row] for row in rows))
    estimates: Estimates = getattr(solution, what)
    rows = _rows(estimates.names, what, names)
    part = Estimates(tuple(estimates.names[row] for row in rows), estimates.values[rows], estimates.sd[rows])
    if what == "cameras":
        additional = tuple(effect for effect in solution.additional if effect.camera in part.names)
        return replace(solution, cameras=part, additional=additional)
    if what == "photos":
        about_axes = tuple(solution.photo_rotation_sd_about_axes[row] for row in rows)
        are_known = len(solution.photo_correlations) == len(estimates.names)
        correlations = solution.photo_correlations[rows] if are_known else solution.photo_correlations
        return replace(solution, photos=part, photo_rotation_sd_about_axes=about_axes, photo_correlations=correlations)
    return replace(
        solution,
        points=part,
        point_rays=solution.point_rays[rows],
        point_kinds=tuple(solution.point_kinds[row] for row in rows),
    )


def _rows(known: Sequence[str], what: str, names: Sequence[str]) -> list[int]:
    if not names:
        return list(range(len(known)))
    # record names ignore case, point names do not
    key = record_key if what in ("cameras", "photos") else str
    place = {key(name): row for row, name in enumerate(known)}
    missing = [name for name in names if key(name) not in place]
    if len(missing) == 1:
        raise UnknownNameError(missing[0], what[:-1], known)
    if missing:
        message = f"the solution has no {what[:-1]} {', '.join(missing)}; 'orip results {what}' shows all"
        raise UsageError(message)
    return [place[key(name)] for name in names]


def _residuals(solution: Solution, names: Sequence[str]) -> Results:
    found = solution.residuals
    wanted = set(names) | {record_key(name) for name in names}
    chosen = coded(found.point).where(lambda point: point in names)
    chosen |= coded(found.photo).where(lambda photo: record_key(photo) in wanted)
    rows = np.flatnonzero(chosen | (not names)).tolist()
    if names and not rows:
        message = f"no residual belongs to {', '.join(names)}; name photos or points"
        raise UsageError(message)
    text = "\n".join(table_lines(component_columns(found, rows, solution.ground_unit)))
    columns = Residuals.__struct_fields__
    table = [[_plain(getattr(found, column)[row]) for column in columns] for row in rows]
    document = {"run": solution.run, "residuals": [dict(zip(columns, row, strict=True)) for row in table]}
    return Results(f"{text}\n", document)


def write_residuals(project: ProjectFolder, solution: Solution, output: Path, *, force: bool = False) -> None:
    """Write all residuals with their reliability, in the format that the file's name says.

    With `force` also in the place of another file.

    Raises
    ------
    UsageError
        If it ends in neither .npz nor .csv, or another file would be replaced.
    OripError
        If it cannot be written.
    """
    write = _FORMATS.get(output.suffix.lower())
    if write is None:
        message = "name the file of the residuals: --output residuals.npz for NumPy, or --output residuals.csv"
        raise UsageError(message)
    with reporting_failure(output, "choose another file with --output"):
        pieces = iter(write(solution.residuals, reliability_of(solution)))
        first = [*islice(pieces, 1)]
        usual = project.outputs(solution.bundle)
        require_replaceable(
            project, output, force=force, usual=(usual.residuals, usual.residual_arrays), begins=first_bytes(first)
        )
        replace_in_pieces(output, chain(first, pieces))


_FORMATS: Mapping[str, Callable[[Residuals, Reliability], Iterable[str | bytes | memoryview]]] = {
    ".csv": residuals_csv_pieces,
    ".npz": residuals_npz_pieces,
}


def _plain(value: Any) -> str | float | None:
    if isinstance(value, str):
        return value
    return float(value) if np.isfinite(value) else None


# Stores hold standard deviations and some correlations, not normal equations: the adjustment is computed again, by the
# method by which it was made, which its run id tells.


MOST_FIGURES = 10_000
"""A matrix of so many figures takes 800 MB."""

_MATRIX_FORMATS = {".npz": npz_bytes, ".csv": csv_bytes}


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
    records = _chosen_records(list(_records(stored)), names)
    solved = solved_again(bundle)
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


def solved_again(bundle: BundleState) -> SolvedBlock:
    """Return the last adjustment with its normal equations, which are not stored: it is computed again.

    Parameters
    ----------
    bundle : BundleState
        With `ADJUSTED_FROM` and solutions.

    Raises
    ------
    InputError
        If the bundle has not been adjusted, or what it was adjusted from has changed since.
    """
    return adjust_bundle(block_input(bundle), _method(bundle, bundle.adjusted))


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
        data = _MATRIX_FORMATS[output.suffix.lower()](matrix)
        require_replaceable(project, output, force=force, begins=data)
        replace_bytes(output, data)


def require_format(output: Path | None) -> Path:
    """Return the file to write; raise UsageError if there is none, or it ends in neither .npz nor .csv."""
    if output is None or output.suffix.lower() not in _MATRIX_FORMATS:
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


def _chosen_records(records: list[_Record], names: Sequence[str]) -> list[_Record]:
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


class WrittenNormals(NamedTuple):
    """The run whose normal equations were written, and how many unknowns they have."""

    run: str
    unknowns: int


def write_normals(bundle: BundleState, output: Path | None, folder: Path, *, force: bool = False) -> WrittenNormals:
    """Write the normal equations, which are computed again; see `NormalEquations` for what they are.

    The arrays of the .npz are names, data, indices, indptr (of a sparse matrix by rows), right, removed, square_sum,
    sigma0 and run.

    Raises
    ------
    UsageError
        If the file does not end in .npz, or another one would be replaced.
    InputError
        If the bundle has not been adjusted, or what it was adjusted from has changed since.
    """
    if output is None or output.suffix.lower() != ".npz":
        message = "name the file of the normal equations: --output normals.npz, for NumPy"
        raise UsageError(message)
    found = normal_equations(solved_again(bundle))
    file = io.BytesIO()
    np.savez_compressed(
        file, names=np.array(found.names, dtype=np.str_), data=found.matrix.data, indices=found.matrix.indices,
        indptr=found.matrix.indptr, right=found.right, removed=found.removed, square_sum=np.array(found.square_sum),
        sigma0=np.array(bundle.adjusted.sigma0), run=np.array(bundle.adjusted.run),
    )  # fmt: skip
    data, path = file.getvalue(), folder / output
    with reporting_failure(path, "choose another file with --output"):
        require_replaceable(bundle.project, path, force=force, begins=data)
        replace_bytes(path, data)
    return WrittenNormals(bundle.adjusted.run, len(found.names))
