"""Which antenna, strip and session each exposure station of a block belongs to, and the velocity of its photo."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.records.block import Block
from orip.records.names import record_key
from orip.records.observations.station import Station
from orip.records.project.antenna import Antenna, Extent

Number = TypeVar("Number", np.float64, np.int64)

NONE = -1
"""Of a station without an antenna, or one whose antenna has no unknown shift or drift."""


class Stretch(NamedTuple):
    """Stations with a common shift or drift: their antenna's row, and their strip; None: a whole session."""

    antenna: int
    strip: str | None


class StationPlaces(Struct, frozen=True):
    """Where n exposure stations belong.

    Parameters
    ----------
    photo : array (n,) of int
    antenna, shift, drift : arrays (n,) of int
        Rows of the antenna, and of its stretches; `NONE` where there is none.
    elapsed : array (n,)
        Seconds since the mean time of the station's stretch of drift; 0 without one.
    velocity : array (n, 3)
        Ground unit a second; 0 where it is not known.
    shifts, drifts : tuples of Stretch
    """

    photo: IntArray
    antenna: IntArray
    shift: IntArray
    drift: IntArray
    elapsed: FloatArray
    velocity: FloatArray
    shifts: tuple[Stretch, ...]
    drifts: tuple[Stretch, ...]


def station_places(block: Block) -> StationPlaces:
    """Return where the exposure stations of a block belong."""
    stations = block.stations
    row_of = {record_key(photo.name): row for row, photo in enumerate(block.photos) if stations}
    photo = np.array([row_of[record_key(station.photo)] for station in stations], dtype=np.int64)
    camera_of = block.photo_camera[photo]
    of_cameras = [antenna_of(block.antennas, camera.name) for camera in block.cameras]
    antenna = np.array([of_cameras[camera] for camera in camera_of], dtype=np.int64)
    shift, shifts = _stretches(block, antenna, [record.shift for record in block.antennas])
    drift, drifts = _stretches(block, antenna, [record.drift for record in block.antennas])
    return StationPlaces(
        photo, antenna, shift, drift, _elapsed(stations, drift), _velocities(stations, antenna), shifts, drifts
    )


def antenna_of(antennas: Sequence[Antenna], camera: str) -> int:
    """Return the row of the antenna of a camera's photos; `NONE` where there is none."""
    key = record_key(camera)
    for row, antenna in enumerate(antennas):
        if not antenna.cameras or key in map(record_key, antenna.cameras):
            return row
    return NONE


def is_shifted(antenna: Antenna, strip: str) -> bool:
    """Return whether the stations of a strip have an unknown shift or drift."""
    return any(_is_unknown(antenna, extent, strip) for extent in (antenna.shift, antenna.drift))


def _is_unknown(antenna: Antenna, extent: Extent, strip: str) -> bool:
    """Return whether a shift or drift of some extent is unknown for a strip."""
    return extent != "none" and (not antenna.strips or strip in antenna.strips)


def rows_or(table: NDArray[Number], rows: IntArray, other: float) -> NDArray[Number]:
    """Return rows of a table (k, m), and rows of another value where there is `NONE`."""
    padded = np.vstack([table, np.full((1, table.shape[1]), other, dtype=table.dtype)])
    return padded[np.where(rows == NONE, len(table), rows)]


def name_of_stretch(antenna: Antenna, stretch: Stretch) -> str:
    """Return what a stretch is called: ``GNSS``, ``GNSS strip 2``."""
    return antenna.name if stretch.strip is None else f"{antenna.name} strip {stretch.strip or '-'}"


def _stretches(block: Block, antenna: IntArray, extents: list[Extent]) -> tuple[IntArray, tuple[Stretch, ...]]:
    """Return the row of each station's stretch, and all stretches; those of stations only compared are none."""
    rows: dict[Stretch, int] = {}
    found = np.full(len(antenna), NONE)
    for place, (station, row) in enumerate(zip(block.stations, antenna.tolist(), strict=True)):
        if row == NONE or not _is_observed(station) or block.is_free_network:
            continue
        if not _is_unknown(block.antennas[row], extents[row], station.strip):
            continue
        stretch = Stretch(row, station.strip if extents[row] == "strip" else None)
        found[place] = rows.setdefault(stretch, len(rows))
    return found, tuple(rows)


def _is_observed(station: Station) -> bool:
    return station.has_position and any(error >= 0.0 for error in station.position_error)


def _elapsed(stations: tuple[Station, ...], drift: IntArray) -> FloatArray:
    time = np.array([station.time for station in stations], dtype=np.float64)
    found = np.zeros(len(stations))
    for row in range(drift.max(initial=NONE) + 1):
        mine = (drift == row) & np.isfinite(time)
        found[mine] = time[mine] - time[mine].mean() if mine.any() else 0.0
    return found


def _velocities(stations: tuple[Station, ...], antenna: IntArray) -> FloatArray:
    """Return velocities (n, 3) from the neighbours of each station in its strip: by a parabola, at the ends a line."""
    found = np.zeros((len(stations), 3))
    strips: dict[tuple[int, str], list[int]] = {}
    for place, station in enumerate(stations):
        if station.has_position and np.isfinite(station.time):
            strips.setdefault((int(antenna[place]), station.strip), []).append(place)
    for members in strips.values():
        rows = np.array(sorted(members, key=lambda place: stations[place].time))
        time = np.array([stations[place].time for place in rows])
        if len(rows) > 1 and (np.diff(time) > 0.0).all():
            found[rows] = np.gradient(np.array([stations[place].position for place in rows]), time, axis=0)
    return found
