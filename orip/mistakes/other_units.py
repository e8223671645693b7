"""Lengths, angles and a-priori errors in another unit than the one they are read in."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import FloatArray
from orip.errors import ProjectWarning
from orip.geometry.rotation import angles_between, rotation_from_angles
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.mistakes.photo_precision import likely_precision, smallest_pixel, written_precision
from orip.records.block import Block
from orip.records.camera import Camera
from orip.records.coded_names import coded
from orip.records.control import ControlDirection, ControlPoint
from orip.records.photo import PHOTO_PARAMETERS
from orip.records.results.solution import Solution
from orip.structs import replace
from orip.units import DEGREES_PER_GON, DEGREES_PER_RADIAN, METRES_PER_FOOT, MILLIMETRES_PER_INCH, RADIANS_PER_DEGREE

if TYPE_CHECKING:
    from orip.bundle.solve import SolvedBlock

LENGTH_UNITS = {
    METRES_PER_FOOT: ("feet", "metres"),
    1.0 / METRES_PER_FOOT: ("metres", "feet"),
    1e-3: ("millimetres", "metres"),
    1e-2: ("centimetres", "metres"),
    1e-3 * MILLIMETRES_PER_INCH: ("inches", "metres"),
    1e2: ("metres", "centimetres"),
    1e3: ("metres", "millimetres"),
}
"""By the factor that lengths have to be multiplied by: their unit, and the unit of what they are compared with."""

FEET_AND_METRES = (METRES_PER_FOOT, 1.0 / METRES_PER_FOOT)
"""The factors of the two units that are used side by side."""


def control_unit_text(factor: float) -> str:
    """Return the message for control that fits the orientations of the photos when multiplied by a factor."""
    unit, other = LENGTH_UNITS[factor]
    return (
        f"the control fits the photos' orientations when it is multiplied by {factor:.5g}: it seems to be in {unit}, "
        f"and the orientations in {other}; use one unit"
    )


def millimetres_per_unit(camera: Camera) -> dict[str, float]:
    """Return the size (mm) of the units that principal distances are written in by mistake; pixels if it has any."""
    sizes = {"metres": 1e3, "inches": MILLIMETRES_PER_INCH}
    if camera.sensor is not None:
        sizes["pixels"] = camera.sensor.width / camera.sensor.columns
    return sizes


# Errors that are too small show as a large sigma0, which has many causes. Errors that are too large show as residuals
# that are small throughout, which has only this one.

_TOO_GOOD = 0.2
"""Standard error of unit weight below which caution is not the cause: nobody assumes errors five times too large."""

_UNLIKELY = 1e-6
"""Probability of residuals so small by chance."""

_FEWEST_OBSERVATIONS = 3.0
"""Least redundancy with which a kind of observation is judged."""

_NEAR = 4.0
"""Factor up to which errors in the right unit may still differ from the residuals."""

_MILLI = 1e-3


def errors_too_large(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for each kind of observation whose residuals are far smaller than its a-priori errors."""
    return [*_photos(block, solution), *_control(solution), *_positions(solution), *_distances(solution)]


def _photos(block: Block, solution: Solution) -> Iterator[ProjectWarning]:
    factor = _factor(solution, "photo")
    if factor is None:
        return
    precision = block.definition.measurement_precision
    written = written_precision(precision.value, precision.unit)
    pixels, meant = "", f": write {likely_precision(precision.value, factor, precision.unit)}"
    if precision.unit == "mm":
        pixel = smallest_pixel(block)
        if pixel is not None:
            pixels = f" ({precision.value / pixel:.3g} pixels)"
            meant += f", or write '{precision.value:g}px' if pixels are meant"
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
    if written := _unit_of_errors(solution, "control", factor):
        text += f": these seem to be in {written}; write them in {unit}, the unit of the coordinates"
    else:
        text += f"; check them, they are in {unit}"
    yield ProjectWarning("error-unit", "control file", text)


def _positions(solution: Solution) -> Iterator[ProjectWarning]:
    """Yield a warning where errors of the photos' positions are in another unit.

    Other errors that are too large are not told: rough ones are given on purpose where positions only start the
    iteration.
    """
    for kind, file in (("station", ".STA"), ("element", ".ELE")):
        factor = _factor(solution, kind, _COORDINATES)
        if factor is not None and (unit := _unit_of_errors(solution, kind, factor, _COORDINATES)):
            text = (
                f"they fit {1.0 / factor:.3g} times better than their a-priori errors promise: these seem to be in "
                f"{unit}; write them in {solution.ground_unit}, the unit of the coordinates, in the {file} file"
            )
            yield ProjectWarning("error-unit", "exposure stations", text)


_ROUGH, _RARE = 2e-3, 0.01
"""Relative error that no measured distance has, and probability of distances that then fit far better by chance."""


def _distances(solution: Solution) -> Iterator[ProjectWarning]:
    """Yield a warning where errors of distances, often two only, are in another unit.

    Few residuals prove little; but such errors would not be given to a distance that is to give the scale.
    """
    rows = solution.residuals
    is_distance = coded(rows.kind).where("distance".__eq__) & coded(rows.component).where("XYZ".__eq__)
    is_distance &= (rows.a_priori > 0.0) & (rows.weight_factor >= 1.0)
    redundancy = float(np.sum(rows.redundancy_number[is_distance]))
    if not redundancy > _LEAST_OF_DISTANCES or solution.ground_unit != "m":
        return
    standard = rows.standard_residual[is_distance]
    factor = float(np.sqrt(np.sum(standard**2) / redundancy))
    roughest = float(np.median(rows.a_priori[is_distance] / np.abs(rows.observed[is_distance])))
    from scipy.special import gammainc  # takes its time; few adjustments need it

    if roughest < _ROUGH or factor >= 3.0 * _MILLI or gammainc(redundancy / 2.0, redundancy * factor**2 / 2.0) > _RARE:
        return
    text = (
        f"they fit {1.0 / factor:.3g} times better than their a-priori errors promise: these seem to be in mm; write "
        f"them in {solution.ground_unit}, the unit of the distances, in the .LEN file"
    )
    yield ProjectWarning("error-unit", "distances", text)


_LEAST_OF_DISTANCES = 0.9
"""Redundancy of two distances that give the scale is 1."""

_COORDINATES = frozenset({*"XYZ", *PHOTO_PARAMETERS[:3]})

_UNITS = {"mm": (_MILLI, 10.0), "cm": (10.0 * _MILLI, 3.0)}
"""Units that errors are written in, with the factor up to which residuals may be larger than errors in them: they have
the errors of the photos as well. A factor of ten is another unit, where that is possible."""

_ON_THE_GROUND = (1e-4, 0.3)
"""Ground units (metres): errors of what is surveyed, on a machine or a landscape."""


def _unit_of_errors(solution: Solution, kind: str, factor: float, components: Collection[str] = ()) -> str:
    """Return the unit in which the errors of a kind of observation are small enough, and possible; "" if none is."""
    if solution.ground_unit != "m":
        return ""
    rows = solution.residuals
    mine = coded(rows.kind).where(kind.__eq__) & (rows.a_priori > 0.0)
    if components:
        mine &= coded(rows.component).where(components.__contains__)
    typical = float(np.median(rows.a_priori[mine]))
    for unit, (size, more) in _UNITS.items():
        if size / _NEAR < factor < more * size and _ON_THE_GROUND[0] <= typical * size <= _ON_THE_GROUND[1]:
            return unit
    return ""


def _factor(solution: Solution, kind: str, components: Collection[str] = ()) -> float | None:
    """Return the standard error of unit weight of a kind of observation where it is far below 1, else None."""
    rows = solution.residuals
    used = coded(rows.kind).where(kind.__eq__) & (rows.weight_factor >= 1.0)
    if components:
        used &= coded(rows.component).where(components.__contains__)
    redundancy = float(np.sum(rows.redundancy_number[used]))
    square_sum = float(np.sum(rows.standard_residual[used] ** 2))
    if redundancy < _FEWEST_OBSERVATIONS or square_sum >= _TOO_GOOD**2 * redundancy:
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


ANGLE_UNITS = {DEGREES_PER_GON: "gon", DEGREES_PER_RADIAN: "radians"}
"""Names of units by their size in degrees."""

_CLEARLY = 0.5
"""The right unit leaves less than this part of the rotations between preliminary and adjusted photos."""

_FEWEST = 4
"""Number of photos that a unit has to bring nearer, and as many more for each photo that it takes farther away."""


def angles_in_another_unit(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning if the preliminary rotations are near the adjusted ones in gon or radians, and not in degrees.

    Parameters
    ----------
    block : Block
        As gathered: with the rotations that were given, NaN where none were.
    """
    centres = solution.photos.values[:, :3]
    adjusted = rotation_from_angles(solution.photos.values[:, 3:] * RADIANS_PER_DEGREE)
    in_frame = np.swapaxes(block.ground.axes_at(centres), 1, 2) @ adjusted
    return [
        ProjectWarning("angle-unit", *in_angle_unit(block, factor))
        for factor in ANGLE_UNITS
        if is_nearer(block.photo_orientation[:, 3:], factor, in_frame)
    ]


def in_angle_unit(block: Block, factor: float) -> tuple[str, str]:
    """Return the file of rotations that are in another unit, and what to say of them."""
    observed = any(element.kind in PHOTO_PARAMETERS[3:] for element in (*block.elements, *block.constant_elements))
    return ".ELE file" if observed else "orip.toml", (
        f"the {'' if observed else 'preliminary '}OMEGA, PHI and KAPPA of the photos fit when they are in "
        f"{ANGLE_UNITS[factor]}, but angles have to be in degrees; multiply them by {factor:.6g}"
    )


def is_nearer(given: FloatArray, factor: float, adjusted: FloatArray) -> bool:
    """Tell whether angles (n, 3), NaN where not given, are near rotations (n, 3, 3) when multiplied by a factor."""
    known = np.isfinite(given).all(axis=1)
    as_given, scaled = (
        angles_between(rotation_from_angles(given[known] * unit), adjusted[known]) for unit in (1.0, factor)
    )
    # of photos that were given roughly, or with small angles, either may be nearer by chance
    clear = np.abs(scaled - as_given) > _CLEARLY * np.minimum(scaled, as_given)
    nearer, farther = np.count_nonzero(clear & (scaled < as_given)), np.count_nonzero(clear & (scaled > as_given))
    if nearer < _FEWEST * (1 + farther):
        return False
    return bool(np.median(scaled[clear]) < _CLEARLY * np.median(as_given[clear]))


def angle_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the preliminary rotations as angles in other units than degrees."""
    for factor in ANGLE_UNITS:
        orientation = block.photo_orientation * [1.0, 1.0, 1.0, factor, factor, factor]
        changed = replace(block, photo_orientation=orientation)
        near = partial(_is_near, given=block.photo_orientation[:, 3:], factor=factor)
        found = finding("angle-unit", *in_angle_unit(block, factor))
        yield Hypothesis(changed, found, near, concerns_start=True)


def _is_near(solved: SolvedBlock, given: FloatArray, factor: float) -> bool:
    return is_nearer(given, factor, solved.state.rotations)


def direction_units(block: Block) -> Iterator[Hypothesis]:
    """Yield the theodolite directions and zenith angles, with their a-priori errors, as values in gon."""
    if block.directions:
        changed = replace(block, directions=tuple(map(_from_gon, block.directions)))
        text = (
            "the theodolite directions fit when they are in gon; write degrees: multiply directions, zenith angles and "
            "their a-priori errors by 0.9"
        )
        yield Hypothesis(changed, finding("direction-unit", "control directions", text))


def _from_gon(observed: ControlDirection) -> ControlDirection:
    zenith, error = observed.zenith, observed.zenith_error
    return replace(
        observed,
        direction=observed.direction * DEGREES_PER_GON,
        direction_error=observed.direction_error * DEGREES_PER_GON,
        zenith=None if zenith is None else zenith * DEGREES_PER_GON,
        zenith_error=None if error is None else error * DEGREES_PER_GON,
    )
