"""Normal equations of a refinement without its points: photos in a band, cameras in a border (Brown 1976)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.prelim.refinement.camera_corrections import EXPECTED


class ReducedEquations(NamedTuple):
    """n equations of photos and c of cameras.

    Attributes
    ----------
    band : array (width, n)
        Diagonals of the lower half of the photos' matrix; overwritten if its columns are contiguous.
    right : array (n,)
    border : array (n, c)
    own : array (c, c)
        Of the cameras.
    own_right : array (c,)
    """

    band: FloatArray
    right: FloatArray
    border: FloatArray
    own: FloatArray
    own_right: FloatArray

    def solved(self, corrections: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the solution for photos (n,) and cameras (c,).

        Parameters
        ----------
        corrections : array (cameras, 4)
            Of the cameras so far; they are observed to be 0 with the standard deviations `EXPECTED`.

        Raises
        ------
        LinAlgError
            If the photos' matrix is not positive definite.
        """
        if not corrections.size:
            return _solved(self.band, self.right), np.empty(0)
        solved = _solved(self.band, np.asfortranarray(np.column_stack([self.right, self.border])))
        weights = np.broadcast_to(EXPECTED**-2.0, corrections.shape).ravel()
        own = self.own + np.diag(weights) - self.border.T @ solved[:, 1:]
        right = self.own_right + weights * corrections.ravel() - self.border.T @ solved[:, 0]
        of_cameras = np.asarray(np.linalg.solve(own, right), dtype=np.float64)
        return solved[:, 0] - solved[:, 1:] @ of_cameras, of_cameras


def _solved(band: FloatArray, right: FloatArray) -> FloatArray:
    from scipy.linalg.lapack import dpbsv

    if not len(right):
        return right
    _, solution, leading = dpbsv(band, right, lower=True, overwrite_ab=True)
    if leading:
        message = f"the normal equations are not positive definite at row {leading}"
        raise np.linalg.LinAlgError(message)
    return np.asarray(solution)
