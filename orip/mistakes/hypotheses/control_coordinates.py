"""Control coordinates with exchanged or reversed axes, or in another unit than the orientations of the photos."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypotheses.hypothesis import Hypothesis, finding, photos_stay_near
from orip.mistakes.length_units import FEET_AND_METRES, LENGTH_UNITS, control_unit_text
from orip.prelim.similarity.control_reading import camera_side
from orip.records.block import Block
from orip.records.ground import PlainGround
from orip.records.observations.control import ControlPoint
from orip.structs import replace

_EXCHANGED = np.eye(3)[[1, 0, 2]]
_AXES, _UNIT = "control-axes", "control-unit"


def control_axes(block: Block) -> Iterator[Hypothesis]:
    """Yield control with X and Y exchanged, then with the opposite sign of X, of Y and of Z."""
    text = (
        "the control fits the photos when X and Y are exchanged: it probably has north, east in place of X = east, Y = "
        "north; exchange the columns X and Y of the control file"
    )
    yield from _control(block, _AXES, _EXCHANGED, text)
    for axis, name in enumerate("XYZ"):
        signs = np.ones(3)
        signs[axis] = -1.0
        text = f"the control fits the photos when {name} has the opposite sign; reverse the sign of {name}"
        yield from _control(block, _AXES, np.diag(signs), text)


def control_units(block: Block) -> Iterator[Hypothesis]:
    """Yield control in feet instead of metres and vice versa: all coordinates, and Z alone."""
    for factor in FEET_AND_METRES:
        yield from _control(block, _UNIT, np.eye(3) * factor, control_unit_text(factor))
    yield from control_heights(block)


def control_heights(block: Block) -> Iterator[Hypothesis]:
    """Yield control with Z in feet instead of metres and vice versa."""
    for factor in FEET_AND_METRES:
        unit, other = LENGTH_UNITS[factor]
        text = (
            f"the control fits the photos when Z is multiplied by {factor:.5g}: Z seems to be in {unit}, X and Y in "
            f"{other}; use one unit"
        )
        yield from _control(block, _UNIT, np.diag([1.0, 1.0, factor]), text)


def mirrored_control(block: Block) -> Iterator[Hypothesis]:
    """Yield control with X and Y exchanged, for photos without given orientations: any reflection fits as well."""
    if isinstance(block.ground, PlainGround) and block.control_points:
        yield Hypothesis(with_multiplied_control(block, _EXCHANGED), _reflection)


def _reflection(solved: SolvedBlock) -> list[ProjectWarning]:
    """Return a warning of which reflection it is: with Z reversed the cameras are below the ground, looking up."""
    text = "the control fits the photos as a mirror image: "
    if camera_side(solved.state.rotations) < 0.0:
        text += "Z of the control seems to have the opposite sign (depths in place of heights); reverse the sign of Z"
    else:
        text += (
            "X and Y of the control are exchanged (north, east in place of X = east, Y = north), or one of them has "
            "the opposite sign, or the photos are mirrored; exchange the columns X and Y of the control file first"
        )
    return [ProjectWarning(_AXES, "", text)]


def _control(block: Block, code: str, matrix: FloatArray, text: str) -> Iterator[Hypothesis]:
    """Yield a block whose control is multiplied by a matrix; none without control, or in a reference system."""
    if isinstance(block.ground, PlainGround) and block.control_points:
        yield Hypothesis(with_multiplied_control(block, matrix), finding(code, "", text), photos_stay_near)


def with_multiplied_control(block: Block, matrix: FloatArray) -> Block:
    """Return a block whose control points are multiplied by a matrix (3, 3) that has one element in each row."""
    points = tuple(_multiplied(point, matrix) for point in block.control_points)
    place = block.point_index()
    constant = block.constant_points.copy()
    rows = [place[point.name] for point in points]
    constant[rows] = (np.abs(matrix) @ constant[rows].T > 0.0).T
    return replace(block, control_points=points, constant_points=constant)


def _multiplied(point: ControlPoint, matrix: FloatArray) -> ControlPoint:
    """Return a control point whose coordinates are multiplied by a matrix that has one element in each row."""
    source = np.abs(matrix).argmax(axis=1)
    factors = matrix[np.arange(3), source]

    def product(values: Sequence[float | None], by: FloatArray) -> tuple[float | None, float | None, float | None]:
        x, y, z = (None if (value := values[k]) is None else float(value * by[row]) for row, k in enumerate(source))
        return x, y, z

    return replace(
        point, coordinates=product(point.coordinates, factors), errors=product(point.errors, np.abs(factors))
    )
