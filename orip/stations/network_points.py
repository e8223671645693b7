"""Marks of a network of baselines as control points of a project: `.PNT`, and what they have in common in `.COV`."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.errors import Complaint, InputError, ProjectWarning
from orip.files.control.covariances_text import parse_covariances
from orip.files.control.editing import FORMS, ControlLines, read_control_lines
from orip.files.control.text import points_text
from orip.files.text.shown import Parsed
from orip.geometry.ground_ellipsoid import geographic_from_geocentric, place_axes
from orip.records.control import ControlPoint
from orip.stations.gnss.network_processing import NetworkResult
from orip.stations.in_project import project_frame
from orip.stations.interpolation import WGS84
from orip.units import METRES_PER_GROUND_UNIT
from orip.workflow.project.commit import Change
from orip.workflow.project.outputs import EditedText, digest_of_text
from orip.workflow.project.state import ProjectState
from orip.workflow.records.mentions import is_written

_LEAST_ERROR = 1e-7


class NetworkPoints(Struct, frozen=True):
    """What was or would be written: files, and coordinates with errors (n, 3) in the project's units."""

    files: tuple[str, ...]
    place: FloatArray
    error: FloatArray
    warnings: tuple[ProjectWarning, ...]


def network_points(
    state: ProjectState, *, result: NetworkResult, dry_run: bool = False, replaces: bool = False
) -> Change[NetworkPoints]:
    """Return the change that adds marks to the control points; the one that is held is constant.

    `replaces`: in the place of those that are there.

    Raises
    ------
    InputError
        If the project has points of these names, or no crs.
    """
    project, definition = state.project, state.project.definition
    geographic = geographic_from_geocentric(result.network.place, WGS84)
    frame = project_frame(geographic, definition.crs, definition.ground_unit)
    place = frame.crs.from_geographic(geographic)
    turn = frame.grid_axes_at(place) @ place_axes(geographic) / METRES_PER_GROUND_UNIT[definition.ground_unit]
    covariance = _turned(result.network.covariance, turn)
    error = np.sqrt(np.diag(covariance)).reshape(-1, 3)
    points = _points(result, place, error, covariance)
    paths = [project.folder / f"{definition.control_files}.{ending}" for ending in ("PNT", "COV")]
    edited = []
    texts = points_text(points), _pairs_text(result, covariance)
    for path, text, names in zip(paths, texts, (1, 2), strict=True):
        lines = read_control_lines(path, project.shown(path)) if path.exists() else None
        before = "" if lines is None else _without(lines, result.names, names).text if replaces else lines.text
        if path == paths[0] and lines is not None and not replaces:
            _require_new(lines, result.names, project.shown(path))
        before += "" if before.endswith("\n") or not before else "\n"
        edited.append(EditedText(path, digest_of_text(path), before + text, "the file is unchanged"))
    _check(edited, [project.shown(path) for path in paths])
    shown = tuple(project.shown(path) for path in paths)
    outcome = NetworkPoints(shown, place, error, frame.warnings)
    if dry_run:
        return Change(state, outcome)
    locks = (project.exterior,) if is_written(project.exterior) else ()
    return Change(state, outcome, locks=locks, is_compared=False, edited_texts=tuple(edited))


def _turned(covariance: FloatArray, turn: FloatArray) -> FloatArray:
    count = len(turn)
    blocks = covariance.reshape(count, 3, count, 3)
    return np.asarray(np.einsum("iab,ibjc,jdc->iajd", turn, blocks, turn).reshape(3 * count, 3 * count))


def _points(result: NetworkResult, place: FloatArray, error: FloatArray, covariance: FloatArray) -> list[ControlPoint]:
    points = []
    for mark, name in enumerate(result.names):
        own = covariance[3 * mark : 3 * mark + 3, 3 * mark : 3 * mark + 3]
        correlations = None
        if mark != result.held:
            found = own / np.outer(error[mark], error[mark])
            correlations = (float(found[0, 1]), float(found[0, 2]), float(found[1, 2]))
        x, y, z = place[mark].tolist()
        a, b, c = (0.0 if mark == result.held else max(one, _LEAST_ERROR) for one in error[mark].tolist())
        points.append(ControlPoint(name, (x, y, z), (a, b, c), correlations=correlations))
    return points


def _pairs_text(result: NetworkResult, covariance: FloatArray) -> str:
    free = [mark for mark in range(len(result.names)) if mark != result.held]
    lines = []
    for one, other in combinations(free, 2):
        block = covariance[3 * one : 3 * one + 3, 3 * other : 3 * other + 3]
        lines.append(" ".join([result.names[one], result.names[other], *(f"{value:.6e}" for value in block.ravel())]))
    return "".join(f"{line}\n" for line in lines)


def _without(lines: ControlLines, marks: tuple[str, ...], names: int) -> ControlLines:
    """Return the lines without those that have marks among their first `names` fields."""
    return lines.without_lines(
        line.number for line in lines.records() if {field.text for field in line.fields[:names]} & set(marks)
    )


def _require_new(lines: ControlLines, names: tuple[str, ...], shown: str) -> None:
    form = FORMS["points"]
    there = {form.fields_of(line)[0]: line.number for line in form.records(lines)}
    complaints = [
        Complaint(f"point '{name}' is there already; remove it, or name the mark otherwise", shown, there[name])
        for name in names if name in there
    ]  # fmt: skip
    if complaints:
        raise InputError(complaints)


def _check(edited: list[EditedText], shown: list[str]) -> None:
    """Read the texts as they will be."""
    points, pairs = (Parsed(text.text.removeprefix("\ufeff").splitlines()) for text in edited)
    parsed = FORMS["points"].parse(points, shown[0])
    complaints = [*parsed.complaints]
    if not complaints:
        complaints += parse_covariances(pairs, shown[1], parsed.value).complaints
    if complaints:
        raise InputError(complaints)
