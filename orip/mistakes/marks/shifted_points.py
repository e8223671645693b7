"""All points of photos shifted against their fiducial marks: the zero of the measurement changed, or the film moved.

A shift acts like a principal point of that photo alone. Its orientation absorbs nearly all of it, and heights of the
terrain or control show the rest; a rotation in the plane of the photo is absorbed altogether. The test is that of
additional parameters (Baarda 1968, *A testing procedure for use in geodetic networks*), by the residuals of the
adjustment without them, for each photo a hypothesis of its own.
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
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Misfit, fit_of_adjustment, is_good
from orip.mistakes.mistake import ALL_OF_ITS_PHOTO, BENT_PICTURES, declare
from orip.records.camera import CAMERA_PARAMETERS
from orip.structs import replace

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


SHIFTED_POINTS = declare(
    "shifted-points", "all points of a photo are shifted against its fiducial marks", ALL_OF_ITS_PHOTO, BENT_PICTURES
)

_ALPHA = 1e-3
"""Probability that any photo is accused although none is shifted."""

_MEDIAN = 2.0 * float(np.log(2.0))
"""Median of chi-square on 2 degrees of freedom."""

_MATERIAL = 5.0
"""A-priori errors of a photo coordinate that a shift is at least: less is no mistake, and harms little."""

_HIDDEN = 4.0
"""Times the limit that a statistic exceeds where none stood out before: two shifts bend all of a small block, but so do
deformed films."""

_MOST = 0.34
"""Part of the photos that may be shifted; of more it cannot be told which are."""

_PASSES = 2
"""Times that every one of them is corrected on the average: what is down-weighted at first shows too little."""


def shifted_points(misfit: Misfit) -> list[ProjectWarning]:
    """Return that the points of photos with fiducial marks are shifted, if all fits once they are moved back.

    They are found one after the other, each beside those found before.
    """
    solved, readjuster = misfit.solved, misfit.readjuster
    block = readjuster.block
    is_of_marks = np.array([bool(block.cameras[row].fiducials) for row in block.photo_camera])
    if not (solved.converged and readjuster.is_worthwhile and is_of_marks.any()):
        return []
    limit = -2.0 * float(np.log(_ALPHA / len(is_of_marks)))
    most = max(1, int(_MOST * len(is_of_marks)))
    least = _MATERIAL * float(np.median(block.photo_points.error))
    correction, shifted = np.zeros((len(is_of_marks), 2)), list[int]()
    stood_out = False
    for _ in range(_PASSES * most + 1):
        tests = shift_tests(solved)
        if tests is None:
            return []
        statistic = np.where(is_of_marks, np.nan_to_num(tests.statistic), 0.0)
        photo = int(np.argmax(statistic))
        stands_out = bool(statistic[photo] > limit * _scale(tests, solved))
        stood_out |= stands_out
        is_left = statistic[photo] > limit and np.linalg.norm(tests.shift[photo]) > least
        if not (stands_out and is_left):
            named = _named(solved, shifted, correction, tests, limit if stood_out else _HIDDEN * limit)
            if named or not is_left:
                return named
        if photo not in shifted:
            shifted.append(photo)
        if len(shifted) > most:
            return []
        correction[shifted] += tests.together(shifted)[0]
        points = block.photo_points
        moved = readjuster.adjust(replace(block, photo_points=replace(points, xy=points.xy - correction[points.photo])))
        if moved is None:
            return []
        solved = moved
    return []


def _named(
    solved: SolvedBlock, shifted: Sequence[int], correction: FloatArray, tests: ShiftTests, limit: float
) -> list[ProjectWarning]:
    """Return a warning for each photo that is moved back in an adjustment, if all then fits, and each is needed."""
    if not (shifted and is_good(fit_of_adjustment(solved))):
        return []
    remaining, covariance = tests.together(shifted)
    shift, scale = correction[shifted] + remaining, _scale(tests, solved)
    if (np.einsum("ka,kab,kb->k", shift, np.linalg.inv(covariance), shift) < limit * scale).any():
        return []
    sd = np.sqrt(scale * np.einsum("kaa->ka", covariance))
    return [
        ProjectWarning(SHIFTED_POINTS, f"photo {solved.block.photos[photo].name}", _text(*found))
        for photo, *found in sorted(zip(shifted, shift, sd, strict=True))
    ]


def _text(shift: FloatArray, sd: FloatArray) -> str:
    sizes = ", ".join(f"{axis} {size:+.2g} ± {own:.1g}" for axis, size, own in zip("xy", shift, sd, strict=True))
    return (
        f"all of its points are off by {sizes} mm against its fiducial marks, and fit without that: the zero of the "
        "measurement changed between marks and points, or the film moved; measure its marks and its points again"
    )


def _scale(tests: ShiftTests, solved: SolvedBlock) -> float:
    """Return the variance that most statistics have: films are deformed."""
    usual = float(np.median(np.nan_to_num(tests.statistic))) / _MEDIAN
    return max(1.0, usual, solved.deviation_scale**2)
