"""Slips of the pen in the coordinates of a control point: what was probably meant, as far as the photos know it.

A control point that contradicts the photos has coordinates that the photos see elsewhere. Where what they see is what
is written but for a sign, two digits or a decimal point, that is what happened.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.mistakes.adjusted_rays import PhotoSight
from orip.mistakes.misnamed_points import doubted_photo_points
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.solution import Solution

_ERRORS = 4.0
"""Standard errors within which a coordinate is the one that was meant."""

_NARROW = 0.2
"""Of the error of a coordinate: what the photos know worse can be met by a slip that nobody made."""

_FEW = 0.2
"""Part of the control that may contradict the photos without a reason that is seen; more has a reason elsewhere."""

_NEARLY = 0.1
"""Of how far a control point is off: what is left of it when it has the coordinates of another one."""

_SMALL = 0.01
"""Of the extent of the control: by less a coordinate of the origin, or of a plane, may be off."""

_WEIGHTED_AWAY = 0.5
"""Weight factor below which a coordinate had no say in where its point is."""

Known = Mapping[str, tuple[FloatArray, FloatArray]]
"""Coordinates (3,) of points as the photos see them, and their standard deviations."""


def contradicting_control(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each weighted control point that is not where the rays of the photos meet.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting; looked at are control points that it has gone without, in part or in some photos.
    """
    rows = solution.residuals
    doubted = {
        point
        for kind, point, weight in zip(rows.kind, rows.point, rows.weight_factor, strict=True)
        if kind == "control" and weight < _WEIGHTED_AWAY
    }
    points = block.photo_points
    doubted |= {block.point_names[k] for k in points.point[doubted_photo_points(solution)].tolist()}
    sight, place = PhotoSight(block, solution), block.point_index()
    seen = {
        point.name: meeting
        for point in block.control_points
        if point.name in doubted
        and point.kind == "control"
        and (meeting := sight.meeting(np.flatnonzero(points.point == place[point.name]))) is not None
    }
    return control_warnings(block, seen, solution.ground_unit)


def control_warnings(block: Block, seen: Known, ground_unit: str) -> list[ProjectWarning]:
    """Return a warning for each control point that the photos see elsewhere, with what was probably meant.

    Parameters
    ----------
    block : Block
    seen : mapping of the point's name to coordinates and standard deviations (3,)
    ground_unit : str
    """
    points = {
        point.name: point
        for point in block.control_points
        if point.name in seen and not _is_at(point, *seen[point.name])
    }
    control = sum(point.kind == "control" for point in block.control_points)
    size = _extent(block)
    few = len(points) <= max(1.0, _FEW * control)
    partner = dict(_exchanged(points, seen))
    found = []
    for name, point in points.items():
        other = partner.get(name)
        if other is not None and list(points).index(other) < list(points).index(name):
            continue
        if other is not None:
            text = (
                f"the photos see it where control point {other} is given, and {other} where {name} is: the two are "
                "exchanged; exchange their names in the control file, or in the photos"
            )
        else:
            text = _slips_of(point, *seen[name], _SMALL * size) or (
                _contradiction(point, *seen[name], ground_unit) if few else ""
            )
        if text:
            found.append(ProjectWarning("contradicting-control", f"control point {name}", text))
    return found


def _extent(block: Block) -> float:
    """Return the largest extent of the control points, ground units."""
    extents = [0.0]
    for axis in range(3):
        given = [value for point in block.control_points if (value := point.coordinates[axis]) is not None]
        extents.append(max(given, default=0.0) - min(given, default=0.0))
    return max(extents)


def _slips_of(point: ControlPoint, there: FloatArray, sd: FloatArray, small: float) -> str:
    """Return which slips of the pen explain a point; nothing where none does. A 0 that is off by little was meant."""
    if _axes_exchanged(point, there, sd):
        return "the photos see it where it would be with X and Y exchanged; exchange them in the control file"
    slips = []
    for kind, value, seen, tolerance in _off(point, there, sd):
        if value == 0.0 and abs(seen) < small:
            continue
        if (meant := slip(value, seen, tolerance)) is not None:
            slips.append(f"{kind} = {value:.10g} {meant}")
    return (
        f"{'; '.join(slips)} (the photos see {_shown(point, there)}); correct it in the control file" if slips else ""
    )


def _contradiction(point: ControlPoint, there: FloatArray, sd: FloatArray, ground_unit: str) -> str:
    deviations = dict(zip("XYZ", sd.tolist(), strict=True))
    offs = [f"{kind} {value - seen:+.3g} ± {deviations[kind]:.1g}" for kind, value, seen, _ in _off(point, there, sd)]
    return (
        f"its coordinates contradict the photos: they are off by {', '.join(offs)} {ground_unit}; check them, and "
        "whether what was measured in the photos is what was surveyed"
    )


def _off(point: ControlPoint, there: FloatArray, sd: FloatArray) -> Iterator[tuple[str, float, float, float]]:
    """Yield the coordinates that the photos see elsewhere: kind, as given, as seen, and the tolerance."""
    for kind, value, error, seen, deviation in zip(
        "XYZ", point.coordinates, point.errors, there.tolist(), sd.tolist(), strict=True
    ):
        if value is None or error is None or error < 0.0:
            continue
        tolerance = _ERRORS * float(np.hypot(deviation, error))
        if abs(value - seen) > tolerance:
            yield kind, value, seen, tolerance


def _shown(point: ControlPoint, there: FloatArray) -> str:
    """Return where the photos see a point, with as many digits as the control has."""
    shown = [
        f"{kind} = {value:.3f}"
        for kind, value, given in zip("XYZ", there, point.coordinates, strict=True)
        if given is not None
    ]
    return ", ".join(shown)


def slip(value: float, seen: float, tolerance: float) -> str | None:
    """Return which slip of the pen makes a value of the one that the photos see; None: none that is known.

    Parameters
    ----------
    value : float
        As given.
    seen : float
        As the photos see it.
    tolerance : float
        Largest difference from what was meant.
    """
    if value == 0.0:
        return "was probably written for want of a value: write - for it and its error if it is not known"
    if tolerance > _NARROW * abs(value - seen):
        return None
    for meant, how in _slips(value):
        if abs(meant - seen) <= tolerance:
            return f"is probably {meant:.10g}: {how}"
    return None


def _slips(value: float) -> Iterator[tuple[float, str]]:
    yield -value, "its sign is wrong"
    text = f"{value:.10g}"
    for place in range(len(text) - 1):
        one = text[place]
        rest = text[place + 1 :].removeprefix(".")
        if one.isdigit() and rest and rest[0].isdigit() and rest[0] != one:
            after = len(text) - len(rest)
            swapped = list(text)
            swapped[place], swapped[after] = swapped[after], swapped[place]
            yield float("".join(swapped)), "two digits are exchanged"
    for power in (1, 2, 3):
        yield value * 10.0**power, "its decimal point is displaced"
        yield value / 10.0**power, "its decimal point is displaced"
    for place, digit in enumerate(text):
        for other in "0123456789" if digit.isdigit() else "":
            if other != digit:
                yield float(text[:place] + other + text[place + 1 :]), "one digit is wrong"


def _axes_exchanged(point: ControlPoint, there: FloatArray, sd: FloatArray) -> bool:
    x, y, _ = point.coordinates
    errors = point.errors[:2]
    if x is None or y is None or None in errors:
        return False
    tolerance = _ERRORS * np.hypot(sd[:2], np.array(errors, dtype=np.float64))
    return bool((np.abs(there[:2] - [y, x]) <= tolerance).all() and (np.abs(there[:2] - [x, y]) > tolerance).any())


def _exchanged(points: Mapping[str, ControlPoint], seen: Known) -> Iterator[tuple[str, str]]:
    """Yield points, and those that they were probably exchanged with."""
    for name, point in points.items():
        for other, another in points.items():
            if other != name and _is_nearly_at(point, seen, name, other) and _is_nearly_at(another, seen, other, name):
                yield name, other


def _is_nearly_at(point: ControlPoint, seen: Known, name: str, other: str) -> bool:
    """Tell whether a point is given where another one is seen; two wrong points may have bent the block a little."""
    given = np.array([np.nan if value is None else value for value in point.coordinates])
    off, left = (float(np.linalg.norm(given - seen[each][0])) for each in (name, other))
    return left < _NEARLY * off


def _is_at(point: ControlPoint, there: FloatArray, sd: FloatArray) -> bool:
    pairs: Sequence[tuple[float | None, float | None, float, float]] = list(
        zip(point.coordinates, point.errors, there.tolist(), sd.tolist(), strict=True)
    )
    return all(
        value is None or error is None or abs(value - seen) <= _ERRORS * float(np.hypot(deviation, error))
        for value, error, seen, deviation in pairs
    )
