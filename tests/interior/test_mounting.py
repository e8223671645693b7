"""Films mounted again: what was measured before stays where it was on the film."""

from __future__ import annotations

import numpy as np
import pytest
from films import (
    DEFINITIONS,
    FIDUCIALS,
    POINTS,
    TICKS,
    complaints,
    measured,
    on_plate,
    photo,
    photo_coordinates,
    placed,
    points,
    replayed,
    template,
)

from orip.interior.orientation import orient_photo

FIRST = placed(0.7, 12.0, 8.0)
AGAIN = placed(3.7, 17.0, 8.0)
MICRO = 1e-9
"""mm: what noise-free coordinates of 200 mm keep after three transformations."""


def same(found, expected):
    assert set(found) == set(expected)
    for name, xy in expected.items():
        assert found[name] == pytest.approx(xy, abs=MICRO)


@pytest.mark.parametrize("kind", ["A", "C", "W"])
def test_template_mounted_again_needs_its_ticks_alone(kind):
    log = template(FIRST, kind) + photo("P1", on_plate("P1", FIRST), kind) + points("P1", on_plate("P1", FIRST))
    log += template(AGAIN, kind) + points("P1", on_plate("P1", AGAIN), {"1003": (1.0, 2.0)})
    log += photo("P2", on_plate("P2", AGAIN), kind) + points("P2", on_plate("P2", AGAIN))
    found = measured(log)
    same(photo_coordinates(found, "P1"), {**POINTS, "1003": (1.0, 2.0)})
    same(photo_coordinates(found, "P2"), POINTS)


def test_template_orientation_in_force_is_the_last_one_on_its_stage():
    found = measured(template(FIRST) + "TEMPLATE T1 C UPPER\n" + template(AGAIN).split("\n", 1)[1])
    assert found.templates["T1"].transformation == "C"
    assert found.templates["T1"].stage == "UPPER"
    assert np.allclose(found.templates["T1"].marks.measured[0], [17.0, 8.0])
    assert measured(template(FIRST)).templates["T1"].stage == "LOWER"


def test_second_photo_record_on_a_template_replaces_the_photo_orientation_only():
    place = on_plate("P1", FIRST)
    log = template(FIRST) + photo("P1", placed(2.0, 55.0, 71.0)) + points("P1", place)
    before = measured(log)
    after = measured(log + photo("P1", place, "C", ends={"4": "-"}))
    assert np.array_equal(after.observations["MAIN"].measured, before.observations["MAIN"].measured)
    assert after.photos["P1"].transformation == "C"
    assert after.photos["P1"].marks.disregarded.tolist() == [False, False, False, True]
    same(photo_coordinates(after, "P1"), POINTS)


def test_photo_off_a_template_mounted_again_takes_its_points_along_in_all_bundles():
    log = photo("P3", FIRST) + points("P3", FIRST) + points("P3", FIRST, {"7": (5.0, 5.0)}, bundle="SIDE")
    log += photo("P3", AGAIN) + points("P3", AGAIN, {"1003": (1.0, 2.0)})
    found = measured(log)
    same(photo_coordinates(found, "P3"), {**POINTS, "1003": (1.0, 2.0)})
    same(photo_coordinates(found, "P3", "SIDE"), {"7": (5.0, 5.0)})
    # what is stored are plate coordinates of the last mounting
    stored = dict(zip(found.observations["MAIN"].points, found.observations["MAIN"].measured, strict=True))
    assert np.allclose(stored["1001"], AGAIN.apply(np.array(POINTS["1001"])), atol=MICRO)


def test_photo_mounted_three_times_and_points_measured_each_time():
    places = [FIRST, AGAIN, placed(-91.0, 30.0, 150.0)]
    log = ""
    for number, place in enumerate(places):
        log += points("P3", place, {str(number): (number, 2.0 * number)}) if number == 0 else ""
        log += photo("P3", place) + points("P3", place, {f"{number}b": (-number, 3.0)})
    found = measured(log)
    expected = {"0": (0.0, 0.0), "0b": (0.0, 3.0), "1b": (-1.0, 3.0), "2b": (-2.0, 3.0)}
    same(photo_coordinates(found, "P3"), expected)


def test_points_measured_before_the_first_photo_record_belong_to_its_mounting():
    found = measured(points("P3", FIRST) + photo("P3", FIRST))
    same(photo_coordinates(found, "P3"), POINTS)


def test_earlier_marks_come_along_without_influence_and_marks_measured_again_replace_them():
    five = {**FIDUCIALS, "5": (0.0, 18.0)}
    log = photo("P3", FIRST, marks=five, ends={"5": "= 0.003 18"}) + points("P3", FIRST)
    found = measured(log + photo("P3", AGAIN, marks={name: FIDUCIALS[name] for name in "123"}))
    marks = found.photos["P3"].marks
    assert marks.names == ("1", "2", "3", "4", "5")
    assert marks.disregarded.tolist() == [False, False, False, True, True]
    assert np.allclose(marks.measured[3:], AGAIN.apply(np.array([FIDUCIALS["4"], (0.0, 18.0)])), atol=1e-3)
    assert marks.given[4].tolist() == [0.003, 18.0]
    assert np.isnan(marks.given[:4]).all()


def test_earlier_points_keep_their_photo_coordinates_when_a_mark_of_the_new_mounting_is_disregarded():
    bad = {**FIDUCIALS, "2": (12.5, -18.0)}
    log = (
        photo("P3", FIRST)
        + points("P3", FIRST)
        + photo("P3", AGAIN, marks=bad)
        + points("P3", AGAIN, {"9": (1.0, 1.0)})
    )
    found = measured(log + "DISREGARD MARK P3 2\n")
    same(photo_coordinates(found, "P3"), {**POINTS, "9": (1.0, 1.0)})


def test_edit_of_a_mark_that_was_measured_in_an_earlier_mounting_alone_counts_there():
    bad = {**FIDUCIALS, "5": (3.0, 3.0)}
    log = photo("P3", FIRST, marks=bad, ends={"5": "= 0 0"}) + points("P3", FIRST) + photo("P3", AGAIN)
    off = photo_coordinates(measured(log), "P3")
    assert abs(off["1001"][0] - POINTS["1001"][0]) > 0.1
    found = measured(log + "DISREGARD MARK P3 5\n")
    same(photo_coordinates(found, "P3"), POINTS)
    killed = measured(log + "KILL MARK P3 5\n")
    same(photo_coordinates(killed, "P3"), POINTS)
    assert killed.photos["P3"].marks.names == ("1", "2", "3", "4")


@pytest.mark.parametrize("action", ["DISREGARD", "KILL"])
def test_disregarded_tick_has_no_influence_on_points_measured_before_the_edit(action):
    bad = {**TICKS, "5": (100.0, 100.0)}
    ticks = template(FIRST, ticks=bad, ends={"5": "= 103 100"})
    log = photo("P1", on_plate("P1", FIRST)) + points("P1", on_plate("P1", FIRST))
    edited = measured(ticks + log + f"{action} TICK T1 5\n")
    clean = measured(template(FIRST) + log)
    assert np.allclose(edited.observations["MAIN"].measured, clean.observations["MAIN"].measured, atol=MICRO)
    assert np.allclose(edited.photos["P1"].marks.measured, clean.photos["P1"].marks.measured, atol=MICRO)


def test_edit_of_a_tick_leaves_what_was_measured_in_an_earlier_mounting():
    log = template(FIRST) + points("P1", on_plate("P1", FIRST)) + photo("P1", on_plate("P1", FIRST))
    log += template(AGAIN, ticks={**TICKS, "1": (1.0, 1.0)}) + points("P1", on_plate("P1", AGAIN), {"1003": (1.0, 2.0)})
    found = measured(log + "DISREGARD TICK T1 1\n")
    same(photo_coordinates(found, "P1"), {**POINTS, "1003": (1.0, 2.0)})


def test_digitised_ticks_give_the_same_when_the_log_is_replayed_on_what_it_left():
    moved = {name: (x + 1.0, y) for name, (x, y) in TICKS.items()}
    log = template(FIRST) + photo("P1", on_plate("P1", FIRST)) + points("P1", on_plate("P1", FIRST))
    log += "TICKS TT\n" + "".join(f"  {name} {x} {y}\n" for name, (x, y) in moved.items())
    once = measured(log)
    again = measured(log, definitions=DEFINITIONS.with_temtick(once.temticks["TT"]))
    assert np.array_equal(once.observations["MAIN"].measured, again.observations["MAIN"].measured)


def test_log_on_top_of_the_stores_is_the_whole_log():
    first = template(FIRST) + photo("P1", on_plate("P1", FIRST)) + points("P1", on_plate("P1", FIRST))
    first += photo("P3", FIRST) + points("P3", FIRST)
    then = template(AGAIN) + points("P1", on_plate("P1", AGAIN), {"9": (4.0, 4.0)})
    then += photo("P3", AGAIN) + points("P3", AGAIN, {"9": (4.0, 4.0)})
    whole, on_top = measured(first + then), measured(then, start=measured(first))
    for name in ("P1", "P3"):
        same(photo_coordinates(on_top, name), photo_coordinates(whole, name))
        same(photo_coordinates(on_top, name), {**POINTS, "9": (4.0, 4.0)})
    assert on_top.observations["MAIN"].photos == whole.observations["MAIN"].photos


def test_edit_of_a_tick_that_the_stores_hold_says_that_points_stay():
    start = measured(template(FIRST) + points("P1", on_plate("P1", FIRST)))
    outcome = replayed("DISREGARD TICK T1 1\n", start)
    assert [(warning.code, warning.where) for warning in outcome.warnings] == [("stored-points-stay", "a.MEA:1")]
    assert "template T1" in outcome.warnings[0].text
    before, after = start.observations["MAIN"], outcome.measured.observations["MAIN"]
    assert np.array_equal(before.measured, after.measured)


def test_photo_mounted_again_whose_first_orientation_is_not_valid_names_the_first_record():
    two = {name: FIDUCIALS[name] for name in "12"}
    log = photo("P3", FIRST, marks=two) + points("P3", FIRST) + photo("P3", AGAIN)
    assert complaints(log) == [
        "a.MEA:1: photo P3 has 2 usable marks; transformation A needs 3: measure more marks or include disregarded ones"
    ]


def test_photo_mounted_again_whose_first_orientation_was_spoilt_by_an_edit_names_the_edit():
    log = photo("P3", FIRST) + points("P3", FIRST) + "DISREGARD MARK P3 1\nDISREGARD MARK P3 2\nINCLUDE MARK P3 4\n"
    assert [complaint.split(": ")[0] for complaint in complaints(log + photo("P3", AGAIN))] == ["a.MEA:10"]


def test_photo_without_points_whose_first_orientation_is_not_valid_is_just_measured_again():
    two = {name: FIDUCIALS[name] for name in "12"}
    found = measured(photo("P3", FIRST, marks=two) + photo("P3", AGAIN) + points("P3", AGAIN))
    same(photo_coordinates(found, "P3"), POINTS)


def test_new_orientation_that_is_not_valid_is_complained_of_once():
    two = {name: FIDUCIALS[name] for name in "12"}
    log = photo("P3", FIRST) + points("P3", FIRST) + points("P3", FIRST, bundle="SIDE") + photo("P3", AGAIN, marks=two)
    assert [complaint.split(": ")[0] for complaint in complaints(log)] == ["a.MEA:12"]


def test_scan_turned_on_its_side_between_two_scannings():
    # P4 is scanned with pixels of 0.01 x 0.02 mm: column = x / 0.01, row = -y / 0.02
    def pixels(place):
        scale = np.array([[100.0, 0.0], [0.0, -50.0]])
        return type(place)(scale @ place.matrix, scale @ place.shift)

    first, second = pixels(placed(0.3, 5.0, -4.0)), pixels(placed(90.2, 33.0, -20.0))
    log = photo("P4", first) + points("P4", first) + photo("P4", second) + points("P4", second, {"9": (4.0, 4.0)})
    found = measured(log)
    same(photo_coordinates(found, "P4"), {**POINTS, "9": (4.0, 4.0)})


def test_orientation_of_the_whole_log_has_no_residuals():
    log = template(FIRST) + photo("P1", on_plate("P1", FIRST)) + template(AGAIN)
    found = measured(log)
    oriented = orient_photo(found.photos["P1"], DEFINITIONS.cameras["FILM"], True)
    assert np.abs(oriented.adjustment.residuals).max() < MICRO
    assert oriented.adjustment.system == "template"
