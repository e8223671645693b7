"""Orientation for driving: what is done with too few marks, and that it is said."""

from __future__ import annotations

import numpy as np
import pytest
from films import DEFINITIONS, FIDUCIALS, TICKS, placed

from orip.errors import OrientationError
from orip.geometry.plane import PlaneTransformation
from orip.interior.in_force import drive_photo, drive_template
from orip.interior.orientation import orient_photo
from orip.records.measurement import MeasuredMarks, PhotoOrientation, TemplateOrientation

CAMERA = DEFINITIONS.cameras["FILM"]
ALL_TICKS = DEFINITIONS.temticks["TT"].ticks
PLACE = placed(3.0, 50.0, 20.0)
STORED = PlaneTransformation(np.array([[0.999, 0.02], [-0.01, 1.001]]), np.array([-40.0, -10.0]))
EXACT = 1e-11
"""mm: rounding of coordinates of 200 mm."""


def marks(positions, names, disregarded=()):
    xy = np.array([PLACE.apply(np.array(positions[name])) for name in names]).reshape(-1, 2)
    flags = np.array([name in disregarded for name in names], dtype=bool)
    return MeasuredMarks(tuple(names), xy, flags, np.full_like(xy, np.nan))


def photo(names, kind="A", disregarded=()):
    return PhotoOrientation("P", kind, marks(FIDUCIALS, names, disregarded))


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_marks_enough_are_the_final_orientation_and_nothing_is_said(kind):
    found = drive_photo(photo("1234", kind), CAMERA, STORED)
    final = orient_photo(photo("1234", kind), CAMERA, False).transformation
    assert found.warning is None
    assert np.array_equal(found.transformation.matrix, final.matrix)
    assert np.array_equal(found.transformation.shift, final.shift)


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_no_marks_drive_as_before_or_on_the_plate_as_it_is(kind):
    assert drive_photo(photo("", kind), CAMERA, STORED).transformation is STORED
    found = drive_photo(photo("", kind), CAMERA)
    assert np.array_equal(found.transformation.apply(np.array([[3.0, 4.0]])), [[3.0, 4.0]])
    assert found.warning.code == "driving-only"
    assert found.warning.where == "photo P"
    assert "0 usable marks" in found.warning.text
    assert "as an orientation it is not valid" in found.warning.text


@pytest.mark.parametrize("kind", ["A", "C", "W"])
@pytest.mark.parametrize("stored", [STORED, None])
def test_one_mark_shifts_the_orientation_before_and_turns_nothing(kind, stored):
    found = drive_photo(photo("3", kind), CAMERA, stored)
    assert np.array_equal(found.transformation.matrix, np.eye(2) if stored is None else STORED.matrix)
    on_plate = PLACE.apply(np.array([FIDUCIALS["3"]]))
    assert np.allclose(found.transformation.apply(on_plate), [FIDUCIALS["3"]], atol=EXACT)
    assert "shifted to the mark" in found.warning.text


def test_two_marks_of_an_affine_orientation_are_driven_by_a_conform_one():
    found = drive_photo(photo("13"), CAMERA, STORED)
    # two marks and four parameters: exact, and as the photo really lies
    back = PLACE.inverse()
    assert np.allclose(found.transformation.matrix, back.matrix, atol=1e-13)
    assert np.allclose(found.transformation.shift, back.shift, atol=EXACT)
    assert found.warning.text.startswith("2 usable marks, and transformation A needs 3: driven by the conformal")


def test_ticks_on_one_line_are_driven_by_a_conform_transformation():
    line = {**TICKS, "5": (100.0, 0.0)}
    ticks = marks(line, "125")
    own = np.array([line[name] for name in "125"])
    found = drive_template(
        TemplateOrientation("T", "A", None, MeasuredMarks(ticks.names, ticks.measured, ticks.disregarded, own)),
        ALL_TICKS,
    )
    assert np.allclose(found.transformation.apply(ticks.measured), own, atol=EXACT)
    assert found.warning.where == "template T"
    assert "lie on one line" in found.warning.text


def test_disregarded_marks_do_not_count():
    found = drive_photo(photo("1234", "C", disregarded="124"), CAMERA)
    assert "1 usable mark, and transformation C needs 2" in found.warning.text
    assert np.array_equal(found.transformation.matrix, np.eye(2))


def test_what_may_be_driven_by_is_no_final_orientation():
    with pytest.raises(OrientationError) as fault:
        orient_photo(photo("13"), CAMERA, False)
    assert fault.value.exit_code == 3


def test_mark_that_nobody_knows_is_an_error_for_driving_too():
    odd = {**FIDUCIALS, "9": (1.0, 1.0)}
    with pytest.raises(OrientationError, match="camera Film has no mark 9"):
        drive_photo(PhotoOrientation("P", "A", marks(odd, "19")), CAMERA)
