"""All points of photos shifted against its fiducial marks: the zero of the measurement changed, or the film moved."""

from __future__ import annotations

from collections.abc import Sequence

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
