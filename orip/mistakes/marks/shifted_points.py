"""All points of a photo shifted against its fiducial marks: the zero of the measurement changed, or the film moved.

A shift acts like a principal point of that photo alone. Its orientation absorbs nearly all of it, and heights of the
terrain or control show the rest; a rotation in the plane of the photo is absorbed altogether. The test is that of
additional parameters (Baarda 1968, *A testing procedure for use in geodetic networks*), by the residuals of the
adjustment without them, for each photo a hypothesis of its own.
"""

from __future__ import annotations

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
    """

    statistic: FloatArray
    shift: FloatArray
    sd: FloatArray


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
    return ShiftTests(np.einsum("ni,ni->n", shift, value), shift, np.sqrt(np.einsum("nii->ni", inverse)))


SHIFTED_POINTS = declare(
    "shifted-points", "all points of a photo are shifted against its fiducial marks", ALL_OF_ITS_PHOTO, BENT_PICTURES
)

_ALPHA = 1e-3
"""Probability that any photo is accused although none is shifted."""

_MEDIAN = 2.0 * float(np.log(2.0))
"""Median of chi-square on 2 degrees of freedom."""

_MATERIAL = 5.0
"""A-priori errors of a photo coordinate that a shift is at least: less is no mistake, and harms little."""

_LEFT = 0.25
"""Part of its statistic that another photo may keep where one explains the misfit."""


def shifted_points(misfit: Misfit) -> list[ProjectWarning]:
    """Return that the points of one photo with fiducial marks are shifted, if all fits once they are moved back."""
    solved, readjuster = misfit.solved, misfit.readjuster
    block = readjuster.block
    if not (solved.converged and readjuster.is_worthwhile and any(camera.fiducials for camera in block.cameras)):
        return []
    tests = shift_tests(solved)
    if tests is None:
        return []
    statistic = _scaled(tests, solved)
    photo = int(np.argmax(statistic))
    rows = block.photo_points.photo == photo
    shift, sd = tests.shift[photo], tests.sd[photo] * solved.deviation_scale
    error = float(np.median(block.photo_points.error[rows]))
    is_of_marks = bool(block.cameras[block.photo_camera[photo]].fiducials)
    limit = -2.0 * np.log(_ALPHA / len(statistic))
    if not (is_of_marks and statistic[photo] > limit and np.linalg.norm(shift) > _MATERIAL * error):
        return []
    xy = block.photo_points.xy - np.where(rows[:, None], shift, 0.0)
    moved = readjuster.adjust(replace(block, photo_points=replace(block.photo_points, xy=xy)))
    if moved is None or not is_good(fit_of_adjustment(moved)):
        return []
    again = shift_tests(moved)
    if again is None or _scaled(again, moved).max() > max(limit, _LEFT * statistic[photo]):
        return []
    sizes = ", ".join(f"{axis} {size:+.2g} ± {own:.1g}" for axis, size, own in zip("xy", shift, sd, strict=True))
    text = (
        f"all of its points are off by {sizes} mm against its fiducial marks, and fit without that: the zero of the "
        "measurement changed between marks and points, or the film moved; measure its marks and its points again"
    )
    return [ProjectWarning(SHIFTED_POINTS, f"photo {block.photos[photo].name}", text)]


def _scaled(tests: ShiftTests, solved: SolvedBlock) -> FloatArray:
    """Return the statistics (n,) over the variance that most of them have: films are deformed."""
    statistic = np.nan_to_num(tests.statistic)
    usual = float(np.median(statistic)) / _MEDIAN
    return np.asarray(statistic / max(1.0, usual, solved.deviation_scale**2))
