"""Pixels: where the origin is, which way rows count, and what scans of the same plate have in common."""

from __future__ import annotations

import numpy as np
import pytest

from orip.geometry.plane import PlaneTransformation
from orip.interior.image_coordinates import pixel_size, scan_transformation, sensor_transformation
from orip.interior.orientation import orient_photo, transformation_without_marks
from orip.records.camera import Camera, Mark, Sensor
from orip.records.measurement import MeasuredMarks, PhotoOrientation
from orip.records.photo import Photo, Scan, Template

SENSOR = Sensor(columns=1280, rows=1024, width=8.245, height=6.6)
NO_PARAMETERS = (50.0,) + (0.0,) * 12


def test_sensor_has_its_origin_in_the_middle_and_y_up():
    pixels = np.array([[640.0, 512.0], [0.0, 0.0], [1280.0, 0.0], [0.0, 1024.0]])
    expected = [[0.0, 0.0], [-4.1225, 3.3], [4.1225, 3.3], [-4.1225, -3.3]]
    assert np.allclose(sensor_transformation(SENSOR).apply(pixels), expected, atol=1e-14)


def test_centre_of_the_upper_left_pixel_of_a_sensor_is_half_a_pixel_inside():
    xy = sensor_transformation(SENSOR).apply(np.array([[0.5, 0.5]]))
    assert np.allclose(xy, [[-4.1225 + 0.5 * 8.245 / 1280, 3.3 - 0.5 * 6.6 / 1024]], atol=1e-14)


def test_scan_counts_from_the_outer_corner_or_the_centre_of_its_first_pixel():
    pixels = np.array([[0.0, 0.0], [100.0, 200.0]])
    corner = scan_transformation(Scan((0.02, 0.01), "corner")).apply(pixels)
    centre = scan_transformation(Scan((0.02, 0.01), "centre")).apply(pixels)
    assert np.allclose(corner, [[0.0, 0.0], [2.0, -2.0]], atol=1e-14)
    assert np.allclose(centre, [[0.01, -0.005], [2.01, -2.005]], atol=1e-14)


def test_camera_without_marks_is_measured_in_photo_millimetres():
    camera = Camera("C", NO_PARAMETERS)
    assert np.array_equal(transformation_without_marks(camera).apply(np.array([[1.0, 2.0]])), [[1.0, 2.0]])
    with_marks = Camera("C", NO_PARAMETERS, fiducials=(Mark("1", 0.0, 0.0),))
    assert transformation_without_marks(with_marks) is None


def test_pixel_size_is_the_sensors_or_the_photos_scan_or_the_templates():
    film, digital = Camera("C", NO_PARAMETERS), Camera("D", NO_PARAMETERS, sensor=SENSOR)
    scanned = Template("T", "TT", scan=Scan((0.03, 0.03)))
    own = Photo("P", "C", scan=Scan((0.01, 0.02)))
    assert pixel_size(Photo("P", "D"), digital, None, None) == (8.245 / 1280, 6.6 / 1024)
    assert pixel_size(own, film, scanned, None) == (0.01, 0.02)
    assert pixel_size(Photo("P", "C"), film, scanned, None) == (0.03, 0.03)
    assert pixel_size(Photo("P", "C"), film, None, None) is None


@pytest.mark.parametrize("origin", ["corner", "centre"])
@pytest.mark.parametrize(
    ("quarter_turns", "pixel"), [(0, (0.0127, 0.0127)), (1, (0.007, 0.0071)), (2, (0.02, 0.01)), (3, (0.05, 0.025))]
)
def test_scan_turned_by_a_quarter_gives_the_photo_coordinates_of_the_plate(quarter_turns, pixel, origin):
    fiducials = tuple(
        Mark(name, x, y) for name, x, y in [("1", -12, -18), ("2", 12, -18), ("3", 12, 18), ("4", -12, 18)]
    )
    camera = Camera("C", NO_PARAMETERS, fiducials=fiducials)
    photo_mm = np.array([[mark.x, mark.y] for mark in fiducials] + [[3.25, -7.5], [-11.0, 16.0]])
    angle = np.radians(90.0 * quarter_turns + 0.4)
    matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    plate_mm = PlaneTransformation(matrix, np.array([40.0, -35.0])).apply(photo_mm)

    def photo_coordinates(measured_mm):
        marks = MeasuredMarks(("1", "2", "3", "4"), measured_mm[:4], np.zeros(4, dtype=bool), np.full((4, 2), np.nan))
        return orient_photo(PhotoOrientation("P", "A", marks), camera, False).transformation.apply(measured_mm[4:])

    # what a scanner would say: column right from the first pixel, row down
    first = 0.5 if origin == "centre" else 0.0
    pixels = plate_mm / [pixel[0], -pixel[1]] - first
    scanned = scan_transformation(Scan(pixel, origin)).apply(pixels)
    assert np.allclose(photo_coordinates(scanned), photo_mm[4:], atol=1e-9)
    assert np.allclose(photo_coordinates(scanned), photo_coordinates(plate_mm), atol=1e-9)
