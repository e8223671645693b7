"""Exposure stations under the name of the photo before or after: an event too many or too few in the log."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.bundle.antennas import with_orientations_of_stations
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.observations.station import Station
from orip.structs import replace

_FEWEST = 6
"""Stations of which the others still determine the ground system when one of them is left out."""


def moved_stations(block: Block) -> Iterator[Hypothesis]:
    """Yield the stations moved by one photo, forward and backward, in the order of their times or of the file."""
    stations = [station for station in block.stations if station.has_position]
    if len(stations) < _FEWEST:
        return
    if all(np.isfinite(station.time) for station in stations):
        stations.sort(key=lambda station: station.time)
    photos = [station.photo for station in stations]
    for moved, names in ((stations[:-1], photos[1:]), (stations[1:], photos[:-1])):
        text = (
            f"they fit when they are moved by one photo: the position under {moved[0].photo} is that of {names[0]}, "
            "and so on; correct the names in the .STA file, or match events and photos again"
        )
        renamed = tuple(replace(station, photo=name) for station, name in zip(moved, names, strict=True))
        yield Hypothesis(_with_stations(block, renamed), finding("moved-stations", "exposure stations", text))


def _with_stations(block: Block, stations: tuple[Station, ...]) -> Block:
    """Return a block with other stations; photos that were oriented by theirs are oriented by these."""
    oriented = {record_key(station.photo) for station in block.stations if station.has_angles}
    orientation = block.photo_orientation.copy()
    for row, photo in enumerate(block.photos):
        if record_key(photo.name) in oriented:
            orientation[row] = np.nan
    return with_orientations_of_stations(replace(block, stations=stations, photo_orientation=orientation))
