"""A-priori errors in another unit than they should be: observations that fit a thousand times better than promised.

Too small an error shows as a large sigma0, and has many causes. Too large an error shows as residuals that are small
throughout, and has but one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.records.block import Block
from orip.records.solution import Solution

_TOO_GOOD = 0.2
"""Standard residuals that small are not caution: nobody takes errors for five times what they are."""

_UNLIKELY = 1e-6
_FEWEST = 3.0
"""Redundancy from which on a kind of observation is judged."""

_NEAR = 4.0
"""Factor within which a unit explains it."""

_MILLI = 1e-3


def errors_too_large(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each kind of observation whose residuals are far smaller than its a-priori errors."""
    return [*_photos(block, solution), *_control(solution)]


def _photos(block: Block, solution: Solution) -> Iterator[ProjectWarning]:
    factor = _factor(solution, "photo")
    if factor is None:
        return
    precision = block.definition.measurement_precision
    text = (
        f"measurement_precision = {_written(precision.value, precision.unit)} is {1.0 / factor:.3g} times larger than "
        "the residuals"
    )
    if precision.unit == "mm":
        pixel = _pixel(block)
        if pixel is not None:
            text += f" ({precision.value / pixel:.3g} pixels); write '{precision.value:g}px' if pixels are meant"
        elif _explains(_MILLI, factor):
            text += f"; it is in mm: write {precision.value * _MILLI:g} if {precision.value:g} µm are meant"
    yield ProjectWarning("error-unit", f"bundle {block.definition.name}", f"{text}; correct it")


def _control(solution: Solution) -> Iterator[ProjectWarning]:
    factor = _factor(solution, "control")
    if factor is None:
        return
    unit = solution.ground_unit
    text = f"control points fit {1.0 / factor:.3g} times better than their a-priori errors promise"
    if _explains(_MILLI, factor):
        text += f": these seem to be in mm; write them in {unit}, the unit of the coordinates"
    else:
        text += f"; check them, they are in {unit}"
    yield ProjectWarning("error-unit", "control file", text)


def _factor(solution: Solution, kind: str) -> float | None:
    """Return the standard error of unit weight of a kind of observation where it is far below 1, else None."""
    from scipy.special import gammainc  # takes its time; few adjustments need it

    rows = solution.residuals
    mine = (np.array(rows.kind) == kind) & (rows.weight_factor >= 1.0)
    redundancy = float(np.sum(rows.redundancy_number[mine]))
    square_sum = float(np.sum(rows.standard_residual[mine] ** 2))
    if redundancy < _FEWEST or square_sum >= _TOO_GOOD**2 * redundancy:
        return None
    if gammainc(redundancy / 2.0, square_sum / 2.0) > _UNLIKELY:
        return None
    return float(np.sqrt(square_sum / redundancy)) or None


def _explains(unit: float, factor: float) -> bool:
    """Tell whether a unit makes residuals and errors alike."""
    return bool(1.0 / _NEAR < factor / unit < _NEAR)


def _written(value: float, unit: str) -> str:
    return f"'{value:g}px'" if unit == "px" else f"{value:g} mm"


def _pixel(block: Block) -> float | None:
    sensors = [camera.sensor for camera in block.cameras if camera.sensor is not None]
    return sensors[0].width / sensors[0].columns if sensors else None
