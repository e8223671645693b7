"""A-priori errors in another unit, where those given are so large that photos or control determine nothing."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding
from orip.mistakes.length_units import smallest_pixel
from orip.records.block import Block
from orip.records.observations.control import ControlPoint
from orip.structs import replace

_MILLI = 1e-3

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
