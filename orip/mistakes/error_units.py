"""A-priori errors that are far too large, mostly by a wrong unit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.errors import ProjectWarning
from orip.mistakes.contradicting_distances import smallest_pixel
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.records.block import Block
from orip.records.coded_names import coded
from orip.records.observations.control import ControlPoint
from orip.records.results.solution import Solution
from orip.structs import replace

# Errors that are too small show as a large sigma0, which has many causes. Errors that are too large show as residuals
# that are small throughout, which has only this one.


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


_IMPOSSIBLE = 2e-6
"""Part of the extent of photos that is finer than any measurement: half a micrometre on an aerial photo."""

_USELESS = 0.01
"""Part of the extent of photos or control above which an error leaves a position undetermined."""


def measurement_precision_units(block: Block) -> Iterator[Hypothesis]:
    """Yield a measurement precision in micrometres or pixels if it is too large, in metres if it is too small."""
    precision, points = block.definition.measurement_precision, block.photo_points
    factors = {}
    extent = float(np.ptp(points.xy, axis=0).max())
    if extent <= 0.0:  # all points are at one place of their photos
        return
    part = float(np.median(points.error)) / extent
    if part < _IMPOSSIBLE:
        factors["metres"] = 1.0 / _MILLI
    elif part > _USELESS:
        factors["micrometres"] = _MILLI
        if precision.unit == "mm" and (pixel := smallest_pixel(block)) is not None:
            factors["pixels"] = pixel
    for unit, factor in factors.items():
        written = f"'{precision.value:g}px'" if unit == "pixels" else f"{precision.value * factor:g}"
        text = (
            f"measurement_precision = {precision.value:g} is in {precision.unit}, but makes sense only in {unit}; "
            f"write measurement_precision = {written}"
        )
        changed = replace(block, photo_points=replace(points, error=points.error * factor))
        yield Hypothesis(changed, finding("error-unit", "orip.toml", text))


def control_error_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the a-priori errors of control in thousandths of the ground unit if they are too large."""
    if not _control_is_useless(block):
        return
    text = (
        "the a-priori errors of the control points make sense in thousandths of the ground unit, as millimetres "
        "beside metres; write them in the unit of the coordinates"
    )
    changed = replace(block, control_points=tuple(_with_errors(point, _MILLI) for point in block.control_points))
    yield Hypothesis(changed, finding("error-unit", "control file", text))


def _control_is_useless(block: Block) -> bool:
    known = [point for point in block.control_points if point.kind == "control"]
    coordinates = np.array([point.coordinates for point in known], dtype=np.float64)
    errors = np.array([point.errors for point in known], dtype=np.float64)
    if not np.isfinite(coordinates).any() or not np.isfinite(errors).any():
        return False
    extent = float(np.nanmax(np.nanmax(coordinates, axis=0) - np.nanmin(coordinates, axis=0)))
    return float(np.nanmedian(errors)) > _USELESS * extent


def _with_errors(point: ControlPoint, factor: float) -> ControlPoint:
    x, y, z = (None if error is None else error * factor for error in point.errors)
    return replace(point, errors=(x, y, z))
