"""Cameras with the principal distance of another lens, or with a sign that is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.points.starting import given_coordinates
from orip.errors import ProjectWarning
from orip.geometry.projection import PROJECTIONS
from orip.geometry.rotation import rotation_from_angles
from orip.interior.mounting import frame_corners
from orip.mistakes.hypothesis import Hypothesis, finding
from orip.mistakes.mistake import BAD_START, ON_GROUND, Consequence, declare
from orip.mistakes.other_units import millimetres_per_unit
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, READOUT, Camera
from orip.structs import replace

if TYPE_CHECKING:
    from orip.bundle.solve import SolvedBlock

_LONGEST = 20.0
"""Largest ratio of principal distance to diagonal of the frame: the angle of view is 3°, that of a telescope."""

_SHORTEST = 0.1
"""Smallest such ratio: the angle of view is 157°, of a fisheye 573° from corner to corner, which no lens has."""


def is_possible_view(c: float, diagonal: float) -> bool:
    """Tell whether a principal distance, with the diagonal of its frame, is that of a lens."""
    return _SHORTEST < c / diagonal < _LONGEST


# Every function yields hypotheses for one camera, given by its index in the block.

_PRINCIPAL_POINT = slice(1, 3)
_DISTORTION = slice(3, READOUT)
_OTHER_CAMERA = Consequence(groups=(*ON_GROUND, "check point", "camera"))
"""A camera displaces photos along their axes, and these the control."""

DISTORTION_SIGN = declare(
    "distortion-sign", "the distortion of a camera has the opposite sign", BAD_START, _OTHER_CAMERA
)
POINT_SIGN = declare(
    "principal-point-sign", "the principal point of a camera has the opposite sign", BAD_START, _OTHER_CAMERA
)
DISTORTION = declare("distortion", "the distortion of a lens is not given", BAD_START, _OTHER_CAMERA)
NOT_SQUARE = declare(
    "pixels-not-square", "the sensor is given with another ratio of its sides", BAD_START, _OTHER_CAMERA,
    Consequence(groups=("distance",)),
)  # fmt: skip

_ROUNDED, _NOT_SQUARE = 1e-5, 0.02
"""What the ratio of the sides of a pixel differs from 1 by where a size was rounded."""

_LENS = ("A3", "A5", "P1", "P2")
"""The distortion of an ordinary lens."""


def distortion_sign(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera's distortion with the opposite sign."""
    camera = block.cameras[row]
    given = _values(camera)[_DISTORTION] != 0.0
    if given.any() and not _is_unknown(camera)[_DISTORTION][given].any():
        text = (
            "the distortion fits with the opposite sign; reverse the sign of its coefficients (positive distortion "
            "moves the image outwards: measured = ideal + distortion)"
        )
        changed = _with_factors(block, row, _DISTORTION, np.array(-1.0))
        yield Hypothesis(changed, finding(DISTORTION_SIGN, f"camera {camera.name}", text))


def principal_point_sign(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera's principal point with the opposite sign of y, of x, and of both."""
    camera = block.cameras[row]
    x, y = camera.parameters[_PRINCIPAL_POINT]
    if _is_unknown(camera)[_PRINCIPAL_POINT].any():
        return
    for signs, kinds in (((1.0, -1.0), "y"), ((-1.0, 1.0), "x"), ((-1.0, -1.0), "x and y")):
        if (x, y) == (x * signs[0], y * signs[1]):
            continue
        text = (
            f"the principal point ({x:g}, {y:g}) mm fits with the opposite sign of {kinds}; reverse it (x to the right "
            "and y up, from the centre of the sensor or the fiducial marks to the principal point)"
        )
        changed = _with_factors(block, row, _PRINCIPAL_POINT, np.array(signs))
        yield Hypothesis(changed, finding(POINT_SIGN, f"camera {camera.name}", text))


def distortion_of_lens(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera without distortion as one whose distortion is unknown."""
    camera = block.cameras[row]
    if not _values(camera)[_DISTORTION].any() and not _is_unknown(camera)[_DISTORTION].any():
        text = (
            "the lens has a distortion that is not in the camera's record; give it (distortion = { ... }), or let the "
            'adjustment determine it: unknown = ["A3", "A5", "P1", "P2"]'
        )
        changed = with_unknown(block, row, *_LENS)
        yield Hypothesis(changed, finding(DISTORTION, f"camera {camera.name}", text))


def square_pixels(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield a camera whose pixels are square, with the height of its sensor that follows from the width."""
    camera = block.cameras[row]
    if camera.sensor is None or "B1" in camera.unknown:
        return
    width, height = camera.sensor.width / camera.sensor.columns, camera.sensor.height / camera.sensor.rows
    if not _ROUNDED < abs(width / height - 1.0) < _NOT_SQUARE:
        return
    rows = block.photo_camera[block.photo_points.photo] == row
    xy = np.where(rows[:, None], block.photo_points.xy * [1.0, width / height], block.photo_points.xy)
    unknown = ", ".join(f'"{kind}"' for kind in (*camera.unknown, "B1"))
    text = (
        f"the photos fit with square pixels, and the sensor has pixels of {width * 1e3:.4g} x {height * 1e3:.4g} µm: "
        f"sizes in data sheets are rounded; write height = {width * camera.sensor.rows:.5g}, or set unknown = "
        f"[{unknown}]"
    )
    changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
    yield Hypothesis(changed, finding(NOT_SQUARE, f"camera {camera.name}", text))


def with_camera(block: Block, row: int, camera: Camera) -> Block:
    """Return a block with another camera in one row."""
    return replace(block, cameras=(*block.cameras[:row], camera, *block.cameras[row + 1 :]))


def with_unknown(block: Block, row: int, *kinds: str) -> Block:
    """Return a block in which parameters of one camera are unknown, besides those that are unknown already."""
    camera = block.cameras[row]
    unknown = tuple(kind for kind in CAMERA_PARAMETERS if kind in {*kinds, *camera.unknown})
    return with_camera(block, row, replace(camera, unknown=unknown))


def _with_factors(block: Block, row: int, which: slice, factor: FloatArray) -> Block:
    values = _values(block.cameras[row])
    values[which] *= factor
    return with_camera(block, row, replace(block.cameras[row], parameters=tuple(values.tolist())))


def _values(camera: Camera) -> FloatArray:
    return np.array(camera.parameters, dtype=np.float64)


def _is_unknown(camera: Camera) -> BoolArray:
    return np.isin(CAMERA_PARAMETERS, camera.unknown)


# Where the photos' orientations are roughly known, the adjustment starts from the value that follows from points with
# given coordinates.

OTHER_LENS = declare(
    "principal-distance", "the principal distance of a camera does not fit its photos", BAD_START, _OTHER_CAMERA
)
OTHER_POINT = declare(
    "principal-point", "the principal point of a camera does not fit its photos", BAD_START, _OTHER_CAMERA
)
UNEQUAL_AXES = declare(
    "unequal-axes", "x and y of the photos have different scales", BAD_START, _OTHER_CAMERA,
    Consequence(groups=("distance",)),
)  # fmt: skip

_NEAR_AXIS = 0.02
"""Angle, radians, from the camera's axis below which a point says nothing about the principal distance."""

_DIAGONAL_OF_35_MM_FILM = float(np.hypot(36.0, 24.0))

_ALIKE = 0.15
"""Logarithm of the ratio up to which two principal distances count as the same: the accuracy of an uncalibrated one."""


def other_principal_distance(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield the camera of one row with an unknown principal distance."""
    camera = block.cameras[row]
    if "C" in camera.unknown:
        return
    start = replace(camera, parameters=(principal_distance_seen(block, row), *camera.parameters[1:]))
    changed = with_unknown(with_camera(block, row, start), row, "C")
    yield Hypothesis(changed, partial(_findings, row=row, given=camera.parameters[0]))


def _findings(solved: SolvedBlock, row: int, given: float) -> list[ProjectWarning]:
    camera = solved.block.cameras[row]
    found = float(solved.state.cameras[row, 0])
    if found <= 0.0:
        return []
    corners = frame_corners(camera)
    if corners is not None and not is_possible_view(found, float(np.hypot(*(corners[1] - corners[0])))):
        return []
    sd = float(_sd_of_parameters(solved, row, "C")[0])
    sensor, size, sizes = camera.sensor, "", ""
    if sensor is not None:
        width, height = (side * given / found for side in (sensor.width, sensor.height))
        size = ", or the size of the sensor,"
        sizes = f", or the sensor (with C = {given:g} mm that is {width:.4g} x {height:.4g} mm)"
    unit = _unit_clause(given, found, camera)
    text = (
        f"C = {given:g} mm does not fit the photos, {found:.4g} ± {sd:.1g} mm does{unit}: the "
        f"principal distance{size} is probably that of another lens, zoom or camera; correct it (c = {found:.5g})"
        f"{sizes}, "
        'or let the adjustment determine it (unknown = ["C"])'
    )
    return [ProjectWarning(OTHER_LENS, f"camera {camera.name}", text)]


_SIGNIFICANT = 5.0
"""Standard deviations by which a parameter is another one."""


def other_principal_point(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield the camera of one row with an unknown principal point."""
    camera = block.cameras[row]
    if not _is_unknown(camera)[_PRINCIPAL_POINT].any():
        given = _values(camera)[_PRINCIPAL_POINT]
        yield Hypothesis(with_unknown(block, row, "DX", "DY"), partial(_of_point, row=row, given=given))


def _of_point(solved: SolvedBlock, row: int, given: FloatArray) -> list[ProjectWarning]:
    camera, found = solved.block.cameras[row], solved.state.cameras[row, _PRINCIPAL_POINT]
    sd = _sd_of_parameters(solved, row, "DX", "DY")
    if not (np.abs(found - given) > _SIGNIFICANT * sd).any():
        return []
    x, y = found
    text = (
        f"the principal point [{given[0]:g}, {given[1]:g}] does not fit the photos, [{x:.3f} ± {sd[0]:.1g}, {y:.3f} ± "
        f"{sd[1]:.1g}] mm does: it is probably that of another calibration, or counted from a corner or with another "
        f"direction of y; correct it (principal_point = [{x:.4g}, {y:.4g}]), or let the adjustment determine it "
        '(unknown = ["DX", "DY"])'
    )
    return [ProjectWarning(OTHER_POINT, f"camera {camera.name}", text)]


def unequal_axes(block: Block, row: int) -> Iterator[Hypothesis]:
    """Yield the camera of one row with an unknown scale of x against y, and of both."""
    camera, place = block.cameras[row], CAMERA_PARAMETERS.index("B1")
    if "B1" not in camera.unknown:
        yield Hypothesis(
            with_unknown(block, row, "C", "B1"), partial(_of_axes, row=row, place=place, given=camera.parameters[place])
        )


def _of_axes(solved: SolvedBlock, row: int, place: int, given: float) -> list[ProjectWarning]:
    camera = solved.block.cameras[row]
    found, sd = float(solved.state.cameras[row, place]), float(_sd_of_parameters(solved, row, "B1")[0])
    if abs(found - given) < _SIGNIFICANT * sd:
        return []
    text = (
        f"x is {1.0 + found:.5f} ± {sd:.1g} times as long as y in its photos: their sides, or those of the sensor or "
        'of a pixel, are given wrong; correct them, or let the adjustment determine it (unknown = ["C", "B1"])'
    )
    return [ProjectWarning(UNEQUAL_AXES, f"camera {camera.name}", text)]


def _sd_of_parameters(solved: SolvedBlock, row: int, *kinds: str) -> FloatArray:
    columns = solved.problem.unknowns.cameras[row, [CAMERA_PARAMETERS.index(kind) for kind in kinds]]
    return np.asarray(solved.deviation_scale * np.sqrt(np.diagonal(solved.cofactors_of(columns))))


def _unit_clause(given: float, found: float, camera: Camera) -> str:
    """Return in which unit a principal distance was probably given, as a clause; "" where none explains it."""
    units = {f"in {unit}": size for unit, size in millimetres_per_unit(camera).items()}
    units["in micrometres"] = 1e-3
    if camera.sensor is not None:
        diagonal = float(np.hypot(camera.sensor.width, camera.sensor.height))
        units["the equivalent for 35 mm film"] = diagonal / _DIAGONAL_OF_35_MM_FILM
    differences = {unit: abs(float(np.log(given * size / found))) for unit, size in units.items()}
    nearest = min(differences, key=differences.__getitem__)
    is_nearer = differences[nearest] < min(_ALIKE, 0.5 * abs(float(np.log(given / found))))
    return f" ({given:g} is probably {nearest})" if is_nearer else ""


FAR_FROM_GIVEN = "far-from-given"

_FAR = 0.35
"""Logarithm of the ratio of two principal distances from which no rough value explains the difference."""

_DETERMINED = 0.02
"""Standard deviation of a principal distance, as a part of it, above which the adjustment hardly determines it."""


def far_from_given(block: Block, solved: SolvedBlock) -> Iterator[ProjectWarning]:
    """Yield a warning for each principal distance that was free and ended far from where it started.

    Parameters
    ----------
    block : Block
        As gathered.
    solved : SolvedBlock
        An adjustment that fits.
    """
    place = {camera.name: row for row, camera in enumerate(solved.block.cameras)}
    for camera in block.cameras:
        row = place.get(camera.name, -1)
        given, found = camera.parameters[0], float(solved.state.cameras[row, 0])
        if row < 0 or "C" not in camera.unknown or found <= 0.0 or abs(float(np.log(given / found))) < _FAR:
            continue
        sd = float(_sd_of_parameters(solved, row, "C")[0])
        if sd < _DETERMINED * found:
            text = (
                f"C = {given:g} mm is far from the {found:.5g} ± {sd:.1g} mm that the adjustment found"
                f"{_unit_clause(given, found, camera)}; the result does not suffer from it: check that the camera and "
                f"its sensor are the right ones, and write c = {found:.5g}"
            )
            yield ProjectWarning(FAR_FROM_GIVEN, f"camera {camera.name}", text)


def principal_distance_seen(block: Block, camera: int) -> float:
    """Return the median ratio (mm) of photo coordinates to those that given points would have with C = 1.

    Parameters
    ----------
    block : Block
        With orientations of the photos.
    camera : int
        Its index in the block.

    Returns
    -------
    float
        The camera's own principal distance where its photos show no point whose coordinates are given in full.
    """
    own = block.cameras[camera].parameters
    rows, ground = _of_given_points(block, camera)
    photo = block.photo_points.photo[rows]
    orientation = block.photo_orientation[photo]
    u = np.einsum("ni,nij->nj", ground - orientation[:, :3], rotation_from_angles(orientation[:, 3:]))
    projection = PROJECTIONS[block.cameras[camera].projection]
    with np.errstate(divide="ignore", invalid="ignore"):
        tangents = np.stack(projection.ideal_coordinates(1.0, *u.T), axis=1)
    size = np.sum(tangents**2, axis=1)
    counted = projection.is_in_front(*u.T) & (size > _NEAR_AXIS**2)
    xy = block.photo_points.xy[rows] - np.array(own[1:3])
    found = np.sum(xy * tangents, axis=1)[counted] / size[counted]
    found = found[found > 0.0]
    return float(np.median(found)) if len(found) else own[0]


def _of_given_points(block: Block, camera: int) -> tuple[IntArray, FloatArray]:
    """Return rows of photo points that show points given in full, and these (n, 3) in the frame of the block."""
    known, points = given_coordinates(block), block.photo_points
    full: BoolArray = np.asarray(np.isfinite(known).all(axis=1))
    rows = np.flatnonzero(full[points.point] & (block.photo_camera[points.photo] == camera) & points.in_use)
    return rows, block.ground.to_local(known[points.point[rows]])
