"""Preliminary values after an adjustment: the unknowns take the adjusted values, all else stays as it is."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping, Sequence
from typing import NamedTuple

from msgspec import Struct

from orip.records.camera import CAMERA_PARAMETERS, RADIAL_PARAMETERS, Camera
from orip.records.control import PreliminaryPoint
from orip.records.names import record_key
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.records.results.solution import Estimates, Solution
from orip.structs import replace

_ANGLES = slice(PHOTO_PARAMETERS.index("OMEGA"), PHOTO_PARAMETERS.index("KAPPA") + 1)


class ChangedValue(Struct, frozen=True):
    """A preliminary value before (None: there was none) and after; mm, degrees, ground units."""

    name: str
    parameter: str
    old: float | None
    new: float


class KeptValue(Struct, frozen=True):
    """An unknown that did not take the value of the adjustment, and why."""

    name: str
    parameter: str
    reason: str


class UpdatedPoints(Struct, frozen=True):
    """The points of a .PRE file after an update.

    Parameters
    ----------
    points : tuple of PreliminaryPoint
        In the order of the file, new ones after them.
    changed : tuple of str
        Names of those whose line differs.
    """

    points: tuple[PreliminaryPoint, ...]
    changed: tuple[str, ...]
    values: tuple[ChangedValue, ...]
    kept: tuple[KeptValue, ...]


class EstimatedParameter(NamedTuple):
    """Adjusted value of a parameter and its standard deviation: NaN for a constant, infinite if undetermined."""

    parameter: str
    value: float
    sd: float


def estimates_of(estimates: Estimates, row: int, parameters: Sequence[str]) -> tuple[EstimatedParameter, ...]:
    """Return the estimates of one record."""
    return tuple(map(EstimatedParameter, parameters, estimates.values[row].tolist(), estimates.sd[row].tolist()))


def updated_camera(
    camera: Camera, estimates: Sequence[EstimatedParameter]
) -> tuple[Camera, list[ChangedValue | KeptValue]]:
    """Return a camera with the adjusted values of its unknown parameters, and what is new and what is not."""
    found = list(_verdicts(camera.name, estimates, dict(zip(CAMERA_PARAMETERS, camera.parameters, strict=True)),
                           camera.unknown))  # fmt: skip
    new = {verdict.parameter: verdict.new for verdict in found if isinstance(verdict, ChangedValue)}
    pairs = zip(CAMERA_PARAMETERS, camera.parameters, strict=True)
    updated = replace(camera, parameters=tuple(new.get(parameter, old) for parameter, old in pairs))
    if any(parameter in new for parameter in RADIAL_PARAMETERS):
        # the form in which the distortion was once given does not say what it is now
        updated = replace(updated, distortion_isp=None, distortion_curve=None)
    return updated, found


def updated_photo(
    photo: Photo, estimates: Sequence[EstimatedParameter]
) -> tuple[Photo, list[ChangedValue | KeptValue]]:
    """Return a photo with the adjusted values of its unknown orientation elements, and what is new and what is not.

    The unknowns of a rotation turn about the ground axes: where one of them is undetermined, all three angles stay.
    """
    together = list(estimates)
    if any(math.isinf(angle.sd) for angle in together[_ANGLES]):
        together[_ANGLES] = [
            angle if math.isnan(angle.sd) else angle._replace(sd=math.inf) for angle in together[_ANGLES]
        ]
    free = [parameter for parameter in PHOTO_PARAMETERS if parameter not in photo.constant]
    old = dict(zip(PHOTO_PARAMETERS, photo.orientation, strict=True))
    found = list(_verdicts(photo.name, together, old, free))
    new = {verdict.parameter: verdict.new for verdict in found if isinstance(verdict, ChangedValue)}
    return replace(photo, orientation=tuple(new.get(parameter, old[parameter]) for parameter in old)), found


def updated_points(
    points: Sequence[PreliminaryPoint], solution: Solution, wanted: Container[str] | None
) -> UpdatedPoints:
    """Return preliminary points with the adjusted coordinates of the points that have an unknown coordinate.

    Parameters
    ----------
    points : sequence of PreliminaryPoint
        What the file holds; those that the solution does not have, holds constant or does not determine stay.
    wanted : container of str or None
        Names of the points to update; None: all.
    """
    new: dict[str, PreliminaryPoint] = {}
    kept: list[KeptValue] = []
    for row, name in enumerate(solution.points.names):
        if wanted is not None and name not in wanted:
            continue
        estimates = estimates_of(solution.points, row, "XYZ")
        if all(math.isnan(estimate.sd) for estimate in estimates):
            continue
        # a point that slides along its ray is not where two of its coordinates and an older third one put it
        fault = next((fault for estimate in estimates if (fault := _fault(estimate)) is not None), None)
        if fault is None:
            new[name] = _preliminary_point(name, estimates)
        else:
            kept.append(KeptValue(name, "XYZ", fault))
    before = {point.name: replace(point, line=0) for point in points}  # values are compared, not where they stand
    after = {**before, **new}
    changed = tuple(name for name, point in after.items() if point != before.get(name))
    values = tuple(value for name in changed for value in _changed_coordinates(before, after[name]))
    return UpdatedPoints(tuple(after.values()), changed, values, tuple(kept))


def _verdicts(
    name: str, estimates: Sequence[EstimatedParameter], old: Mapping[str, float | None], free: Container[str]
) -> Iterator[ChangedValue | KeptValue]:
    for estimate in estimates:
        before = old[estimate.parameter]
        if math.isnan(estimate.sd) or estimate.value == before:
            continue
        if estimate.parameter not in free:
            yield KeptValue(name, estimate.parameter, "it is now held constant")
        elif (fault := _fault(estimate)) is not None:
            yield KeptValue(name, estimate.parameter, fault)
        else:
            yield ChangedValue(name, estimate.parameter, before, estimate.value)


def _fault(estimate: EstimatedParameter) -> str | None:
    """Say why an adjusted value is unfit as a preliminary one; None if it is fit."""
    if math.isinf(estimate.sd):
        return "nothing determines it"
    return None if math.isfinite(estimate.value) else "its adjusted value is not a number"


def _preliminary_point(name: str, estimates: Sequence[EstimatedParameter]) -> PreliminaryPoint:
    x, y, z = (estimate.value for estimate in estimates)
    sx, sy, sz = (estimate.sd for estimate in estimates)
    deviations = (sx, sy, sz) if all(math.isfinite(estimate.sd) for estimate in estimates) else None
    return PreliminaryPoint(name, (x, y, z), deviations)


def _changed_coordinates(before: Mapping[str, PreliminaryPoint], after: PreliminaryPoint) -> Iterator[ChangedValue]:
    old = before[after.name].coordinates if after.name in before else (None,) * 3
    for axis, was, now in zip("XYZ", old, after.coordinates, strict=True):
        if was != now:
            yield ChangedValue(after.name, axis, was, now)


def rows_of(names: Sequence[str], wanted: Sequence[str], *, exact: bool) -> tuple[list[int], list[str]]:
    """Return the rows of the wanted names (none: of all), and the wanted names that do not exist.

    Names of points are compared exactly, in those of records case does not count.
    """
    key = str if exact else record_key
    place = {key(name): row for row, name in enumerate(names)}
    if not wanted:
        return list(place.values()), []
    missing = [name for name in wanted if key(name) not in place]
    return sorted({place[key(name)] for name in wanted if key(name) in place}), missing
