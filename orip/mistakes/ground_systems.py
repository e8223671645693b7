"""Control in another system, unit or order of axes than it is read in."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

import numpy as np

from orip.arrays import FloatArray
from orip.bundle.solve import SolvedBlock
from orip.errors import ProjectWarning
from orip.mistakes.hypothesis import Hypothesis, finding, photos_stay_near
from orip.mistakes.other_units import FEET_AND_METRES, LENGTH_UNITS, control_unit_text
from orip.prelim.similarity.control_reading import camera_side
from orip.records.block import Block
from orip.records.control import Control, ControlPoint
from orip.records.ground import PlainGround
from orip.records.names import record_key
from orip.records.preliminary import ControlReading
from orip.structs import replace
from orip.units import METRES_PER_FOOT
from orip.wording import counted_names

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


def are_east_and_north(block: Block) -> bool:
    """Tell whether X and Y of the control are easting and northing by their size: six digits, and seven."""
    known = [point.coordinates[:2] for point in block.control_points if None not in point.coordinates[:2]]
    if not known:
        return False
    x, y = np.median(np.array(known, dtype=np.float64), axis=0).tolist()
    return bool(0.0 < x < _ZONE <= y < 10.0 * _ZONE)


def misread_control(reading: ControlReading | None, *, east_and_north: bool = False) -> tuple[str, ...]:
    """Return the sentence about control that fits if read differently; none if there is no such reading.

    Parameters
    ----------
    reading : ControlReading or None
    east_and_north : bool
        By their size X and Y are not exchanged.
    """
    if reading is None:
        return ()
    if reading.reading == "mirror image":
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


GROUND_SYSTEM, IN_DEGREES = "ground-system", "degrees"

SHORT_TEXTS_OF_SYSTEMS = {
    GROUND_SYSTEM: "control and positions of the photos are in different systems",
    IN_DEGREES: "longitude and latitude in degrees stand beside coordinates in units of length",
}
"""What the status says, by the code of the warning."""

_FAR, _NEAR = 20.0, 3.0
"""Distances of control and photos, as parts of the larger extent of the two: what cannot be, and what is usual."""

_FEWEST_PLACES = 3

_ZONE = 1e6
"""Eastings have six digits before the decimal point; what precedes them is the zone."""

_ZONES = (1, 60)

_METRES_PER_DEGREE = 1.1e5

_LARGEST_AREA = 5.0
"""Degrees from one end of a block to the other."""

_OF_ONE_BLOCK = 30.0
"""Ratio of the extents of control and photos up to which they are those of one block."""

_ANGLES = np.array([180.0, 90.0])

Reading = tuple[FloatArray, FloatArray, str]
"""Control and photos (n, 2) as they were probably meant, and what is wrong then."""


def contradicting_ground_systems(control: Control, given: FloatArray) -> list[ProjectWarning]:
    """Return a warning if control is far from where the photos were taken, and near it if read differently.

    Parameters
    ----------
    control : Control
        Of the project, with its exposure stations in the project's coordinates.
    given : array (n, 2)
        X0 and Y0 of the photos, NaN where not given.
    """
    in_project = not control.station_reference.crs
    observed = [station.position[:2] for station in control.stations if station.has_position and in_project]
    in_elements = _centres_of_elements(control)
    of_stations, observed = bool(observed), [*observed, *in_elements]
    places = np.vstack([np.array(observed, dtype=np.float64).reshape(-1, 2), given])
    places = places[np.isfinite(places).all(axis=1)]
    known = [point for point in control.points if None not in point.coordinates[:2]]
    if len(places) < _FEWEST_PLACES or not known:
        return []
    points = np.array([point.coordinates[:2] for point in known], dtype=np.float64)
    if _apart(points, places) < _FAR:
        return []
    where = counted_names("control point", [point.name for point in known])
    file = ".STA" if of_stations else ".ELE" if in_elements else "orip.toml"
    if text := _degrees(points, places, file):
        return [
            ProjectWarning(
                IN_DEGREES, where if text.endswith("of these") else f"positions of the photos in {file}", text
            )
        ]
    other = "exposure stations" if of_stations else "photos"
    readings = chain(
        _feet(points, places, other), _zones(points, places, other), _exchanged(points, places, other, file)
    )
    texts = (text for read, photos, text in readings if _apart(read, photos) < _NEAR)
    return [ProjectWarning(GROUND_SYSTEM, where, text) for text in list(texts)[:1]]


def _centres_of_elements(control: Control) -> list[tuple[float, float]]:
    """Return X0 and Y0 of the photos of which both are observed."""
    values: dict[str, dict[str, float]] = {}
    for element in control.elements:
        if element.group == "PHOTO":
            values.setdefault(record_key(element.name), {})[element.kind] = element.value
    return [(found["X0"], found["Y0"]) for found in values.values() if {"X0", "Y0"} <= set(found)]


def _degrees(points: FloatArray, places: FloatArray, file: str) -> str:
    """Return that positions of the photos, or the control, are in degrees; "" where neither is."""
    for concerned, others in ((places, points), (points, places)):
        extent, other = (float(np.ptp(which, axis=0).max()) for which in (concerned, others))
        # latitude may come first
        are_angles = any((np.abs(concerned[:, order]) <= _ANGLES).all() for order in ([0, 1], [1, 0]))
        is_length = bool((np.abs(np.median(others, axis=0)) > _ANGLES.max()).any())
        if not (are_angles and is_length and 0.0 < extent < _LARGEST_AREA and other > 0.0):
            continue
        if abs(np.log(extent * _METRES_PER_DEGREE / other)) > np.log(_OF_ONE_BLOCK):
            continue
        x, y = np.median(concerned, axis=0)
        if concerned is points:
            return (
                f"X and Y, about {x:.6g} and {y:.6g}, are longitude and latitude in degrees, unlike the positions of "
                f"the photos in {file}: convert the control to easting and northing in the system of these"
            )
        text = (
            f"X and Y, about {x:.6g} and {y:.6g}, are longitude and latitude in degrees, and the control is in units "
            "of length: convert them to easting and northing in the system of the control"
        )
        by_heading = (
            "; or write 'CRS EPSG:4326' as the first line of the .STA file, and the system of the control as crs in "
            "[project]"
        )
        return f"{text}{by_heading if file == '.STA' else ''}"
    return ""


def _apart(points: FloatArray, places: FloatArray) -> float:
    """Return the distance of the middles of points and places over the larger extent of the two."""
    extent = max(float(np.ptp(points, axis=0).max()), float(np.ptp(places, axis=0).max()), 1e-9)
    return float(np.linalg.norm(np.median(points, axis=0) - np.median(places, axis=0))) / extent


def _feet(points: FloatArray, places: FloatArray, other: str) -> Iterator[Reading]:
    for factor, unit, of_others in ((METRES_PER_FOOT, "feet", "metres"), (1.0 / METRES_PER_FOOT, "metres", "feet")):
        text = (
            f"they are near the {other} when multiplied by {factor:.4f}: they seem to be in {unit}, and the {other} in "
            f"{of_others}; write both in one unit (US survey feet: 1200/3937 m, international feet: 0.3048 m)"
        )
        yield points * factor, places, text


def _zones(points: FloatArray, places: FloatArray, other: str) -> Iterator[Reading]:
    for concerned, is_control in ((points, True), (places, False)):
        zones = np.unique(np.floor(concerned[:, 0] / _ZONE))
        if len(zones) == 1 and _ZONES[0] <= zones[0] <= _ZONES[1]:
            zone = int(zones[0])
            without = concerned - [zone * _ZONE, 0.0]
            own, others = ("their X", f"those of the {other}") if is_control else (f"X of the {other}", "theirs")
            text = (
                f"{own} begins with the number of a zone, {zone}, and {others} {'do' if is_control else 'does'} not: "
                "write eastings of six digits before the decimal point in all files"
            )
            yield (without, places, text) if is_control else (points, without, text)


def _exchanged(points: FloatArray, places: FloatArray, other: str, file: str) -> Iterator[Reading]:
    easting, northing = np.median(points, axis=0).tolist()
    control, photos = "the control file", "orip.toml" if file == "orip.toml" else f"the {file} file"
    # what has six digits before the decimal point is the easting, where the other one has seven
    wrong = photos if 0.0 < easting < _ZONE <= northing else control if northing < _ZONE <= easting else ""
    text = (
        f"they are near the {other} when X and Y are exchanged: X is the easting, Y the northing; exchange the columns "
        f"X and Y of {wrong or f'{control}, or those of {photos}'}"
    )
    yield points[:, ::-1], places, text


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
