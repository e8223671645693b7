"""Exposure stations as observed elements of their photos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from orip.records.observations.control import ControlElement
from orip.records.observations.station import Station
from orip.records.project.photo import PHOTO_PARAMETERS
from orip.units import DEGREES_PER_RADIAN


def station_elements(stations: Sequence[Station]) -> tuple[ControlElement, ...]:
    """Return X0, Y0, Z0 and OMEGA, PHI, KAPPA of stations as elements, as far as they are given.

    The antenna is taken for the projection centre, and correlations of the coordinates are left out.
    """
    return tuple(element for station in stations for element in _elements(station))


def _elements(station: Station) -> Iterator[ControlElement]:
    if station.has_position:
        observed = zip(PHOTO_PARAMETERS[:3], station.position, station.position_error, strict=True)
        for kind, value, error in observed:
            yield ControlElement(station.photo, "PHOTO", kind, value, error, station.line)
    if station.has_angles:
        for kind, angle, error in zip(PHOTO_PARAMETERS[3:], station.angles, station.angle_error, strict=True):
            value, deviation = angle * DEGREES_PER_RADIAN, error * DEGREES_PER_RADIAN
            yield ControlElement(station.photo, "PHOTO", kind, value, deviation, station.line)
