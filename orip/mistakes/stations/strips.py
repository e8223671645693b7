"""Stations that do not belong to their photos, and strips that are not in their file."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.bundle.antennas import antenna_of, with_orientations_of_stations
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.mistakes.mistake import STATIONS_OFF, declare
from orip.records.block import Block
from orip.records.control import Station
from orip.records.names import record_key
from orip.structs import replace
from orip.wording import joined, listed_names


def missing_strips(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning for each antenna with an unknown of strips that its stations have not."""
    cameras = [antenna_of(block.antennas, camera.name) for camera in block.cameras]
    rows = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    for row, antenna in enumerate(block.antennas):
        keys = [f'{key} = "strip"' for key in ("shift", "drift") if getattr(antenna, key) == "strip"]
        strips = {
            station.strip
            for station in block.stations
            if station.has_position and cameras[block.photo_camera[rows[record_key(station.photo)]]] == row
        }
        if keys and strips == {""}:
            text = (
                f"{joined(keys)} needs the strips of stations, and no line of the .STA file has one (its last field): "
                'all are one strip; write them there, or "session" in place of "strip"'
            )
            yield ProjectWarning("missing-strips", f"antenna {antenna.name}", text)
        elif unknown := [name for name in antenna.strips if strips and name not in strips]:
            known = listed_names(sorted(strip for strip in strips if strip))
            text = f"no station has strip {joined(unknown)}, which strips names; those of the .STA file are: {known}"
            yield ProjectWarning("missing-strips", f"antenna {antenna.name}", text)


MOVED = declare("moved-stations", "", STATIONS_OFF)

_FEWEST_STATIONS = 6
"""Stations of which the others still determine the ground system when one of them is left out."""


def moved_stations(block: Block) -> Iterator[Hypothesis]:
    """Yield the stations moved by one photo, forward and backward, in the order of their times or of the file."""
    stations = [station for station in block.stations if station.has_position]
    if len(stations) < _FEWEST_STATIONS:
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
        yield Hypothesis(_with_stations(block, renamed), finding(MOVED, "exposure stations", text))


def _with_stations(block: Block, stations: tuple[Station, ...]) -> Block:
    """Return a block with other stations; photos that were oriented by theirs are oriented by these."""
    oriented = {record_key(station.photo) for station in block.stations if station.has_angles}
    orientation = block.photo_orientation.copy()
    for row, photo in enumerate(block.photos):
        if record_key(photo.name) in oriented:
            orientation[row] = np.nan
    return with_orientations_of_stations(replace(block, stations=stations, photo_orientation=orientation))
