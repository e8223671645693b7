"""Replaying logs: measuring, measuring again, editing, and complaints that name the line."""

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
    without,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from orip.interior.replay import Measured, replay
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    MeasuredMarks,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TextPlace,
    TicksRecord,
)
from orip.records.photo import Scan
from orip.structs import replace

REMEDY = "measure more marks or include disregarded ones"
HERE = placed(1.0, 20.0, 30.0)
FILM = photo("P3", HERE) + points("P3", HERE)
ON_TEMPLATE = template(HERE) + photo("P1", on_plate("P1", HERE)) + points("P1", on_plate("P1", HERE))


def errors_of(found, bundle="MAIN"):
    observations = found.observations[bundle]
    return dict(zip(observations.points, observations.errors.tolist(), strict=True))


def disregarded_of(found, bundle="MAIN"):
    observations = found.observations[bundle]
    return {name for name, flag in zip(observations.points, observations.disregarded, strict=True) if flag}


# measuring


def test_nothing_measured():
    assert measured("") == Measured()


def test_observations_are_sorted_by_photo_as_defined_and_keep_the_order_of_points():
    log = FILM + ON_TEMPLATE + points("D1", placed(), {"9": (1.0, 1.0), "2": (2.0, 2.0)})
    observations = measured(log).observations["MAIN"]
    assert observations.bundle == "Main"
    assert observations.photos == ("P1", "P1", "P3", "P3", "D1", "D1")
    assert observations.points == ("1001", "1002", "1001", "1002", "9", "2")


def test_record_names_ignore_case_and_show_as_defined():
    found = measured(ON_TEMPLATE.replace("P1", "p1").replace("T1", "t1").replace("MAIN", "main"))
    assert found.templates["T1"].template == "T1"
    assert found.photos["P1"].photo == "P1"
    assert set(found.observations["MAIN"].photos) == {"P1"}


def test_points_measured_again_replace_the_earlier_ones_and_are_counted():
    log = points("P3", HERE, ends={"1001": "0.01 0.01", "1002": "-"}) + photo("P3", HERE)
    again = {"1001": (3.0, -7.0), "1002": (-11.0, 16.1), "1003": (0.0, 0.0)}
    outcome = replayed(log + points("P3", HERE, again) + points("P3", HERE, again, bundle="SIDE"))
    assert outcome.remeasured == 2
    assert np.isnan(errors_of(outcome.measured)["1001"]).all()
    assert disregarded_of(outcome.measured) == set()
    assert photo_coordinates(outcome.measured, "P3")["1002"] == pytest.approx([-11.0, 16.1])


def test_pixels_of_a_digital_frame_are_stored_as_measured():
    found = measured(points("D1", placed(), {"1": (500.0, 250.0), "2": (0.5, 0.5)}))
    assert found.observations["MAIN"].measured.tolist() == [[500.0, 250.0], [0.5, 0.5]]
    assert photo_coordinates(found, "D1")["1"] == pytest.approx([0.0, 0.0])


def test_photo_without_marks_or_sensor_is_measured_in_photo_millimetres():
    found = measured(points("B1", placed()))
    assert photo_coordinates(found, "B1") == {name: pytest.approx(list(xy)) for name, xy in POINTS.items()}


def test_own_marks_orient_a_photo_whose_camera_has_none():
    ends = {name: f"= {x} {y}" for name, (x, y) in FIDUCIALS.items()}
    found = measured(photo("B1", HERE, ends=ends) + points("B1", HERE))
    assert photo_coordinates(found, "B1")["1001"] == pytest.approx(POINTS["1001"])


def test_own_errors_in_pixels_become_millimetres_of_the_sensor_or_scan():
    ends = {"1001": "0.5px -2px", "1002": "0.004 0.5px"}
    sensor = errors_of(measured(points("D1", placed(), ends=ends)))
    assert sensor["1001"] == pytest.approx([0.005, -0.02])
    assert sensor["1002"] == pytest.approx([0.004, 0.005])
    scan = errors_of(measured(points("P4", placed(), ends=ends)))
    assert scan["1001"] == pytest.approx([0.005, -0.04])


def test_own_errors_in_pixels_on_a_scanned_template():
    scanned = replace(DEFINITIONS.templates["T1"], scan=Scan((0.02, 0.03)))
    definitions = replace(DEFINITIONS, templates={**DEFINITIONS.templates, "T1": scanned})
    log = template(HERE) + points("P1", HERE, ends={"1001": "1px 1px"})
    assert errors_of(measured(log, definitions=definitions))["1001"] == pytest.approx([0.02, 0.03])


def test_own_error_in_pixels_of_an_unscanned_film_names_the_line_of_the_point():
    found = complaints(photo("P3", HERE) + points("P3", HERE, ends={"1002": "0.004 0.5px"}))
    assert len(found) == 1
    assert found[0].startswith("a.MEA:8: an a-priori error in px needs a sensor or scan, and photo P3 has neither")


def test_photo_of_a_digital_frame_is_refused():
    assert complaints(photo("D1", HERE))[0].startswith(
        "a.MEA:1: photo D1 is a digital frame (camera Digital has a sensor)"
    )


@pytest.mark.parametrize("record", [photo("P5", HERE), points("P5", HERE)])
def test_photo_of_a_template_that_is_not_oriented_yet_is_refused(record):
    # T1 is oriented, T2 is not
    found = complaints(template(HERE) + record + template(HERE, name="T2"))
    assert len(found) == 1
    assert found[0].startswith("a.MEA:6: photo P5 is on template T2, which is not oriented yet; measure its tick marks")


def test_template_that_is_at_fault_brings_no_complaint_of_its_photos():
    two = {name: TICKS[name] for name in "12"}
    found = complaints(template(HERE, ticks=two) + photo("P1", HERE) + points("P1", HERE) + points("P2", HERE))
    assert len(found) == 1
    assert found[0].startswith("a.MEA:1: template T1 has 2 usable marks; transformation A needs 3")


def test_all_faults_are_reported_at_once_in_the_order_of_the_files():
    files = {
        "b.MEA": "POINTS MIAN P33\n 1 1 1\n" + template(HERE, name="T7"),
        "a.MEA": photo("P9", HERE) + photo("P3", HERE, marks={"1": (0.0, 0.0)}) + "KILL TICK T8 1\n",
    }
    found = [complaint.split("; correct")[0].split(" (correct")[0] for complaint in complaints("", files=files)]
    assert found == [
        "b.MEA:1: photo P33 is not defined; did you mean P3?",
        "b.MEA:1: bundle MIAN is not defined; did you mean Main?",
        "b.MEA:3: template T7 is not defined; known are: T1, T2",
        "a.MEA:1: photo P9 is not defined; known are: P1, P2, P3, P4, P5, D1, B1",
        "a.MEA:6: photo P3 has 1 usable mark; transformation A needs 3: " + REMEDY,
        "a.MEA:8: template T8 is not defined; known are: T1, T2",
    ]


def test_marks_that_nobody_knows_are_named_with_their_photo_or_template():
    odd = {**FIDUCIALS, "77": (0.0, 0.0)}
    found = complaints(template(HERE, ticks={**TICKS, "T": (1.0, 1.0)}) + photo("P3", HERE, marks=odd))
    assert found[0].startswith(
        "a.MEA:1: template T1: its temtick record has no mark T; name one of its marks (1, 2, 3, 4)"
    )
    assert found[1].startswith("a.MEA:7: photo P3: camera Film has no mark 77; name one of its marks (1, 2, 3, 4)")


def test_mark_with_its_own_coordinates_need_not_be_in_the_camera():
    odd = {**FIDUCIALS, "77": (1.0, 2.0)}
    assert measured(photo("P3", HERE, marks=odd, ends={"77": "= 1 2"})).photos["P3"].marks.given[4].tolist() == [
        1.0,
        2.0,
    ]


# edits


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        ("MAIN P3 1001", {"P3 1001"}),
        ("MAIN P3 *", {"P3 1001", "P3 1002"}),
        ("main * 1002", {"P1 1002", "P3 1002"}),
        ("MAIN * *", {"P1 1001", "P1 1002", "P3 1001", "P3 1002"}),
    ],
)
def test_points_are_disregarded_included_and_killed_by_name_or_all(edit, expected):
    log = ON_TEMPLATE + FILM + points("P3", HERE, bundle="SIDE")

    def left(text):
        observations = measured(text).observations["MAIN"]
        names = [f"{owner} {name}" for owner, name in zip(observations.photos, observations.points, strict=True)]
        return set(names), {name for name, flag in zip(names, observations.disregarded, strict=True) if flag}

    everything, _ = left(log)
    assert left(log + f"DISREGARD POINT {edit}\n") == (everything, expected)
    assert left(log + f"DISREGARD POINT MAIN * *\nINCLUDE POINT {edit}\n") == (everything, everything - expected)
    assert left(log + f"KILL POINT {edit}\n") == (everything - expected, set())
    other = measured(log + f"KILL POINT {edit}\n").observations["SIDE"]
    assert other.points == ("1001", "1002")


def test_marks_and_ticks_are_edited_of_one_film_or_of_all():
    log = template(HERE) + template(HERE, name="T2") + photo("P3", HERE) + photo("P1", on_plate("P1", HERE))
    found = measured(log + "DISREGARD MARK * 2\nDISREGARD TICK T2 4\nKILL MARK P3 3\nINCLUDE MARK P3 *\n")
    assert found.photos["P1"].marks.disregarded.tolist() == [False, True, False, False]
    assert found.photos["P3"].marks.names == ("1", "2", "4")
    assert not found.photos["P3"].marks.disregarded.any()
    assert not found.templates["T1"].marks.disregarded.any()
    assert found.templates["T2"].marks.disregarded.tolist() == [False, False, False, True]


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("DISREGARD POINT MIAN P3 1", "bundle MIAN is not defined; did you mean Main?"),
        ("DISREGARD POINT MIAN * 1", "bundle MIAN is not defined; did you mean Main?"),
        ("KILL POINT MAIN P33 *", "photo P33 is not defined; did you mean P3?"),
        ("INCLUDE MARK P33 1", "photo P33 is not defined; did you mean P3?"),
        ("KILL TICK P3 1", "template P3 is not defined; known are: T1, T2"),
    ],
)
def test_edit_of_something_that_is_not_defined_names_what_is(edit, message):
    found = complaints(FILM + edit + "\n")
    assert len(found) == 1
    assert found[0].startswith(f"a.MEA:9: {message}")


@pytest.mark.parametrize(
    "edit",
    [
        "DISREGARD POINT MAIN P3 9999", "KILL POINT SIDE * *", "INCLUDE POINT MAIN P1 1001", "KILL MARK P3 9",
        "DISREGARD MARK P1 1", "INCLUDE TICK T1 *", "INCLUDE TICK * 1",
    ],
)  # fmt: skip
def test_edit_that_finds_nothing_warns(edit):
    outcome = replayed(FILM + "\n" + edit + "\n")
    assert outcome.complaints == ()
    assert [(warning.code, warning.where) for warning in outcome.warnings] == [("nothing-to-edit", "a.MEA:10")]
    assert outcome.warnings[0].text.startswith(f"{edit} finds nothing measured")


def test_killed_point_measured_again_is_new():
    outcome = replayed(FILM + "KILL POINT MAIN P3 1001\n" + points("P3", HERE))
    assert outcome.remeasured == 1
    assert outcome.measured.observations["MAIN"].points == ("1002", "1001")


def test_disregarding_too_many_marks_names_the_edit():
    found = complaints(FILM + "DISREGARD MARK P3 1\nDISREGARD MARK P3 2\nDISREGARD MARK P3 9\n")
    assert found == ["a.MEA:10: photo P3 has 2 usable marks; transformation A needs 3: " + REMEDY]
    found = complaints(ON_TEMPLATE + "KILL TICK T1 1\nINCLUDE TICK T1 2\nKILL TICK T1 3\n")
    assert [complaint.split(";")[0] for complaint in found] == ["a.MEA:16: template T1 has 2 usable marks"]


def test_edit_of_an_orientation_that_was_not_valid_before_does_not_take_the_blame():
    two = {name: FIDUCIALS[name] for name in "12"}
    found = complaints(photo("P3", HERE, marks=two) + points("P3", HERE) + "DISREGARD MARK P3 1\n")
    assert [complaint.split(":")[1] for complaint in found] == ["1"]


def test_edits_that_disregard_and_include_again_leave_a_valid_log():
    edits = "DISREGARD TICK T1 *\nINCLUDE TICK T1 *\nDISREGARD MARK P1 *\nINCLUDE MARK P1 *\n"
    same = measured(ON_TEMPLATE + edits)
    assert np.array_equal(same.observations["MAIN"].measured, measured(ON_TEMPLATE).observations["MAIN"].measured)


def test_mark_included_by_an_edit_completes_an_orientation():
    log = photo("P3", HERE, ends={"1": "-", "2": "-"}) + points("P3", HERE)
    assert len(complaints(log)) == 1
    assert photo_coordinates(measured(log + "INCLUDE MARK P3 *\n"), "P3")["1001"] == pytest.approx(POINTS["1001"])


def test_killing_all_marks_of_a_photo_without_points_is_as_if_it_were_not_measured():
    assert "P3" not in measured(photo("P3", HERE) + "KILL MARK P3 *\n").photos
    assert measured(template(HERE) + "KILL TICK T1 *\n").templates == {}


@pytest.mark.parametrize("edit", ["KILL TICK T1 *", "KILL TICK * *", "KILL TICK T1 1\nKILL TICK T1 *"])
def test_killing_all_ticks_leaves_what_was_measured_where_it_is_on_the_template(edit):
    before, outcome = measured(ON_TEMPLATE), replayed(ON_TEMPLATE + edit + "\n")
    assert outcome.complaints == ()
    assert outcome.measured.templates == {}
    assert outcome.measured.photos["P1"].marks.names == before.photos["P1"].marks.names
    assert photo_coordinates(outcome.measured, "P1")["1001"] == pytest.approx(POINTS["1001"])
    assert [found.code for found in outcome.warnings] == ["no-longer-oriented"]
    assert "template T1 is no longer oriented: all its marks are killed" in outcome.warnings[0].text


def test_killing_all_marks_of_a_photo_keeps_its_points_without_an_orientation():
    outcome = replayed(FILM + "KILL MARK P3 *\n")
    assert outcome.complaints == ()
    assert outcome.measured.photos == {}
    assert outcome.measured.observations["MAIN"].points == tuple(POINTS)
    assert [found.code for found in outcome.warnings] == ["no-longer-oriented"]


def test_what_is_measured_after_all_ticks_were_killed_needs_new_ticks():
    killed = ON_TEMPLATE + "KILL TICK T1 *\n"
    assert "which is not oriented yet" in complaints(killed + points("P1", HERE))[0]
    again = placed(3.0, 25.0, 31.0)
    found = measured(killed + template(again) + points("P1", on_plate("P1", again), {"1003": (1.0, 2.0)}))
    expected = {**POINTS, "1003": (1.0, 2.0)}
    assert {name: pytest.approx(xy) for name, xy in expected.items()} == photo_coordinates(found, "P1")


def test_marks_that_were_killed_do_not_come_along_with_a_new_mounting():
    log = photo("P3", HERE, marks={**FIDUCIALS, "5": (0.0, 18.0)}, ends={"5": "= 0 18"}) + points("P3", HERE)
    again = placed(3.0, 25.0, 31.0)
    found = measured(log + "KILL MARK P3 *\n" + photo("P3", again))
    assert found.photos["P3"].marks.names == tuple(FIDUCIALS)
    assert photo_coordinates(found, "P3")["1001"] == pytest.approx(POINTS["1001"])


@pytest.mark.parametrize("edit", ["DISREGARD TICK T1 1", "KILL TICK T1 2", "KILL TICK T1 *"])
def test_there_is_nothing_to_edit_after_all_ticks_were_killed(edit):
    outcome = replayed(ON_TEMPLATE + "KILL TICK T1 *\n" + edit + "\n")
    assert {found.code for found in outcome.warnings} == {"nothing-to-edit", "no-longer-oriented"}


# digitised marks


def test_digitised_fiducials_go_into_the_camera():
    corners = "".join(f" {name} {x + 50} {y + 70}\n" for name, (x, y) in FIDUCIALS.items())
    found = measured("FIDUCIALS bare corners\n" + corners + photo("B1", HERE))
    assert [(mark.name, mark.x, mark.y) for mark in found.cameras["BARE"].fiducials] == [
        (name, pytest.approx(x), pytest.approx(y)) for name, (x, y) in FIDUCIALS.items()
    ]
    assert set(found.cameras) == {"BARE"}


def test_digitised_ticks_are_taken_as_they_are():
    found = measured("TICKS tt\n a 1.5 2.5\n b 3 4\n")
    assert [(mark.name, mark.x, mark.y) for mark in found.temticks["TT"].ticks] == [("a", 1.5, 2.5), ("b", 3.0, 4.0)]


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ("FIDUCIALS Flim corners", "camera Flim is not defined; did you mean Film?"),
        ("FIDUCIALS Digital corners", "camera Digital has a sensor, and a digital frame has no fiducial marks"),
        ("FIDUCIALS Film midsides", "fiducials of camera Film: 2 marks; at least four are needed"),
        ("TICKS T1", "temtick T1 is not defined; known are: TT"),
    ],
)
def test_digitised_marks_that_cannot_be_taken(record, message):
    found = complaints(f"\n{record}\n 1 0 0\n 2 5 5\n")
    assert len(found) == 1
    assert found[0].startswith(f"a.MEA:2: {message}")


# definitions and stores that have changed


@pytest.mark.parametrize(
    ("group", "key", "message"),
    [
        ("cameras", "FILM", "photo P1: camera Film is not defined; known are: Digital, Bare"),
        ("templates", "T1", "template T1 is not defined; known are: T2"),
        ("temticks", "TT", "template T1: temtick TT is not defined; known are: none"),
        ("photos", "P1", "photo P1 is not defined; known are: P2, P3"),
        ("bundles", "MAIN", "bundle MAIN is not defined; known are: Side"),
    ],
)
def test_log_that_refers_to_a_record_that_is_gone_names_it(group, key, message):
    assert any(
        message in complaint for complaint in complaints(ON_TEMPLATE, definitions=without(DEFINITIONS, group, key))
    )


@pytest.mark.parametrize(
    ("group", "key"), [("templates", "T1"), ("photos", "P1"), ("photos", "P3"), ("bundles", "MAIN")]
)
def test_stores_with_measurements_of_a_record_that_is_gone_lose_them(group, key):
    start = measured(ON_TEMPLATE + FILM)
    outcome = replayed("", start, without(DEFINITIONS, group, key))
    found = outcome.measured
    assert key not in {**found.templates, **found.photos, **found.observations}
    assert all(key not in observations.photos for observations in found.observations.values())


@pytest.mark.parametrize(("group", "key"), [("cameras", "FILM"), ("temticks", "TT")])
def test_stores_whose_marks_have_no_given_coordinates_any_more_are_complained_of(group, key):
    start = measured(ON_TEMPLATE + FILM)
    assert any(
        "is not defined" in complaint
        for complaint in complaints("", start=start, definitions=without(DEFINITIONS, group, key))
    )


# anything

NAMES = st.sampled_from(["P1", "P3", "P4", "D1", "B1", "T1", "T2", "TT", "Film", "Digital", "MAIN", "1", "2", "nobody"])
OWNERS = st.one_of(NAMES, st.just("*"))
MARK_NAMES = st.lists(st.sampled_from(["1", "2", "3", "4", "5"]), unique=True, max_size=5)
NUMBERS = st.one_of(st.sampled_from([0.0, 1.0, -12.0, 18.0, 200.0]), st.floats(-1e6, 1e6))
KINDS = st.sampled_from(["A", "C", "W"])
PLACES = st.integers(1, 99).map(lambda line: TextPlace("a.MEA", line))


@st.composite
def any_marks(draw):
    names = tuple(draw(MARK_NAMES))
    count = len(names)
    numbers = [draw(NUMBERS) for _ in range(4 * count)]
    given_xy = np.array(numbers[2 * count :]).reshape(count, 2)
    own = np.array([draw(st.booleans()) for _ in names], dtype=bool)
    disregarded = np.array([draw(st.booleans()) for _ in names], dtype=bool)
    given_xy[~own] = np.nan
    return MeasuredMarks(names, np.array(numbers[: 2 * count]).reshape(count, 2), disregarded, given_xy)


@st.composite
def any_points(draw):
    marks = draw(any_marks())
    shape = marks.measured.shape
    in_pixels = np.full(shape, draw(st.booleans()))
    lines = np.arange(len(marks.names))
    return PointsRecord(
        draw(PLACES), draw(NAMES), draw(NAMES), marks.names, marks.measured, np.abs(marks.given), in_pixels,
        marks.disregarded, lines,
    )  # fmt: skip


RECORDS = st.one_of(
    st.builds(TemplateRecord, PLACES, NAMES, KINDS, st.none(), any_marks()),
    st.builds(PhotoRecord, PLACES, NAMES, KINDS, any_marks()),
    any_points(),
    st.builds(FiducialsRecord, PLACES, NAMES, st.sampled_from(["corners", "midsides"]), any_marks()),
    st.builds(TicksRecord, PLACES, NAMES, any_marks()),
    st.builds(
        EditRecord, PLACES, st.sampled_from(["DISREGARD", "INCLUDE", "KILL"]),
        st.sampled_from(["POINT", "MARK", "TICK"]), NAMES, OWNERS, OWNERS,
    ),
)  # fmt: skip


@st.composite
def any_definitions(draw):
    fewer = DEFINITIONS
    for group in ("cameras", "temticks", "templates", "photos", "bundles"):
        for key in getattr(DEFINITIONS, group):
            if draw(st.integers(0, 9)) == 0:
                fewer = without(fewer, group, key)
    return fewer


@settings(max_examples=150, deadline=None)
@given(st.lists(RECORDS, max_size=12), st.lists(RECORDS, max_size=6), any_definitions(), any_definitions())
def test_any_log_is_replayed_or_complained_of(records, later, definitions, then):
    first = replay(records, definitions, Measured())
    assert all(complaint.line is not None for complaint in first.complaints)
    second = replay(later, then, first.measured)
    for observations in second.measured.observations.values():
        assert len(observations.points) == len(observations.photos) == len(observations.measured)
