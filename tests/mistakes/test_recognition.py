"""Recognition of single mistakes: what is recognised, what is not taken for one, and what cannot be seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip
from mistakes.edits import in_logs, number, sample
from mistakes.simulated import explained, with_camera
from support.long_cases import every
from support.synthetic_block import DISTORTED, synthetic_block
from workflow.quiet import run_quietly

from orip.errors import InputError, ProjectWarning
from orip.interior.definitions import Definitions
from orip.interior.orientation import orient_photo
from orip.mistakes.checks import camera_warnings, raise_if_impossible
from orip.mistakes.control.contradicting_control import control_warnings, slip_of_pen
from orip.mistakes.marks.misnamed import misnamed_marks
from orip.mistakes.names import photos_under_two_names
from orip.mistakes.outside_frame import points_outside_frames
from orip.records.block import Block
from orip.records.camera import CAMERA_PARAMETERS, Camera, Mark, Sensor
from orip.records.control import ControlPoint
from orip.records.measurement import MeasuredMarks, PhotoObservations, PhotoOrientation
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.structs import replace

# ------------------------------------------------------------------------------------------------------------- cameras


def test_a_lens_distortion_that_is_not_in_the_record() -> None:
    block = synthetic_block("strip", "no distortion given", noise_mm=0.005, distortion=DISTORTED).block
    (said,) = explained(with_camera(block, *((place, 0.0) for place in range(3, len(CAMERA_PARAMETERS)))))
    assert said.code == "distortion"
    assert 'unknown = ["A3", "A5", "P1", "P2"]' in said.text


@pytest.mark.long
def test_a_principal_point_of_the_opposite_sign() -> None:
    # photos of two walls held by control: elsewhere the photos turn a little, and take most of it over
    block = synthetic_block(
        "terrestrial", "principal point", noise_mm=0.002, precision_mm=0.002, control="constant"
    ).block
    x, y = block.cameras[0].parameters[1:3]
    (said,) = explained(with_camera(block, (1, -x), (2, -y)))
    assert (said.code, said.where) == ("principal-point-sign", "camera CAM")
    assert "opposite sign of x and y" in said.text


@pytest.mark.parametrize("code", every(3, ["misnamed-marks", "outside-frame", "senseless-camera"]))
def test_no_hypothesis_is_tried_where_the_misfit_is_explained_already(code: str) -> None:
    block = synthetic_block("strip", "explained", noise_mm=0.005, distortion=DISTORTED).block
    wrong = with_camera(block, *((place, 0.0) for place in range(3, len(CAMERA_PARAMETERS))))
    said = explained(wrong, [ProjectWarning(code, "camera CAM", "is wrong")])
    assert "distortion" not in {warning.code for warning in said}


def test_a_camera_that_makes_sense() -> None:
    values = (50.0, *[0.0] * 12)
    assert not list(camera_warnings(Camera("A", values, sensor=Sensor(6000, 4000, 35.9, 23.9))))
    # a fisheye of 8 mm on small-frame film, and a long aerial lens
    assert not list(camera_warnings(Camera("B", (8.0, *[0.0] * 12), frame=(36.0, 24.0))))
    assert not list(camera_warnings(Camera("C", (610.0, *[0.0] * 12), frame=(230.0, 230.0))))
    # pixels of 6 µm, large enough to be a small sensor's width
    (said,) = camera_warnings(Camera("P", (35.0, *[0.0] * 12), sensor=Sensor(6000, 4000, 6.0, 6.0)))
    assert "seem to be the size of a pixel in µm: write width = 36, height = 24 (mm)" in said.text
    # a circular fisheye of 220 degrees, with black corners in its square frame
    fisheye = Camera("F", (1.25, *[0.0] * 12), frame=(4.8, 4.8), projection="equidistant")
    assert not list(camera_warnings(fisheye))
    (said,) = camera_warnings(replace(fisheye, parameters=(0.4, *[0.0] * 12)))
    assert "angle of view of 972°" in str(said)
    raise_if_impossible([fisheye, *map(_phone, (0.56, 1.12))])
    (said,) = camera_warnings(Camera("D", (0.05, *[0.0] * 12), sensor=Sensor(6000, 4000, 35.9, 23.9)))
    assert (said.code, "angle of view" in said.text) == ("senseless-camera", True)


def _phone(pixel: float) -> Camera:
    """Return the camera of a phone with pixels of a size in µm."""
    sensor = Sensor(16320, 12240, 16.320 * pixel, 12.240 * pixel)
    return Camera("PHONE", (1.2 * sensor.height, *[0.0] * 12), sensor=sensor)


@pytest.mark.parametrize(
    ("c", "sides", "words"),
    [
        (0.0088, (13.2, 8.8), "in metres, but C is in mm: write c = 8.8"),
        (8.8, (0.00241, 0.00241), "the size of a pixel in mm: write width = 13.188, height = 8.7917"),
        (8.8, (2.41, 2.41), "the size of a pixel in µm: write width = 13.188, height = 8.7917"),
        (8.8, (0.0132, 0.0088), "in metres: write width = 13.2, height = 8.8"),
        (0.0088, (0.0132, 0.0088), "in metres: write width = 13.2, height = 8.8"),
    ],
)
def test_a_camera_in_another_unit_ends_with_the_value_to_write(
    c: float, sides: tuple[float, float], words: str
) -> None:
    with pytest.raises(InputError, match="camera DRONE") as raised:
        raise_if_impossible([Camera("DRONE", (c, *[0.0] * 12), sensor=Sensor(5472, 3648, *sides))])
    assert words in str(raised.value)


@pytest.mark.parametrize(
    ("c", "words"),
    [
        (0.0088, "in metres, but C is in mm: write c = 8.8"),
        (3648.0, "in pixels, but C is in mm: write c = 8.8"),
        (8800.0, "in pixels or in micrometres, but C is in mm: write c = 21.2281 or c = 8.8"),
    ],
)
def test_a_principal_distance_of_no_lens_ends_with_the_value_to_write(c: float, words: str) -> None:
    with pytest.raises(InputError, match="camera DRONE") as raised:
        raise_if_impossible([Camera("DRONE", (c, *[0.0] * 12), sensor=Sensor(5472, 3648, 13.2, 8.8))])
    assert words in str(raised.value)


def test_other_impossible_cameras_end_with_the_values_to_write() -> None:
    known = (8.8, *[0.0] * 12)
    sensor = Sensor(5472, 3648, 13.2, 8.8)
    cameras = [
        (Camera("D", known, sensor=Sensor(5472, 3648, 13200.0, 8800.0)), "write width = 13.2, height = 8.8"),
        (Camera("D", known, sensor=Sensor(5472, 3648, 0.51969, 0.34646)), "in inches: write width = 13.2"),
        (Camera("D", (8.8, 2744.0, 1838.0, *[0.0] * 10), sensor=sensor), "principal_point = [0.01930, -0.03377]"),
        (Camera("D", (8.8, 0.0, 0.0, 0.0, -0.2, 0.05, *[0.0] * 7), sensor=sensor), "A3 = -0.002583, A5 = 8.338e-06"),
    ]
    for camera, words in cameras:
        with pytest.raises(InputError, match="camera D:") as raised:
            raise_if_impossible([camera])
        assert words in str(raised.value)
    (said,) = camera_warnings(Camera("D", (8.8, 6.62, 4.43, *[0.0] * 10), sensor=sensor))
    assert "subtract 6.6 from x and 4.4 from y" in said.text


def test_a_frame_in_metres_ends_with_the_value_to_write() -> None:
    with pytest.raises(InputError, match=r"write frame = \[230, 230\]"):
        raise_if_impossible([Camera("RC30", (153.0, *[0.0] * 12), frame=(0.23, 0.23))])


# --------------------------------------------------------------------------------------------------------------- marks


def _photo(name: str, given: np.ndarray, labels: list[int], random: np.random.Generator) -> PhotoOrientation:
    """Return a photo whose marks lie as the camera has them, measured under other labels."""
    turn = np.radians(30.0)
    plate = given @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * 1.0004 + [12.0, -40.0]
    measured = plate + random.normal(scale=0.002, size=plate.shape)
    unknown = np.full_like(given, np.nan)
    marks = MeasuredMarks(tuple(str(label) for label in labels), measured, np.zeros(len(given), dtype=bool), unknown)
    return PhotoOrientation(name, "A", marks)


@pytest.mark.parametrize(
    ("asymmetry_mm", "labels", "found"),
    [
        (0.03, [1, 2, 3, 4, 5, 6, 7, 8], ""),
        (0.03, [5, 6, 7, 8, 1, 2, 3, 4], "turned by 180°"),
        # nothing tells how a quite symmetrical camera lay: no alarm, whatever the names
        (0.0, [1, 2, 3, 4, 5, 6, 7, 8], ""),
        (0.0, [5, 6, 7, 8, 1, 2, 3, 4], ""),
    ],
)
def test_marks_named_by_their_place(asymmetry_mm: float, labels: list[int], found: str) -> None:
    random = np.random.default_rng(41)
    around = np.array([(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0)], dtype=float)
    given = around * [18.0, 12.0] + asymmetry_mm * random.normal(size=around.shape)
    fiducials = tuple(Mark(str(k + 1), x, y) for k, (x, y) in enumerate(given.tolist()))
    camera = Camera("A", (35.0, *[0.0] * 12), fiducials=fiducials)
    photos = [_photo(str(k), given, [1, 2, 3, 4, 5, 6, 7, 8], random) for k in range(4)]
    photos.append(_photo("last", given, labels, random))
    said = misnamed_marks([orient_photo(photo, camera, on_template=False).adjustment for photo in photos])
    assert [warning.where for warning in said] == (["photo last"] if found else [])
    assert all(found in warning.text and warning.code == "misnamed-marks" for warning in said)


def test_one_mark_mispointed_is_no_other_name() -> None:
    random = np.random.default_rng(42)
    given = np.array([(-18.02, -12.01), (18.01, -12.03), (18.0, 12.02), (-17.98, 12.0)])
    camera = Camera("A", (35.0, *[0.0] * 12), fiducials=tuple(Mark(str(k + 1), *xy) for k, xy in enumerate(given)))
    photos = [_photo(str(k), given, [1, 2, 3, 4], random) for k in range(5)]
    photos[2].marks.measured[1] += 0.5
    found = misnamed_marks([orient_photo(photo, camera, on_template=False).adjustment for photo in photos])
    assert [(warning.code, warning.where) for warning in found] == [("misread-mark", "photo 2")]


# -------------------------------------------------------------------------------------------------------------- photos


def test_photos_taken_one_after_the_other_are_two() -> None:
    block = synthetic_block("convergent", "two photos", noise_mm=0.005).block
    assert photos_under_two_names(block) == []
    points = block.photo_points
    xy = points.xy.copy()
    first, second = (np.flatnonzero(points.photo == k) for k in (0, 1))
    place = {point: row for row, point in zip(first, points.point[first], strict=True)}
    for row in second:
        if points.point[row] in place:
            xy[row] = points.xy[place[points.point[row]]] + 0.004
    (said,) = photos_under_two_names(replace(block, photo_points=replace(points, xy=xy)))
    assert said.where == "photo P2"


# ------------------------------------------------------------------------------------------------------------- control


@pytest.mark.parametrize(
    ("given", "seen", "what"),
    [
        (149.989, 194.98, "194.989: two digits are exchanged"),
        (2.615, -2.61, "-2.615: its sign is wrong"),
        (19.4989, 194.98, "194.989: its decimal point is displaced"),
        (194.989, 184.98, "184.989: one digit is wrong"),
        (0.0, 83.0, "the value is not known"),
        (194.989, 187.3, None),
        # half the difference is unknown: any slip would do
        (149.989, 150.3, None),
    ],
)
def test_slips_of_the_pen(given: float, seen: float, what: str | None) -> None:
    found = slip_of_pen(given, seen, 0.04 if abs(given - seen) > 1.0 else 0.16)
    assert found is None if what is None else found is not None and what in found


def test_a_value_near_zero_is_no_displaced_decimal_point() -> None:
    assert slip_of_pen(-0.0984, 0.0016, 0.003) is None
    assert slip_of_pen(-0.984, -0.0982, 0.003) == "is probably -0.0984: its decimal point is displaced"


# ------------------------------------------------------------------------------------------------------------- control


def controlled_at(given: dict[str, tuple[float, float, float]], kind: float = 1.0) -> Block:
    """Return a block with control points at these coordinates."""
    block = synthetic_block("strip", "control as it is seen").block
    control = tuple(ControlPoint(name, xyz, (kind * 0.02,) * 3) for name, xyz in given.items())
    return replace(block, control_points=control)


def test_control_in_another_height_system_is_no_wrong_digit_in_each_height() -> None:
    seen = {
        "1": (450.0, 600.0, 19.9),
        "2": (900.0, 650.0, 35.0),
        "3": (100.0, 100.0, 10.1),
        "4": (1100.0, 1100.0, 50.0),
    }
    block = controlled_at({name: (x, y, round(z + 49.2, 1)) for name, (x, y, z) in seen.items()})
    deviation = np.full(3, 0.2)
    assert not control_warnings(block, {name: (np.array(xyz), deviation) for name, xyz in seen.items()})
    # of one point alone it is a slip
    (said,) = control_warnings(block, {"4": (np.array([1100.0, 1100.0, 49.3]), deviation)})
    assert "Z = 99.2 is probably 49.2: one digit is wrong" in said.text


def test_a_digit_is_not_offered_where_with_it_the_point_does_not_fit() -> None:
    block = controlled_at({"1": (450.0, 600.0, 69.2), "2": (0.0, 0.0, 0.0), "3": (1.0, 0.0, 0.0)})
    (said,) = control_warnings(block, {"1": (np.array([450.0, 600.0, 19.89]), np.full(3, 0.2))})
    assert "digit" not in said.text
    assert "off by Z +49.3" in said.text


def test_a_control_point_seen_where_a_check_point_is_given_is_exchanged_with_it() -> None:
    given = {"44": (1400.0, 1500.0, 120.0), "21": (2400.0, 3000.0, 94.0), "5": (0.0, 0.0, 0.0)}
    block = controlled_at(given)
    control = tuple(
        replace(point, errors=(-1.0,) * 3) if point.name == "21" else point for point in block.control_points
    )
    seen = {"44": (np.array(given["21"]) + 0.01, np.full(3, 0.05))}
    (said,) = control_warnings(replace(block, control_points=control), seen)
    assert "44 and 21 are probably exchanged" in said.text
    assert "digit" not in said.text


# ---------------------------------------------------------------------------------------------- what cannot be seen


def test_half_a_pixel_is_absorbed_by_an_unknown_principal_point(tmp_path: Path) -> None:
    (as_it_is,) = run_quietly(sample("dcs260_calibration", tmp_path / "a"))
    folder = sample("dcs260_calibration", tmp_path / "b")
    in_logs(folder, lambda _, words: [words[0], *(number(word, 1.0, -0.5) for word in words[1:])])
    (shifted,) = run_quietly(folder)
    pixel = 7.5078 / 1536
    moved = shifted.solution.cameras.values[0, 1:3] - as_it_is.solution.cameras.values[0, 1:3]
    # the input has six decimals of a pixel
    assert moved == pytest.approx([-0.5 * pixel, 0.5 * pixel], abs=1e-5)
    assert shifted.solution.sigma0 == pytest.approx(as_it_is.solution.sigma0, abs=1e-6)


def test_micrometres_on_the_stage_change_nothing(tmp_path: Path) -> None:
    (as_it_is,) = run_quietly(sample("small_frame_block", tmp_path / "a"))
    folder = sample("small_frame_block", tmp_path / "b")
    in_logs(folder, lambda _, words: [words[0], *(number(word, 1e3) for word in words[1:])])
    assert "warning" not in orip(folder, "run", "--no-report").err
    (other,) = run_quietly(folder)
    assert other.solution.points.values == pytest.approx(as_it_is.solution.points.values, abs=1e-6)


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        (Sensor(2736, 1824, 13.2, 8.8), "write columns = 5472, rows = 3648"),
        (Sensor(3648, 5472, 13.2, 8.8), "or exchange columns and rows of the sensor"),
        (Sensor(3648, 5472, 8.8, 13.2), "exchange columns and rows (and width and height) of the sensor"),
    ],
)
def test_the_columns_of_a_sensor_that_the_points_exceed(sensor: Sensor, words: str) -> None:
    camera = Camera("D", (8.8, *[0.0] * 12), sensor=sensor)
    photos = {record_key(name): Photo(name, "D") for name in ("1", "2")}
    definitions = Definitions({record_key("D"): camera}, {}, {}, photos, {})
    xy = np.array([[20.0, 10.0], [5450.0, 3630.0], [2700.0, 900.0], [4000.0, 1800.0]])
    observations = PhotoObservations(
        "B", ("1", "1", "2", "2"), ("A", "B", "A", "B"), xy, np.full((4, 2), np.nan), np.zeros(4, dtype=bool)
    )
    (said,) = points_outside_frames(definitions, observations, {})
    assert words in said.text
