"""Distances and check points in another unit or system: all differ from the adjustment in the same way.

A blunder is one observation. Where all distances are wrong by the same factor, or all check points by the same amount,
their unit or coordinate system is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.length_units import LENGTH_UNITS
from orip.records.solution import Solution

_LENGTH_ALIKE = 0.01
"""Relative difference within which a factor is recognised: wrong distances may have changed the scale of the block."""

_DOUBTED = 5.0
"""Standard residual from which an observation does not fit."""

_TOGETHER = 0.1
"""Largest standard deviation of differences that are the same, as part of their mean."""

_FEWEST = 2
"""Check points that may agree by chance; more are needed."""

_SYSTEMS = {
    "X": "coordinate system",
    "Y": "coordinate system",
    "Z": "height system (above the ellipsoid, above the geoid)",
}


def units_of_observations(solution: Solution) -> list[ProjectWarning]:
    """Return a warning if the distances are in another unit, and if the check points are in another system."""
    return [*_distances(solution), *_check_points(solution)]


def _distances(solution: Solution) -> Iterator[ProjectWarning]:
    rows = solution.residuals
    wrong = np.array([kind.endswith("distance") for kind in rows.kind]) & (rows.standard_residual > _DOUBTED)
    if not wrong.any():
        return
    observed = rows.observed[wrong]
    ratios = (observed + rows.residual[wrong]) / observed
    factor = min(LENGTH_UNITS, key=lambda unit: float(np.median(np.abs(np.log(np.abs(ratios) / unit)))))
    fits = np.abs(ratios / factor - 1.0) < _LENGTH_ALIKE
    if not fits.all():
        return
    unit, other = LENGTH_UNITS[factor]
    names = ", ".join(name for name, chosen in zip(rows.point, wrong, strict=True) if chosen)
    text = (
        f"the distances fit when they are multiplied by {factor:.5g} ({names}): they seem to be in {unit}, and the "
        f"control in {other}; write both in one unit, and correct the one that is wrong"
    )
    yield ProjectWarning("distance-unit", "control files", text)


def _check_points(solution: Solution) -> Iterator[ProjectWarning]:
    """Yield a warning for each coordinate in which all check points differ by the same amount."""
    points = solution.check_points
    if len(points) <= _FEWEST:
        return
    place = {name: row for row, name in enumerate(solution.points.names)}
    sd = solution.points.sd[[place[point.name] for point in points]]
    differences = np.array([(point.dX, point.dY, point.dZ) for point in points])
    for axis, kind in enumerate("XYZ"):
        mean, spread = float(differences[:, axis].mean()), float(differences[:, axis].std(ddof=1))
        if not (spread < _TOGETHER * abs(mean) and abs(mean) > _DOUBTED * float(sd[:, axis].max())):
            continue
        text = (
            f"all {len(points)} are given {abs(mean):.3f} {solution.ground_unit} too {'low' if mean > 0 else 'high'} "
            f"in {kind} (standard deviation {spread:.2g}): they are probably in another {_SYSTEMS[kind]} than the "
            "control points; use one system for both"
        )
        yield ProjectWarning("check-point-system", "check points", text)
