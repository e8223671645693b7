"""Control points whose coordinates contradict the photos, and the slip in writing that explains them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from functools import partial

import numpy as np

from orip.arrays import FloatArray, IntArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.control.slips_of_pen import slip_of_pen
from orip.mistakes.doubted_observations import AdjustedRays, doubted_control, doubted_photo_points
from orip.mistakes.hypothesis import Hypothesis
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.results.solution import Solution
from orip.structs import replace

# Where the coordinates that the photos see differ from those given by a sign, two digits or a decimal point, or are
# those of another control point, that is what happened.

CODE = "contradicting-control"

_ERRORS = 4.0
"""Standard errors within which two coordinates are the same."""

_FEW = 0.2
"""Part of the control up to which contradictions are reported without a reason; more have a cause elsewhere."""

_PART = 0.2
"""Part of the rays of a constant point that is doubted if the point is wrong, and not single rays."""

_MOST = 0.5
"""Part of the control that is off alike from which its system is another one."""

_SWAPPED = 0.1
"""Two points count as exchanged if swapping removes all but this part of the misfit."""

_SMALL = 0.01
"""Part of the extent of the control by which a coordinate 0 (the origin, a plane) may be off and still be meant."""

SeenCoordinates = Mapping[str, tuple[FloatArray, FloatArray]]
"""By the names of points: the coordinates (3,) that the photos see, and their standard deviations (3,)."""


def contradicting_control(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each weighted control point that is not where the rays of its photo points meet.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
        With down-weighting; only control points that it doubts, themselves or in some photos, are examined.
    """
    points, place = block.photo_points, block.point_index()
    doubted = doubted_control(solution)
    doubted |= _with_doubted_rays(block, points.point[doubted_photo_points(block, solution)])
    rays = AdjustedRays(block, solution)
    seen = {
        point.name: meeting
        for point in block.control_points
        if point.name in doubted
        and point.kind == "control"
        and (meeting := rays.meeting(np.flatnonzero(points.point == place[point.name]))) is not None
    }
    return control_warnings(block, seen)


def _with_doubted_rays(block: Block, of_rays: IntArray) -> set[str]:
    """Return the points of which not only a few rays are doubted: a wrong constant displaces most of its own."""
    number = len(block.point_names)
    doubted = np.bincount(of_rays, minlength=number)
    rays = np.bincount(block.photo_points.point[block.photo_points.in_use], minlength=number)
    return {block.point_names[row] for row in np.flatnonzero((doubted > 0) & (doubted >= _PART * rays)).tolist()}


def control_warnings(block: Block, seen: SeenCoordinates) -> list[ProjectWarning]:
    """Return a warning for each control point that the photos see elsewhere, with what was probably meant."""
    points = {
        point.name: point
        for point in block.control_points
        if point.name in seen and any(_differences(point, *seen[point.name]))
    }
    count = sum(point.kind == "control" for point in block.control_points)
    are_few = len(points) <= max(1.0, _FEW * count)
    small = _SMALL * _extent(block)
    partners = dict(_exchanged(points, seen))
    together = frozenset(_off_alike(points, seen, count))
    texts: dict[str, str] = {}
    for name, point in points.items():
        if partners.get(name) in texts:
            continue
        if name in partners:
            texts[name] = _exchange_text(name, partners[name])
        elif (other := _seen_at_another(block, point, *seen[name])) is not None:
            texts[name] = _elsewhere_text(name, other)
        elif together & {kind for kind, *_ in _differences(point, *seen[name])}:
            continue
        elif slips := _slips_text(point, *seen[name], small):
            texts[name] = slips
        elif are_few:
            texts[name] = _contradiction_text(point, *seen[name], block.ground_unit)
    return [ProjectWarning(CODE, f"control point {name}", text) for name, text in texts.items()]


def _off_alike(points: Mapping[str, ControlPoint], seen: SeenCoordinates, count: int) -> Iterator[str]:
    """Yield the coordinates in which most of `count` control points are off alike: another system is no slip."""
    off: dict[str, list[tuple[float, float]]] = {}
    for name, point in points.items():
        for kind, value, coordinate, _, tolerance in _differences(point, *seen[name]):
            off.setdefault(kind, []).append((value - coordinate, tolerance))
    for kind, found in off.items():
        median = float(np.median([difference for difference, _ in found]))
        alike = sum(abs(difference - median) <= tolerance for difference, tolerance in found)
        if alike > max(1.0, _MOST * count):
            yield kind


def _seen_at_another(block: Block, point: ControlPoint, seen: FloatArray, sd: FloatArray) -> str | None:
    """Return the control or check point whose given coordinates are those at which the photos see a point."""
    for other in block.control_points:
        if other.name == point.name or None in other.coordinates or None in point.coordinates:
            continue
        given, own = (np.array(each.coordinates, dtype=np.float64) for each in (other, point))
        tolerance = _ERRORS * np.hypot(sd, np.abs(np.array(point.errors, dtype=np.float64)))
        if (np.abs(given - seen) <= tolerance).all() and np.linalg.norm(given - seen) < _SWAPPED * np.linalg.norm(
            own - seen
        ):
            return other.name
    return None


def _extent(block: Block) -> float:
    """Return the largest extent of the control points, ground units."""
    extents = [0.0]
    for axis in range(3):
        given = [value for point in block.control_points if (value := point.coordinates[axis]) is not None]
        extents.append(max(given, default=0.0) - min(given, default=0.0))
    return max(extents)


def _differences(
    point: ControlPoint, seen: FloatArray, sd: FloatArray
) -> Iterator[tuple[str, float, float, float, float]]:
    """Yield the coordinates that the photos see elsewhere: kind, as given, as seen, standard deviation, tolerance."""
    for kind, value, error, coordinate, deviation in zip(
        "XYZ", point.coordinates, point.errors, seen.tolist(), sd.tolist(), strict=True
    ):
        if value is None or error is None or error < 0.0:
            continue
        tolerance = _ERRORS * float(np.hypot(deviation, error))
        if abs(value - coordinate) > tolerance:
            yield kind, value, coordinate, deviation, tolerance


# -------------------------------------------------------------------------------------------------------------- texts

_BESIDE = 0.3
"""Largest difference beside those that slips explain, as a part of these: a block is bent by a wrong control point."""


def _exchange_text(name: str, other: str) -> str:
    return (
        f"the photos see it where control point {other} is given, and {other} where {name} is: the two are exchanged; "
        "exchange their names in the control file, or in the photos"
    )


def _elsewhere_text(name: str, other: str) -> str:
    return (
        f"the photos see it where {other} is given: {name} and {other} are probably exchanged; compare their names in "
        "the control file and in the photos"
    )


def _slips_text(point: ControlPoint, seen: FloatArray, sd: FloatArray, small: float) -> str:
    """Return which slips in writing explain a point; "" where none does. A 0 that is nearly right was meant."""
    if _axes_exchanged(point, seen, sd):
        return "the photos see it where it would be with X and Y exchanged; exchange them in the control file"
    slips, explained, unexplained = [], 0.0, 0.0
    for kind, value, coordinate, _, tolerance in _differences(point, seen, sd):
        meant = None
        if not (value == 0.0 and abs(coordinate) < small):
            meant = slip_of_pen(value, coordinate, tolerance)
        if meant is None:
            unexplained = max(unexplained, abs(value - coordinate))
        else:
            slips.append(f"{kind} = {value:.10g} {meant}")
            explained = max(explained, abs(value - coordinate))
    if not slips or unexplained > _BESIDE * explained:
        return ""
    return f"{'; '.join(slips)} (the photos see {_shown(point, seen)}); correct it in the control file"


def _contradiction_text(point: ControlPoint, seen: FloatArray, sd: FloatArray, ground_unit: str) -> str:
    offsets = ", ".join(
        f"{kind} {value - coordinate:+.3g} ± {deviation:.1g}"
        for kind, value, coordinate, deviation, _ in _differences(point, seen, sd)
    )
    return (
        f"its coordinates contradict the photos: they are off by {offsets} {ground_unit}; check them, and whether what "
        "was measured in the photos is what was surveyed; or reject the point (x at the end of its line)"
    )


def _shown(point: ControlPoint, seen: FloatArray) -> str:
    """Return the coordinates that the photos see, of those that are given for a point."""
    shown = [
        f"{kind} = {value:.3f}"
        for kind, value, given in zip("XYZ", seen, point.coordinates, strict=True)
        if given is not None
    ]
    return ", ".join(shown)


# ---------------------------------------------------------------------------------------------------------- exchanges


def _axes_exchanged(point: ControlPoint, seen: FloatArray, sd: FloatArray) -> bool:
    x, y, _ = point.coordinates
    errors = point.errors[:2]
    if x is None or y is None or None in errors:
        return False
    tolerance = _ERRORS * np.hypot(sd[:2], np.array(errors, dtype=np.float64))
    return bool((np.abs(seen[:2] - [y, x]) <= tolerance).all() and (np.abs(seen[:2] - [x, y]) > tolerance).any())


def _exchanged(points: Mapping[str, ControlPoint], seen: SeenCoordinates) -> Iterator[tuple[str, str]]:
    """Yield pairs of points that were probably exchanged."""
    for name, point in points.items():
        for other, another in points.items():
            if other != name and _is_nearly_at(point, seen, other) and _is_nearly_at(another, seen, name):
                yield name, other


def _is_nearly_at(point: ControlPoint, seen: SeenCoordinates, other: str) -> bool:
    """Tell whether a point is given nearly where another one is seen: two wrong points may bend the block slightly."""
    given = np.array(point.coordinates, dtype=np.float64)
    own, swapped = (float(np.linalg.norm(given - seen[name][0])) for name in (point.name, other))
    return swapped < _SWAPPED * own


def released_control(block: Block, names: Sequence[str]) -> Iterator[Hypothesis]:
    """Yield control points, one at a time, as tie points.

    Parameters
    ----------
    names : sequence of str
        Control points that are doubted, the worst first.
    """
    for name in names:
        changed = without_control(block, [name])
        yield Hypothesis(changed, partial(_findings, block=block, name=name))


def without_control(block: Block, names: Sequence[str]) -> Block:
    """Return a block with some of its control points as tie points."""
    place = block.point_index()
    constant = block.constant_points.copy()
    constant[[place[name] for name in names]] = False
    points = tuple(point for point in block.control_points if point.name not in names)
    return replace(block, control_points=points, constant_points=constant)


def _findings(solved: SolvedBlock, block: Block, name: str) -> list[ProjectWarning]:
    """Return how the coordinates as given differ from those found; nothing if they do not."""
    row = block.point_index()[name]
    sd = solved.deviation_scale * np.sqrt(np.diag(solved.cofactors_of(solved.problem.unknowns.points[row])))
    found = block.ground.to_project(solved.state.points[[row]])[0]
    return control_warnings(block, {name: (found, sd)})
