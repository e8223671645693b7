"""Distances and check points that differ from the adjustment by one and the same amount: another unit or system.

A blunder is one observation. Where all of a kind are wrong by one factor or one difference, it is not they that are
wrong, but what they are counted in.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.records.solution import Solution

_FOOT = 0.3048
_FACTORS = {
    _FOOT: "feet, and the control in metres",
    1.0 / _FOOT: "metres, and the control in feet",
    1e-3: "millimetres, and the control in metres",
    1e-2: "centimetres, and the control in metres",
    1e2: "metres, and the control in centimetres",
    1e3: "metres, and the control in millimetres",
}
_LENGTH_ALIKE = 0.01
"""Of a factor: a foot is known better, the scale of a block that a wrong length has pulled at may not be."""

_DOUBTED = 5.0
"""Standard residuals from which on an observation does not fit."""

_TOGETHER = 0.1
"""Spread of differences, as part of their mean, below which they are one and the same."""

_FEWEST = 2
"""Check points that may agree by chance."""

_SYSTEMS = {
    "X": "coordinate system",
    "Y": "coordinate system",
    "Z": "height system (above the ellipsoid, above the geoid)",
}


def units_of_observations(solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each kind of observation that is wrong as a whole."""
    return [*_distances(solution), *_check_points(solution)]


def _distances(solution: Solution) -> Iterator[ProjectWarning]:
    rows = solution.residuals
    mine = np.array([kind.endswith("distance") for kind in rows.kind]) & (rows.standard_residual > _DOUBTED)
    if not mine.any():
        return
    observed = rows.observed[mine]
    ratios = (observed + rows.residual[mine]) / observed
    factor = min(_FACTORS, key=lambda each: float(np.median(np.abs(np.log(np.abs(ratios) / each)))))
    fits = np.abs(ratios / factor - 1.0) < _LENGTH_ALIKE
    if not fits.all():
        return
    names = ", ".join(name for name, chosen in zip(rows.point, mine, strict=True) if chosen)
    text = (
        f"the distances fit when they are multiplied by {factor:.5g} ({names}): they seem to be in {_FACTORS[factor]}; "
        "write both in one unit, and correct the one that is wrong"
    )
    yield ProjectWarning("distance-unit", "control files", text)


def _check_points(solution: Solution) -> Iterator[ProjectWarning]:
    """Say so when all check points differ in a coordinate by one amount."""
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
            f"in {kind}, within {spread:.2g}: they are probably in another {_SYSTEMS[kind]} than the control points; "
            "take both from one system"
        )
        yield ProjectWarning("check-point-system", "check points", text)
