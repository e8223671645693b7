"""All points of a photo shifted against its fiducial marks: the zero of the measurement changed, or the film moved."""

from __future__ import annotations

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.groups.shifted_photos import ShiftTests, shift_tests
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Misfit, fit_of_adjustment, is_good
from orip.mistakes.mistake import ALL_OF_ITS_PHOTO, BENT_PICTURES, declare
from orip.structs import replace

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
