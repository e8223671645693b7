"""Photo coordinates in another unit, at another resolution, or mirrored."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import ProjectWarning
from orip.geometry.figures import FittedPlanes, fitted_planes
from orip.interior.definitions import Definitions
from orip.mistakes.hypothesis import Hypothesis, finding, photos_stay_near
from orip.mistakes.mistake import ALL_THE_REST, BAD_START, MISPLACED_PHOTO, declare
from orip.records.block import Block
from orip.records.camera import Camera, Sensor
from orip.records.coded_names import CodedNames, coded
from orip.records.measurement import PhotoObservations
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.records.results.solution import Solution
from orip.structs import replace


def points_of_cameras(
    definitions: Definitions, observations: PhotoObservations, concerned: Callable[[Photo], bool]
) -> Iterator[tuple[Camera, IntArray]]:
    """Yield each camera with the rows of the photo points that are measured in its photos.

    Parameters
    ----------
    observations : PhotoObservations
        Of one bundle; photos that are not defined are passed over.
    concerned : callable
        Whether the points of a photo are looked at.
    """
    names = coded(observations.photos)
    numbers: dict[str, int] = {}

    def camera(name: str) -> int:
        photo = definitions.photos.get(record_key(name))
        if photo is None or not concerned(photo):
            return -1
        return numbers.setdefault(record_key(photo.camera), len(numbers))

    number = names.numbers(camera)
    for key, place in numbers.items():
        found = np.flatnonzero(number == place)
        if len(found):
            yield definitions.cameras[key], found


# Cameras with a sensor are measured in pixels: millimetres, or parts of the picture, are far smaller. Those with
# fiducial marks are scaled by these.

COORDINATE_UNIT = declare(
    "coordinate-unit", "the photo coordinates are in another unit", ALL_THE_REST, explains_misfit=True
)

_UNITS = {1e3: "micrometres", 1e4: "tenths of micrometres (0.0001 mm)", 1e-3: "metres", 1.0 / 25.4: "inches"}
"""Names of units by their number in a millimetre."""

_OUTSIDE, _TINY = 2.0, 0.03
"""Parts of half the longer side of the frame: in millimetres the farthest coordinate does not exceed the first, and
reaches the second."""

_FILLED_BY_MILLIMETRES = 0.3
"""Part of half the longer side that the coordinates reach in the right unit."""

_WIDEST, _NARROWEST = 3.0, 0.02
"""The same limits for the farthest coordinate over the principal distance, where no frame is given."""

_USUAL = (0.15, 1.5)
"""Farthest coordinate over the principal distance in the right unit, where no frame is given."""

_LARGEST_FRAME = 300.0
"""mm."""

_FEWEST_COORDINATES, _FEWEST_PIXELS = 4, 10
"""Least number of photo points with which a camera is judged, and one with a sensor."""

_PIXELS, _EDGE = 5.0, 1.01
"""Least number of pixels in a unit that is taken for them, and the tolerance at the edge of any picture."""


def coordinates_in_other_units(definitions: Definitions, observations: PhotoObservations) -> Iterator[ProjectWarning]:
    """Yield a warning for each camera whose photo coordinates cannot be millimetres.

    Parameters
    ----------
    observations : PhotoObservations
        Of one bundle.
    """
    for camera, rows in points_of_cameras(definitions, observations, _is_measured_directly):
        if camera.sensor is not None and len(rows) >= _FEWEST_PIXELS:
            yield from _no_pixels(camera, camera.sensor, observations.measured[rows])
        elif camera.sensor is None and not camera.fiducials and len(rows) >= _FEWEST_COORDINATES:
            yield from _warnings(camera, observations.measured[rows])


def _is_measured_directly(photo: Photo) -> bool:
    return photo.template is None and photo.scan is None


def _warnings(camera: Camera, xy: FloatArray) -> Iterator[ProjectWarning]:
    # corners of what is measured say as much as all of it
    xy = np.stack([column(xy[:, axis]) for column in (np.min, np.max) for axis in (0, 1)]).reshape(2, 2)
    reached = _reached(camera, xy - camera.parameters[1:3])
    limits = (_TINY, _OUTSIDE) if camera.frame is not None else (_NARROWEST, _WIDEST)
    if limits[0] <= reached <= limits[1]:
        return
    farthest = float(np.abs(xy).max())
    compared = (
        f"on a frame of {camera.frame[0]:g} x {camera.frame[1]:g} mm"
        if camera.frame is not None
        else f"with C = {camera.parameters[0]:g} mm"
    )
    text = f"photo coordinates reach {farthest:.6g} {compared}, but they have to be in mm{_meant(camera, xy)}"
    yield ProjectWarning(COORDINATE_UNIT, f"camera {camera.name}", text)


def _no_pixels(camera: Camera, sensor: Sensor, xy: FloatArray) -> Iterator[ProjectWarning]:
    """Yield a warning where coordinates lie within the sensor's millimetres, or within 1, and not in its pixels."""
    pixels, size = np.array([sensor.columns, sensor.rows]), np.array([sensor.width, sensor.height])
    low, high = xy.min(axis=0), xy.max(axis=0)
    centred = bool((low < 0.0).any())
    extents = {
        "mm from the upper left corner": (size, not centred, "divide them by the size of a pixel"),
        "mm from the centre": (
            0.5 * size, centred, "give the camera a frame = [width, height] in place of the sensor, or write pixels"
        ),
        "parts of the picture": (np.ones(2), not centred, "multiply them by the numbers of columns and rows"),
    }  # fmt: skip
    farthest = np.maximum(np.abs(low), np.abs(high))
    for unit, (extent, fits, remedy) in extents.items():
        parts = farthest / extent
        if (
            fits
            and (pixels > _PIXELS * extent).all()
            and parts.max() <= _EDGE
            and parts.min() >= _FILLED_BY_MILLIMETRES
        ):
            text = (
                f"photo coordinates reach {farthest[0]:.4g} and {farthest[1]:.4g} on a sensor of {sensor.columns} "
                f"columns and {sensor.rows} rows, but they have to be pixels; they seem to be {unit}: {remedy}"
            )
            yield ProjectWarning(COORDINATE_UNIT, f"camera {camera.name}", text)
            return
    # pixels are never far left of the first column and above the first row: these count from the middle
    half = 0.5 * pixels
    if (
        (low < -_FILLED_BY_MILLIMETRES * half).all()
        and (high > _FILLED_BY_MILLIMETRES * half).all()
        and (farthest <= _EDGE * half).all()
    ):
        text = (
            f"photo coordinates go from {low[0]:.4g} to {high[0]:.4g} and from {low[1]:.4g} to {high[1]:.4g} on a "
            f"sensor of {sensor.columns} columns and {sensor.rows} rows: they seem to be pixels from the centre of the "
            f"picture, but they count from its upper left corner: add {half[0]:g} and {half[1]:g} (where rows count "
            "upwards, change their sign before)"
        )
        yield ProjectWarning(COORDINATE_UNIT, f"camera {camera.name}", text)


def _reached(camera: Camera, xy: FloatArray) -> float:
    """Return the farthest coordinate over half the frame, or over the principal distance without a frame."""
    if camera.frame is None:
        return float(np.abs(xy).max()) / camera.parameters[0]
    return float(np.abs(xy).max()) / (0.5 * max(camera.frame))


def _meant(camera: Camera, xy: FloatArray) -> str:
    """Return in what unit the coordinates probably are, as a clause."""
    if _are_pixels(xy):
        return "; they seem to be pixels: give the camera a sensor = { columns, rows, width, height }, and no frame"
    filled = (_FILLED_BY_MILLIMETRES, _OUTSIDE) if camera.frame is not None else _USUAL
    units = [
        f"; they seem to be in {unit}: multiply them by {1.0 / size:g}"
        for size, unit in _UNITS.items()
        if filled[0] <= _reached(camera, xy / size) <= filled[1]
    ]
    return units[0] if units else ": correct their unit"


def _are_pixels(xy: FloatArray) -> bool:
    """Tell whether coordinates count from a corner and exceed the millimetres of any frame."""
    return bool(xy.min() >= 0.0 and xy.max() > _LARGEST_FRAME)


RESOLUTION = declare("resolution", "", ALL_THE_REST, explains_misfit=True, comes_first=True)

_FACTORS = (2, 4, 8)

_FEWEST_IN_A_PICTURE, _FEWEST_PICTURES = 100, 3
"""Photo points and photos: photos of one object may show it in one corner."""

_FILLED, _OFF_MIDDLE = 0.7, 0.08
"""Parts of the reduced picture that the points reach at least, and that the middle of their extent is from its own."""


def find_reduced_pictures(definitions: Definitions, observations: PhotoObservations) -> Iterator[ProjectWarning]:
    """Yield a warning for each camera whose photo points surround the middle of a corner of its sensor, and no more.

    Parameters
    ----------
    observations : PhotoObservations
        Of one bundle.
    """
    for camera, rows in points_of_cameras(definitions, observations, lambda _: True):
        photos = coded(observations.photos)[rows].occurring()
        if camera.sensor is None or len(rows) < _FEWEST_IN_A_PICTURE or len(photos) < _FEWEST_PICTURES:
            continue
        if (observations.measured[rows] < -0.01 * np.array([camera.sensor.columns, camera.sensor.rows])).any():
            continue  # no corner: they count from elsewhere
        parts = observations.measured[rows] / [camera.sensor.columns, camera.sensor.rows]
        reached, middle = parts.max(axis=0), 0.5 * (parts.min(axis=0) + parts.max(axis=0))
        for factor in _FACTORS:
            is_filled = ((reached * factor > _FILLED) & (reached * factor < _EDGE)).all()
            if is_filled and (np.abs(middle * factor - 0.5) < _OFF_MIDDLE).all():
                text = (
                    f"all {len(rows)} points lie in the upper left corner of the {camera.sensor.columns} columns and "
                    f"{camera.sensor.rows} rows of the sensor, and would fill it multiplied by {factor}: they seem to "
                    "be measured at a lower resolution; write columns and rows of the pictures that were measured, "
                    "with the same width and height"
                )
                yield ProjectWarning(RESOLUTION, f"camera {camera.name}", text)


_FEWEST_TO_TRY = 10
"""Number of photo points that all lie in one corner by chance with a probability of one in a million."""


def reduced_pictures(block: Block) -> Iterator[Hypothesis]:
    """Yield the pixels of each camera multiplied by a factor, if they lie in the upper left corner of its sensor."""
    for row, camera in enumerate(block.cameras):
        if camera.sensor is None:
            continue
        rows = block.photo_camera[block.photo_points.photo] == row
        corner = np.array([-camera.sensor.width, camera.sensor.height]) / 2.0
        # columns and rows as parts of those of the sensor
        part = np.abs(block.photo_points.xy[rows] - corner) / np.abs(2.0 * corner)
        for factor in _FACTORS:
            if np.count_nonzero(rows) < _FEWEST_TO_TRY or part.max() > _EDGE / factor:
                break
            xy = block.photo_points.xy.copy()
            xy[rows] = (xy[rows] - corner) * factor + corner
            text = (
                f"all points lie in the upper left corner of the {camera.sensor.columns} columns and "
                f"{camera.sensor.rows} rows of the sensor, and fit when multiplied by "
                f"{factor:g}: they were measured at a lower resolution; write columns and "
                "rows of the pictures that were measured, with the same width and height"
            )
            changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
            yield Hypothesis(changed, finding(RESOLUTION, f"camera {camera.name}", text))


MIRRORED = declare("mirrored", "", BAD_START, MISPLACED_PHOTO)

# A mirrored picture of points in a plane is what a camera behind the plane would see. The adjustment fits, with the
# cameras on the wrong side; only their given positions show that.

_FLAT = 0.01
"""Largest ratio of the extent across a plane to the smaller one within it."""

_FEWEST_IN_A_PLANE = 2
"""Photos that have to change sides; a single one may have been given wrong, see `mirrored_alone`."""

_NEARLY_FLAT, _BESIDE = 0.1, 5.0
"""The same of the points of one photo, which fits as its mirror image: relief that it cannot see is no objection; and
how many times farther beside the plane photos are."""

_FEWEST_OF_ONE, _SHARED = 4, 0.5
"""Points of a photo that tell its side of their plane, and the part of them that another photo has to see."""

_FEW_CHANGE = 0.3
"""Part of the photos up to which those that change sides are said to be wrong."""


def mirrored_plane(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning if the adjustment puts all photos on the other side of a plane object.

    Parameters
    ----------
    block : Block
        As gathered: with the projection centres that were given.
    """
    given = block.ground.to_project(block.photo_orientation[:, :3])
    points = solution.points.values[np.isfinite(solution.points.values).all(axis=1)]
    known = np.isfinite(given).all(axis=1)
    if np.count_nonzero(known) < _FEWEST_IN_A_PLANE or len(points) <= _FEWEST_IN_A_PLANE + 1:
        return []
    plane = fitted_planes(points, np.zeros(len(points), dtype=np.int64), 1)
    sides = plane.beside(given[known]) * plane.beside(solution.photos.values[known, :3])
    if not (_is_flat(plane, _FLAT).all() and (sides < 0.0).all()):
        return []
    text = (
        "the adjustment puts them on the other side of the plane of the points than given: the photos or the control "
        "are mirrored. Pixel rows may count upwards (they count down from the upper edge), or film may have been "
        "scanned from its back, or X and Y of the control are exchanged (X = east, Y = north)"
    )
    return [ProjectWarning(MIRRORED, "photos", text)]


def mirrored_alone(block: Block, solution: Solution) -> list[ProjectWarning]:
    """Return a warning for the few photos whose points lie in a plane, and that alone are on its other side.

    Parameters
    ----------
    block : Block
        As gathered: with the projection centres that were given.
    """
    given, found = block.ground.to_project(block.photo_orientation[:, :3]), solution.photos.values[:, :3]
    points, count = block.photo_points, len(block.photos)
    of_block = CodedNames(block.point_names, np.arange(len(block.point_names)))
    ground = solution.points.values[of_block.places_among(solution.points.names)]
    is_known = np.asarray(np.isfinite(ground).all(axis=1))
    rows = points.in_use & is_known[points.point]
    photo, point = points.photo[rows], points.point[rows]
    planes = fitted_planes(ground[point], photo, count)
    least, there, here = _BESIDE * planes.extent[:, 0], planes.beside(given), planes.beside(found)
    may_be = _is_flat(planes, _NEARLY_FLAT) & (np.abs(here) > least) & (there * np.sign(here) < -least)
    names = []
    for row in np.flatnonzero(may_be).tolist():
        beside = planes.beside(found, row)
        side = np.where(np.abs(beside) > least[row], np.sign(beside), 0.0)
        is_own = np.zeros(len(ground), dtype=bool)
        is_own[point[photo == row]] = True
        shared = np.bincount(photo[is_own[point]], minlength=count)
        others = shared >= max(_FEWEST_OF_ONE, _SHARED * shared[row])
        others[row] = False
        if others.any() and (side[others] * side[row] < 0.0).all():
            names.append(block.photos[row].name)
    text = (
        "the adjustment puts it on the other side of the plane of its points than given, and than all photos that show "
        "them: it is a mirror image. Pixel rows may count upwards or columns from the right, x and y may be exchanged, "
        "or film may have been scanned from its back; correct the POINTS lines"
    )
    few = len(names) <= max(1.0, _FEW_CHANGE * count)
    return [ProjectWarning(MIRRORED, f"photo {name}", text) for name in names if few]


def _is_flat(planes: FittedPlanes, flat: float) -> BoolArray:
    return (planes.number >= _FEWEST_OF_ONE) & (planes.extent[:, 0] <= flat * planes.extent[:, 1])


_X, _Y = 0, 1

_EXCHANGED = "x and y seem to be exchanged; write x, to the right, first, and y upwards"


def mirrored_photos(block: Block) -> Iterator[Hypothesis]:
    """Yield the photos of each camera with the opposite sign of y, of x, and with x and y exchanged."""
    for row, camera in enumerate(block.cameras):
        of_camera = block.photo_camera[block.photo_points.photo] == row
        for axis in (_Y, _X):
            xy = block.photo_points.xy.copy()
            xy[of_camera, axis] *= -1.0
            changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
            text = f"the photos fit as mirror images: {_text(camera, axis)}"
            yield Hypothesis(changed, finding(MIRRORED, f"camera {camera.name}", text), photos_stay_near)
        xy = block.photo_points.xy.copy()
        xy[of_camera] = xy[of_camera, ::-1] if camera.sensor is None else exchanged_axes(xy[of_camera], camera.sensor)
        changed = replace(block, photo_points=replace(block.photo_points, xy=xy))
        text = f"the photos fit as mirror images: {_EXCHANGED}"
        yield Hypothesis(changed, finding(MIRRORED, f"camera {camera.name}", text), photos_stay_near)


def exchanged_axes(xy: FloatArray, sensor: Sensor) -> FloatArray:
    """Return photo coordinates (n, 2) of pixels that were written with the row before the column."""
    return np.asarray(0.5 * (sensor.height - sensor.width) - xy[:, ::-1])


def _text(camera: Camera, axis: int) -> str:
    if camera.sensor is None:
        left = "x seems to count to the left, as on film seen from its back"
        way = "y seems to count downwards" if axis == _Y else left
        return f"{way}; reverse it, or name the fiducial marks as in the camera's record"
    if axis == _Y:
        return (
            f"pixel rows seem to count upwards; rows count down from the upper edge (write {camera.sensor.rows} - row)"
        )
    return (
        "pixel columns seem to count from the right; columns count from the left edge "
        f"(write {camera.sensor.columns} - column)"
    )
