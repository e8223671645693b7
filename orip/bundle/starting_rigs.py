"""Where exposures and mountings of rigs start: robust means of what the orientations of their photos give."""

from __future__ import annotations

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.rigs import RigState
from orip.geometry.rig import exposures_of_photos
from orip.geometry.rotation import (
    angles_from_rotation,
    rotation_about_axes,
    rotation_from_angles,
    rotation_vectors_with_partials,
)
from orip.records.block import Block
from orip.structs import replace
from orip.units import RADIANS_PER_DEGREE

_ROUNDS = 5
_Poses = tuple[FloatArray, FloatArray]
"""Places (n, 3) and rotations (n, 3, 3)."""


def starting_rigs(block: Block) -> RigState | None:
    """Return exposures and mountings at the orientations of a block's photos; None where no photo is of a rig.

    Photos that are not oriented (NaN) say nothing. What no photo tells is NaN.
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
    return _found(state, (orientation[:, :3], rotation_from_angles(orientation[:, 3:])), held, rig)


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
    rigs = starting_rigs(block)
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


def _found(state: RigState, photos: _Poses, held: BoolArray, rig: IntArray) -> RigState:
    """Return the state with what the photos tell, camera after camera; a rig begins with what is held, or given."""
    given: BoolArray = np.asarray(
        np.isfinite(state.offsets).all(axis=1) & np.isfinite(state.mountings).all(axis=(1, 2))
    )
    known: BoolArray = given & held
    for number in range(int(rig.max()) + 1):
        mine = rig == number
        if not known[mine].any():
            known |= mine & given if (mine & given).any() else _most_photos(state, mine)
    first: BoolArray = np.asarray(np.isnan(state.offsets).any(axis=1) & known)
    if first.any():  # without a reference there is any system of the rig
        state = replace(
            state,
            offsets=np.where(first.reshape(-1, 1), 0.0, state.offsets),
            mountings=np.where(first.reshape(-1, 1, 1), np.eye(3), state.mountings),
        )
    while True:
        state = _with_exposures(state, photos, known)
        placed: BoolArray = np.asarray(np.isfinite(state.centres).all(axis=1))
        usable = ~known[state.mounted] & placed[state.exposure] & np.isfinite(photos[0]).all(axis=1)
        usable &= np.isfinite(photos[1]).all(axis=(1, 2))
        if not usable.any():
            break
        counts = np.bincount(state.mounted[usable], minlength=len(known))
        camera = int(np.argmax(counts))
        state = _with_mounting(state, photos, np.flatnonzero(usable & (state.mounted == camera)), camera)
        known[camera] = True
    # a mounting that no photo tells stays as it is given
    return _with_exposures(state, photos, known | given)


def _most_photos(state: RigState, mine: BoolArray) -> BoolArray:
    counts = np.where(mine, np.bincount(state.mounted, minlength=len(mine)), -1)
    return np.asarray(np.arange(len(mine)) == int(np.argmax(counts)))


def _with_exposures(state: RigState, photos: _Poses, known: BoolArray) -> RigState:
    rows = np.flatnonzero(known[state.mounted] & np.isfinite(photos[0]).all(axis=1))
    mounted = state.mounted[rows]
    found = exposures_of_photos(photos[0][rows], photos[1][rows], state.offsets[mounted], state.mountings[mounted])
    centres, rotations = state.centres.copy(), state.rotations.copy()
    order = np.argsort(state.exposure[rows], kind="stable")
    exposures, starts = np.unique(state.exposure[rows][order], return_index=True)
    for exposure, of_it in zip(exposures.tolist(), np.split(order, starts[1:]), strict=True):
        centres[exposure], rotations[exposure] = robust_pose(found[0][of_it], found[1][of_it])
    return replace(state, centres=centres, rotations=rotations)


def _with_mounting(state: RigState, photos: _Poses, rows: IntArray, camera: int) -> RigState:
    """Return the state with the mounting of a camera from photos (k,) whose exposures are known."""
    to_rig = np.swapaxes(state.rotations[state.exposure[rows]], 1, 2)
    offsets = (to_rig @ (photos[0][rows] - state.centres[state.exposure[rows]])[:, :, None])[:, :, 0]
    new_offsets, new_mountings = state.offsets.copy(), state.mountings.copy()
    new_offsets[camera], new_mountings[camera] = robust_pose(offsets, to_rig @ photos[1][rows])
    return replace(state, offsets=new_offsets, mountings=new_mountings)


def robust_pose(places: FloatArray, rotations: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the place (3,) and the rotation (3, 3) about which most of n poses lie.

    The place is the median of each coordinate. The rotation is the one with the least sum of angles (Hartley, Trumpf,
    Dai and Li 2013, *Rotation averaging*), from the one of the poses that has the least.
    """
    place = np.median(places, axis=0)
    if len(rotations) < 3:  # the first one or, of two, the one in their middle
        start = rotations[0]
        return place, _turned(start, _vectors(rotations, start).mean(axis=0))
    some = rotations[:: max(1, len(rotations) // 50)]
    traces = np.einsum("aij,bij->ab", some, rotations)
    start = some[np.argmax(np.sqrt(np.maximum(3.0 - traces, 0.0)).sum(axis=1) * -1.0)]
    for _ in range(_ROUNDS):
        vectors = _vectors(rotations, start)
        weight = 1.0 / np.maximum(np.linalg.norm(vectors, axis=1), 1e-9)
        start = _turned(start, weight @ vectors / weight.sum())
    return place, start


def _vectors(rotations: FloatArray, start: FloatArray) -> FloatArray:
    return rotation_vectors_with_partials(rotations @ start.T)[0]


def _turned(rotation: FloatArray, vector: FloatArray) -> FloatArray:
    return np.asarray(rotation_about_axes(vector[None])[0] @ rotation)
