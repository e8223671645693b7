"""Photos of rigs: their elements from exposures and mountings, and the starting values of these.

Observations have partials by the six elements of a photo. Those of a rig's photo are no unknowns: their numbers come
after all unknowns, and partials by them are multiplied by the photo's partials by its exposure and its mounting.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.geometry.rolling_shutter import RigPhotos, exposures_of_photos, photos_with_partials
from orip.geometry.rotation import (
    angles_from_rotation,
    rotation_about_axes,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.records.block import Block
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

_NONE = -1
"""CONSTANT of `orip.bundle.unknowns`."""
ELEMENTS = 6


class RigState(Struct, frozen=True):
    """Current values of e exposures and of c cameras on rigs, and which k photos follow from them.

    Parameters
    ----------
    photo, exposure, mounted : arrays (k,) of int
        Photos of the block, their exposures, and their cameras among the mounted ones.
    centres : array (e, 3)
    rotations : array (e, 3, 3)
        Rig to ground.
    offsets : array (c, 3)
    mountings : array (c, 3, 3)
        Photo to rig.
    """

    photo: IntArray
    exposure: IntArray
    mounted: IntArray
    centres: FloatArray
    rotations: FloatArray
    offsets: FloatArray
    mountings: FloatArray

    def photos(self) -> RigPhotos:
        """Return the orientations of the photos, and their partials."""
        exposure, mounted = self.exposure, self.mounted
        return photos_with_partials(
            self.centres[exposure], self.rotations[exposure], self.offsets[mounted], self.mountings[mounted]
        )

    def moved(self, of_exposures: FloatArray, of_mountings: FloatArray) -> RigState:
        """Return the state after corrections (e, 6) and (c, 6): of places, and small rotations."""
        return replace(
            self,
            centres=self.centres + of_exposures[:, :3],
            rotations=rotation_about_axes(of_exposures[:, 3:]) @ self.rotations,
            offsets=self.offsets + of_mountings[:, :3],
            mountings=rotation_about_axes(of_mountings[:, 3:]) @ self.mountings,
        )


class RigColumns(Struct, frozen=True):
    """Columns of the unknowns of exposures and mountings, `CONSTANT` where a parameter is none.

    Parameters
    ----------
    photo, exposure, mounted : arrays (k,) of int
        As in `RigState`.
    exposures : array (e, 6)
        Place, and small rotations about the axes of the ground.
    mountings : array (c, 6)
        Offset, and small rotations about the axes of the rig.
    first : int
        Number of the first element of the first photo, those of the others follow.
    """

    photo: IntArray
    exposure: IntArray
    mounted: IntArray
    exposures: IntArray
    mountings: IntArray
    first: int = 0

    @property
    def of_photos(self) -> IntArray:
        """Return the unknowns (k, 12) that the elements of each photo depend on."""
        return np.hstack([self.exposures[self.exposure], self.mountings[self.mounted]])

    def numbers(self) -> IntArray:
        """Return the numbers (k, 6) of the photos' elements."""
        return self.first + np.arange(ELEMENTS * len(self.photo)).reshape(-1, ELEMENTS)


def partials_of_photos(state: RigState) -> FloatArray:
    """Return the partials (k, 6, 12) of the elements of the photos by exposure and mounting."""
    found = state.photos()
    return np.concatenate([found.by_exposure, found.by_mounting], axis=2)


class Chained(NamedTuple):
    """Partials (n, j) of observations, and the unknowns (n, j) that they are by."""

    partials: FloatArray
    columns: IntArray


def columns_by_rigs(columns: IntArray, rigs: RigColumns | None) -> IntArray:
    """Return the unknowns (n, j + 12 or 24) that observations touch, for columns (n, j) with elements of photos."""
    if rigs is None:
        return columns
    of_photos = _further_columns(len(columns), _elements(columns, rigs), rigs).astype(columns.dtype)
    return np.hstack([np.where(columns >= rigs.first, _NONE, columns), of_photos])


def chained(
    partials: FloatArray, columns: IntArray, rigs: RigColumns | None, by_unknowns: FloatArray | None
) -> Chained:
    """Return partials by unknowns alone: those by elements of rigs' photos multiplied by theirs.

    Parameters
    ----------
    partials, columns : arrays (n, j)
        An observation depends on two photos at most.
    by_unknowns : array (k, 6, 12) or None
        As of `partials_of_photos`.
    """
    if rigs is None or by_unknowns is None:
        return Chained(partials, columns)
    found = _elements(columns, rigs)
    unknowns = _further_columns(len(columns), found, rigs)
    element = (columns[found.row, found.place] - rigs.first) % ELEMENTS
    parts = partials[found.row, found.place, None] * by_unknowns[found.photo, element]
    further = np.zeros((len(columns), unknowns.shape[1] // (2 * ELEMENTS), 2 * ELEMENTS))
    np.add.at(further, (found.row, found.slot), parts)
    if further.shape[1] == 2:  # photos of one camera share its mounting, and those of one release their exposure
        shared = rigs.of_photos[found.photo] == unknowns[found.row, : 2 * ELEMENTS]
        shared &= (found.slot == 1)[:, None]
        row, place = np.nonzero(shared)
        np.add.at(further, (found.row[row], np.zeros_like(row), place), parts[row, place])
        further[found.row[row], 1, place] = 0.0
    return Chained(
        np.hstack([partials, further.reshape(unknowns.shape)]),
        np.hstack([np.where(columns >= rigs.first, _NONE, columns), unknowns]),
    )


class _Elements(NamedTuple):
    """Rows and places of the elements of rigs' photos, which photo of the k, and 0 or 1: a row's first or second."""

    row: IntArray
    place: IntArray
    photo: IntArray
    slot: IntArray


def _elements(columns: IntArray, rigs: RigColumns) -> _Elements:
    row, place = np.nonzero(columns >= rigs.first)
    photo = (columns[row, place] - rigs.first) // ELEMENTS
    first = np.full(len(columns), -1)
    first[row[::-1]] = photo[::-1]
    return _Elements(row, place, photo, (photo != first[row]).astype(np.int64))


def _further_columns(count: int, found: _Elements, rigs: RigColumns) -> IntArray:
    """Return the unknowns (n, 12 or 24) of the photos that observations depend on; each but once."""
    slots = 1 + int(found.slot.max(initial=0))
    further = np.full((count, slots, 2 * ELEMENTS), _NONE)
    further[found.row, found.slot] = rigs.of_photos[found.photo]
    if slots == 2:
        further[:, 1][further[:, 1] == further[:, 0]] = _NONE
    return further.reshape(count, slots * 2 * ELEMENTS)


_ROUNDS = 8
_SIDES: tuple[Literal["left", "right"], ...] = ("left", "right")
_LEAST_ANGLE = 1e-5
"""Radians, that weights stay finite."""


class _Poses(NamedTuple):
    """Places (n, 3), rotations (n, 3, 3) and weights (n,) of photos: one more than the points that each shows.

    Without the points a photo of three of them, which may be oriented in four ways, would move the others of its
    exposure.
    """

    places: FloatArray
    rotations: FloatArray
    weights: FloatArray


def starting_rigs(block: Block, *, is_guessed: bool = True) -> RigState | None:
    """Return exposures and mountings at the orientations of a block's photos; None where no photo is of a rig.

    Photos that are not oriented (NaN) say nothing. Mountings that neither photos nor values tell are in the origin of
    the rig if they are to be guessed, else NaN.
    """
    places = block.places_on_rigs()
    if not places.photos:
        return None
    photo, exposure, mounted = np.array(places.photos, dtype=np.int64).T
    given = [(camera.mounting.offset, camera.mounting.rotation) for camera in places.mounted]
    held = np.array(
        [camera.mounting.offset_error is None and camera.mounting.rotation_error is None for camera in places.mounted]
    )
    offsets, angles = (np.array([one or (np.nan,) * 3 for one in values]) for values in zip(*given, strict=True))
    state = RigState(
        photo,
        exposure,
        mounted,
        np.full((len(places.exposures), 3), np.nan),
        np.full((len(places.exposures), 3, 3), np.nan),
        offsets,
        rotation_from_angles(angles * RADIANS_PER_DEGREE),
    )
    orientation = block.photo_orientation[photo]
    rig = np.unique([camera.rig for camera in places.mounted], return_inverse=True)[1]
    weights = 1.0 + np.bincount(block.photo_points.photo, minlength=len(block.photos))[photo]
    photos = _Poses(orientation[:, :3], rotation_from_angles(orientation[:, 3:]), weights)
    return _found(state, photos, held, rig, is_guessed)


def with_photos_on_rigs(block: Block) -> Block:
    """Return the block with the photos of rigs where exposures and mountings have them at the start."""
    rigs = starting_rigs(block)
    if rigs is None:
        return block
    found, orientation = rigs.photos(), block.photo_orientation.copy()
    orientation[rigs.photo] = np.hstack([found.centres, angles_from_rotation(found.rotations)])
    return replace(block, photo_orientation=orientation)


def oriented_by_rigs(block: Block) -> Block:
    """Return the block with photos of rigs that are not oriented where the others of their exposures have them."""
    rigs = starting_rigs(block, is_guessed=False)
    if rigs is None:
        return block
    missing = np.isnan(block.photo_orientation[rigs.photo]).any(axis=1)
    if not missing.any():
        return block
    found = rigs.photos()
    orientation = block.photo_orientation.copy()
    own = np.hstack([found.centres, angles_from_rotation(found.rotations)])
    rows = missing & np.isfinite(own).all(axis=1)
    orientation[rigs.photo[rows]] = own[rows]
    return replace(block, photo_orientation=orientation)


def _found(state: RigState, photos: _Poses, held: BoolArray, rig: IntArray, is_guessed: bool) -> RigState:
    """Return the state with what the photos tell, camera after camera; a rig begins with what is held, or given."""
    given: BoolArray = np.asarray(
        np.isfinite(state.offsets).all(axis=1) & np.isfinite(state.mountings).all(axis=(1, 2))
    )
    known: BoolArray = given & held
    for number in range(int(rig.max()) + 1):
        mine = rig == number
        if not known[mine].any():
            known |= mine & given if (mine & given).any() else _most_photos(state, mine)
    state = _in_origin(state, known)
    while True:
        state = _with_exposures(state, photos, known)
        placed: BoolArray = np.asarray(np.isfinite(state.centres).all(axis=1))
        usable = ~known[state.mounted] & placed[state.exposure] & np.isfinite(photos.places).all(axis=1)
        usable &= np.isfinite(photos.rotations).all(axis=(1, 2))
        if not usable.any():
            break
        counts = np.bincount(state.mounted[usable], minlength=len(known))
        camera = int(np.argmax(counts))
        state = _with_mounting(state, photos, np.flatnonzero(usable & (state.mounted == camera)), camera)
        known[camera] = True
    # a mounting that no photo tells stays as it is given
    known |= given
    if is_guessed:
        state, known = _in_origin(state, ~known), np.ones_like(known)
    return _with_exposures(state, photos, known)


def _in_origin(state: RigState, chosen: BoolArray) -> RigState:
    """Return the state with some of the cameras (c,), where they have no mounting yet, in the origin of their rig."""
    first: BoolArray = chosen & np.asarray(np.isnan(state.offsets).any(axis=1))
    return replace(
        state,
        offsets=np.where(first.reshape(-1, 1), 0.0, state.offsets),
        mountings=np.where(first.reshape(-1, 1, 1), np.eye(3), state.mountings),
    )


def _most_photos(state: RigState, mine: BoolArray) -> BoolArray:
    counts = np.where(mine, np.bincount(state.mounted, minlength=len(mine)), -1)
    return np.asarray(np.arange(len(mine)) == int(np.argmax(counts)))


def _with_exposures(state: RigState, photos: _Poses, known: BoolArray) -> RigState:
    rows = np.flatnonzero(known[state.mounted] & np.isfinite(photos.places).all(axis=1))
    mounted = state.mounted[rows]
    found = exposures_of_photos(
        photos.places[rows], photos.rotations[rows], state.offsets[mounted], state.mountings[mounted]
    )
    exposures, group = np.unique(state.exposure[rows], return_inverse=True)
    centres, rotations = state.centres.copy(), state.rotations.copy()
    centres[exposures], rotations[exposures] = robust_poses(*found, group, len(exposures), photos.weights[rows])
    return replace(state, centres=centres, rotations=rotations)


def _with_mounting(state: RigState, photos: _Poses, rows: IntArray, camera: int) -> RigState:
    """Return the state with the mounting of a camera from photos (k,) whose exposures are known."""
    to_rig = np.swapaxes(state.rotations[state.exposure[rows]], 1, 2)
    offsets = (to_rig @ (photos.places[rows] - state.centres[state.exposure[rows]])[:, :, None])[:, :, 0]
    new_offsets, new_mountings = state.offsets.copy(), state.mountings.copy()
    one = np.zeros(len(rows), dtype=np.int64)
    new_offsets[[camera]], new_mountings[[camera]] = robust_poses(
        offsets, to_rig @ photos.rotations[rows], one, 1, photos.weights[rows]
    )
    return replace(state, offsets=new_offsets, mountings=new_mountings)


def robust_poses(
    places: FloatArray, rotations: FloatArray, group: IntArray, count: int, weights: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return places (g, 3) and rotations (g, 3, 3) about which most poses of each group lie.

    A place is the weighted median of each coordinate. A rotation has the least weighted sum of angles, from the mean on
    (Hartley, Aftab and Trumpf 2011, *L1 rotation averaging using the Weiszfeld algorithm*).

    Parameters
    ----------
    places, rotations : arrays (n, 3) and (n, 3, 3)
    group : array (n,) of int
        From 0 to g - 1; none of them is empty.
    count : int
        g.
    weights : array (n,), optional
        Above 0; equal if they are not given.
    """
    weights = np.ones(len(group)) if weights is None else weights
    sums = np.zeros((count, 3, 3))
    np.add.at(sums, group, weights[:, None, None] * rotations)
    u, _, vt = np.linalg.svd(sums)
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    found = u @ vt
    for _ in range(_ROUNDS):
        vectors = rotation_vectors_with_partials(rotations @ np.swapaxes(found, 1, 2)[group])[0]
        weight = weights / np.maximum(np.linalg.norm(vectors, axis=1), _LEAST_ANGLE)
        moves = np.zeros((count, 3))
        np.add.at(moves, group, weight[:, None] * vectors)
        found = rotation_about_axes(moves / np.bincount(group, weight, count)[:, None]) @ found
    return _medians(places, group, count, weights), found


def _medians(places: FloatArray, group: IntArray, count: int, weights: FloatArray) -> FloatArray:
    """Return weighted medians (g, 3); the mean of two values where half of the weight is on either side."""
    totals, found = np.bincount(group, weights, count), np.empty((count, 3))
    halves = np.cumsum(totals) - 0.5 * totals
    for axis in range(3):
        order = np.lexsort((places[:, axis], group))
        ordered, sums = places[order, axis], np.cumsum(weights[order])
        first, second = (np.searchsorted(sums, halves, side) for side in _SIDES)
        found[:, axis] = (ordered[first] + ordered[second]) / 2.0
    return found
