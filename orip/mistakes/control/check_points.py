"""Check points that contradict the adjustment, and control and check points that are all too high or too low."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct

from orip.adjustment.weights import MEDIAN_OF_NORMAL
from orip.arrays import BoolArray, FloatArray
from orip.errors import ProjectWarning
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.mistake import STATIONS_OFF, declare
from orip.records.block import Block
from orip.records.names import places_of_names
from orip.records.results.solution import Solution
from orip.wording import counted_names

_DOUBTED = 5.0
"""Standard deviations from which check points contradict the adjustment together."""

_TOGETHER = 0.1
"""Largest standard deviation of differences that count as the same, as a part of their mean."""

_FEWEST = 2
"""Number of check points that may agree by chance; more are needed."""

_FAR_OFF = 8.0
"""Standard deviations, and multiples of the usual difference of the others, from which a single check point is wrong:
how well it was surveyed is not known."""

_MARK = 1.0
"""A-priori error, without its sign, that marks a check point and says nothing else."""

_SWAPPED = 0.1
"""Two points are exchanged if exchanging them removes all but this part of both differences."""

_SYSTEMS = {
    "X": "coordinate system",
    "Y": "coordinate system",
    "Z": "height system (above the ellipsoid, above the geoid)",
}


def contradicting_check_points(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for what is wrong with check points; nothing where they agree with the adjustment."""
    compared = _compared(block, solution)
    if compared is None:
        return []
    if any(group.kind == "station" and group.doubted for group in solution.groups):
        return []  # stations that are all off displace the check points
    together = list(_in_another_system(compared, solution.ground_unit))
    return together or list(_single(compared, block, solution.ground_unit))


class ComparedPoints(Struct, frozen=True):
    """n check points: coordinates as given and as adjusted (n, 3), NaN where not given, standard deviations (n, 3)."""

    names: tuple[str, ...]
    given: FloatArray
    adjusted: FloatArray
    sd: FloatArray

    @property
    def differences(self) -> FloatArray:
        """Return adjusted minus given coordinates (n, 3)."""
        return self.adjusted - self.given


def _compared(block: Block, solution: Solution) -> ComparedPoints | None:
    points = solution.check_points
    if not points:
        return None
    place = places_of_names(solution.points.names)
    rows = [place[point.name] for point in points]
    differences = np.array([(point.dX, point.dY, point.dZ) for point in points])
    adjusted, sd = solution.points.values[rows], solution.points.sd[rows]
    known = {point.name: point.errors for point in block.control_points}
    errors = np.abs(np.array([known.get(point.name, (None,) * 3) for point in points], dtype=np.float64))
    if not (errors[np.isfinite(errors)] == _MARK).all():
        sd = np.hypot(sd, np.nan_to_num(errors))
    return ComparedPoints(tuple(point.name for point in points), adjusted - differences, adjusted, sd)


def _in_another_system(compared: ComparedPoints, unit: str) -> Iterator[ProjectWarning]:
    """Yield a warning for each coordinate in which all check points differ by the same amount."""
    count = len(compared.names)
    if count <= _FEWEST:
        return
    for axis, kind in enumerate("XYZ"):
        difference = compared.differences[:, axis]
        mean, spread = float(difference.mean()), float(difference.std(ddof=1))
        if not (spread < _TOGETHER * abs(mean) and abs(mean) > _DOUBTED * float(compared.sd[:, axis].max())):
            continue
        text = (
            f"all {count} are given {abs(mean):.3f} {unit} too {'low' if mean > 0 else 'high'} "
            f"in {kind} (standard deviation {spread:.2g}): they are probably in another {_SYSTEMS[kind]} than the "
            "control points; use one system for both"
        )
        yield ProjectWarning("check-point-system", "check points", text)


def _single(compared: ComparedPoints, block: Block, unit: str) -> Iterator[ProjectWarning]:
    """Yield a warning for each pair of check points that are exchanged, else for each that alone is far off."""
    told = exchanged_points(compared)
    for pair in told:
        one, other = (compared.names[row] for row in pair)
        text = (
            f"the photos see check point {one} where {other} is given, and {other} where {one} is: the two are "
            "exchanged; exchange their names in the control file, or in the photos"
        )
        yield ProjectWarning("contradicting-check-point", f"check points {one} and {other}", text)
    wrong = _far_off(compared)
    if wrong.any():
        wrong &= ~_at_another(compared, block)[:, None]
    rows = np.flatnonzero(wrong.any(axis=1)).tolist()
    if not told and len(rows) <= max(1, len(compared.names) // 2):
        yield from (_wrong_point(compared, row, wrong[row], unit) for row in rows)


def _at_another(compared: ComparedPoints, block: Block) -> BoolArray:
    """Return which check points (n,) the photos see where a control point is given: that has a warning of its own."""
    controls = [point.coordinates for point in block.control_points if point.kind == "control"]
    given = np.array([place for place in controls if None not in place], dtype=np.float64)
    found = np.zeros(len(compared.names), dtype=bool)
    seen = np.flatnonzero(np.isfinite(compared.adjusted).all(axis=1))
    if len(given) and len(seen):
        from scipy.spatial import KDTree  # takes as long to import as all that is compared here

        off, _ = KDTree(given).query(compared.adjusted[seen])
        found[seen] = (off < _SWAPPED * np.linalg.norm(compared.differences[seen], axis=1)) & (
            off < _FAR_OFF * np.linalg.norm(np.nan_to_num(compared.sd[seen], posinf=np.inf), axis=1)
        )
    return found


def _far_off(compared: ComparedPoints) -> BoolArray:
    """Return which coordinates (n, 3) differ by far more than their standard deviations and the other check points."""
    size = np.abs(compared.differences)
    usual = np.column_stack([medians_of_others(column) for column in size.T]) / MEDIAN_OF_NORMAL
    return np.asarray(size > _FAR_OFF * np.maximum(usual, np.nan_to_num(compared.sd, posinf=np.inf)))


def medians_of_others(values: FloatArray) -> FloatArray:
    """Return for each of n values the median (n,) of the others that are no NaN; 0 where there is none."""
    ordered = np.sort(values[np.isfinite(values)])
    rank = np.where(np.isfinite(values), np.searchsorted(ordered, values), len(ordered))
    others = len(ordered) - np.isfinite(values)
    low, high = np.maximum(others - 1, 0) // 2, others // 2
    padded = np.append(ordered, np.zeros(2))
    # those behind the value itself move up by one place
    middle = 0.5 * (padded[low + (rank <= low)] + padded[high + (rank <= high)])
    return np.asarray(np.where(others > 0, middle, 0.0))


_MOST_SUSPECTS = 1000
"""Check points that may be exchanged with another one: where so many are off, it is by no slip of the pen."""


def exchanged_points(compared: ComparedPoints) -> list[tuple[int, int]]:
    """Return the pairs of check points that the photos see one where the other is given."""
    off, sd = np.linalg.norm(compared.differences, axis=1), np.linalg.norm(compared.sd, axis=1)
    # the differences of two that are exchanged are opposite: each has more than half of the length of both
    rows = np.flatnonzero(off > 0.5 * _FAR_OFF * sd)
    if not 1 < len(rows) <= _MOST_SUSPECTS:
        return []
    away = np.linalg.norm(compared.given[rows] - compared.adjusted[rows, None], axis=2)
    before, after = np.hypot(off[rows, None], off[rows]), np.hypot(away, away.T)
    found = (after < _SWAPPED * before) & (before > _FAR_OFF * np.hypot(sd[rows, None], sd[rows]))
    first, second = np.nonzero(np.triu(found, 1))
    return list(zip(rows[first].tolist(), rows[second].tolist(), strict=True))


def _wrong_point(compared: ComparedPoints, row: int, wrong: BoolArray, unit: str) -> ProjectWarning:
    parts, slips = [], []
    for axis in np.flatnonzero(wrong).tolist():
        value, seen = float(compared.given[row, axis]), float(compared.adjusted[row, axis])
        sd = max(float(compared.sd[row, axis]), 1e-9)
        parts.append(f"{'XYZ'[axis]} {value - seen:+.3f} ± {sd:.2g}")
        if (slip := slip_of_pen(value, seen, _FAR_OFF * sd)) is not None:
            slips.append(f"{'XYZ'[axis]} = {value:.10g} {slip}")
    text = f"its coordinates contradict the adjustment: they are off by {', '.join(parts)} {unit}"
    text += f"; {'; '.join(slips)}" if slips else ""
    text += "; check them, and whether what was measured in the photos is what was surveyed"
    return ProjectWarning("contradicting-check-point", f"check point {compared.names[row]}", text)


OF_HEIGHT_SYSTEMS = "the heights of the control and of the stations are in different height systems"
HEIGHT_SYSTEM = declare("height-system", OF_HEIGHT_SYSTEMS, STATIONS_OFF)

_FEWEST_OF_A_SYSTEM = 3
"""Points that do not agree by chance."""

_ALIKE = 0.02
"""Largest standard deviation of the differences, as a part of their mean."""

_LEAST, _MOST = 1.0, 120.0
"""Metres: heights of the geoid above the ellipsoid are between -107 and 86; less than the first is no height system."""


def control_in_another_height_system(block: Block, solution: Solution) -> Iterator[ProjectWarning]:
    """Yield a warning if the stations contradict the heights of all points on the ground by the same amount.

    Parameters
    ----------
    block : Block
        As gathered.
    """
    observed = any(element.group == "PHOTO" and element.kind == "Z0" for element in block.elements)
    if not (observed or any(station.has_position for station in block.stations)) or block.ground_unit != "m":
        return
    rows = solution.residuals
    of_control = {
        point: (residual, weight)
        for kind, point, component, residual, weight in zip(
            rows.kind, rows.point, rows.component, rows.residual.tolist(), rows.weight_factor.tolist(), strict=True
        )
        if kind == "control" and component == "Z" and weight >= 0.0
    }
    # single ones without weight may be wrong by themselves; all of them contradict the stations
    single = any(weight > 0.0 for _, weight in of_control.values())
    off = {point: residual for point, (residual, weight) in of_control.items() if weight > 0.0 or not single}
    control = list(off)
    off |= {point.name: point.dZ for point in solution.check_points if np.isfinite(point.dZ)}
    differences = np.array(list(off.values()))
    if not control or len(differences) < _FEWEST_OF_A_SYSTEM:
        return
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    if not (_LEAST < abs(mean) < _MOST and spread < _ALIKE * abs(mean)):
        return
    also = ", and so are the check points" if len(differences) > len(control) else ""
    text = (
        f"they are given {abs(mean):.2f} m too {'low' if mean > 0.0 else 'high'} in Z (standard deviation "
        f"{spread:.2g}){also}, compared with the exposure stations: their heights and those of the stations are "
        "probably in different height systems (above the ellipsoid, above the geoid); use one for both"
    )
    yield ProjectWarning(HEIGHT_SYSTEM, counted_names("control point", control), text)
