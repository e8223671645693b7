"""`orip results`: cameras, photos, points, theodolites or residuals of the last adjustment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal

import numpy as np

from orip.errors import UsageError
from orip.files.listings.bundle_estimates import camera_lines, photo_lines, point_lines, zero_direction_lines
from orip.files.listings.bundle_residuals import component_columns
from orip.files.result.json_text import result_document
from orip.files.text.table import table_lines
from orip.records.names import record_key
from orip.records.results.solution import Estimates, Residuals, Solution

What = Literal["cameras", "photos", "points", "theodolites", "residuals"]


@dataclass(frozen=True, slots=True)
class Results:
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
    return Results("\n".join(lines) + "\n", {"run": solution.run, what: result_document(chosen)[what]})


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
        point_rays=tuple(solution.point_rays[row] for row in rows),
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
    rows = [
        row
        for row, (photo, point) in enumerate(zip(found.photo, found.point, strict=True))
        if not names or point in names or record_key(photo) in wanted
    ]
    if names and not rows:
        message = f"no residual belongs to {', '.join(names)}; name photos or points"
        raise UsageError(message)
    text = "\n".join(table_lines(component_columns(found, rows, solution.ground_unit)))
    columns = [field.name for field in fields(Residuals)]
    table = [[_plain(getattr(found, column)[row]) for column in columns] for row in rows]
    document = {"run": solution.run, "residuals": [dict(zip(columns, row, strict=True)) for row in table]}
    return Results(f"{text}\n", document)


def _plain(value: Any) -> str | float | None:
    if isinstance(value, str):
        return value
    return float(value) if np.isfinite(value) else None
