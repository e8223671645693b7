"""Photos of rigs in a block: their orientations from exposures and mountings, and what their elements depend on.

Observations have partials by the six elements of a photo. Those of a rig's photo are no unknowns: their numbers come
after all unknowns, and partials by them are multiplied by the photo's partials by its exposure and its mounting.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray, IntArray
from orip.geometry.rig import RigPhotos, photos_with_partials
from orip.geometry.rotation import rotation_about_axes
from orip.structs import replace

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
