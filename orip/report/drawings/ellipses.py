"""Standard error ellipses of points and photos in plan and elevation."""

from __future__ import annotations

import math
from html import escape
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.records.coded_names import coded
from orip.records.results.solution import Estimates, Solution
from orip.report.drawings.svg import (
    WIDTH,
    MapPlane,
    drawing,
    labels,
    labels_of,
    map_plane,
    number,
    numbers,
    round_step,
    text,
)

MOST_ELLIPSES = 600
_MOST_LABELS = 60
_BEYOND = 0.25
"""How far an ellipse may widen the drawing, as a part of the block's longer side."""

_POINT, _PHOTO = 0.02, 0.10
"""Largest semi-axis of the ellipses of a typical point and photo, as a part of the sides of the drawing."""

VIEWS = (("Plan", 0, 1), ("Elevation, X and Z", 0, 2), ("Elevation, Y and Z", 1, 2))
_PAIR = {(0, 1): 0, (0, 2): 1, (1, 2): 2}


class Ellipses(NamedTuple):
    """Standard ellipses: semi-axes (n,) in the ground unit, and the major axis' angle (radians) from the first axis."""

    major: FloatArray
    minor: FloatArray
    angle: FloatArray


class EllipseView(NamedTuple):
    """A drawing of ellipses and its title."""

    title: str
    picture: Markup


class EllipseViews(Struct, frozen=True):
    """Plan and elevations, equally enlarged, a note on them, and the kinds of positions that are drawn."""

    views: tuple[EllipseView, ...]
    note: str
    kinds: tuple[str, ...]


def standard_ellipses(sd_a: FloatArray, sd_b: FloatArray, r: FloatArray) -> Ellipses:
    """Return the standard ellipses of n places from two standard deviations and their correlation; NaN stays NaN.

    The semi-axes are the roots of the eigenvalues of the covariance matrix (Helmert 1868).
    """
    a, b, ab = sd_a**2, sd_b**2, r * sd_a * sd_b
    middle, half = (a + b) / 2.0, np.hypot((a - b) / 2.0, ab)
    return Ellipses(np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0)), 0.5 * np.arctan2(2.0 * ab, a - b))


def ellipse_views(solution: Solution) -> EllipseViews | None:
    """Return plan and elevations; none where the correlations of coordinates are not known."""
    count = len(solution.points.names)
    known = np.isfinite(solution.points.values).all(axis=1).any()
    if not known or len(solution.point_correlations) != count:
        return None
    rows = drawn_points(solution, MOST_ELLIPSES)
    scenes = [_scene(solution, rows, *view) for view in VIEWS]
    enlargement = min(_enlargement(scene) for scene in scenes)
    note = f"Standard ellipses, enlarged {round(enlargement)} times. Point at a mark without a label to see its name."
    if len(rows) < count:
        note += (
            f" {len(rows)} of {count} points are drawn: control and check points, and a regular sample of the others."
        )
    found = {"photo", *coded(solution.point_kinds)[rows].occurring()}
    kinds = tuple(kind for kind in ("photo", "control", "check", "rejected", "tie") if kind in found)
    return EllipseViews(tuple(_view(solution, rows, scene, enlargement) for scene in scenes), note, kinds)


def drawn_points(solution: Solution, most: int) -> IntArray:
    """Return the rows of the points to draw: all that are not tie points, and an even selection of tie points."""
    is_tie = coded(solution.point_kinds).where("tie".__eq__)
    ties, others = np.flatnonzero(is_tie), np.flatnonzero(~is_tie)[:most]
    room = max(most - len(others), 0)
    if len(ties) > room:
        ties = ties[:: -(-len(ties) // room)] if room else ties[:0]
    return np.sort(np.concatenate([others, ties]))


class _Scene(NamedTuple):
    """What one view shows: its title and axes, places and standard deviations (n, 2), the ellipses of both kinds."""

    title: str
    axes: list[int]
    places: FloatArray
    sd: FloatArray
    points: Ellipses
    photos: Ellipses

    def bounds(self, enlargement: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return the corners of what is drawn: all places and their ellipses, with a margin."""
        known = np.isfinite(self.places).all(axis=1)
        at = self.places[known]
        longest = max(float(np.max(np.ptp(at, axis=0))), 1e-9)
        reach = np.minimum(np.nan_to_num(enlargement * self.sd[known]), _BEYOND * longest)
        return (at - reach).min(axis=0) - 0.06 * longest, (at + reach).max(axis=0) + 0.06 * longest


def _scene(solution: Solution, rows: IntArray, title: str, across: int, up: int) -> _Scene:
    axes, pair = [across, up], _PAIR[across, up]
    photos = np.arange(len(solution.photos.names))
    sd = np.concatenate([solution.points.sd[rows][:, axes], solution.photos.sd[:, axes]])
    return _Scene(
        title,
        axes,
        np.concatenate([solution.points.values[rows][:, axes], solution.photos.values[:, axes]]),
        np.where(np.isfinite(sd), sd, np.nan),
        _ellipses(solution.points, solution.point_correlations, axes, pair, rows),
        _ellipses(solution.photos, solution.photo_correlations, axes, pair, photos),
    )


def _view(solution: Solution, rows: IntArray, scene: _Scene, enlargement: float) -> EllipseView:
    plane = map_plane(*scene.bounds(enlargement))
    scale = plane.scale * enlargement
    points = plane.place(solution.points.values[rows][:, scene.axes])
    photos = plane.place(solution.photos.values[:, scene.axes])
    drawn = [
        *_drawn(scene.photos, photos, scale, ["photo"] * len(photos)),
        *_drawn(scene.points, points, scale, list(coded(solution.point_kinds)[rows])),
        *_photo_marks(solution, photos),
        *_point_marks(solution, rows, points),
        *_names(solution, rows, plane, photos, points),
    ]
    unit = solution.ground_unit
    parts = [*plane.axes(labels_of(scene.axes, unit)), plane.clipped(drawn), *_key(plane, enlargement, unit)]
    label = f"{scene.title}: standard error ellipses of points and photos"
    return EllipseView(scene.title, drawing(*plane.size, label, parts, "map"))


def _ellipses(estimates: Estimates, correlations: FloatArray, axes: list[int], pair: int, rows: IntArray) -> Ellipses:
    sd = estimates.sd[rows][:, axes]
    sd = np.where(np.isfinite(sd), sd, np.nan)
    return standard_ellipses(sd[:, 0], sd[:, 1], correlations[rows, pair])


def _enlargement(scene: _Scene) -> float:
    """Return a round number that makes typical ellipses visible, and does not let them cover the drawing."""
    low, high = scene.bounds()
    shorter, longer = sorted((high - low).tolist())
    allowed = [
        part * length / float(np.median(known))
        for part, length, major in (
            (_POINT, longer, scene.points.major),
            (_PHOTO, (shorter + longer) / 2.0, scene.photos.major),
        )
        for known in [major[major > 0.0]]
        if known.size
    ]
    return max(round_step(min(allowed), 1) / 2.0, 1.0) if allowed else 1.0


def _drawn(ellipses: Ellipses, places: FloatArray, scale: float, kinds: list[str]) -> list[str]:
    major, minor, angle = ellipses
    rows = np.column_stack([scale * major, scale * minor, places, -np.degrees(angle)])
    known = np.isfinite(rows[:, :4]).all(axis=1)
    found = iter(numbers(rows[known].ravel().tolist()))
    drawn = [kind for kind, is_known in zip(kinds, known.tolist(), strict=True) if is_known]
    return [
        f'<ellipse rx="{rx}" ry="{ry}" class="ellipse {kind}" transform="translate({x} {y}) rotate({turn})"/>'
        for kind, rx, ry, x, y, turn in zip(drawn, found, found, found, found, found, strict=True)
    ]


def _photo_marks(solution: Solution, places: FloatArray) -> list[str]:
    marks = []
    for name, (x, y) in zip(solution.photos.names, places.tolist(), strict=True):
        if not math.isfinite(x + y):
            continue
        marks.append(f'<rect x="{number(x - 2.5)}" y="{number(y - 2.5)}" width="5" height="5" class="mark photo">'
                     f"<title>photo {escape(name)}</title></rect>")  # fmt: skip
    return marks


def _point_marks(solution: Solution, rows: IntArray, places: FloatArray) -> list[str]:
    marks = []
    for row, kind, (x, y) in zip(rows.tolist(), coded(solution.point_kinds)[rows], places.tolist(), strict=True):
        name = solution.points.names[row]
        if not math.isfinite(x + y):
            continue
        title = f"<title>{kind} point {escape(name)}</title>"
        if kind == "tie":
            marks.append(f'<circle cx="{number(x)}" cy="{number(y)}" r="1.3" class="mark tie">{title}</circle>')
            continue
        marks.append(f'<path d="M{number(x)} {number(y - 4.5)}l4 7h-8z" class="mark {kind}">{title}</path>')
    return marks


def _names(solution: Solution, rows: IntArray, plane: MapPlane, photos: FloatArray, points: FloatArray) -> list[str]:
    """Return the names of photos, control and check points that find room, if they are not too many."""
    surveyed = np.flatnonzero(~coded(solution.point_kinds)[rows].where("tie".__eq__))
    groups = [
        (photos, solution.photos.names),
        (points[surveyed], [solution.points.names[row] for row in rows[surveyed]]),
    ]
    few = [(places, names) for places, names in groups if 0 < len(names) <= _MOST_LABELS]
    if not few:
        return []
    found = labels(
        np.concatenate([places for places, _ in few]), [name for _, names in few for name in names], plane.frame
    )
    return [text(label.x, label.y, label.name, text_anchor=label.anchor, class_="faint") for label in found]


def _key(plane: MapPlane, enlargement: float, unit: str) -> list[str]:
    """Return a scale bar for standard deviations, of a round length."""
    sd = round_step(0.12 * WIDTH / plane.scale / enlargement, 1) / 2.0
    return plane.scale_bar(sd * plane.scale * enlargement, f"sd {sd:g} {unit}")
