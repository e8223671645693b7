"""Control in another system, unit or order of axes than it is read in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Hypothesis, finding, photos_stay_near
from orip.mistakes.other_units import FEET_AND_METRES, LENGTH_UNITS, control_unit_text
from orip.records.block import Block
from orip.records.control import ControlPoint
from orip.records.ground import PlainGround
from orip.records.preliminary import ControlReading
from orip.structs import replace

_EXCHANGE = "exchange the columns X and Y of the control file"
_ANY_REFLECTION = "X and Y of the control are exchanged (north, east in place of X = east, Y = north), or"
_CHANGE_TEXTS = {
    "exchanged": "when X and Y are exchanged: the control file probably has north, east in place of X = east, Y = "
    f"north; {_EXCHANGE}",
    "X": "when X has the opposite sign: X of the control seems to count to the west; reverse its sign",
    "Y": "when Y has the opposite sign: Y of the control seems to count to the south; reverse its sign",
    "Z": "when Z has the opposite sign: Z of the control seems to count downwards; reverse its sign",
    "photos": "when the photos are mirrored: their x seems to count to the left, as on film scanned from the back, or "
    "their y downwards, or x and y are exchanged; reverse it, or check the fiducial marks",
}
_EXCHANGED_OR_MIRRORED = (
    f"as a mirror image: {_ANY_REFLECTION} one of them has the opposite sign, or the photos are mirrored (x counted to "
    f"the left); the control alone cannot tell which. {_EXCHANGE[0].upper()}{_EXCHANGE[1:]} first"
)
_DOWNWARDS = (
    "when Z has the opposite sign: Z of the control seems to count downwards, or y of photos that look horizontally; "
    "reverse its sign"
)
_MIRROR_IMAGE = (
    f"as a mirror image: {_ANY_REFLECTION} one axis has the opposite sign, or the photos are mirrored (x counted to "
    "the left); check them in this order"
)


_MIRRORED_PHOTOS = (
    "as a mirror image: the photos are mirrored, as X and Y of the control are easting and northing by their size. "
    "Pixel rows seem to count upwards (write rows - row), or columns from the right (write columns - column), or film "
    "was scanned from its back"
)


_SIX_DIGITS = 1e6
"""Ground units: eastings have six digits before the decimal point, northings seven."""


def are_east_and_north(block: Block) -> bool:
    """Tell whether X and Y of the control are easting and northing by their size: six digits, and seven."""
    known = [point.coordinates[:2] for point in block.control_points if None not in point.coordinates[:2]]
    if not known:
        return False
    x, y = np.median(np.array(known, dtype=np.float64), axis=0).tolist()
    return bool(0.0 < x < _SIX_DIGITS <= y < 10.0 * _SIX_DIGITS)


_MIRRORED_FILMS = (
    "as a mirror image, and fiducial or tick marks show the same: they have the wrong sign of x or of y in the "
    "[[camera]] (or [[temtick]]) of orip.toml; reverse that sign of all of them"
)


def misread_control(
    reading: ControlReading | None, *, east_and_north: bool = False, films_mirrored: bool = False
) -> tuple[str, ...]:
    """Return the sentence about control that fits if read differently; none if there is no such reading.

    Parameters
    ----------
    east_and_north : bool
        By their size X and Y are not exchanged.
    films_mirrored : bool
        By their marks photos or templates are mirror images.
    """
    if reading is None:
        return ()
    if reading.reading == "mirror image":
        if films_mirrored:
            return (_fits(reading) + _MIRRORED_FILMS,)
        is_of_photos = east_and_north and not reading.changes and reading.side > 0.0
        return (_fits(reading) + (_MIRRORED_PHOTOS if is_of_photos else _reflection(reading)),)
    if reading.reading == "unit of Z":
        unit, others = LENGTH_UNITS[reading.z_factor]
        text = f"when Z is multiplied by {reading.z_factor:.5g}: Z seems to be in {unit}, X and Y in {others}"
        return (f"{_fits(reading)}{text}; use one unit",)
    if reading.reading == "from below":
        return (_from_below(reading),)
    order = "X, Y" if reading.reading == "longitude, latitude" else "Y, X"
    text = (
        f"the control fits when {order} are longitude and latitude in degrees, but X, Y and Z have to be in one unit "
        "of length: convert them to projected coordinates (a national grid or UTM: easting, northing), and name the "
        "system as crs in [project] if the area is large"
    )
    return (text,)


def _fits(reading: ControlReading) -> str:
    return f"control fits within {reading.misfit:.2g} (as given it fits within {reading.misfit_as_given:.3g}) "


def _reflection(reading: ControlReading) -> str:
    """Return which change explains a mirror image, from known projection centres, else from the side of the cameras.

    An exchange of X and Y, or one of them reversed, leaves the cameras above the ground; Z reversed puts them below it.
    """
    if len(reading.changes) == 1:
        return _CHANGE_TEXTS[reading.changes[0]]
    if reading.side > 0.0:
        return _EXCHANGED_OR_MIRRORED
    return _DOWNWARDS if reading.side < 0.0 else _MIRROR_IMAGE


def _from_below(reading: ControlReading) -> str:
    points = "three control points" if reading.points == 3 else "control points that lie in a plane"
    return (
        f"{points} fit within {reading.misfit:.2g}, but with the cameras below them, looking up; {points} fit a mirror "
        f"image equally well. If the photos were taken from above, {_ANY_REFLECTION} one axis has the opposite sign, "
        f"or the photos are mirrored; {_EXCHANGE} first, or measure control points at other heights"
    )


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
        yield Hypothesis(with_multiplied_control(block, _EXCHANGED), _reflect_control)


def _reflect_control(solved: SolvedBlock) -> list[ProjectWarning]:
    """Return a warning of which reflection it is: with Z reversed the cameras are below the ground, looking up."""
    from orip.prelim.similarity.control_reading import camera_side

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
    """Yield a block whose control is multiplied by a matrix; none without control, or in a reference system.

    Nor is there one where nothing changes: heights that are all zero have no sign.
    """
    if not (isinstance(block.ground, PlainGround) and block.control_points):
        return
    changed = with_multiplied_control(block, matrix)
    pairs = zip(changed.control_points, block.control_points, strict=True)
    if any(one.coordinates != other.coordinates for one, other in pairs):
        yield Hypothesis(changed, finding(code, "", text), photos_stay_near)


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
