"""All points of one photo shifted: an error common to them, for each photo a hypothesis of its own.

It acts like a principal point of that photo alone. Its orientation absorbs nearly all of it, and heights of the terrain
or control show the rest; a rotation in the plane of the photo is absorbed altogether. The test is that of additional
parameters (Baarda 1968, *A testing procedure for use in geodetic networks*), by the residuals of the adjustment
without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.kinds.observation import partials_by_unknowns
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.solve import SolvedBlock
from orip.bundle.unknowns import CONSTANT
from orip.records.camera import CAMERA_PARAMETERS

_MOST_NUMBERS = 20_000_000
"""Of what all unknowns absorb of the shifts."""

_PRINCIPAL_POINT = slice(CAMERA_PARAMETERS.index("DX"), CAMERA_PARAMETERS.index("DY") + 1)

_ABSORBED = 1e-7
"""Part of the weight of a shift below which the unknowns absorb it."""


class ShiftTests(NamedTuple):
    """Tests of the shifts of n photos; NaN of those that the unknowns absorb.

    Attributes
    ----------
    statistic : array (n,)
        How much the square sum of the residuals, in a-priori variances, falls; chi-square on 2 degrees of freedom.
    shift, sd : arrays (n, 2)
        Of measured x and y, mm, and its standard deviation from a-priori errors.
    value : array (n, 2)
        Right-hand sides of the shifts.
    square : array (n, 2, 2)
        Their normal equations, before what the unknowns absorb.
    right, moved : arrays (2, n, u)
        What they have in common with the unknowns, and that multiplied by the cofactors of these.
    """

    statistic: FloatArray
    shift: FloatArray
    sd: FloatArray
    value: FloatArray
    square: FloatArray
    right: FloatArray
    moved: FloatArray

    def together(self, photos: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """Return the shifts (k, 2) of k photos that are all shifted, and their covariances (k, 2, 2)."""
        rows, count = list(photos), len(photos)
        shown = -np.einsum("aiu,bju->iajb", self.right[:, rows], self.moved[:, rows])
        place = np.arange(count)
        shown[place, :, place, :] += self.square[rows]
        covariance = np.linalg.inv(shown.reshape(2 * count, 2 * count))
        shift = covariance @ self.value[rows].ravel()
        return shift.reshape(count, 2), covariance.reshape(count, 2, count, 2)[place, :, place, :]


def shift_tests(solved: SolvedBlock) -> ShiftTests | None:
    """Test for each photo whether all of its points are shifted; None where the block is too large."""
    count, size = len(solved.block.photos), solved.problem.layout.size
    if 2 * count * size > _MOST_NUMBERS:
        return None
    points = solved.problem.observations[0]
    assert isinstance(points, PhotoPointObservations), "photo points are the first kind of observation"
    value, square = np.zeros((count, 2)), np.zeros((count, 2, 2))
    right, first = np.zeros((2, count, size)), 0
    weight = np.where(solved.equations.active, solved.weight_factors, 0.0)
    for part in points.in_parts():
        rows = slice(first, first + len(part.rows.error))
        first = rows.stop
        _, (partials, columns) = partials_by_unknowns(part, solved.linearised_at, solved.problem.unknowns)
        partials = partials / part.rows.error[:, None]
        # measured coordinates that are too large lower residuals, which are computed minus measured
        acts = -partials[:, _PRINCIPAL_POINT]
        weighted = weight[rows, None] * acts
        photo = np.repeat(part.photo, 2)
        np.add.at(value, photo, weighted * np.nan_to_num(solved.equations.residual[rows])[:, None])
        np.add.at(square, photo, weighted[:, :, None] * acts[:, None, :])
        touched = columns != CONSTANT
        place = (photo[:, None] * size + columns)[touched]
        for one in range(2):
            products = (partials * weighted[:, one, None])[touched]
            right[one] += np.bincount(place, products, minlength=count * size).reshape(count, size)
    moved = solved.normals.solve(right.reshape(2 * count, size).T).T.reshape(right.shape)
    # what the unknowns absorb
    shown = square - np.einsum("inu,jnu->nij", right, moved)
    shows = np.linalg.eigvalsh(shown)[:, 0] > _ABSORBED * np.einsum("nii->n", square)
    shows &= np.einsum("nii->n", square) > 0.0
    inverse = np.full_like(shown, np.nan)
    inverse[shows] = np.linalg.inv(shown[shows])
    shift = np.einsum("nij,nj->ni", inverse, value)
    statistic, sd = np.einsum("ni,ni->n", shift, value), np.sqrt(np.einsum("nii->ni", inverse))
    return ShiftTests(statistic, shift, sd, value, square, right, moved)
