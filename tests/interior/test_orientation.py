"""Orientation by marks: parameters and residuals as listed, mirror images, and what makes no orientation."""

from __future__ import annotations

import numpy as np
import pytest
from films import DEFINITIONS, FIDUCIALS, TICKS, placed

from orip.errors import OrientationError
from orip.interior.orientation import orient_photo, orient_template
from orip.records.camera import Mark
from orip.records.measurement import MeasuredMarks, PhotoOrientation, TemplateOrientation

CAMERA = DEFINITIONS.cameras["FILM"]
ALL_TICKS = DEFINITIONS.temticks["TT"].ticks


def marks(positions, disregarded=(), given=()):
    xy = np.array(list(positions.values()), dtype=float).reshape(-1, 2)
    own = np.full_like(xy, np.nan)
    for name, value in dict(given).items():
        own[list(positions).index(name)] = value
    return MeasuredMarks(tuple(positions), xy, np.array([name in disregarded for name in positions], dtype=bool), own)


def photo(positions, kind="A", **keywords):
    return orient_photo(PhotoOrientation("P", kind, marks(positions, **keywords)), CAMERA, False)


def moved(positions, place):
    return {name: tuple(place.apply(np.array(xy)).tolist()) for name, xy in positions.items()}


def test_parameters_are_listed_in_millimetres_and_degrees():
    # plate turned by +3 degrees: the transformation back turns by -3
    oriented = photo(moved(FIDUCIALS, placed(3.0, 50.0, 20.0)), "C")
    summary = oriented.adjustment.summary
    back = placed(3.0, 50.0, 20.0).inverse()
    assert (summary.x0, summary.y0) == pytest.approx(tuple(back.shift), abs=1e-12)
    assert summary.ro == pytest.approx(-3.0, abs=1e-12)
    assert (summary.sk, summary.sx, summary.sy) == pytest.approx((0.0, 1.0, 1.0), abs=1e-12)
    assert (summary.group, summary.name, summary.type, summary.redundancy) == ("photos", "P", "C", 4)


def test_residual_is_transformed_minus_given_and_s0_their_root_mean_square():
    plate = {**FIDUCIALS, "1": (-11.96, -18.0)}
    oriented = photo(plate, "W")
    residuals = oriented.adjustment.residuals
    assert np.allclose(
        residuals, oriented.transformation.apply(np.array(list(plate.values()))) - list(FIDUCIALS.values())
    )
    assert residuals[0, 0] > 0.02
    assert oriented.adjustment.summary.s0 == pytest.approx(np.sqrt((residuals**2).sum() / (2 * 4 - 3)), rel=1e-12)


def test_disregarded_mark_has_a_residual_and_no_influence():
    oriented = photo({**FIDUCIALS, "9": (1.0, 2.0)}, disregarded=["9"], given={"9": (0.0, 0.0)})
    assert np.allclose(oriented.transformation.matrix, np.eye(2), atol=1e-14)
    assert np.allclose(oriented.adjustment.residuals[4], [1.0, 2.0], atol=1e-12)
    assert oriented.adjustment.summary.s0 == pytest.approx(0.0, abs=1e-12)
    assert oriented.adjustment.summary.redundancy == 2


def test_own_coordinates_of_a_mark_go_before_those_of_the_record():
    oriented = photo(FIDUCIALS, given={"1": (-12.4, -18.0)})
    assert oriented.adjustment.given[0].tolist() == [-12.4, -18.0]
    assert np.allclose(oriented.adjustment.residuals[:, 0], [0.1, -0.1, 0.1, -0.1], atol=1e-12)


def test_without_redundancy_there_is_no_s0():
    summary = photo({name: FIDUCIALS[name] for name in "123"}).adjustment.summary
    assert summary.redundancy == 0
    assert np.isnan(summary.s0)


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_film_upside_down_is_recognised(kind):
    # a rectangle that is not a square, as photo frames are
    upside_down = {name: (-x, y) for name, (x, y) in FIDUCIALS.items()}
    assert photo(upside_down, kind).adjustment.mirrored
    assert not photo(moved(FIDUCIALS, placed(170.0, 3.0, 4.0)), kind).adjustment.mirrored


@pytest.mark.parametrize("kind", ["C", "W"])
def test_square_of_ticks_that_lies_right_is_not_taken_for_a_mirror_image(kind):
    # turned over, a square fits no conformal transformation at all
    oriented = orient_template(TemplateOrientation("T", kind, None, marks(moved(TICKS, placed(3.0)))), ALL_TICKS)
    assert not oriented.adjustment.mirrored


@pytest.mark.parametrize("kind", ["C", "W"])
def test_square_of_ticks_upside_down_is_told_so(kind):
    upside_down = {name: (-x, y + 0.01 * x) for name, (x, y) in TICKS.items()}
    with pytest.raises(OrientationError, match="upside down"):
        orient_template(TemplateOrientation("T", kind, None, marks(upside_down)), ALL_TICKS)


def test_two_marks_cannot_tell_a_mirror_image():
    two = {name: (-x, y) for name, (x, y) in FIDUCIALS.items() if name in "13"}
    assert not photo(two, "C").adjustment.mirrored


@pytest.mark.parametrize(("kind", "count"), [("A", 2), ("C", 1), ("W", 0)])
def test_too_few_usable_marks_name_the_photo_and_what_is_needed(kind, count):
    with pytest.raises(
        OrientationError, match=f"photo P has {count} usable marks; transformation {kind} needs {count + 1}|2"
    ):
        photo(FIDUCIALS, kind, disregarded=list("1234")[count:])


def test_marks_on_one_line_name_the_photo():
    line = {"1": (0.0, 0.0), "2": (10.0, 0.001), "3": (20.0, 0.0)}
    with pytest.raises(OrientationError, match="photo P cannot be oriented: the measured marks lie on one line"):
        photo(line)


def test_unknown_marks_are_all_named_with_those_that_are_known():
    with pytest.raises(OrientationError) as fault:
        photo({**FIDUCIALS, "x7": (0.0, 0.0), "01": (1.0, 1.0)})
    assert str(fault.value).startswith("photo P: camera Film has no mark x7, 01; name one of its marks (1, 2, 3, 4)")


def test_listing_of_known_marks_of_a_reseau_is_cut_short():
    reseau = [Mark(f"R{number}", number % 11, number // 11) for number in range(121)]
    with pytest.raises(OrientationError, match="R19 and 101 more"):
        orient_template(TemplateOrientation("T", "A", None, marks({"Q": (0.0, 0.0)})), reseau)
