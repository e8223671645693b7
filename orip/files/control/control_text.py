"""Control points and distances as text (.PNT, .LEN), with numbers that read back exactly."""

from __future__ import annotations

from collections.abc import Sequence

from orip.records.observations.control import ControlDistance, ControlPoint

_UNKNOWN = "-"


def points_text(points: Sequence[ControlPoint]) -> str:
    """Return the lines of a .PNT file; errors of a coordinate that is known are known."""
    return "".join(
        " ".join([point.name, *map(_field, (*point.coordinates, *point.errors)), *(["x"] if point.rejected else [])])
        + "\n"
        for point in points
    )


def distances_text(distances: Sequence[ControlDistance]) -> str:
    """Return the lines of a .LEN file."""
    return "".join(
        f"{one.name} {one.start} {one.end} {one.code} {_field(one.distance)} {_field(one.error)}\n" for one in distances
    )


def _field(value: float | None) -> str:
    return _UNKNOWN if value is None else repr(float(value))
