"""A-priori errors that are far too large, mostly by a wrong unit: residuals are far smaller than they promise.

Errors that are too small show as a large sigma0, which has many causes. Errors that are too large show as residuals
that are small throughout, which has only this one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.length_units import smallest_pixel
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.results.solution import Solution

_TOO_GOOD = 0.2
"""Standard error of unit weight below which caution is not the cause: nobody assumes errors five times too large."""

_UNLIKELY = 1e-6
"""Probability of residuals so small by chance."""

_FEWEST = 3.0
"""Least redundancy with which a kind of observation is judged."""

_NEAR = 4.0
"""Factor up to which errors in the right unit may still differ from the residuals."""

_MILLI = 1e-3


def errors_too_large(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each kind of observation whose residuals are far smaller than its a-priori errors."""
    return [*_photos(block, solution), *_control(solution)]


def _photos(block: Block, solution: Solution) -> Iterator[ProjectWarning]:
    factor = _factor(solution, "photo")
    if factor is None:
        return
    precision = block.definition.measurement_precision
    written = f"'{precision.value:g}px'" if precision.unit == "px" else f"{precision.value:g} mm"
    pixels = meant = ""
    if precision.unit == "mm":
        pixel = smallest_pixel(block)
        if pixel is not None:
            pixels = f" ({precision.value / pixel:.3g} pixels)"
            meant = f", or write '{precision.value:g}px' if pixels are meant"
        elif _explains(_MILLI, factor):
            meant = f", or write {precision.value * _MILLI:g} (mm) if {precision.value:g} µm are meant"
    text = (
        f"measurement_precision = {written}{pixels} is {1.0 / factor:.3g} times larger than the residuals; correct it"
        f"{meant}"
    )
    yield ProjectWarning("error-unit", f"bundle {block.definition.name}", text)


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
    rows = solution.residuals
    used = coded(rows.kind).where(kind.__eq__) & (rows.weight_factor >= 1.0)
    redundancy = float(np.sum(rows.redundancy_number[used]))
    square_sum = float(np.sum(rows.standard_residual[used] ** 2))
    if redundancy < _FEWEST or square_sum >= _TOO_GOOD**2 * redundancy:
        return None
    from scipy.special import gammainc  # takes its time; few adjustments need it

    if gammainc(redundancy / 2.0, square_sum / 2.0) > _UNLIKELY:
        return None
    return float(np.sqrt(square_sum / redundancy)) or None


def _explains(unit: float, factor: float) -> bool:
    """Tell whether errors in a unit agree with the residuals."""
    return bool(1.0 / _NEAR < factor / unit < _NEAR)
