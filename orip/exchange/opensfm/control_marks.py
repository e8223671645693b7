"""Ground control points of OpenSfM (``ground_control_points.json``), and of lists of OpenDroneMap as points with marks.

Positions are latitude, longitude and height; a point without a position is a tie point measured by hand. Projections
are normalised as those of tracks.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from msgspec import Struct

from orip.exchange.opensfm.point_lists import ControlList, ControlMark
from orip.exchange.sources.json_tree import JsonValue


class MarkedPoint(Struct, frozen=True):
    """A point with its measurements.

    Parameters
    ----------
    name : str
    coordinates : tuple of 3 (float or None), or None
        x before y: longitude, latitude, height; or east, north, height. None where the point has no position.
    marks : tuple of (photo, coordinates)
        Normalised coordinates, or pixels from the centre of the first one.
    line : int
        0 where it is not known.
    """

    name: str
    coordinates: tuple[float | None, float | None, float | None] | None
    marks: tuple[tuple[str, tuple[float, float]], ...]
    line: int = 0


def marked_points_of_document(document: JsonValue) -> tuple[MarkedPoint, ...]:
    """Return the points of a ``ground_control_points.json``."""
    points = document.required("points")
    found = []
    for point in points.items() if points is not None else ():
        name = _name(point)
        if name is not None:
            found.append(MarkedPoint(name, _position(point), _marks(point)))
    return tuple(found)


def _name(point: JsonValue) -> str | None:
    name = point.required("id")
    if name is None or isinstance(name.value, str | int):
        return None if name is None else str(name.value)
    name.complain("a name should be here; correct it")
    return None


def _position(point: JsonValue) -> tuple[float | None, float | None, float | None] | None:
    position = point.get("position")
    if position is None:
        return None
    height = position.number("altitude") if position.get("altitude") is not None else None
    return position.number("longitude"), position.number("latitude"), height


def _marks(point: JsonValue) -> tuple[tuple[str, tuple[float, float]], ...]:
    observations = point.get("observations")
    found = []
    for observation in observations.items() if observations is not None else ():
        shot, projection = observation.text("shot_id"), observation.numbers("projection", 2)
        if shot is not None and projection is not None:
            found.append((shot, (projection[0], projection[1])))
    return tuple(found)


def marked_points_of_list(control: ControlList) -> tuple[MarkedPoint, ...]:
    """Return the points of a ``gcp_list.txt``: marks of equal coordinates are those of one point.

    A point is named after its label where all its marks have the same, and no other point has it; else GCP1, GCP2, ...
    """
    groups: dict[tuple[float, float, float | None], list[ControlMark]] = {}
    for mark in control.marks:
        x, y, z = mark.coordinates
        groups.setdefault((x, y, None if math.isnan(z) else z), []).append(mark)
    names = _names(groups)
    return tuple(
        MarkedPoint(names[place], place, tuple((mark.photo, mark.pixel) for mark in marks), marks[0].line)
        for place, marks in groups.items()
    )


def _names(
    groups: Mapping[tuple[float, float, float | None], list[ControlMark]],
) -> dict[tuple[float, float, float | None], str]:
    labels = {place: {mark.label for mark in marks} for place, marks in groups.items()}
    single = [min(found) for found in labels.values() if len(found) == 1]
    return {
        place: min(found) if len(found) == 1 and min(found) and single.count(min(found)) == 1 else f"GCP{number}"
        for number, (place, found) in enumerate(labels.items(), start=1)
    }
