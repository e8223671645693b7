"""The checks before an adjustment, in the order in which their warnings are printed."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from orip.errors import Complaint, InputError, ProjectWarning
from orip.interior.definitions import Definitions
from orip.interior.in_force import Interior
from orip.interior.mounting import frame_corners
from orip.mistakes.camera_values import is_possible_view
from orip.mistakes.marks.all_films import MARKS_GIVEN_WRONG, marks_of_all_films
from orip.mistakes.marks.misnamed import misnamed_marks
from orip.mistakes.mistake import OTHER_FRAME, declare
from orip.mistakes.names import figures_told, name_warnings, photos_under_two_names
from orip.mistakes.other_units import millimetres_per_unit
from orip.mistakes.outside_frame import (
    TURNED_SENSOR,
    exchanged_templates,
    points_in_another_unit,
    points_outside_frames,
)
from orip.mistakes.photo_coordinates import coordinates_in_other_units, find_reduced_pictures
from orip.mistakes.stations.errors_too_small import errors_too_small
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, Camera, Sensor
from orip.records.control import Control
from orip.records.measurement import Measured
from orip.records.names import record_key
from orip.units import MILLIMETRES_PER_INCH

SENSELESS = declare("senseless-camera", "", OTHER_FRAME, explains_misfit=True)

SQUARE_PIXELS = "but pixels are square"

_SQUARE = 1.05
"""Largest ratio of the sides of a pixel; sensor sizes in data sheets are rounded to a hundredth."""

_NO_LENS = 0.01
"""Ratio of principal distance to diagonal of the frame below which it is in another unit: a fisheye has 0.2."""

_SMALLEST_PIXEL, _SMALL_PIXEL = 1e-4, 1e-3
"""mm. The first is a fifth of the wavelength of light, and of the smallest pixel that is made; few are smaller than the
second."""

_PIXEL_IN_MICROMETRES = "the size of a pixel in µm"

_SIZES = (1.0, 300.0)
"""Longer sides of frames, mm: of phones, of aerial cameras."""

_USUAL = (0.2, 10.0)
"""Ratios of principal distance to diagonal: of fisheyes, of long lenses."""


def raise_if_impossible(cameras: Iterable[Camera]) -> None:
    """Refuse cameras whose principal distance or sensor is surely in another unit, or the size of a pixel.

    An adjustment of them could only blame other data.

    Raises
    ------
    InputError
        With the values to write.
    """
    found = [
        Complaint(f"camera {camera.name}: {text}")
        for camera in cameras
        if (text := _wrong_frame(camera) or _in_another_unit(camera) or _in_parts_of_c(camera))
    ]
    if found:
        raise InputError(tuple(found))


def _wrong_frame(camera: Camera) -> str:
    return _tiny_sensor(camera) or _tiny_frame(camera) or _huge_sensor(camera) or _in_pixels_from_the_corner(camera)


def _tiny_sensor(camera: Camera) -> str:
    """Return what is wrong with a sensor whose pixels would be smaller than the wavelength of light."""
    sensor = camera.sensor
    if sensor is None:
        return ""
    pixel = (sensor.width / sensor.columns, sensor.height / sensor.rows)
    is_pixel = _are_square(sensor.width, sensor.height) and not _are_square(float(sensor.columns), float(sensor.rows))
    if max(pixel) >= (_SMALL_PIXEL if is_pixel else _SMALLEST_PIXEL):
        return ""
    text = (
        f"a sensor of {sensor.width:g} x {sensor.height:g} mm with {sensor.columns} columns and {sensor.rows} rows "
        f"would have pixels of {pixel[0] * 1e3:.2g} x {pixel[1] * 1e3:.2g} µm, which no camera has; width and height "
        "are those of the whole sensor in mm"
    )
    meant = [
        f"{what}: write width = {size[0]:.5g}, height = {size[1]:.5g}"
        for what, size in _sizes_meant(sensor).items()
        if _is_usual(camera, size)
    ]
    return f"{text}; they seem to be {' (or '.join(meant)}{')' * (len(meant) - 1)}" if meant else text


def _sizes_meant(sensor: Sensor) -> dict[str, tuple[float, float]]:
    """Return width and height of the sensor, mm, by what may have been written in their place."""
    width, height = sensor.width, sensor.height
    sizes = {"in metres": (width * 1e3, height * 1e3)}
    sizes["in inches"] = (width * MILLIMETRES_PER_INCH, height * MILLIMETRES_PER_INCH)
    if _are_square(width, height):
        sizes["the size of a pixel in mm"] = (width * sensor.columns, height * sensor.rows)
        sizes[_PIXEL_IN_MICROMETRES] = (width * sensor.columns * 1e-3, height * sensor.rows * 1e-3)
    return {what: size for what, size in sizes.items() if _are_square(size[0] / sensor.columns, size[1] / sensor.rows)}


def _is_usual(camera: Camera, size: tuple[float, float]) -> bool:
    """Tell whether a frame is one that cameras have, with the principal distance as it is, or in metres."""
    diagonal, c = float(np.hypot(*size)), camera.parameters[0]
    fits = any(_USUAL[0] <= c * factor / diagonal <= _USUAL[1] for factor in (1.0, 1e3))
    return fits and _SIZES[0] <= max(size) <= _SIZES[1]


def _tiny_frame(camera: Camera) -> str:
    """Return that a frame, far smaller than its principal distance, is in metres."""
    if camera.frame is None or camera.parameters[0] / np.hypot(*camera.frame) < 1.0 / _NO_LENS:
        return ""
    width, height = (side * 1e3 for side in camera.frame)
    if max(camera.frame) >= _SIZES[0] or not _is_usual(camera, (width, height)):
        return ""
    return (
        f"a frame of {camera.frame[0]:g} x {camera.frame[1]:g} mm with C = {camera.parameters[0]:g} mm seems to be in "
        f"metres; write frame = [{width:.6g}, {height:.6g}]"
    )


def _huge_sensor(camera: Camera) -> str:
    """Return that a sensor, far larger than its principal distance, is in micrometres."""
    sensor, c = camera.sensor, camera.parameters[0]
    if sensor is None or max(sensor.width, sensor.height) < 1e3 * _SIZES[0]:
        return ""
    width, height = sensor.width * 1e-3, sensor.height * 1e-3
    if (sensor.width, sensor.height) == (sensor.columns, sensor.rows):
        return (
            f"width and height of the sensor are {sensor.width:g} x {sensor.height:g}, its columns and rows, but have "
            "to be in mm; write the size of the sensor (columns and rows times the size of a pixel in mm)"
        )
    if c / np.hypot(sensor.width, sensor.height) >= _NO_LENS or not _is_usual(camera, (width, height)):
        return ""
    return (
        f"a sensor of {sensor.width:g} x {sensor.height:g} mm with C = {c:g} mm seems to be in micrometres; write "
        f"width = {width:.6g}, height = {height:.6g}"
    )


_NEAR_CENTRE = 0.1
"""Part of width and height by which a principal point is off the centre of an ordinary camera at most."""


def _in_pixels_from_the_corner(camera: Camera) -> str:
    """Return that a principal point is in pixels, counted from the upper left corner."""
    sensor, (x, y) = camera.sensor, camera.parameters[1:3]
    if sensor is None or not _is_near_centre(x, y, float(sensor.columns), float(sensor.rows)):
        return ""
    dx = (x - 0.5 * sensor.columns) * sensor.width / sensor.columns
    dy = (0.5 * sensor.rows - y) * sensor.height / sensor.rows
    return (
        f"the principal point ({x:g}, {y:g}) mm is outside the sensor of {sensor.width:g} x {sensor.height:g} mm; it "
        "seems to be in pixels from the upper left corner, but is in mm from the centre, y up: write principal_point "
        f"= [{dx:.5f}, {dy:.5f}]"
    )


def _is_near_centre(x: float, y: float, width: float, height: float) -> bool:
    return abs(x / width - 0.5) < _NEAR_CENTRE and abs(y / height - 0.5) < _NEAR_CENTRE


_TOO_FAR = 3.0
"""Displacement at the corner of the frame, over its distance from the centre, that no lens has."""


def _in_parts_of_c(camera: Camera) -> str:
    """Return that coefficients of distortion are those of coordinates divided by the principal distance."""
    corners, c = frame_corners(camera), camera.parameters[0]
    if corners is None:
        return ""
    radius = 0.5 * float(np.hypot(*(corners[1] - corners[0])))
    given = np.array(camera.parameters[4:8])
    powers = 2.0 * np.arange(1, 5)
    meant = given / c**powers
    if abs(given @ radius**powers) < _TOO_FAR or abs(meant @ radius**powers) > 0.5:
        return ""
    values = ", ".join(
        f"{kind} = {value:.4g}" for kind, value in zip(CAMERA_PARAMETERS[4:8], meant.tolist(), strict=True) if value
    )
    return (
        "the distortion would move the corners of the picture by several times their distance from the centre; its "
        "coefficients seem to be those of OpenCV and others (k1, k2, k3), for coordinates in parts of C, but here they "
        f"are for mm: A3 = k1 / C², A5 = k2 / C⁴, A7 = k3 / C⁶; write {values}"
    )


def _in_another_unit(camera: Camera) -> str:
    """Return that a principal distance that no lens has is in metres, micrometres or pixels."""
    corners, c = frame_corners(camera), camera.parameters[0]
    if corners is None:
        return ""
    width, height = (corners[1] - corners[0]).tolist()
    diagonal = float(np.hypot(width, height))
    if _NO_LENS <= c / diagonal <= 1.0 / _NO_LENS:
        return ""
    sizes = {**millimetres_per_unit(camera), "micrometres": 1e-3}
    # a fisheye's distance is hardly known to the micrometre: what would be one is in pixels
    shortest = {"micrometres": 2.0 * _USUAL[0]}
    usual = [unit for unit, size in sizes.items() if shortest.get(unit, _USUAL[0]) <= c * size / diagonal <= _USUAL[1]]
    if c < diagonal:  # so short a lens is in metres, not in inches
        usual = [unit for unit in usual if unit == "metres"]
    if not usual:
        return ""
    meant = " or ".join(f"in {unit}" for unit in usual)
    values = " or ".join(f"c = {c * sizes[unit]:.6g}" for unit in usual)
    return (
        f"C = {c:g} mm on a frame of {width:g} x {height:g} mm is that of no lens; it seems to be {meant}, but C is "
        f"in mm: write {values}"
    )


def camera_warnings(camera: Camera) -> Iterator[ProjectWarning]:
    """Yield a warning for a principal distance that does not suit the frame, and for pixels that are not square."""
    where = f"camera {camera.name}"
    for text in (_angle_of_view(camera), _pixels(camera), _from_the_corner(camera)):
        if text:
            yield ProjectWarning(SENSELESS, where, text)


def _angle_of_view(camera: Camera) -> str:
    corners, c = frame_corners(camera), camera.parameters[0]
    if corners is None:
        return ""
    width, height = (corners[1] - corners[0]).tolist()
    diagonal = float(np.hypot(width, height))
    if is_possible_view(c, diagonal):
        return ""
    angle = float(np.degrees(_angle_at(camera, c, diagonal)))
    shown = f"{angle:.0f}" if angle >= 10.0 else f"{angle:.2g}"
    return (
        f"C = {c:g} mm on a frame of {width:g} x {height:g} mm would be an angle of view of {shown}°; C is in mm"
        f"{_meant(camera, diagonal)}"
    )


def _angle_at(camera: Camera, c: float, diagonal: float) -> float:
    """Return the angle of view, radians."""
    return diagonal / c if camera.projection == "equidistant" else float(2.0 * np.arctan(0.5 * diagonal / c))


def _meant(camera: Camera, diagonal: float) -> str:
    """Return what C would be if it was written in another unit by mistake, for those units that are possible."""
    c = camera.parameters[0]
    listed = ", ".join(
        f"if it is in {unit}: C = {c * size:.4g} mm"
        for unit, size in millimetres_per_unit(camera).items()
        if is_possible_view(c * size, diagonal)
    )
    return f" ({listed})" if listed else ""


def _pixels(camera: Camera) -> str:
    sensor = camera.sensor
    if sensor is None:
        return ""
    width, height = sensor.width / sensor.columns, sensor.height / sensor.rows
    if _are_square(width, height):
        return ""
    text = f"the sensor's pixels would be {width * 1e3:.3g} x {height * 1e3:.3g} µm, {SQUARE_PIXELS}"
    if _are_square(sensor.height / sensor.columns, sensor.width / sensor.rows):
        return f"{text}; they are if width and height are exchanged: exchange them"
    size = _sizes_meant(sensor).get(_PIXEL_IN_MICROMETRES)
    if size and _is_usual(camera, size):
        meant = f"width = {size[0]:.5g}, height = {size[1]:.5g}"
        return f"{text}; width and height seem to be {_PIXEL_IN_MICROMETRES}: write {meant} (mm)"
    return f"{text}; check columns, rows, width and height of the sensor (of the image as measured: not cropped)"


def _from_the_corner(camera: Camera) -> str:
    sensor, (x, y) = camera.sensor, camera.parameters[1:3]
    if sensor is None or not _is_near_centre(x, y, sensor.width, sensor.height):
        return ""
    return (
        f"the principal point ({x:g}, {y:g}) mm would be at a corner of the sensor; it seems to count from another "
        f"corner, but counts from the centre, y up: subtract {0.5 * sensor.width:g} from x and {0.5 * sensor.height:g} "
        "from y (where y counts downwards, change its sign then)"
    )


def _are_square(width: float, height: float) -> bool:
    return max(width / height, height / width) <= _SQUARE


def measurement_warnings(
    definitions: Definitions, measured: Measured, interior: Interior
) -> tuple[ProjectWarning, ...]:
    """Return what is probably wrong with cameras, marks and photo points, together with the interior's own warnings.

    Parameters
    ----------
    interior : Interior
        Orientations from those marks.
    """
    cameras = (warning for camera in definitions.cameras.values() for warning in camera_warnings(camera))
    outside = [
        warning
        for observations in measured.observations.values()
        for warning in points_outside_frames(definitions, observations, interior.to_photo)
    ]
    units = [
        warning
        for observations in measured.observations.values()
        for warning in (
            *coordinates_in_other_units(definitions, observations),
            *points_in_another_unit(definitions, observations, interior.to_photo),
        )
    ]
    reduced = [
        warning
        for observations in measured.observations.values()
        for warning in find_reduced_pictures(definitions, observations)
    ]
    templates = tuple(exchanged_templates(definitions, measured))
    # points in another unit, from another origin or another template lie outside; that is no second mistake
    misread = {warning.where for warning in (*units, *reduced)}
    outside = [warning for warning in outside if not (templates or _cameras_of(definitions, warning) & misread)]
    # columns and rows that are exchanged make pixels that are not square
    turned = {warning.where for warning in outside if TURNED_SENSOR in warning.text}
    cameras = (warning for warning in cameras if warning.where not in turned or SQUARE_PIXELS not in warning.text)
    # photos of several bundles are checked once for each bundle
    of_all = marks_of_all_films(definitions, interior.adjustments)
    # names are judged by residuals, which another unit or transformation has made
    single = (
        [] if any(warning.code != MARKS_GIVEN_WRONG for warning in of_all) else misnamed_marks(interior.adjustments)
    )
    marks = (*templates, *(single or of_all), *interior.warnings)
    return tuple(dict.fromkeys((*cameras, *units, *reduced, *marks, *outside)))


def _cameras_of(definitions: Definitions, warning: ProjectWarning) -> set[str]:
    """Return the camera that a warning is about, or that of the photo that it is about, as warnings name it."""
    photo = definitions.photos.get(record_key(warning.where.removeprefix("photo ")))
    camera = definitions.cameras.get(record_key(photo.camera)) if photo is not None else None
    return {warning.where} if camera is None else {warning.where, f"camera {camera.name}"}


def block_warnings(block: Block, control: Control) -> tuple[ProjectWarning, ...]:
    """Return what is probably wrong with the names of a gathered block's photos and points.

    Parameters
    ----------
    control : Control
        All control of the project, even what the block does not use.
    """
    # measurements are checked without these
    from orip.bundle.starting_state import left_out_figures
    from orip.mistakes.control.free_network import distances_along_no_axes, observations_without_weight
    from orip.mistakes.stations.strips import missing_strips

    names = name_warnings(block, control, block.preliminary)
    measured = frozenset(block.point_names)
    told = figures_told(measured, control)
    figures = [point for point in control.figure_points if point.figure not in told]
    names += left_out_figures(figures, measured)
    errors = errors_too_small(block)
    return (
        *photos_under_two_names(block),
        *names,
        *errors,
        *distances_along_no_axes(block),
        *observations_without_weight(block),
        *missing_strips(block),
    )
