"""Orientations of photos from their exposure stations: where position and attitude were observed."""

from __future__ import annotations

import numpy as np

from orip.bundle.antennas import NONE, station_places
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.block import Block
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE


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
