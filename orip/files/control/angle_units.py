"""Angles of control files in gon or radians, taken to degrees."""

from __future__ import annotations

from orip.records.control import Control
from orip.structs import replace


def in_degrees(control: Control, degrees: float) -> Control:
    """Return control whose elements, directions and given directions have angles in degrees.

    Exposure stations and differences between them are written by programs, in degrees.

    Parameters
    ----------
    degrees : float
        Of a unit of the files; 1: nothing is to be done.
    """
    if degrees == 1.0:
        return control
    from orip.records.observation_kinds import ANGULAR_UNKNOWNS  # takes arrays

    return replace(
        control,
        elements=tuple(
            replace(one, value=one.value * degrees, error=one.error * degrees) if one.kind in ANGULAR_UNKNOWNS else one
            for one in control.elements
        ),
        directions=tuple(
            replace(
                line,
                direction=line.direction * degrees,
                direction_error=line.direction_error * degrees,
                zenith=None if line.zenith is None else line.zenith * degrees,
                zenith_error=None if line.zenith_error is None else line.zenith_error * degrees,
            )
            for line in control.directions
        ),
        given_directions=tuple(replace(line, error=line.error * degrees) for line in control.given_directions),
    )
