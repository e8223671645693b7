"""The residuals of photo points as vectors, photo by photo."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray
from orip.records.coded_names import coded
from orip.records.observations.observation_kinds import PHOTO_POINT
from orip.records.results.solution import Residuals


class PhotoVectors(Struct, frozen=True):
    """Residual vectors of n photo points.

    Parameters
    ----------
    photo : str
    xy, residual : arrays (n, 2), mm
        Measured coordinates, and adjusted minus measured ones.
    sound : array (n,) of bool
        Neither component is down-weighted or disregarded.
    """

    photo: str
    xy: FloatArray
    residual: FloatArray
    sound: NDArray[np.bool_]

    @property
    def rms(self) -> float:
        """Return the root mean square (mm) of the components of the sound points, 0 where there are none."""
        sound = self.sound_residual
        return float(np.sqrt(np.vdot(sound, sound) / sound.size)) if sound.size else 0.0

    @property
    def sound_residual(self) -> FloatArray:
        """Return the residuals (k, 2) of the sound points, mm."""
        return self.residual if self.sound.all() else self.residual[self.sound]


def photo_vectors(residuals: Residuals) -> dict[str, PhotoVectors]:
    """Return the residual vectors of each photo that has photo points; x and y are in successive rows."""
    rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
    pairs = np.stack([rows, rows + 1], axis=1)
    sound = (residuals.weight_factor[pairs] == 1.0).all(axis=1)
    photo = coded(residuals.photo)[rows]
    count = np.bincount(photo.codes, minlength=len(photo.distinct))
    members = np.split(np.argsort(photo.codes, kind="stable"), np.cumsum(count)[:-1])
    of_photo = dict(zip(photo.distinct, members, strict=False))  # without photos there is still one part
    return {
        name: PhotoVectors(name, residuals.observed[pairs[mine]], residuals.residual[pairs[mine]], sound[mine])
        for name, mine in ((name, of_photo[name]) for name in photo.occurring())
    }
