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
    """Return the unknowns (n, j + 12) that observations touch, for columns (n, j) with elements of rigs' photos."""
    if rigs is None:
        return columns
    row, _, of_rig = _elements(columns, rigs)
    further = np.full((len(columns), 2 * ELEMENTS), _NONE, dtype=columns.dtype)
    further[row] = rigs.of_photos[of_rig]
    return np.hstack([np.where(columns >= rigs.first, _NONE, columns), further])


def chained(
    partials: FloatArray, columns: IntArray, rigs: RigColumns | None, by_unknowns: FloatArray | None
) -> Chained:
    """Return partials by unknowns alone: those by elements of rigs' photos multiplied by theirs.

    Parameters
    ----------
    partials, columns : arrays (n, j)
        An observation depends on one photo at most.
    rigs : RigColumns or None
    by_unknowns : array (k, 6, 12) or None
        As of `partials_of_photos`.
    """
    if rigs is None or by_unknowns is None:
        return Chained(partials, columns)
    row, place, of_rig = _elements(columns, rigs)
    further = np.zeros((len(columns), 2 * ELEMENTS))
    element = (columns[row, place] - rigs.first) % ELEMENTS
    np.add.at(further, row, partials[row, place, None] * by_unknowns[of_rig, element])
    return Chained(np.hstack([partials, further]), columns_by_rigs(columns, rigs))


def _elements(columns: IntArray, rigs: RigColumns) -> tuple[IntArray, IntArray, IntArray]:
    """Return rows and places of the elements of rigs' photos, and which of these photos (k,) they are of."""
    row, place = np.nonzero(columns >= rigs.first)
    return row, place, (columns[row, place] - rigs.first) // ELEMENTS
