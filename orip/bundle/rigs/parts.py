"""Parts of a block that only rigs tie to the ground: placed where the exposures of other parts have them.

Photos of a part share too few points with others. With the rotation R and the centre E of an exposure, known
from other parts, a camera with the mounting M, o has a photo of the rotation B and the place x in a part of its own::

    R M = S B,    E + R o = s S x + t

M, S are the vector of the smallest singular value of these equations, o, s, t then follow linearly (the hand-eye
calibration of Tsai and Lenz 1989, here with the scale of the part).
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.rigs.starting import RigState, oriented_by_rigs, starting_rigs
from orip.geometry.projection import PROJECTIONS
from orip.geometry.rotation import angles_from_rotation, rotation_from_angles
from orip.records.block import Block
from orip.structs import replace

_COMMON = 5
"""Points by which a photo belongs to others: as many as a relative orientation needs."""

_LEAST_COSINE = 0.995
"""Of the angle, 6 degrees, between a ray and the place of its point: distortion is not taken into account."""

_FEWEST = 3
"""Exposures, control points or stations that place a part."""

_SEPARATE = 3.0
"""By so much the second smallest singular value is above the smallest where the rotations tell the mounting."""

_SMALL_OFFSET = 1e-3
"""Weight of the offset as zero: where exposures do not turn about all axes, it is not told from the place."""

_MISFIT = 3.0
"""Medians of the residuals beyond which an exposure is left out."""


class PlacedParts(NamedTuple):
    """A block with parts placed by rigs, and which of its points (p,) are seen in these parts alone."""

    block: Block
    moved: BoolArray


def with_parts_on_rigs(block: Block, places: FloatArray) -> PlacedParts:
    """Return the block with each part that nothing else ties to the ground where rigs have it.

    Parameters
    ----------
    block : Block
        With orientations (NaN where there are none), each part in a system of its own if nothing ties it.
    places : array (p, 3)
        Of the points where these orientations have them, NaN where they are not known: what a photo shows elsewhere
        does not tie it to others.
    """
    nothing = np.zeros(len(block.point_names), dtype=bool)
    if not block.places_on_rigs().photos:
        return PlacedParts(block, nothing)
    part = _parts(block, _fit(block, places))
    loose = np.flatnonzero(~_tied(block, part))
    if not loose.size:
        return PlacedParts(block, nothing)
    given = block.photo_orientation
    placed = np.where(np.isin(part, loose)[:, None], np.nan, given)
    for number in sorted(loose.tolist(), key=lambda one: -np.count_nonzero(part == one)):
        mine = np.flatnonzero(part == number)
        placed = oriented_by_rigs(replace(block, photo_orientation=placed)).photo_orientation
        if np.isnan(placed[mine]).any():
            state = starting_rigs(replace(block, photo_orientation=placed), is_guessed=False)
            own = None if state is None else _placed(block, mine, state)
            placed[mine] = given[mine] if own is None else own
    changed = (placed != block.photo_orientation).any(axis=1) & ~np.isnan(block.photo_orientation).any(axis=1)
    points = nothing.copy()
    points[block.photo_points.point[changed[block.photo_points.photo]]] = True
    return PlacedParts(replace(block, photo_orientation=placed), points)


def _fit(block: Block, places: FloatArray) -> BoolArray:
    """Return which of the rays (n,) point at the places of their points."""
    rays = block.photo_points
    orientation, camera = block.photo_orientation[rays.photo], block.photo_camera[rays.photo]
    towards = places[rays.point] - orientation[:, :3]
    seen = np.einsum("nji,nj->ni", rotation_from_angles(orientation[:, 3:]), towards)
    measured = np.full(seen.shape, np.nan)
    for number, one in enumerate(block.cameras):
        rows = camera == number
        c, x0, y0 = one.parameters[:3]
        measured[rows] = np.column_stack(PROJECTIONS[one.projection].image_vector(c, *(rays.xy[rows] - (x0, y0)).T))
    with np.errstate(invalid="ignore"):
        cosine = np.einsum("ni,ni->n", seen, measured)
        cosine /= np.linalg.norm(seen, axis=1) * np.linalg.norm(measured, axis=1)
    return np.asarray(cosine > _LEAST_COSINE)


def _parts(block: Block, fits: BoolArray) -> IntArray:
    """Return the part (n,) of each photo: a photo of a part has five points at least that others of the part show."""
    photos, rays = len(block.photos), block.photo_points.of(np.flatnonzero(fits))
    shape = (photos, len(block.point_names))
    shown = coo_array((np.ones(len(rays.photo), dtype=np.int64), (rays.photo, rays.point)), shape=shape).tocsr()
    shown.data[:] = 1  # a point may be measured twice in a photo
    part = np.full(photos, -1)
    counts = shown.sum(axis=1)
    for number in range(photos):
        free = part < 0
        if not free.any():
            break
        joins = np.arange(photos) == int(np.argmax(np.where(free, counts, -1)))
        while joins.any():
            part[joins] = number
            seen = (shown[part == number].sum(axis=0) > 0).astype(np.int64)
            joins = (part < 0) & (shown @ seen >= _COMMON)
    return part


def _tied(block: Block, part: IntArray) -> BoolArray:
    """Return which parts control or stations tie to the ground; where there are none, the largest."""
    count = int(part.max()) + 1
    full = {point.name for point in block.control_points if point.kind == "control" and None not in point.coordinates}
    known = np.array([name in full for name in block.point_names], dtype=bool)
    rays = block.photo_points
    pairs = np.unique(np.stack([part[rays.photo], rays.point], axis=1)[known[rays.point]], axis=0)
    of_photo = {photo.name: n for n, photo in enumerate(block.photos)}
    stations = [of_photo[one.photo] for one in block.stations if one.has_position and one.photo in of_photo]
    tied = np.bincount(pairs[:, 0], minlength=count) >= _FEWEST
    tied |= np.bincount(part[np.array(stations, dtype=np.int64)], minlength=count) >= _FEWEST
    constant = np.array([len(photo.constant) > 0 for photo in block.photos])
    tied |= np.bincount(part, constant, count) > 0
    if not tied.any():
        tied[int(np.argmax(np.bincount(part)))] = True
    return np.asarray(tied)


def _placed(block: Block, mine: IntArray, state: RigState) -> FloatArray | None:
    """Return the orientations of the photos of a part on the ground; None where its exposures do not tell."""
    place, rotation = block.photo_orientation[:, :3], rotation_from_angles(block.photo_orientation[:, 3:])
    for rows in _of_cameras(mine, state, place):
        photo, exposure = state.photo[rows], state.exposure[rows]
        found = _similarity(state.rotations[exposure], state.centres[exposure], rotation[photo], place[photo])
        if found is not None:
            turn, scale, shift = found
            centres = scale * place[mine] @ turn.T + shift
            return np.hstack([centres, angles_from_rotation(turn @ rotation[mine])])
    return None


def _of_cameras(mine: IntArray, state: RigState, place: FloatArray) -> Iterator[IntArray]:
    """Yield the rows of photos of each camera whose exposures are known, those of most photos first."""
    usable = np.isin(state.photo, mine) & np.isfinite(state.centres[state.exposure]).all(axis=1)
    usable &= np.isfinite(place[state.photo]).all(axis=1)
    counts = np.bincount(state.mounted[usable], minlength=len(state.offsets))
    for camera in np.argsort(-counts, kind="stable"):
        if counts[camera] >= _FEWEST:
            yield np.flatnonzero(usable & (state.mounted == camera))


def _similarity(
    bodies: FloatArray, centres: FloatArray, photos: FloatArray, places: FloatArray
) -> tuple[FloatArray, float, FloatArray] | None:
    """Return S, s, t of a part from n exposures and its photos of one camera; None where they do not tell."""
    kept, turn, solution = np.ones(len(bodies), dtype=bool), None, np.zeros(7)
    for _ in range(2):
        turn = _turn(bodies[kept], photos[kept])
        if turn is None:
            return None
        solution, misfit = _scale_and_shift(bodies, centres, places @ turn.T, kept)
        kept = misfit <= _MISFIT * float(np.median(misfit)) + 1e-12
        if kept.sum() < _FEWEST or solution[3] <= 0.0:
            return None
    return None if turn is None else (turn, float(solution[3]), solution[4:])


def _turn(bodies: FloatArray, photos: FloatArray) -> FloatArray | None:
    """Return S of R M = S B; None where the exposures turn too little to tell it."""
    rows = [
        np.hstack([np.kron(np.eye(3), body), -np.kron(photo.T, np.eye(3))])
        for body, photo in zip(bodies, photos, strict=True)
    ]
    _, sizes, right = np.linalg.svd(np.vstack(rows), full_matrices=False)
    if sizes[-2] < _SEPARATE * sizes[-1]:
        return None
    mounting = right[-1, :9].reshape(3, 3, order="F")
    mounting = _nearest(mounting if np.linalg.det(mounting) > 0.0 else -mounting)
    return _nearest(np.einsum("nij,jk,nlk->il", bodies, mounting, photos))


def _nearest(matrix: FloatArray) -> FloatArray:
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def _scale_and_shift(
    bodies: FloatArray, centres: FloatArray, turned: FloatArray, kept: BoolArray
) -> tuple[FloatArray, FloatArray]:
    """Return o, s and t (7,) from the exposures that are kept, and the misfits (n,) of all."""
    unit = np.broadcast_to(np.eye(3), bodies.shape)
    middle = centres[kept].mean(axis=0)
    rows = np.concatenate([-bodies, turned[:, :, None], unit], axis=2)
    right = centres - middle
    weak = _SMALL_OFFSET * np.eye(7)[:3]
    solution = np.linalg.lstsq(
        np.vstack([rows[kept].reshape(-1, 7), weak]), np.append(right[kept].ravel(), np.zeros(3)), rcond=None
    )[0]
    misfit = np.linalg.norm(rows @ solution - right, axis=1)
    solution[4:] += middle
    return solution, misfit
