"""What may have been written otherwise in the control, and in a-priori errors: blocks as they would be then."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from orip.arrays import FloatArray
from orip.mistakes.hypotheses import Hypothesis, plainly, stay_near
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.ground import PlainGround

_FOOT = 0.3048
_GON = 0.9
_MILLI = 1e-3
_USELESS = 0.01
"""Of the extent of photos or control: with errors that large they do not say where anything is."""


def control_hypotheses(block: Block) -> Iterator[Hypothesis]:
    """Yield control with its axes exchanged or reversed, or in another unit than the photos' orientations."""
    if not isinstance(block.ground, PlainGround) or not block.control_points:
        return
    exchanged = (
        "the control fits the photos when X and Y are exchanged: it probably has north, east in place of X = east, Y = "
        "north; exchange the columns X and Y of the control file"
    )
    yield _control(block, "control-axes", np.eye(3)[[1, 0, 2]], exchanged)
    for axis, name in enumerate("XYZ"):
        signs = np.ones(3)
        signs[axis] = -1.0
        text = f"the control fits the photos when {name} has the opposite sign; reverse the sign of {name}"
        yield _control(block, "control-axes", np.diag(signs), text)
    for factor, unit, other in ((_FOOT, "feet", "metres"), (1.0 / _FOOT, "metres", "feet")):
        text = (
            f"the control fits the photos' orientations when it is multiplied by {factor:.5g}: it seems to be in "
            f"{unit}, and the orientations in {other}; use one unit"
        )
        yield _control(block, "control-unit", np.eye(3) * factor, text)
        text = (
            f"the control fits the photos when Z is multiplied by {factor:.5g}: Z seems to be in {unit}, X and Y in "
            f"{other}; use one unit"
        )
        yield _control(block, "control-unit", np.diag([1.0, 1.0, factor]), text)


def mirrored_control(block: Block) -> Iterator[Hypothesis]:
    """Yield control with X and Y exchanged, for photos that had no orientations: any reflection fits as well."""
    if isinstance(block.ground, PlainGround) and block.control_points:
        text = (
            "the control fits the photos as a mirror image: X and Y of the control are exchanged (north, east in place "
            "of X = east, Y = north), or an axis has the opposite sign, or the photos are mirrored; exchange the "
            "columns X and Y of the control file first"
        )
        yield _control(block, "control-axes", np.eye(3)[[1, 0, 2]], text)


def _control(block: Block, code: str, matrix: FloatArray, text: str) -> Hypothesis:
    points = tuple(_changed(point, matrix) for point in block.control_points)
    place = block.point_index()
    constant = block.constant_points.copy()
    rows = [place[point.name] for point in points]
    constant[rows] = (np.abs(matrix) @ constant[rows].T > 0.0).T
    changed = replace(block, control_points=points, constant_points=constant)
    return Hypothesis(code, "", changed, plainly(text), stay_near)


def _changed(point: ControlPoint, matrix: FloatArray) -> ControlPoint:
    """Return a control point whose coordinates are multiplied by a matrix that has one element in each row."""
    source = np.abs(matrix).argmax(axis=1)
    factors = matrix[np.arange(3), source]

    def taken(values: Sequence[float | None], by: FloatArray) -> tuple[float | None, float | None, float | None]:
        x, y, z = (None if (value := values[k]) is None else float(value * by[row]) for row, k in enumerate(source))
        return x, y, z

    return replace(point, coordinates=taken(point.coordinates, factors), errors=taken(point.errors, np.abs(factors)))


def released_control(block: Block, names: Sequence[str]) -> Iterator[tuple[str, Block]]:
    """Yield blocks in which one of the control points is a tie point."""
    place = block.point_index()
    for name in names:
        constant = block.constant_points.copy()
        constant[place[name]] = False
        points = tuple(point for point in block.control_points if point.name != name)
        yield name, replace(block, control_points=points, constant_points=constant)


def direction_hypotheses(block: Block) -> Iterator[Hypothesis]:
    """Yield theodolite directions in gon."""
    if block.directions:
        directions = tuple(
            replace(
                each,
                direction=each.direction * _GON,
                direction_error=each.direction_error * _GON,
                zenith=None if each.zenith is None else each.zenith * _GON,
                zenith_error=None if each.zenith_error is None else each.zenith_error * _GON,
            )
            for each in block.directions
        )
        text = (
            "the theodolite directions fit when they are in gon; write degrees: multiply directions, zenith angles and "
            "their a-priori errors by 0.9"
        )
        yield Hypothesis("direction-unit", "control directions", replace(block, directions=directions), plainly(text))


def error_hypotheses(block: Block) -> Iterator[Hypothesis]:
    """Yield a-priori errors in other units, where those given are so large that photos or control say nothing."""
    precision, points = block.definition.measurement_precision, block.photo_points
    sensors = {camera.sensor.width / camera.sensor.columns for camera in block.cameras if camera.sensor is not None}
    too_large = float(np.median(points.error)) > _USELESS * float(np.ptp(points.xy, axis=0).max())
    factors = [(_MILLI, "micrometres")] if too_large else [(1.0 / _MILLI, "metres")]
    if too_large and precision.unit == "mm":
        factors += [(pixel, "pixels") for pixel in sorted(sensors)[:1]]
    for factor, unit in factors:
        written = f"'{precision.value:g}px'" if unit == "pixels" else f"{precision.value * factor:g}"
        text = (
            f"measurement_precision = {precision.value:g} is in {precision.unit}, and makes sense in {unit}; write "
            f"measurement_precision = {written}"
        )
        changed = replace(block, photo_points=replace(points, error=points.error * factor))
        yield Hypothesis("error-unit", "orip.toml", changed, plainly(text))
    if _control_is_useless(block):
        text = (
            "the a-priori errors of the control points make sense in thousandths of the ground unit, as millimetres "
            "beside metres; write them in the unit of the coordinates"
        )
        weighted = tuple(_with_errors(point, _MILLI) for point in block.control_points)
        yield Hypothesis("error-unit", "control file", replace(block, control_points=weighted), plainly(text))


def _control_is_useless(block: Block) -> bool:
    known = [point for point in block.control_points if point.kind == "control"]
    coordinates = np.array([[np.nan if value is None else value for value in point.coordinates] for point in known])
    errors = np.array([[np.nan if error is None else error for error in point.errors] for point in known])
    if not np.isfinite(coordinates).any() or not np.isfinite(errors).any():
        return False
    extent = float(np.nanmax(np.nanmax(coordinates, axis=0) - np.nanmin(coordinates, axis=0)))
    return float(np.nanmedian(errors)) > _USELESS * extent


def _with_errors(point: ControlPoint, factor: float) -> ControlPoint:
    x, y, z = (None if error is None else error * factor for error in point.errors)
    return replace(point, errors=(x, y, z))
