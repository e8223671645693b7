"""A relative orientation whose residuals are large only because of wrong points near the epipolar lines.

These fit a bent model better than chance explains, and the scale of the residuals follows them. From there the scale is
lowered as long as the points that fit it have smaller residuals than it says.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from orip.geometry.essential import TwoPhotos
from orip.prelim.relative.adjustment import MAX_STANDARD_RESIDUAL, adjust_relative
from orip.prelim.relative.parallax import Pairs, meeting_points
from orip.prelim.relative.solution import PairSolution, intersection_deviations, usable_points
from orip.prelim.relative.start import POINTS_NEEDED

_LIMIT, _OF_KEPT = 3.0, 0.986
"""Residuals over the scale up to which points count, and the standard deviation of normal errors cut off there."""

_ITERATIONS, _MOST = 5, 20

_STEADY = 0.95
"""Ratio of scales from which no more is to be gained."""


def annealed(solution: PairSolution, pairs: Pairs) -> PairSolution:
    """Return the orientation that fits the points at the least scale, begun at one that fits them at a larger scale.

    Standard deviations of the orientation and redundancy numbers stay those of the first one.
    """
    scale, photos = solution.scale, TwoPhotos(solution.photos.base[None], solution.photos.rotation[None])
    for _ in range(_MOST):
        found = adjust_relative(photos, pairs, scale * _LIMIT / MAX_STANDARD_RESIDUAL, _ITERATIONS)
        photos, residuals = found.photos, found.residuals(pairs)[0]
        kept = residuals <= _LIMIT * scale
        redundancy = np.count_nonzero(kept) - POINTS_NEEDED
        if redundancy <= 0:
            break
        lower = max(float(np.sqrt((residuals[kept] ** 2).sum() / redundancy)) / _OF_KEPT, 1.0)
        if lower > _STEADY * scale:
            break
        scale = lower
    best = TwoPhotos(photos.base[0], photos.rotation[0])
    meeting = meeting_points(best, pairs)
    usable = usable_points(meeting, found.weight_factor[0])
    return replace(
        solution,
        photos=best,
        parallax=found.parallax[0],
        weight_factor=found.weight_factor[0],
        coordinates=meeting.coordinates,
        deviations=intersection_deviations(best, meeting.coordinates, usable, pairs),
        in_front=meeting.in_front,
        usable=usable,
        scale=scale,
        seuw=scale,
    )
