"""Standard error ellipses of points and photos in plan and elevation."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from orip.model.solution import Estimates, Solution
from orip.report.drawing import drawing, element, number, round_step, shown_tick, text, ticks

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MOST_ELLIPSES = 1500
_TYPICAL = 0.02
"""Semi-axis of a typical point's ellipse in the drawing, in parts of its longer side."""

_LARGEST = 0.15
_WIDTH, _TALLEST, _SHORTEST = 620.0, 560.0, 60.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 64.0, 14.0, 12.0, 46.0

VIEWS = (("Plan", 0, 1), ("Elevation along X", 0, 2), ("Elevation along Y", 1, 2))
_PAIR = {(0, 1): 0, (0, 2): 1, (1, 2): 2}


class Ellipses(NamedTuple):
    """Standard ellipses: semi-axes (n,) in the ground unit, and the major axis' angle (radians) from the first axis."""

    major: FloatArray
    minor: FloatArray
    angle: FloatArray


@dataclass(frozen=True, slots=True)
class EllipseView:
    """A drawing of ellipses, and what it shows."""

    title: str
    picture: Markup
    note: str


def standard_ellipses(sd_a: FloatArray, sd_b: FloatArray, r: FloatArray) -> Ellipses:
    """Return the standard ellipses of n places from two standard deviations and their correlation; NaN stays NaN.

    The semi-axes are the roots of the eigenvalues of the covariance matrix (Helmert 1868).
    """
    a, b, ab = sd_a**2, sd_b**2, r * sd_a * sd_b
    middle, half = (a + b) / 2.0, np.hypot((a - b) / 2.0, ab)
    return Ellipses(
        np.sqrt(middle + half), np.sqrt(np.maximum(middle - half, 0.0)), 0.5 * np.arctan2(2.0 * ab, a - b)
    )


def ellipse_views(solution: Solution) -> tuple[EllipseView, ...]:
    """Return plan and elevations; none where correlations are not known or nothing has a standard deviation."""
    if len(solution.point_correlations) != len(solution.points.names):
        return ()
    if not len(solution.points.names):
        return ()
    return tuple(_view(solution, *view) for view in VIEWS)


def drawn_points(solution: Solution, most: int) -> IntArray:
    """Return the rows of the points to draw: all that are not tie points, and of tie points every so many."""
    kinds = np.array(solution.point_kinds)
    ties = np.flatnonzero(kinds == "tie")
    others = np.flatnonzero(kinds != "tie")[:most]
    room = max(most - len(others), 0)
    if len(ties) > room:
        ties = ties[:: -(-len(ties) // room)] if room else ties[:0]
    return np.sort(np.concatenate([others, ties]))


class _Plane(NamedTuple):
    """The drawing's plane: lower left corner, scale (pixels a ground unit), and its size in pixels."""

    low: FloatArray
    scale: float
    width: float
    height: float

    def place(self, at: FloatArray) -> FloatArray:
        x = _LEFT + (at[:, 0] - self.low[0]) * self.scale
        y = _TOP + self.height - (at[:, 1] - self.low[1]) * self.scale
        return np.stack([x, y], axis=1)


def _view(solution: Solution, title: str, across: int, up: int) -> EllipseView:
    axes, pair = [across, up], _PAIR[across, up]
    rows = drawn_points(solution, MOST_ELLIPSES)
    points = _ellipses(solution.points, solution.point_correlations, axes, pair, rows)
    photos = np.arange(len(solution.photos.names))
    centres = _ellipses(solution.photos, solution.photo_correlations, axes, pair, photos)
    at, at_photos = solution.points.values[np.ix_(rows, axes)], solution.photos.values[:, axes]
    plane = _plane(np.concatenate([at, at_photos]))
    enlargement = _enlargement(points, plane)
    kinds = [solution.point_kinds[row] for row in rows]
    parts = [
        *_axes(plane, axes, solution.ground_unit),
        *_drawn(centres, plane.place(at_photos), plane.scale * enlargement, ["photo"] * len(photos)),
        *_drawn(points, plane.place(at), plane.scale * enlargement, kinds),
        *_photo_marks(solution, plane.place(at_photos)),
        *_point_marks(solution, rows, plane.place(at)),
        *_key(plane, enlargement, solution.ground_unit),
    ]
    note = f"Standard ellipses, enlarged {enlargement:,.0f} times.".replace(",", "\N{NARROW NO-BREAK SPACE}")
    if len(rows) < len(solution.points.names):
        note += f" {len(rows)} of {len(solution.points.names)} points are drawn: control, check and every so many tie points."
    size = plane.width + _LEFT + _RIGHT, plane.height + _TOP + _BOTTOM
    return EllipseView(title, drawing(*size, f"{title}: standard error ellipses of points and photos", parts, "map"), note)


def _ellipses(estimates: Estimates, correlations: FloatArray, axes: list[int], pair: int, rows: IntArray) -> Ellipses:
    sd = np.where(np.isfinite(estimates.sd[np.ix_(rows, axes)]), estimates.sd[np.ix_(rows, axes)], np.nan)
    return standard_ellipses(sd[:, 0], sd[:, 1], correlations[rows, pair])


def _plane(at: FloatArray) -> _Plane:
    at = at[np.isfinite(at).all(axis=1)]
    low, high = at.min(axis=0), at.max(axis=0)
    margin = 0.06 * max(float(np.max(high - low)), 1e-9)
    low, high = low - margin, high + margin
    width, height = (high - low).tolist()
    scale = min((_WIDTH - _LEFT - _RIGHT) / width, (_TALLEST - _TOP - _BOTTOM) / height)
    if height * scale < _SHORTEST:
        low[1] -= (_SHORTEST / scale - height) / 2.0
        height = _SHORTEST / scale
    return _Plane(low, scale, width * scale, height * scale)


def _enlargement(ellipses: Ellipses, plane: _Plane) -> float:
    """Return a round number that makes the typical ellipse visible and the largest not cover the drawing."""
    known = ellipses.major[np.isfinite(ellipses.major) & (ellipses.major > 0.0)]
    if not known.size:
        return 1.0
    longer = max(plane.width, plane.height)
    wanted = min(_TYPICAL * longer / np.median(known), _LARGEST * longer / np.quantile(known, 0.98)) / plane.scale
    return max(round_step(wanted, 1) / 2.0, 1.0)


def _drawn(ellipses: Ellipses, places: FloatArray, scale: float, kinds: list[str]) -> list[str]:
    return [
        element(
            "ellipse", rx=major * scale, ry=minor * scale, class_=f"ellipse {kind}",
            transform=f"translate({number(x)} {number(y)}) rotate({number(-np.degrees(angle))})",
        )
        for (x, y), major, minor, angle, kind in zip(places.tolist(), *(part.tolist() for part in ellipses), kinds, strict=True)
        if np.isfinite([major, minor, x, y]).all()
    ]  # fmt: skip


def _photo_marks(solution: Solution, places: FloatArray) -> list[str]:
    labelled = len(places) <= 40
    marks = []
    for name, (x, y) in zip(solution.photos.names, places.tolist(), strict=True):
        marks.append(f'<rect x="{number(x - 2.5)}" y="{number(y - 2.5)}" width="5" height="5" class="mark photo">'
                     f"<title>photo {escape(name)}</title></rect>")  # fmt: skip
        if labelled:
            marks.append(text(x + 5.0, y - 4.0, name, class_="faint"))
    return marks


def _point_marks(solution: Solution, rows: IntArray, places: FloatArray) -> list[str]:
    marks = []
    for row, (x, y) in zip(rows.tolist(), places.tolist(), strict=True):
        kind, name = solution.point_kinds[row], solution.points.names[row]
        title = f"<title>{kind} point {escape(name)}</title>"
        if kind == "tie":
            marks.append(f'<circle cx="{number(x)}" cy="{number(y)}" r="1.3" class="mark tie">{title}</circle>')
            continue
        marks.append(f'<path d="M{number(x)} {number(y - 4.5)}l4 7h-8z" class="mark {kind}">{title}</path>')
        marks.append(text(x + 5.0, y + 9.0, name, class_="faint"))
    return marks


def _axes(plane: _Plane, axes: list[int], unit: str) -> list[str]:
    base, parts = _TOP + plane.height, [element("rect", x=_LEFT, y=_TOP, width=plane.width, height=plane.height, class_="frame")]
    high = plane.low + np.array([plane.width, plane.height]) / plane.scale
    for tick in ticks(float(plane.low[0]), float(high[0]), 6):
        x = _LEFT + (tick - plane.low[0]) * plane.scale
        parts += [element("line", x1=x, x2=x, y1=_TOP, y2=base, class_="grid"), text(x, base + 16.0, _tick(tick), text_anchor="middle")]
    for tick in ticks(float(plane.low[1]), float(high[1]), max(int(plane.height / 70), 2)):
        y = base - (tick - plane.low[1]) * plane.scale
        parts += [element("line", x1=_LEFT, x2=_LEFT + plane.width, y1=y, y2=y, class_="grid"), text(_LEFT - 6.0, y + 4.0, _tick(tick), text_anchor="end")]
    parts.append(text(_LEFT + plane.width / 2, base + 34.0, f"{'XYZ'[axes[0]]} ({unit})", text_anchor="middle", class_="label"))
    y = _TOP + plane.height / 2
    parts.append(text(12.0, y, f"{'XYZ'[axes[1]]} ({unit})", text_anchor="middle", class_="label", transform=f"rotate(-90 12 {number(y)})"))
    return parts


def _tick(value: float) -> str:
    return shown_tick(value) if abs(value) < 1e6 else f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


def _key(plane: _Plane, enlargement: float, unit: str) -> list[str]:
    """Return a bar that shows how long a round standard deviation is drawn."""
    sd = round_step(0.12 * _WIDTH / plane.scale / enlargement, 1) / 2.0
    length = sd * plane.scale * enlargement
    x, y = _LEFT + plane.width - length - 8.0, _TOP + plane.height + 30.0
    bar = element("path", d=f"M{number(x)} {number(y)}h{number(length)}", class_="bar")
    return [bar, text(x - 5.0, y + 4.0, f"sd {sd:g} {unit}", text_anchor="end")]
