"""The residuals of photo points as vectors, photo by photo."""

from __future__ import annotations

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
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
    def sound_xy(self) -> FloatArray:
        """Return the measured coordinates (k, 2) of the sound points, mm."""
        return self.xy if self.sound.all() else self.xy[self.sound]

    @property
    def sound_residual(self) -> FloatArray:
        """Return the residuals (k, 2) of the sound points, mm."""
        return self.residual if self.sound.all() else self.residual[self.sound]


def photo_vectors(residuals: Residuals) -> dict[str, PhotoVectors]:
    """Return the residual vectors of each photo that has photo points; x and y are in successive rows."""
    rows = np.flatnonzero(coded(residuals.kind).where(PHOTO_POINT.name.__eq__))[::2]
    photo = coded(residuals.photo)[rows]
    if (photo.codes[1:] < photo.codes[:-1]).any():  # mostly measured photo by photo
        order = np.argsort(photo.codes, kind="stable")
        rows, photo = rows[order], photo[order]
    xy, residual, weight = (
        _in_pairs(values, rows) for values in (residuals.observed, residuals.residual, residuals.weight_factor)
    )
    sound = (weight == 1.0).all(axis=1)
    start = np.append(0, np.cumsum(np.bincount(photo.codes, minlength=len(photo.distinct)))).tolist()
    return {
        name: PhotoVectors(name, xy[first:last], residual[first:last], sound[first:last])
        for name, first, last in zip(photo.distinct, start[:-1], start[1:], strict=True)
        if first < last
    }


def _in_pairs(values: FloatArray, rows: IntArray) -> FloatArray:
    """Return the values (n, 2) in rows (n,) and those after them; as they lie where they follow each other."""
    if len(rows) and (np.diff(rows) == 2).all():
        return values[rows[0] : rows[-1] + 2].reshape(-1, 2)
    return values[np.stack([rows, rows + 1], axis=1)]
