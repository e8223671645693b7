"""Control and check points that are all too high or too low by the same amount, beside exposure stations."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.wording import counted_names

HEIGHT_SYSTEM = "height-system"

OF_HEIGHT_SYSTEMS = "the heights of the control and of the stations are in different height systems"
"""What the status says."""

_FEWEST = 3
"""Points that do not agree by chance."""

_ALIKE = 0.02
"""Largest standard deviation of the differences, as a part of their mean."""

_LEAST, _MOST = 1.0, 120.0
"""Metres: heights of the geoid above the ellipsoid are between -107 and 86; less than the first is no height system."""


def control_in_another_height_system(block: Block, solution: Solution) -> Iterator[ProjectWarning]:
    """Yield a warning if the stations contradict the heights of all points on the ground by the same amount.

    Parameters
    ----------
    block : Block
        As gathered.
    solution : Solution
    """
    observed = any(element.group == "PHOTO" and element.kind == "Z0" for element in block.elements)
    if not (observed or any(station.has_position for station in block.stations)) or block.ground_unit != "m":
        return
    rows = solution.residuals
    of_control = {
        point: (residual, weight)
        for kind, point, component, residual, weight in zip(
            rows.kind, rows.point, rows.component, rows.residual.tolist(), rows.weight_factor.tolist(), strict=True
        )
        if kind == "control" and component == "Z" and weight >= 0.0
    }
    # single ones without weight may be wrong by themselves; all of them contradict the stations
    single = any(weight > 0.0 for _, weight in of_control.values())
    off = {point: residual for point, (residual, weight) in of_control.items() if weight > 0.0 or not single}
    control = list(off)
    off |= {point.name: point.dZ for point in solution.check_points if np.isfinite(point.dZ)}
    differences = np.array(list(off.values()))
    if not control or len(differences) < _FEWEST:
        return
    mean, spread = float(differences.mean()), float(differences.std(ddof=1))
    if not (_LEAST < abs(mean) < _MOST and spread < _ALIKE * abs(mean)):
        return
    also = ", and so are the check points" if len(differences) > len(control) else ""
    text = (
        f"they are given {abs(mean):.2f} m too {'low' if mean > 0.0 else 'high'} in Z (standard deviation "
        f"{spread:.2g}){also}, compared with the exposure stations: their heights and those of the stations are "
        "probably in different height systems (above the ellipsoid, above the geoid); use one for both"
    )
    yield ProjectWarning(HEIGHT_SYSTEM, counted_names("control point", control), text)
