"""Back to the coordinates of a log: what was measured, and how far a camera's photos reach."""

from __future__ import annotations

import numpy as np
import pytest
from films import DEFINITIONS, NO_PARAMETERS, POINTS, marks_of, measured, on_plate, photo, placed, points, template

from orip.interior.in_force import interior_orientation, stored_to_log
from orip.interior.mounting import frame_corners
from orip.records.camera import Camera, Sensor
from orip.records.names import near_names
from orip.records.photo import Scan
from orip.structs import replace

FIRST, AGAIN = placed(0.7, 12.0, 8.0), placed(3.7, 17.0, 8.0)
SCANNED = replace(
    DEFINITIONS,
    templates={**DEFINITIONS.templates, "T1": replace(DEFINITIONS.templates["T1"], scan=Scan((0.02, 0.01), "centre"))},
)


def back_in_log(log, name, definitions=DEFINITIONS):
    """Return the stored points of a photo in log coordinates."""
    found = measured(log, definitions=definitions)
    interior = interior_orientation(definitions, found)
    to_log = stored_to_log(definitions.photos[name], definitions, interior.to_template)
    observations = found.observations["MAIN"]
    rows = [row for row, owner in enumerate(observations.photos) if owner == name]
    return dict(zip((observations.points[row] for row in rows), to_log.apply(observations.measured[rows]), strict=True))


def test_photo_on_a_template_is_where_the_film_lies_now():
    log = template(FIRST) + photo("P1", on_plate("P1", FIRST)) + points("P1", on_plate("P1", FIRST)) + template(AGAIN)
    found = back_in_log(log, "P1")
    for name, xy in POINTS.items():
        assert np.allclose(found[name], on_plate("P1", AGAIN).apply(np.array(xy)), atol=1e-10)


def test_photo_off_a_template_is_where_its_last_mounting_is():
    log = photo("P3", FIRST) + points("P3", FIRST) + photo("P3", AGAIN)
    found = back_in_log(log, "P3")
    for name, xy in POINTS.items():
        assert np.allclose(found[name], AGAIN.apply(np.array(xy)), atol=1e-10)


@pytest.mark.parametrize(
    ("log", "name", "definitions"),
    [
        (photo("P4", FIRST) + points("P4", FIRST), "P4", DEFINITIONS),
        (points("D1", placed(0.0, 400.0, 200.0)), "D1", DEFINITIONS),
        (points("B1", placed()), "B1", DEFINITIONS),
        (template(FIRST) + points("P1", on_plate("P1", FIRST)), "P1", SCANNED),
    ],
)
def test_what_was_measured_comes_back_in_pixels_or_millimetres(log, name, definitions):
    place = {"P4": FIRST, "D1": placed(0.0, 400.0, 200.0), "B1": placed(), "P1": on_plate("P1", FIRST)}[name]
    found = back_in_log(log, name, definitions)
    for point, xy in POINTS.items():
        assert np.allclose(found[point], place.apply(np.array(xy)), atol=1e-9)


def test_template_that_is_not_oriented_has_no_way_back():
    assert stored_to_log(DEFINITIONS.photos["P1"], DEFINITIONS, {}) is None


def test_frame_is_that_of_the_record_or_the_sensor_or_as_far_as_the_marks_reach():
    marks = marks_of({"1": (-12.0, -18.0), "2": (11.0, 17.0), "3": (0.0, 0.0)})
    sensor = Sensor(1000, 500, 10.0, 5.0)

    def corners(**given):
        found = frame_corners(Camera("C", NO_PARAMETERS, **given))
        return None if found is None else [array.tolist() for array in found]

    assert corners(frame=(24.0, 36.0), fiducials=marks) == [[-12.0, -18.0], [12.0, 18.0]]
    assert corners(sensor=sensor) == [[-5.0, -2.5], [5.0, 2.5]]
    assert corners(fiducials=marks) == [[-12.0, -18.0], [11.0, 17.0]]
    assert corners() is None
    assert corners(fiducials=marks[:1]) is None
    assert corners(fiducials=marks_of({"l": (-10.0, 0.0), "r": (10.0, 0.0)})) is None


def test_names_like_the_one_that_is_not_known():
    known = ["P101", "P102", "P201", "tower"]
    assert near_names("p10", known) == "did you mean P101 or P102?"
    assert near_names("TOWRE", known) == "did you mean tower?"
    assert near_names("zzz", known) == "known are: P101, P102, P201, tower"
    assert near_names("zzz", []) == "known are: none"
