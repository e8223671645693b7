"""What is known of the motions of photos of rolling shutters: from their stations, else from neighbours in the strip.

A station that says how it moved is believed before the neighbours. Its velocity v is that of its antenna, or whatever
its position is of; with the angular rate w a projection centre X0 moves with v + w x (X0 - antenna). Photos of the same
exposure of a rig move with its station.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.antennas import NONE, antenna_of, rows_or
from orip.errors import ProjectWarning
from orip.geometry.other_crs import motion_along
from orip.interior.motions import TimedPhotos, motions, rolling_cameras
from orip.records.block import Block
from orip.records.control import Station, StationMotion
from orip.records.definition import LEVER_ARM
from orip.records.names import record_key
from orip.units import DEGREES_PER_RADIAN
from orip.wording import counted, first_names

_NAMED = 3
"""Photos that a warning names."""

_ARM = slice(0, len(LEVER_ARM))


class KnownMotions(Struct, frozen=True):
    """Motions of photos by their stations, along the axes that the block is adjusted in, and strips with times.

    Parameters
    ----------
    strips : tuple of TimedPhotos
    photo, station : arrays (k,) of int
        Photos whose motion is given, and those of the stations that give it.
    antenna : array (k,) of int
        Of the stations; `NONE` where there is none.
    velocity, rate : arrays (k, 3)
        Ground unit and radians a second; NaN where they are not given.
    """

    strips: tuple[TimedPhotos, ...] = ()
    photo: IntArray = np.zeros(0, dtype=np.int64)
    station: IntArray = np.zeros(0, dtype=np.int64)
    antenna: IntArray = np.zeros(0, dtype=np.int64)
    velocity: FloatArray = np.zeros((0, 3))
    rate: FloatArray = np.zeros((0, 3))

    def at(self, centres: FloatArray, rotations: FloatArray, antennas: FloatArray) -> FloatArray:
        """Return velocities and angular rates (number of photos, 6), radians a second; zero where they are not known.

        Parameters
        ----------
        centres : array (number of photos, 3)
        rotations : array (number of photos, 3, 3)
            Photo to ground.
        antennas : array (number of antennas, 7)
        """
        found = motions(self.strips, centres, rotations)
        if not len(self.photo):
            return found
        rate = np.where(np.isnan(self.rate), found[self.photo, 3:], self.rate)
        arm = rows_or(antennas, self.antenna, 0.0)[:, _ARM]
        antenna = centres[self.station] + np.einsum("nij,nj->ni", rotations[self.station], arm)
        velocity = self.velocity + np.cross(rate, centres[self.photo] - antenna)
        found[self.photo, :3] = np.where(np.isnan(velocity), found[self.photo, :3], velocity)
        found[self.photo, 3:] = rate
        return found


def known_motions(block: Block) -> KnownMotions:
    """Return what is known of the motions of the photos of a block."""
    given = [(station, own, photo) for station, own, photo in _of_exposures(block, _moving(block)) if station.motion]
    if not given:
        return KnownMotions(timed_photos(block))
    along = _motions_in_frame(block, given)
    station, photo = (np.array(rows, dtype=np.int64) for rows in list(zip(*given, strict=True))[1:])
    names = [block.cameras[camera].name for camera in block.photo_camera[station]]
    return KnownMotions(
        timed_photos(block),
        photo,
        station,
        np.array([antenna_of(block.antennas, name) for name in names], dtype=np.int64),
        np.array([motion.velocity for motion in along]),
        np.array([motion.rate for motion in along]),
    )


def motions_of_rolling_shutters(block: Block) -> KnownMotions:
    """Return what is known of the motions of a block with a rolling shutter; nothing of others."""
    return known_motions(block) if rolling_cameras(block).any() else KnownMotions()


class MotionErrors(NamedTuple):
    """A-priori errors of the motions of photos of rolling shutters, arrays (number of photos, 6).

    Attributes
    ----------
    values : array
        Ground unit and degrees a second; NaN: no unknown.
    are_observed : array of bool
        Those that a station gives; else they are the bundle's.
    """

    values: FloatArray
    are_observed: BoolArray


def motion_errors(block: Block) -> MotionErrors:
    """Return the a-priori errors of motions."""
    definition = block.definition
    of_bundle = [definition.velocity_error or np.nan] * 3 + [definition.rate_error or np.nan] * 3
    rolling = rolling_cameras(block)
    found = np.where(rolling[block.photo_camera, None], of_bundle, np.nan)
    are_observed = np.zeros(found.shape, dtype=bool)
    if not rolling.any():
        return MotionErrors(found, are_observed)
    given = [entry for entry in _of_exposures(block, _moving(block)) if rolling[block.photo_camera[entry[2]]]]
    for (_, _, photo), motion in zip(given, _motions_in_frame(block, given), strict=True):
        errors = np.array([*motion.velocity_error, *motion.rate_error]) * np.repeat([1.0, DEGREES_PER_RADIAN], 3)
        known = np.isfinite(errors)
        found[photo, known] = np.where(errors > 0.0, errors, np.nan)[known]
        are_observed[photo] = errors > 0.0
    return MotionErrors(found, are_observed)


def without_motion(block: Block) -> Iterator[ProjectWarning]:
    """Yield a warning of each rolling shutter with photos whose motion is not known."""
    found = motions_of_rolling_shutters(block)
    known = {row for strip in found.strips for row in strip.photos.tolist()} | set(found.photo.tolist())
    for camera in np.flatnonzero(rolling_cameras(block)).tolist():
        photos = np.flatnonzero(block.photo_camera == camera).tolist()
        still = [block.photos[row].name for row in photos if row not in known]
        if still:
            text = (
                f"it has a readout, but {counted(len(still), 'photo')} of {len(photos)} have no known motion "
                f"({first_names(still, _NAMED)}); give exposure stations with motions, or with times and strips (.STA)"
            )
            if not (block.definition.velocity_error or block.definition.rate_error):
                text += ", or velocity_error and rate_error in the [[bundle]]"
            yield ProjectWarning("no-motion", f"camera {block.cameras[camera].name}", text)


def timed_photos(block: Block) -> tuple[TimedPhotos, ...]:
    """Return the photos of each strip and camera whose stations have times; a strip with equal times is left out."""
    timed = [station for station in block.stations if np.isfinite(station.time)]
    strips: dict[tuple[int, str], list[tuple[float, int]]] = {}
    for station, _, photo in _of_exposures(block, timed):
        strips.setdefault((int(block.photo_camera[photo]), station.strip), []).append((station.time, photo))
    found = []
    for members in strips.values():
        times, photos = zip(*sorted(members), strict=True)
        if len(photos) > 1 and all(one < other for one, other in pairwise(times)):
            found.append(TimedPhotos(np.array(photos, dtype=np.int64), np.array(times)))
    return tuple(found)


_OfPhoto = tuple[Station, int, int]
"""A station, the row of its own photo, and that of a photo which it is of."""


def _moving(block: Block) -> list[Station]:
    return [station for station in block.stations if station.motion is not None]


def _of_exposures(block: Block, stations: Sequence[Station]) -> list[_OfPhoto]:
    """Return the photos of stations, and those of the same exposures of rigs that have none of these stations."""
    if not stations:
        return []
    row_of = {record_key(photo.name): row for row, photo in enumerate(block.photos)}
    own = [(station, row_of[record_key(station.photo)]) for station in stations]
    found, done = [(station, row, row) for station, row in own], {row for _, row in own}
    on_rigs = block.places_on_rigs().photos
    exposure_of = {place.photo: place.exposure for place in on_rigs}
    members: dict[int, list[int]] = {}
    for photo, exposure in exposure_of.items():
        members.setdefault(exposure, []).append(photo)
    for station, row in own:
        others = [photo for photo in members.get(exposure_of.get(row, NONE), ()) if photo not in done]
        found += [(station, row, photo) for photo in others]
        done.update(others)
    return found


def _motions_in_frame(block: Block, given: Sequence[_OfPhoto]) -> list[StationMotion]:
    """Return the motions of stations along the axes that the block is adjusted in."""
    centres = block.photo_orientation[[photo for _, _, photo in given], :3]
    axes = block.ground.axes_at(block.ground.to_project(centres))
    turned = [motion_along(station.motion, turn.T) for (station, _, _), turn in zip(given, axes, strict=True)]
    return [motion or StationMotion() for motion in turned]
