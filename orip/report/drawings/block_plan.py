"""The plan of the block: footprints of photos, control and check points with errors and ellipses; and the overlap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from html import escape
from typing import NamedTuple

import numpy as np
from markupsafe import Markup

from orip.arrays import FloatArray, IntArray
from orip.records.coded_names import coded
from orip.records.names import places_of_names
from orip.records.results.solution import Solution
from orip.report.drawings.block_view import BlockSide, doubted_photos, frame_rays, side_of_block, vertical
from orip.report.drawings.ellipses import drawn_points, standard_ellipses
from orip.report.drawings.svg import MapPlane, drawing, element, labels, map_plane, number, numbers, round_step, text
from orip.report.report_input import ReportInput, camera_of_photo, photo_scale
from orip.wording import joined

MOST_POINTS = 1500
_MOST_LABELS = 60
_MARGIN = 0.08
_TYPICAL, _LARGEST = 0.06, 0.2
"""Length of a typical and of the largest error vector, as a part of the drawing's longer side."""

_CELLS = 48
"""Cells of the overlap along the longer side."""

MOST_OVERLAP = 9
"""Photos from which the overlap has one colour."""

_SIGN = {"height": "the adjusted point is higher", "depth": "the adjusted point is nearer to the photos"}

_RINGS = "Rings: photos whose strip or camera contradicts the others, see the groups of observations."

_DOWNWARD = 0.7
"""Cosine between camera axes and the normal of the drawing from which the overlap is counted."""


class BlockPlan(NamedTuple):
    """A drawing with title and note, the kinds of points in it, and the map of overlap, empty where there is none."""

    title: str
    picture: Markup
    note: str
    kinds: tuple[str, ...]
    overlap: Markup


class _Scene(NamedTuple):
    """What is drawn, in the plane's coordinates: points (n, 2), photos (m, 2), footprints (m, 4, 2), NaN if unknown."""

    side: BlockSide
    rows: IntArray
    points: FloatArray
    photos: FloatArray
    footprints: FloatArray


def block_plan(given: ReportInput) -> BlockPlan | None:
    """Return the plan of the block; None where no coordinates are known."""
    solution = given.solution
    up, rows = vertical(given), drawn_points(solution, MOST_POINTS)
    side = side_of_block(up, photo_scale(given).axes)
    flat = side.axes[:2]
    scene = _Scene(
        side, rows, solution.points.values[rows] @ flat.T, solution.photos.values[:, :3] @ flat.T,
        footprints(given) @ flat.T,
    )  # fmt: skip
    places = np.concatenate([scene.points, scene.photos, scene.footprints.reshape(-1, 2)])
    places = places[np.isfinite(places).all(axis=1)]
    if not len(places):
        return None
    longest = max(float(np.ptp(places, axis=0).max()), 1e-9)
    plane = map_plane(places.min(axis=0) - _MARGIN * longest, places.max(axis=0) + _MARGIN * longest)
    picture, enlargement = _plan(given, scene, plane)
    found = coded(solution.point_kinds).occurring()
    kinds = tuple(kind for kind in ("control", "check", "rejected", "tie") if kind in found)
    rings = _RINGS if doubted_photos(given) else ""
    note = " ".join([_note(scene, enlargement, len(solution.points.names)), rings, up.note]).strip()
    return BlockPlan(side.title, picture, note, kinds, _overlap(given, scene, plane))


def footprints(given: ReportInput) -> FloatArray:
    """Return the corners (photos, 4, 3) of the photos' frames at the median depth of their points; NaN if not known."""
    scale = photo_scale(given)
    corners = given.solution.photos.values[:, None, :3] + frame_rays(given) * scale.scale_number[:, None, None]
    for row, name in enumerate(given.solution.photos.names):
        camera = camera_of_photo(given, name)
        if camera is None or camera.projection != "perspective":
            corners[row] = np.nan
    return np.asarray(corners)


def _plan(given: ReportInput, scene: _Scene, plane: MapPlane) -> tuple[Markup, float]:
    solution = given.solution
    errors: dict[str, dict[str, FloatArray]] = {
        kind: dict(zip(points.names, points.difference, strict=True)) for kind, points in given.compared.items()
    }
    enlargement = _enlargement(scene, plane, errors)
    drawn = [
        *_footprints(scene, plane),
        *_points(solution, scene, plane),
        *_doubted(given, scene, plane),
        *_photos(solution, scene, plane),
        *(_errors(solution, scene.side, plane, enlargement, kind, found) for kind, found in errors.items()),
        *_names(solution, scene, plane),
    ]
    unit = solution.ground_unit
    parts = [plane.clipped(drawn), *plane.axes(_axis_names(scene.side, unit))]
    if any(errors.values()):
        size = round_step(0.12 * plane.width / plane.scale / enlargement, 1) / 2.0
        parts += plane.scale_bar(size * plane.scale * enlargement, f"errors {size:g} {unit}")
    label = f"{scene.side.title}: photos, their footprints, control and check points with their errors"
    return drawing(*plane.size, label, parts, "map"), enlargement


def _axis_names(side: BlockSide, unit: str) -> list[str]:
    return [f"{name} ({unit})" for name in side.names]


def _enlargement(scene: _Scene, plane: MapPlane, errors: Mapping[str, Mapping[str, FloatArray]]) -> float:
    """Return a round enlargement at which typical errors are visible, and the largest stay within the drawing."""
    found = [np.nan_to_num(size) @ scene.side.axes.T for mine in errors.values() for size in mine.values()]
    if not found:
        return 1.0
    size = np.abs(np.array(found)).max(axis=1)
    side = max(plane.width, plane.height) / plane.scale
    allowed = [part * side / of for part, of in ((_TYPICAL, np.median(size)), (_LARGEST, size.max())) if of > 0.0]
    return max(round_step(float(min(allowed)), 1) / 2.0, 1.0) if allowed else 1.0


def _footprints(scene: _Scene, plane: MapPlane) -> list[str]:
    known = scene.footprints[np.isfinite(scene.footprints).all(axis=(1, 2))]
    paths = (
        "M" + "L".join(f"{number(x)} {number(y)}" for x, y in plane.place(corners).tolist()) + "z" for corners in known
    )
    return [element("path", d="".join(paths), class_="footprint")] if len(known) else []


def _points(solution: Solution, scene: _Scene, plane: MapPlane) -> list[str]:
    ties = coded(solution.point_kinds)[scene.rows].where("tie".__eq__)
    at = plane.place(scene.points)
    at, is_tie = at[(known := np.isfinite(at).all(axis=1))], ties[known]
    rows = scene.rows[known]
    found = iter(numbers(at[is_tie].ravel().tolist()))
    dots = "".join([f"M{x} {y}h0" for x, y in zip(found, found, strict=True)])
    marks = [element("path", d=dots, class_="ties")] if dots else []
    for row, (x, y) in zip(rows[~is_tie].tolist(), at[~is_tie].tolist(), strict=True):
        kind, name = solution.point_kinds[row], solution.points.names[row]
        title = f"<title>{kind} point {escape(name)}</title>"
        marks.append(f'<path d="M{number(x)} {number(y - 4.5)}l4 7h-8z" class="mark {kind}">{title}</path>')
    return marks


def _photos(solution: Solution, scene: _Scene, plane: MapPlane) -> list[str]:
    marks = []
    for name, (x, y) in zip(solution.photos.names, plane.place(scene.photos).tolist(), strict=True):
        if math.isfinite(x + y):
            title = f"<title>photo {escape(name)}</title>"
            side = f'x="{number(x - 2)}" y="{number(y - 2)}" width="4" height="4"'
            marks.append(f'<rect {side} class="mark photo">{title}</rect>')
    return marks


def _doubted(given: ReportInput, scene: _Scene, plane: MapPlane) -> list[str]:
    """Return rings about the photos whose strip or camera contradicts all others."""
    places = dict(zip(given.solution.photos.names, plane.place(scene.photos).tolist(), strict=True))
    marks = []
    for name, groups in doubted_photos(given).items():
        x, y = places.get(name, (np.nan, np.nan))
        if math.isfinite(x + y):
            title = f"<title>photo {escape(name)}: {escape(joined(groups))} contradicts the others</title>"
            marks.append(f'<circle cx="{number(x)}" cy="{number(y)}" r="6" class="doubted">{title}</circle>')
    return marks


def _errors(
    solution: Solution,
    side: BlockSide,
    plane: MapPlane,
    enlargement: float,
    kind: str,
    errors: Mapping[str, FloatArray],
) -> str:
    """Return the error vectors in plan, the errors across it as dashed lines upwards or downwards, and the ellipses."""
    row_of = places_of_names(solution.points.names)
    scale, drawn = plane.scale * enlargement, []
    for name, size in errors.items():
        row = row_of.get(name)
        if row is None:
            continue
        ((x, y),) = plane.place((side.axes[:2] @ solution.points.values[row])[None]).tolist()
        across, along, high = (scale * side.axes @ np.nan_to_num(size)).tolist()
        if not math.isfinite(x + y):
            continue
        start = f"M{number(x)} {number(y)}"
        drawn.append(element("path", d=f"{start}l{number(across)} {number(-along)}", class_=f"error {kind}"))
        drawn.append(element("path", d=f"{start}v{number(-high)}", class_=f"error height {kind}"))
        drawn += _ellipse(solution, side, row, (x, y), scale, kind)
    return "".join(drawn)


def _ellipse(
    solution: Solution, side: BlockSide, row: int, at: tuple[float, float], scale: float, kind: str
) -> list[str]:
    """Return the standard ellipse of an adjusted point; nothing where its covariances are not known."""
    sd = solution.points.sd[row]
    if len(solution.point_correlations) <= row or not np.isfinite(sd).all():
        return []
    xy, xz, yz = np.nan_to_num(solution.point_correlations[row]).tolist()
    cofactors = np.outer(sd, sd) * np.array([[1.0, xy, xz], [xy, 1.0, yz], [xz, yz, 1.0]])
    (a, ab), (_, b) = (side.axes[:2] @ cofactors @ side.axes[:2].T).tolist()
    if min(a, b) <= 0.0:
        return []
    sd_a, sd_b = np.sqrt(a), np.sqrt(b)
    of_one = standard_ellipses(*(np.array([value]) for value in (sd_a, sd_b, ab / (sd_a * sd_b))))
    major, minor, angle = (float(part[0]) for part in of_one)
    turned = f"translate({number(at[0])} {number(at[1])}) rotate({number(-np.degrees(angle))})"
    return [element("ellipse", rx=major * scale, ry=minor * scale, class_=f"ellipse {kind}", transform=turned)]


def _names(solution: Solution, scene: _Scene, plane: MapPlane) -> list[str]:
    """Return the names of control and check points that find room, and of photos if they are few."""
    surveyed = np.flatnonzero(~coded(solution.point_kinds)[scene.rows].where("tie".__eq__))
    at, names = scene.points[surveyed], [solution.points.names[scene.rows[place]] for place in surveyed]
    if len(solution.photos.names) <= _MOST_LABELS // 2:
        at, names = np.concatenate([at, scene.photos]), [*names, *solution.photos.names]
    if not 0 < len(names) <= _MOST_LABELS:
        return []
    found = labels(plane.place(at), names, plane.frame)
    return [text(label.x, label.y, label.name, text_anchor=label.anchor, class_="faint") for label in found]


def _note(scene: _Scene, enlargement: float, count: int) -> str:
    parts = ["Rectangles: what each photo shows at the median depth of its points."]
    if enlargement > 1.0:
        parts.append(
            "Lines from control and check points: adjusted minus given, in this plane (solid) and in "
            f"{scene.side.third} (dashed, upwards if {_SIGN[scene.side.third]}), with standard ellipses, all enlarged "
            f"{round(enlargement)} times."
        )
    if len(scene.rows) < count:
        parts.append(f"{len(scene.rows)} of {count} points are drawn.")
    return " ".join(parts)


def _overlap(given: ReportInput, scene: _Scene, plane: MapPlane) -> Markup:
    """Return a map of how many photos show each part of the block; empty where they look at it obliquely."""
    axes = photo_scale(given).axes
    down = np.abs(axes @ scene.side.axes[2])
    known = np.isfinite(scene.footprints).all(axis=(1, 2))
    if not known.any() or float(np.median(down)) < _DOWNWARD:
        return Markup("")
    unit = given.solution.ground_unit
    drawn = [*overlap_cells(plane, scene.footprints[known], _CELLS), *_photos(given.solution, scene, plane)]
    label = "Overlap: the number of photos that show each part of the ground"
    return drawing(*plane.size, label, [plane.clipped(drawn), *plane.axes(_axis_names(scene.side, unit))], "map")


def overlap_cells(plane: MapPlane, footprints: FloatArray, cells: int) -> list[str]:
    """Return squares, so many along the longer side of a map: of how many of the footprints (m, 4, 2) each is in."""
    step = max(plane.width, plane.height) / plane.scale / cells
    columns, rows = (int(np.ceil(size / plane.scale / step)) for size in (plane.width, plane.height))
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    centres = plane.low + step * np.stack([x.ravel(), y.ravel()], axis=1)
    count = np.minimum(photos_over(centres, footprints), MOST_OVERLAP)
    side = step * plane.scale
    square, drawn = f"h{number(side)}v{number(side)}h{number(-side)}z", []
    for photos in range(1, MOST_OVERLAP + 1):
        corners = iter(numbers((plane.place(centres[count == photos]) - side / 2.0).ravel().tolist()))
        path = "".join([f"M{a} {b}{square}" for a, b in zip(corners, corners, strict=True)])
        drawn += [element("path", d=path, class_="overlap", style=f"--n:{photos}")] if path else []
    return drawn


def photos_over(places: FloatArray, frames: FloatArray) -> IntArray:
    """Return how many of the convex quadrilaterals (m, 4, 2) each of the places (n, 2) is in."""
    count = np.zeros(len(places), dtype=np.int64)
    x, y = places.T
    sides = np.roll(frames, -1, axis=1) - frames
    bounds = np.hstack([frames.min(axis=1), frames.max(axis=1)]).tolist()
    for corners, (left, lower, right, upper), side in zip(frames, bounds, sides, strict=True):
        near = np.flatnonzero((x >= left) & (x <= right) & (y >= lower) & (y <= upper))
        # a row for each side: reductions are quick along the long axis
        turn = side[:, :1] * (y[near] - corners[:, 1:]) - side[:, 1:] * (x[near] - corners[:, :1])
        count[near] += (turn >= 0.0).all(axis=0) | (turn <= 0.0).all(axis=0)
    return count
