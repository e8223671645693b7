"""The local frame in which a block is adjusted: its origin, what is constant in it, and what it does not allow.

With a coordinate reference system photos and points have local coordinates while they are adjusted. A constant of the
project is a constant of the frame only together with others: the three coordinates of a point or projection centre, and
a photo's angles with its centre. Constants without those others become exact constraints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.points.starting import given_coordinates
from orip.errors import Complaint, InputError
from orip.geometry.ground_frame import ground_frame
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.block import Block
from orip.records.control import ControlElement, ControlPoint
from orip.records.ground import PLAIN, GroundSystem
from orip.records.photo import PHOTO_PARAMETERS, Photo
from orip.structs import replace

_POSITION = frozenset(PHOTO_PARAMETERS[:3])

_ROUNDED_TO = -2
"""Decimals to which the origin is rounded, so that a small change of the block does not move it."""


def ground_system(
    crs: str | None, ground_unit: str, points: Sequence[ControlPoint], centres: FloatArray
) -> GroundSystem:
    """Return the system that a block is adjusted in, with its origin in the middle of control, else of the photos.

    Parameters
    ----------
    crs : str or None
        None: the project's coordinates are plain.
    centres : array (n, 3)
        Projection centres, in the project.

    Raises
    ------
    InputError
        If the system does not fit the project, or a grid for its heights is missing.
    """
    if crs is None:
        return PLAIN
    known = [point.coordinates for point in points if not point.rejected and None not in point.coordinates]
    places = np.array(known, dtype=np.float64) if known else centres[np.isfinite(centres).all(axis=1)]
    if not len(places):
        message = "with a crs the block needs a location: give a control point with X, Y and Z, or projection centres"
        raise InputError.single(message)
    # the median, so that one mistyped point does not move the frame of all others
    return ground_frame(crs, ground_unit, np.round(np.median(places, axis=0), _ROUNDED_TO))


def frame_complaints(block: Block) -> list[Complaint]:
    """Return complaints about what the frame does not allow; the photos still have the project's coordinates."""
    if block.ground is PLAIN:
        return []
    names = [f"photo {photo.name}" for photo in block.photos]
    names += [f"control point {point.name}" for point in block.control_points]
    names += [f"preliminary point {point.name}" for point in block.preliminary]
    names += [f"exposure station {station.photo}" for station in block.stations]
    given = [tuple(centre) for centre in block.photo_orientation[:, :3].tolist()]
    given += [point.coordinates for point in block.control_points]
    given += [point.coordinates for point in block.preliminary]
    given += [station.position for station in block.stations]
    xyz = np.array(given, dtype=np.float64)
    outside = np.isfinite(xyz).all(axis=1) & np.isnan(block.ground.to_local(xyz)).any(axis=1)
    complaints = [
        Complaint(
            f"{names[row]} has the coordinates {', '.join(f'{value:.3f}' for value in xyz[row])}, which are "
            "outside the area of the crs; check the coordinates, and that X is the easting and Y the northing"
        )
        for row in np.flatnonzero(outside)
    ]
    return [*complaints, *_free_network_complaints(block)]


def _free_network_complaints(block: Block) -> Iterator[Complaint]:
    """Yield complaints of observations that would tie a free network to its location on the earth."""
    if not block.is_free_network:
        return
    name = block.definition.name
    if block.directions:
        yield Complaint(
            f"bundle {name} is a free network with theodolite directions, whose verticals differ from place to place "
            "with a crs; leave crs out, or take the directions out of the .DIR file"
        )
    levels = {point.figure for point in block.figure_points if point.kind == "HEIGHT"}
    if levels or block.given_directions:
        yield Complaint(
            f"bundle {name} is a free network with equal heights or given directions, whose verticals differ from "
            "place to place with a crs; leave crs out, or take them out of the .CON file"
        )
    on_grid = [distance.name for distance in block.distances if distance.code != "XYZ" and distance.error >= 0.0]
    if on_grid:
        yield Complaint(
            f"distance {', '.join(on_grid)} of the free network {name} is taken on the map grid with a crs, which "
            "differs from place to place; give a spatial distance (XYZ), or leave crs out"
        )


def photos_in_frame(block: Block) -> Block:
    """Return the block with its photos' orientations taken from the project to the frame.

    A photo with an unknown coordinate has NaN for all elements, one with an unknown angle for all three angles.
    """
    if block.ground is PLAIN:
        return block
    orientation = np.full_like(block.photo_orientation, np.nan)
    placed = np.isfinite(block.photo_orientation[:, :3]).all(axis=1)
    orientation[placed, :3] = block.ground.to_local(block.photo_orientation[placed, :3])
    known = np.isfinite(block.photo_orientation).all(axis=1)
    centres, angles = block.photo_orientation[known, :3], block.photo_orientation[known, 3:]
    rotation = np.swapaxes(block.ground.axes_at(centres), 1, 2) @ rotation_from_angles(angles)
    orientation[known] = np.hstack([block.ground.to_local(centres), angles_from_rotation(rotation)])
    return replace(block, photo_orientation=orientation)


def constants_in_frame(block: Block) -> Block:
    """Return the block with what is constant in the project either constant in the frame, or an exact constraint."""
    block = constants_of_rigs(block)
    if block.ground is PLAIN:
        return block
    whole = block.constant_points & block.constant_points.all(axis=1, keepdims=True)
    given = given_coordinates(block)
    single = [
        ControlElement(block.point_names[point], "POINT", "XYZ"[axis], float(given[point, axis]), 0.0)
        for point, axis in np.argwhere(block.constant_points & ~whole)
    ]
    photos = [_constants_of_photo(photo) for photo in block.photos]
    return replace(
        block,
        constant_points=whole,
        photos=tuple(photo for photo, _ in photos),
        constant_elements=(
            *block.constant_elements, *single, *(element for _, elements in photos for element in elements),
        ),
    )  # fmt: skip


def constants_of_rigs(block: Block) -> Block:
    """Return the block with the constant elements of photos of rigs as exact constraints: they are no unknowns."""
    of_rigs = {photo.photo for photo in block.places_on_rigs().photos}
    if not any(block.photos[row].constant for row in of_rigs):
        return block
    photos, found = list(block.photos), list(block.constant_elements)
    for row in sorted(of_rigs):
        values = dict(zip(PHOTO_PARAMETERS, photos[row].orientation, strict=True))
        given = ((kind, values[kind]) for kind in photos[row].constant)
        found += [
            ControlElement(photos[row].name, "PHOTO", kind, value, 0.0) for kind, value in given if value is not None
        ]
        photos[row] = replace(photos[row], constant=())
    return replace(block, photos=tuple(photos), constant_elements=tuple(found))


def _constants_of_photo(photo: Photo) -> tuple[Photo, list[ControlElement]]:
    """Return a photo with the elements that are constant in the frame, and those that are exact constraints."""
    constant = frozenset[str]()
    if set(photo.constant) >= _POSITION:
        constant = frozenset(PHOTO_PARAMETERS) if set(photo.constant) == set(PHOTO_PARAMETERS) else _POSITION
    values = dict(zip(PHOTO_PARAMETERS, photo.orientation, strict=True))
    single = [
        ControlElement(photo.name, "PHOTO", kind, value, 0.0)
        for kind in photo.constant
        if kind not in constant and (value := values[kind]) is not None
    ]
    return replace(photo, constant=tuple(kind for kind in photo.constant if kind in constant)), single
