"""Which antenna, strip and session an exposure station belongs to, orientations from stations, and parts of a block."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import compress
from typing import NamedTuple, TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.block import Block, IndexedPhotoPoints
from orip.records.control import ControlElement, Station
from orip.records.definition import Antenna, Extent
from orip.records.figures import points_that_count
from orip.records.names import record_key
from orip.records.observation_kinds import photos_per_point
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

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


def with_orientations_of_stations(block: Block) -> Block:
    """Return a block in its frame, whose photos start at their stations where nothing else is known of them.

    Stations that are only compared, or that have no attitude, orient no photo.
    """
    orientation = block.photo_orientation.copy()
    places = station_places(block)
    for station, photo, antenna in zip(block.stations, places.photo, places.antenna, strict=True):
        errors = (*station.position_error, *station.angle_error)
        if not (station.has_position and station.has_angles and min(errors) >= 0.0):
            continue
        arm, boresight = np.zeros(3), np.zeros(3)
        if antenna != NONE:
            record = block.antennas[antenna]
            arm, boresight = np.array(record.lever_arm), np.array(record.boresight) * RADIANS_PER_DEGREE
        position = np.array([station.position])
        of_navigation = rotation_from_angles(np.array(station.angles))
        rotation = block.ground.axes_at(position)[0].T @ of_navigation @ rotation_from_angles(boresight)
        centre = block.ground.to_local(position)[0] - rotation @ arm
        observed = np.concatenate([centre, angles_from_rotation(rotation)])
        orientation[photo] = np.where(np.isnan(orientation[photo]), observed, orientation[photo])
    return replace(block, photo_orientation=orientation)


def part_of_block(block: Block, photos: BoolArray, points: BoolArray) -> Block:
    """Return a block of some photos and points, the cameras of these photos, and what is observed of these alone.

    Parameters
    ----------
    photos : array (number of photos,) of bool
        True: stays.
    points : array (number of points,) of bool
        True: stays.
    """
    cameras = np.unique(block.photo_camera[photos])
    names = frozenset(compress(block.point_names, points))
    gone = frozenset(compress(block.point_names, ~points))
    directions = tuple(line for line in block.directions if {line.station, line.target} <= names)
    sets = {line.set for line in directions}
    shown = {record_key(photo.name) for photo in compress(block.photos, photos)}
    part = replace(
        block,
        definition=replace(
            block.definition, datum_points=tuple(name for name in block.definition.datum_points if name not in gone)
        ),
        cameras=tuple(block.cameras[row] for row in cameras),
        photos=tuple(compress(block.photos, photos)),
        photo_camera=np.searchsorted(cameras, block.photo_camera[photos]),
        photo_orientation=block.photo_orientation[photos],
        point_names=tuple(compress(block.point_names, points)),
        point_start=block.point_start[points],
        photo_points=_rays(block.photo_points, photos, points),
        constant_points=block.constant_points[points],
        control_points=tuple(point for point in block.control_points if point.name in names),
        distances=tuple(line for line in block.distances if {line.start, line.end} <= names),
        directions=directions,
        given_directions=tuple(line for line in block.given_directions if {line.start, line.end} <= names),
        figure_points=points_that_count(block.figure_points, names),
        terrain_heights=tuple(one for one in block.terrain_heights if one.point in names),
        stations=tuple(station for station in block.stations if record_key(station.photo) in shown),
        differences=tuple(
            line for line in block.differences if {record_key(line.first), record_key(line.second)} <= shown
        ),
        theodolites=tuple(station for station in block.theodolites if station.name in sets),
    )
    concerns = _concerns(part)
    return replace(
        part,
        elements=tuple(filter(concerns, block.elements)),
        constant_elements=tuple(filter(concerns, block.constant_elements)),
    )


def without_photos(block: Block, left_out: BoolArray) -> Block:
    """Return a block without some photos, and without the points that they alone show.

    Points that no photo shows (the ends of distances and directions) stay.

    Parameters
    ----------
    left_out : array (number of photos,) of bool
    """
    shown = _is_shown(block)
    return part_of_block(block, ~left_out, ~shown | _is_shown(block, ~left_out[block.photo_points.photo]))


def without_photo(block: Block, photo: int) -> Block:
    """Return a block without a photo, and without the tie points that are then in fewer than two photos.

    Parameters
    ----------
    photo : int
        Its index in the block.
    """
    points = block.photo_points
    used = (points.photo != photo) & points.in_use
    known = {point.name for point in block.control_points if point.kind == "control"}
    known |= {name for distance in block.distances for name in (distance.start, distance.end)}
    known |= {name for direction in block.directions for name in (direction.station, direction.target)}
    known |= {point.point for point in block.figure_points}
    known |= {name for line in block.given_directions for name in (line.start, line.end)}
    rays = photos_per_point(points.photo, points.point, used, len(block.point_names))
    kept = np.array([rays[row] > 1 or (name in known) for row, name in enumerate(block.point_names)])
    return part_of_block(block, np.arange(len(block.photos)) != photo, kept)


def without_unmeasured_points(block: Block) -> Block:
    """Return a block without the points that no photo shows, and what is observed of them."""
    return part_of_block(block, np.ones(len(block.photos), dtype=bool), _is_shown(block))


def without_unused_cameras(block: Block) -> Block:
    """Return a block without the cameras that none of its photos has."""
    return part_of_block(block, np.ones(len(block.photos), dtype=bool), np.ones(len(block.point_names), dtype=bool))


def _is_shown(block: Block, rays: BoolArray | slice = slice(None)) -> BoolArray:
    """Return which points (number of points,) have one of these rays."""
    shown = np.zeros(len(block.point_names), dtype=bool)
    shown[block.photo_points.point[rays]] = True
    return shown


def _rays(measured: IndexedPhotoPoints, photos: BoolArray, points: BoolArray) -> IndexedPhotoPoints:
    rows = photos[measured.photo] & points[measured.point]
    return IndexedPhotoPoints(
        _places(photos)[measured.photo[rows]],
        _places(points)[measured.point[rows]],
        measured.xy[rows],
        measured.error[rows],
        measured.used[rows],
    )


def _places(kept: BoolArray) -> IntArray:
    """Return the new index of each row that is kept; the others have no valid one."""
    return np.asarray(np.cumsum(kept) - 1, dtype=np.int64)


def _concerns(part: Block) -> Callable[[ControlElement], bool]:
    """Return a test of whether an element belongs to a photo, camera, point or theodolite set of a block."""
    known = {
        "PHOTO": {record_key(photo.name) for photo in part.photos},
        "CAMERA": {record_key(camera.name) for camera in part.cameras},
        "POINT": set(part.point_names),
        "THEODOLITE": {line.set for line in part.directions},
    }

    def concerns(element: ControlElement) -> bool:
        is_record = element.group in ("PHOTO", "CAMERA")
        return (record_key(element.name) if is_record else element.name) in known[element.group]

    return concerns
