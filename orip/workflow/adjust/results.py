"""`orip results`: cameras, photos, points, theodolites or residuals of the last adjustment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from msgspec import Struct

from orip.bundle.results.reliability import reliability_of
from orip.errors import UsageError
from orip.files.listings.bundle_estimates import camera_lines, photo_lines, point_lines, zero_direction_lines
from orip.files.listings.bundle_residuals import component_columns
from orip.files.result.json_text import points_by_name, result_document
from orip.files.result.residuals import residuals_csv_pieces, residuals_npz_pieces
from orip.files.text.atomic import replace_in_pieces, reporting_failure
from orip.files.text.table import table_lines
from orip.records.coded_names import coded
from orip.records.names import record_key
from orip.records.results.solution import Estimates, Reliability, Residuals, Solution
from orip.structs import replace
from orip.workflow.project.folder import ProjectFolder
from orip.workflow.project.named_output import first_bytes, require_replaceable

What = Literal["cameras", "photos", "points", "theodolites", "residuals"]


class Results(Struct, frozen=True):
    """The part of a solution that was asked for, as text and as a JSON document."""

    text: str
    document: dict[str, Any]


def results(solution: Solution, what: What, names: Sequence[str]) -> Results:
    """Return part of a solution.

    Parameters
    ----------
    solution : Solution
    what : {"cameras", "photos", "points", "theodolites", "residuals"}
    names : sequence of str
        Cameras, photos, points or sets of directions to show; for residuals photos or points. Empty: all.

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
    }[what]()
    part = points_by_name(chosen) if what == "points" else result_document(chosen)[what]
    return Results("\n".join(lines) + "\n", {"run": solution.run, what: part})


def _chosen(
    solution: Solution, what: Literal["cameras", "photos", "points", "theodolites"], names: Sequence[str]
) -> Solution:
    """Return the solution with only some cameras, photos, points or sets of directions."""
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
        return replace(solution, photos=part, photo_rotation_sd_about_axes=about_axes)
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
