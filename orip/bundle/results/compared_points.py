"""Control and check points of a solution: adjusted minus given coordinates, what is expected of them, and their images.

The one table from which the pages and the data frames of both are made.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.number_text import root_mean_square
from orip.records.coded_names import coded
from orip.records.names import places_of_names
from orip.records.observation_kinds import CONTROL_POINT, PHOTO_POINT, places_of_measured
from orip.records.results.solution import Solution

ComparedKind = Literal["control", "check"]

COMPARED_KINDS: tuple[ComparedKind, ...] = ("control", "check")
AXES = ("X", "Y", "Z")


class ComparedPoints(Struct, frozen=True):
    """The n control points, or check points, of a solution; lengths in ground units, NaN where nothing is known.

    Parameters
    ----------
    kind : {"control", "check"}
    names : tuple of str, length n
    rays : array (n,) of int
        Photos in which a point was measured.
    difference : array (n, 3)
        Adjusted minus given X, Y, Z.
    given_sd : array (n, 3)
        A-priori error of the given coordinates; those of check points are errors too, though they had no influence.
    sd : array (n, 3)
        Standard deviation of the adjusted coordinates; infinite for what nothing determines.
    w : array (n, 3)
        Size of the difference over its own standard deviation: of a control point the normalised residual, of a check
        point with the errors of both coordinates, which are independent: sqrt(sd² + given_sd²).
    image : array (n,)
        Root mean square of the residuals x and y of the point's rays, mm; those that are disregarded do not count.
    doubted : array (n,) of bool
        A coordinate of a control point has lost weight, or was left out.
    """

    kind: ComparedKind
    names: tuple[str, ...]
    rays: IntArray
    difference: FloatArray
    given_sd: FloatArray
    sd: FloatArray
    w: FloatArray
    image: FloatArray
    doubted: BoolArray

    def __len__(self) -> int:
        return len(self.names)

    def part(self, rows: IntArray) -> ComparedPoints:
        """Return the points in some rows."""
        names = tuple(self.names[row] for row in rows.tolist())
        return ComparedPoints(
            self.kind, names, self.rays[rows], self.difference[rows], self.given_sd[rows], self.sd[rows], self.w[rows],
            self.image[rows], self.doubted[rows],
        )  # fmt: skip

    @property
    def rms(self) -> FloatArray:
        """Return the root mean square (3,) of the differences in X, Y and Z."""
        return np.array([root_mean_square(self.difference[:, axis]) for axis in range(3)])


def compared_points(solution: Solution, kind: ComparedKind) -> ComparedPoints:
    """Return the control points, or the check points, of a solution."""
    rows = rows_of_given(solution, kind)
    residuals, place = solution.residuals, places_of_names(solution.points.names)
    known = {name: axes for name, axes in rows.items() if name in place}
    names = tuple(known)
    at = np.array([place[name] for name in names], dtype=np.int64)
    row = np.array([[axes.get(axis, -1) for axis in AXES] for axes in known.values()], dtype=np.int64).reshape(-1, 3)

    def of(values: FloatArray) -> FloatArray:
        return np.where(row >= 0, values[row], np.nan) if len(values) else np.full(row.shape, np.nan)

    difference, given_sd, sd = of(residuals.residual), np.abs(of(residuals.a_priori)), solution.points.sd[at]
    if kind == "check":
        difference = _differences(solution, names, difference)
        doubted: BoolArray = np.zeros(len(names), dtype=np.bool_)
        with np.errstate(invalid="ignore", divide="ignore"):
            w = np.abs(difference) / np.hypot(np.nan_to_num(sd, nan=0.0), given_sd)
        w[~np.isfinite(sd) & ~np.isnan(sd)] = np.nan
    else:
        w = of(residuals.w)
        doubted = np.asarray(((row >= 0) & ~(of(residuals.weight_factor) >= 1.0)).any(axis=1))
    rays = np.asarray(solution.point_rays, dtype=np.int64)[at]
    return ComparedPoints(kind, names, rays, difference, given_sd, sd, w, image_residuals(solution, names), doubted)


def rows_of_given(solution: Solution, kind: ComparedKind) -> dict[str, dict[str, int]]:
    """Return the rows of the residuals of given coordinates, by point and axis: used ones of control, all of checks."""
    residuals = solution.residuals
    chosen = coded(residuals.kind).where(CONTROL_POINT.name.__eq__)
    if kind == "check":
        wanted = {point.name for point in solution.check_points}
        found: dict[str, dict[str, int]] = {point.name: {} for point in solution.check_points}
    else:
        of_kind = coded(solution.point_kinds).where("control".__eq__)
        wanted, found = {solution.points.names[row] for row in np.flatnonzero(of_kind).tolist()}, {}
        chosen &= ~np.isnan(residuals.weight_factor)
    for row in np.flatnonzero(chosen).tolist():
        if residuals.point[row] in wanted:
            found.setdefault(residuals.point[row], {})[residuals.component[row]] = row
    return found


def image_residuals(solution: Solution, names: tuple[str, ...], pixel: FloatArray | None = None) -> FloatArray:
    """Return the root mean square (n,) of the residuals x and y of the rays of each of these points; NaN without rays.

    Parameters
    ----------
    names : tuple of str, length n
    pixel : array (all residuals,), optional
        Length of the unit wanted, for each row of the residuals; mm if not given.
    """
    if not names:
        return np.empty(0)
    residuals = solution.residuals
    rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__) & (residuals.weight_factor > 0.0))
    point, place = coded(residuals.point), places_of_names(solution.points.names)
    wanted = np.full(len(place) + 1, -1)  # the last one: of what is no point
    wanted[[place[name] for name in names]] = np.arange(len(names))
    of_row = wanted[places_of_measured(point, solution.points.names)][point.codes[rows]]
    mine = of_row >= 0
    size = residuals.residual[rows[mine]]
    if pixel is not None:
        size = size / pixel[rows[mine]]
    count = np.bincount(of_row[mine], minlength=len(names))
    total = np.bincount(of_row[mine], size**2, len(names))
    return np.asarray(np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan)))


def _differences(solution: Solution, names: tuple[str, ...], otherwise: FloatArray) -> FloatArray:
    """Return the differences (n, 3) of the check points as the solution has them, which a report may be read from."""
    found = {point.name: (point.dX, point.dY, point.dZ) for point in solution.check_points}
    return np.array([found.get(name, own) for name, own in zip(names, otherwise, strict=True)]).reshape(-1, 3)
