"""Digitising at an emulated plate processor in this process, by simulated operators and by scripts of what they do."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.sample_projects import sample
from workflow.commands import initialise, measure, write_drive_table
from workflow.digitise.digitising_bench import LOG, Bench, codes, did
from workflow.quiet import run_quietly
from workflow.small_projects import contents, film_project, first_project, replace_in

from orip.errors import InputError, LinkError, UsageError
from orip.files.log.text import read_measurements
from orip.multimodel.digitising import operator as digitise_operator
from orip.multimodel.digitising.marks import digitise_template
from orip.multimodel.digitising.operator import (
    AtTheProcessor,
    script_requests,
    typed_requests,
)
from orip.multimodel.digitising.points import digitise_points
from orip.multimodel.digitising.setup import rehearsal
from orip.multimodel.digitising.wanted import PointChoice
from orip.multimodel.link.client import ProcessorFault
from orip.workflow.observations.films import mounted_films

DAY1, DAY2 = Path("films/DAY1.MEA"), Path("films/DAY2.MEA")
LAST_DIGIT = 0.5e-4


@pytest.fixture(scope="module")
def solved_cliff(tmp_path_factory):
    folder = sample(tmp_path_factory.mktemp("cliff"), "small_frame_block")
    run_quietly(folder)
    write_drive_table(folder, None)
    (folder / "films").mkdir()
    for name in ("DAY1.MEA", "DAY2.MEA"):
        shutil.copy(folder / name, folder / "films" / name)
    return folder


@pytest.fixture
def cliff(solved_cliff, tmp_path):
    """Return the bench with the adjusted block, its table loaded."""
    folder = Path(shutil.copytree(solved_cliff, tmp_path / "cliff"))
    return Bench(folder, (folder / "MAIN.DRV").read_bytes())


@pytest.fixture
def new_cliff(tmp_path):
    """Return the bench with the project as it begins: nothing is measured, and there is no table."""
    folder = sample(tmp_path / "new", "small_frame_block")
    (folder / "films").mkdir()
    for name in ("DAY1.MEA", "DAY2.MEA"):
        (folder / name).rename(folder / "films" / name)
    initialise(folder)
    return Bench(folder)


def measured_in(path):
    """Return what a log has measured by header and name, the last time."""
    found = {}
    for record in read_measurements(path, path.name).value:
        owner = next(getattr(record, name) for name in ("photo", "template") if hasattr(record, name))
        names, values = (record.names, record.measured) if hasattr(record, "names") else (
            record.marks.names, record.marks.measured
        )  # fmt: skip
        kind = type(record).__name__
        found |= {(kind, owner, name): tuple(xy) for name, xy in zip(names, values.tolist(), strict=True)}
    return found


# template


def test_tick_marks_are_found_better_and_better(cliff):
    # the film has been turned by 3 degrees and shifted by 5 mm; the stores have it as it lay the day before
    (cliff.folder / "DAY2.MEA").unlink()
    found = cliff.template("LEFT", (DAY1, DAY2))
    assert did(found) == [(name, "digitised") for name in "1234"]
    off = [float(np.hypot(*np.subtract(entry.driven, entry.xy))) for entry in found.entries]
    assert off[0] > 8.0  # as it lay before
    assert 5.0 < off[1] < 15.0  # shifted to the first mark: 210 mm away, 3 degrees are 11 mm
    assert off[2] < 0.1  # conformal: what shrinkage leaves, 0.00016 of 210 mm
    assert off[3] < 0.01  # affine: errors of measuring alone
    assert {entry.known for entry in found.entries} == {"predicted"}
    truth = measured_in(cliff.folder / DAY2)
    for entry in found.entries:
        assert entry.xy == pytest.approx(truth["TemplateRecord", "LEFT", entry.name], abs=LAST_DIGIT)
    (oriented,) = found.orientations
    assert oriented.summary.s0 < 0.005
    assert cliff.line.station.state.automatic is True
    assert "TEMPLATE LEFT A UPPER" in cliff.log


def test_without_any_orientation_the_plate_is_taken_for_the_template(new_cliff):
    found = new_cliff.template("RIGHT", (DAY1,))
    assert found.entries[0].driven == (-105.012, -104.987)
    assert all(guide == "LOWER" for _, _, guide, _, _ in new_cliff.operator.seen)
    outcome = measure(new_cliff.folder).outcome
    assert outcome.counts.templates == 1
    assert outcome.interior.complaints == ()


def test_marks_are_skipped_and_the_session_is_ended(new_cliff):
    found = new_cliff.template("LEFT", "FOOT RIGHT; FOOT LEFT; MOVE 1.5 -2; FOOT RIGHT; KEY ZERO")
    assert did(found) == [("1", "digitised"), ("2", "skipped"), ("3", "digitised")]
    assert found.ending == "ended by the operator"
    driven, digitised = found.entries[2].driven, found.entries[2].xy
    assert digitised == pytest.approx((driven[0] + 1.5, driven[1] - 2.0), abs=0.6e-3)  # the least count is 0.001
    assert "not-oriented" in codes(found)
    assert "2 usable marks; transformation A needs 3" in str(found.warnings)
    assert list(measured_in(new_cliff.folder / LOG)) == [
        ("TemplateRecord", "LEFT", "1"),
        ("TemplateRecord", "LEFT", "3"),
    ]


def test_a_script_that_comes_to_its_end(new_cliff):
    found = new_cliff.template("LEFT", "FOOT RIGHT; MOVE 1 1")
    assert (did(found), found.ending) == ([("1", "digitised")], "no further input")


def test_what_is_pressed_too_early_does_not_count(new_cliff):
    new_cliff.link.foot("RIGHT")
    new_cliff.link.key("ENTER")
    found = new_cliff.template("LEFT", "FOOT LEFT; FOOT RIGHT")
    assert did(found) == [("1", "skipped"), ("2", "digitised")]


def test_again_drives_to_the_old_marks_and_keeps_them(cliff):
    found = cliff.template("LEFT", "KEY ENTER; MOVE 0.1 0; FOOT RIGHT; FOOT LEFT; KEY 4", again=True, kind="C")
    truth = measured_in(cliff.folder / DAY2)
    assert did(found) == [("1", "kept"), ("2", "digitised"), ("3", "skipped")]
    for entry in found.entries:
        assert entry.driven == pytest.approx(truth["TemplateRecord", "LEFT", entry.name], abs=1e-9)
    log = measured_in(cliff.folder / LOG)
    x, y = truth["TemplateRecord", "LEFT", "2"]
    assert log == {
        ("TemplateRecord", "LEFT", "1"): truth["TemplateRecord", "LEFT", "1"],
        ("TemplateRecord", "LEFT", "2"): (pytest.approx(x + 0.1, abs=1e-9), y),
        ("TemplateRecord", "LEFT", "4"): truth["TemplateRecord", "LEFT", "4"],  # not visited: kept
    }
    assert "TEMPLATE LEFT C UPPER" in cliff.log
    assert measure(cliff.folder).outcome.interior.complaints == ()


def test_nothing_is_written_where_all_is_kept(cliff):
    found = cliff.template("LEFT", "KEY ENTER; KEY ENTER; KEY ENTER; KEY ENTER", again=True)
    assert [entry.outcome for entry in found.entries] == ["kept"] * 4
    assert cliff.log == ""


def test_an_interrupted_template_is_taken_up_again(new_cliff):
    new_cliff.line.breaks_at = 12
    with pytest.raises(LinkError):
        new_cliff.template("LEFT", (DAY1,))
    done = len(measured_in(new_cliff.folder / LOG))
    assert 1 <= done < 4
    assert f"{done} digitised so far; all of it is in NEW.MEA" in new_cliff.said[-1]
    new_cliff.line.breaks_at = None
    again = new_cliff.template("LEFT", (DAY1,), again=True)
    assert "not-complete" not in codes(again) or done < 3
    assert len(again.entries) == done
    assert len(new_cliff.template("LEFT", (DAY1,)).orientations) == 1


def test_a_place_beyond_the_stage_is_left_to_the_operator(cliff):
    # stored as lying 100 mm to the side: what is predicted of the right ticks is beyond the table's limits
    text = (cliff.folder / DAY2).read_text().splitlines()
    ticks = [line.split() for line in text[4:8]]
    for row, (name, x, y) in enumerate(ticks):
        text[4 + row] = f"  {name} {float(x) + 100.0:.3f} {y}"
    (cliff.folder / "DAY2.MEA").write_text("\n".join(text[:8]) + "\n")
    found = cliff.template("LEFT", (DAY1, DAY2))
    assert [entry.known for entry in found.entries][:1] == ["predicted"]
    assert did(found) == [(name, "digitised") for name in "1234"]
    found = cliff.template("LEFT", (Path("DAY2.MEA"), DAY1), again=True)
    assert found.entries[1].outcome == "digitised"


def test_template_usage(cliff, new_cliff):
    with pytest.raises(UsageError, match="template LEFR is not defined; did you mean LEFT"):
        cliff.template("LEFR", "")
    with pytest.raises(InputError, match="has no marks to digitise again; leave --again out"):
        new_cliff.template("LEFT", "", again=True)
    assert new_cliff.line.requests == []


# photos


def test_all_photos_of_a_template(new_cliff):
    new_cliff.template("LEFT", (DAY1,))
    found = new_cliff.photos((), (DAY1,), template="left")
    photos = ["101", "103", "105", "201", "203", "205"]
    assert list(dict.fromkeys(entry.owner for entry in found.entries)) == photos
    assert len(found.entries) == 48
    assert [orientation.summary.name for orientation in found.orientations] == photos
    truth = measured_in(new_cliff.folder / DAY1)
    log = measured_in(new_cliff.folder / LOG)
    assert {key for key in log if key[0] == "PhotoRecord"} == {
        key for key in truth if key[0] == "PhotoRecord" and key[1] in photos
    }
    for key, xy in log.items():
        assert xy == pytest.approx(truth[key], abs=LAST_DIGIT)
    # an affine transformation is found with three marks; the others are then driven to within a few micrometres
    for entry in found.entries:
        if int(entry.name) > 4:
            assert entry.driven == pytest.approx(entry.xy, abs=0.02)
    assert len(new_cliff.photos((), (DAY1,), template="LEFT", start="203").entries) == 16


def test_a_photo_whose_template_lies_anew(cliff):
    # DAY2 has the template turned; fiducials were measured on day 1
    found = cliff.photos(["101"], "KEY ENTER; FOOT RIGHT; KEY ZERO", again=True)
    (oriented,) = found.orientations
    # what is kept is written as it lies now, so that the orientation is as good as it was
    assert oriented.summary.s0 < 0.004
    old = measured_in(cliff.folder / DAY1)
    assert np.hypot(*np.subtract(found.entries[0].driven, old["PhotoRecord", "101", "1"])) > 5.0


def test_photo_usage(cliff, new_cliff):
    with pytest.raises(UsageError, match="name photos, or a template"):
        cliff.photos([], "")
    with pytest.raises(UsageError, match="name photos, or a template"):
        cliff.photos(["101"], "", template="LEFT")
    with pytest.raises(UsageError, match="photo 102 is not among those to digitise: 101, 103"):
        cliff.photos([], "", template="LEFT", start="102")
    with pytest.raises(InputError, match="template LEFT, which is not oriented; digitise its tick marks first"):
        new_cliff.photos(["101"], "")


def test_digital_frames_have_no_marks(tmp_path):
    folder = first_project(tmp_path / "first")
    run_quietly(folder)
    with pytest.raises(InputError, match="photo left has no fiducial marks"):
        Bench(folder).photos(["left"], "")


# points


@pytest.fixture
def oriented_cliff(new_cliff):
    """Return the bench with templates and fiducial marks measured, and no points."""
    log = (new_cliff.folder / DAY1).read_text()
    (new_cliff.folder / "MARKS.MEA").write_text(log[: log.index("POINTS")])
    return new_cliff


def test_new_points_go_model_by_model_with_their_partners(oriented_cliff):
    new_cliff = oriented_cliff
    found = new_cliff.points((DAY1,), file=DAY1)
    truth, log = measured_in(new_cliff.folder / DAY1), measured_in(new_cliff.folder / LOG)
    truth = {key: xy for key, xy in truth.items() if key[0] == "PointsRecord"}
    assert log.keys() == truth.keys()
    for key, xy in log.items():
        assert xy == pytest.approx(truth[key], abs=LAST_DIGIT)
    titles = [line for line in new_cliff.log.splitlines() if line.startswith("! orip digitise points")]
    assert titles == [f"! orip digitise points, model 1-{column}" for column in (1, 2, 3, 4, 5)]
    # 1112 is in 101, 102 and 103: stereoscopically in model 1-1, then from 102, which is locked on the lower stage
    first, second = [
        (tuple(mark.owner for mark in sought), locked)
        for sought, locked, *_ in new_cliff.operator.seen
        if sought[0].name == "1112" and sought[0].owner in ("101", "102", "103")
    ]
    assert first == (("101", "102"), None)
    assert second == (("103",), "LOWER")
    assert found.ending == "complete"
    assert new_cliff.line.locked() is None


def test_a_strip_beside_gets_its_points_in_two_steps(cliff):
    # 1102 was measured in strip 1, in photo 101; model 2-1 is 201 (upper) and 202 (lower)
    log = (cliff.folder / "DAY2.MEA").read_text()
    (cliff.folder / "DAY2.MEA").write_text("\n".join(line for line in log.splitlines() if line.split()[:1] != ["1102"]))
    found = cliff.points((DAY1, DAY2), model="2-1", points=("1102",))
    assert did(found) == [("1102", "digitised")] * 2
    assert [entry.known for entry in found.entries] == ["predicted"] * 2
    for entry in found.entries:
        assert entry.driven == pytest.approx(entry.xy, abs=0.02)  # by the adjustment: its residuals
    films = mounted_films(cliff.folder, LOG)
    at = films.points_on_plate("MAIN")
    (first, second) = cliff.operator.seen
    sought, locked, guide, plates, model = first
    assert ([mark.owner for mark in sought], locked, guide, model) == (["202"], "UPPER", "LOWER", "2-1")
    assert plates[0] == pytest.approx(at["101", "1102"], abs=1e-9)
    sought, locked, guide, plates, model = second
    assert ([mark.owner for mark in sought], locked, guide, model) == (["201"], "LOWER", "UPPER", "2-1")
    assert plates[1] == pytest.approx(at["202", "1102"], abs=1e-4)
    # the side lap is seen in stereo with both prisms turned, the model as ever
    assert cliff.operator.prisms == [(90, 90), (0, 0)]


def test_again_goes_point_by_point(cliff):
    found = cliff.points((DAY1, DAY2), again=True, points=("1112", "1102"))
    names = [entry.name for entry in found.entries]
    assert names == sorted(names, key=["1112", "1102"].index)
    old = measured_in(cliff.folder / "DAY1.MEA") | measured_in(cliff.folder / "DAY2.MEA")
    assert len(names) == sum(key[2] in ("1112", "1102") for key in old if key[0] == "PointsRecord")
    assert {entry.known for entry in found.entries} == {"measured before"}
    assert len(cliff.operator.seen[0][0]) == 2
    assert found.warnings == ()
    before = mounted_films(cliff.folder, Path("NONE.MEA")).measured.observations["MAIN"]
    assert measure(cliff.folder).outcome.counts.remeasured >= len(names)
    after = mounted_films(cliff.folder, LOG).measured.observations["MAIN"]
    assert after.points == before.points
    np.testing.assert_allclose(after.measured, before.measured, atol=1e-4)


def test_beginning_with_a_point(cliff):
    every = cliff.points((DAY1, DAY2), again=True, photos=("101", "102"))
    rest = cliff.points((DAY1, DAY2), again=True, photos=("101", "102"), start="1110")
    assert [entry.name for entry in rest.entries] == [
        entry.name for entry in every.entries if entry.name not in [f"110{n}" for n in range(1, 10)]
    ]
    with pytest.raises(UsageError, match="point 9999 is not among those"):
        cliff.points((DAY1, DAY2), again=True, photos=("101",), start="9999")


def test_the_left_foot_locks_and_unlocks_the_left_photo_in_stereo(cliff):
    # 2101 is in 201 (upper stage) and 202 alone; locked, unlocked and locked again it stays where it is
    script = "MOVE 0.5 0.5; FOOT LEFT; FOOT LEFT; FOOT LEFT; GUIDE LOWER; MOVE 0.1 0; FOOT RIGHT; KEY ZERO"
    found = cliff.points(script, again=True, points=("2101",))
    (sought, _, guide, plates, model), *_ = cliff.operator.seen
    assert ([mark.owner for mark in sought], guide, model) == (["201", "202"], "BOTH", "2-1")
    assert [locked for _, locked, *_ in cliff.operator.seen] == [None, "UPPER", None, "UPPER"]
    (x1, y1), (x2, y2) = plates
    assert [entry.xy for entry in found.entries] == [
        pytest.approx((x1 + 0.5, y1 + 0.5), abs=0.6e-3), pytest.approx((x2 + 0.6, y2 + 0.5), abs=0.6e-3),
    ]  # fmt: skip
    with pytest.raises(ProcessorFault, match="204"):
        cliff.points("FOOT LEFT; GUIDE UPPER; MOVE 0.5 0.5", again=True, points=("2101",))
    assert cliff.line.locked() is None


def test_a_lock_that_is_opened(cliff):
    # the partner's plate is locked; unlocked and moved it changes nothing of what was measured on it
    script = "FOOT LEFT; GUIDE LOWER; MOVE 0.5 0.5; GUIDE UPPER; MOVE 0.2 -0.1; FOOT RIGHT; KEY ZERO"
    found = cliff.points(script, again=True, photos=("103",), points=("1112",))
    ((sought, locked, guide, plates, _model), *_) = cliff.operator.seen
    assert ([mark.owner for mark in sought], locked, guide) == (["103"], "LOWER", "UPPER")
    (entry,) = found.entries
    assert entry.xy == pytest.approx((plates[0][0] + 0.2, plates[0][1] - 0.1), abs=0.6e-3)
    assert list(measured_in(cliff.folder / LOG)) == [("PointsRecord", "103", "1112")]


def test_keeping_in_stereo(cliff):
    found = cliff.points("KEY ENTER; KEY ENTER", again=True, photos=("101", "102"), points=("1102",))
    assert did(found) == [("1102", "kept")] * 2
    assert cliff.log == ""


def test_with_one_eye_the_left_foot_skips_and_deletes(cliff):
    found = cliff.points(
        "FOOT LEFT; MOVE 0.01 0; FOOT RIGHT; KEY ENTER", viewing="mono", again=True, photos=("101",),
        points=("1102", "1103", "1104"),
    )  # fmt: skip
    assert did(found) == [("1102", "skipped"), ("1103", "digitised"), ("1104", "kept")]
    assert "KILL POINT MAIN 101 1102" in cliff.log
    after = mounted_films(cliff.folder, LOG).points_on_plate("MAIN")
    assert ("101", "1102") not in after
    assert after["101", "1103"] == pytest.approx(found.entries[1].xy, abs=LAST_DIGIT)
    assert found.warnings == ()


def test_with_one_eye_new_points_come_photo_by_photo(oriented_cliff):
    new_cliff = oriented_cliff
    found = new_cliff.points((DAY1,), viewing="mono", file=DAY1, photos=("102", "101"))
    assert list(dict.fromkeys(entry.owner for entry in found.entries)) == ["101", "102"]
    # nobody knows where they are: the middle of the photo is shown, and left to the operator
    assert [entry.known for entry in found.entries if entry.owner == "101"] == ["middle"] + ["nowhere"] * (
        sum(entry.owner == "101" for entry in found.entries) - 1
    )
    assert all(guide in ("UPPER", "LOWER") for _, _, guide, _, _ in new_cliff.operator.seen)


def test_points_that_should_be_seen_and_are_not_measured(cliff):
    log = (cliff.folder / "DAY1.MEA").read_text().splitlines()
    block = log.index("POINTS MAIN 101")
    gone = [line.split()[0] for line in log[block + 1 : block + 4]]
    (cliff.folder / "DAY1.MEA").write_text("\n".join([*log[: block + 1], *log[block + 4 :]]))
    found = cliff.points((DAY1, DAY2), photos=("101",))
    # all three were seen by others too, and are predicted; what 101 should show and never did is skipped
    assert [name for name, outcome in did(found) if outcome == "digitised"] == gone
    assert {entry.known for entry in found.entries} == {"predicted"}
    again = cliff.points((DAY1, DAY2), photos=("101",))
    assert again.count("digitised") == 0
    assert codes(again) == ["nothing-to-digitise"]


def test_nothing_to_do(cliff):
    with pytest.raises(InputError) as error:
        cliff.points("", points=("1103", "9999", "-"))
    assert "the position of point 9999 is not known; name the photos with --photo, or a model with --model" in str(
        error.value
    )
    assert "point -: '-' is not allowed as a name" in str(error.value)
    with pytest.raises(InputError, match="point 9999 is not measured in any of the photos that were chosen"):
        cliff.points("", points=("9999",), again=True)
    with pytest.raises(UsageError, match="bundle MAIN has no model 1-9; did you mean"):
        cliff.points("", model="1-9")
    with pytest.raises(UsageError, match="model 1-1 is made of 101 and 102"):
        cliff.points("", model="1-1", photos=("103",))
    assert cliff.line.requests == []


def test_a_list_with_faults(cliff):
    (cliff.folder / "list.txt").write_text("1101\nPOINTS MAIN 999\n 1102\nPOINTS MAIN\n! note\n")
    with pytest.raises(InputError) as error:
        cliff.points("", file=Path("list.txt"))
    assert "list.txt:3: photo 999 is not defined" in str(error.value)
    assert "list.txt:4: write POINTS bundle photo" in str(error.value)


def test_a_lost_link_leaves_all_that_was_digitised(cliff):
    cliff.line.breaks_at = 60
    with pytest.raises(LinkError):
        cliff.points((DAY1, DAY2), again=True, photos=("101", "102"))
    found = read_measurements(cliff.folder / LOG, "NEW.MEA")
    assert found.complaints == ()
    written = sum(len(record.names) for record in found.value)
    assert written > 4
    assert f"{written} digitised so far; all of it is in NEW.MEA" in cliff.said[-1]


def test_what_does_not_count_is_said(cliff):
    (cliff.folder / "EDITS.MEA").write_text("DISREGARD POINT MAIN 101 1103\nKILL POINT MAIN 102 1103\n")
    found = cliff.points((DAY1, DAY2), viewing="mono", points=("1103",), photos=("101", "102"), again=True)
    assert [(warning.code, warning.where) for warning in found.warnings] == [("disregarded", "point 1103 of 101")]
    found = cliff.points((DAY1, DAY2), viewing="mono", points=("1103",), photos=("102",))
    assert codes(found) == ["does-not-count"]
    outside = digitise_template(cliff.means((DAY1,), Path("other.txt")), "RIGHT")
    assert codes(outside) == ["not-in-project"]


def test_digital_frames_and_their_pixels(tmp_path):
    folder = first_project(tmp_path / "first")
    for photo, stage in (("left", "UPPER"), ("right", "LOWER")):
        replace_in(folder / "orip.toml", f'name = "{photo}"\ncamera', f'name = "{photo}"\nstage = "{stage}"\ncamera')
    run_quietly(folder)
    bench = Bench(folder)
    found = bench.points((Path("FIRST.MEA"),), again=True)
    assert found.ending == "complete"
    truth, log = measured_in(folder / "FIRST.MEA"), measured_in(folder / LOG)
    assert log.keys() == truth.keys()
    for key, xy in log.items():
        assert xy == pytest.approx(truth[key], abs=0.6e-3)  # the least count is 0.001 px


def test_scans_are_driven_in_mm_and_logged_in_pixels(tmp_path):
    folder = film_project(tmp_path / "film")
    log = []
    for line in (folder / "FIRST.MEA").read_text().splitlines():
        fields = line.split()
        if fields[0] in ("PHOTO", "POINTS"):
            log.append(line)
        else:
            x, y = map(float, fields[1:3])
            log.append(f"{fields[0]} {x / 0.0127:.4f} {(200.0 - y) / 0.0127:.4f}")
    (folder / "FIRST.MEA").write_text("\n".join(log) + "\n")
    for photo, stage in (("left", "UPPER"), ("right", "LOWER")):
        scan = f'name = "{photo}"\nstage = "{stage}"\nscan = {{ pixel = 0.0127 }}\ncamera'
        replace_in(folder / "orip.toml", f'name = "{photo}"\ncamera', scan)
    run_quietly(folder)
    bench = Bench(folder)
    truth = measured_in(folder / "FIRST.MEA")
    marks = bench.photos(["left"], (Path("FIRST.MEA"),))
    points = bench.points((Path("FIRST.MEA"),), again=True, photos=("left",))
    assert len(marks.entries) == 4
    for key, xy in measured_in(folder / LOG).items():
        assert xy == pytest.approx(truth[key], abs=0.04)  # half the least count of 0.001 mm
    assert max(abs(value) for entry in points.entries for value in entry.driven) < 300.0  # mm, not pixels
    assert marks.warnings == points.warnings == ()


def test_a_stage_that_nothing_tells(tmp_path):
    folder = film_project(tmp_path / "film")
    run_quietly(folder)
    with pytest.raises(UsageError, match="the stage of photo left is not known"):
        Bench(folder).photos(["left"], "")


# ground


def test_ground_points_from_a_model(cliff):
    found = cliff.ground((DAY1, DAY2), model="1-1", target="PRE", names=("1101", "nobody", "1102"))
    assert [(point.name, point.outcome) for point in found.points] == [
        ("1101", "digitised"), ("nobody", "skipped"), ("1102", "digitised"),
    ]  # fmt: skip
    lines = [line.split() for line in (cliff.folder / "MAIN.PRE").read_text().splitlines()]
    assert [fields[0] for fields in lines] == ["1101", "1102"]
    truth = {"1101": (37.8365, 11.3827, 50.1595), "1102": (40.8413, 13.1806, 54.506)}  # truth.json
    for name, *values in lines:
        # two rays of 2 um at 35 mm from 75 m, base 34 m: a centimetre or two, and the errors of the block
        assert [float(value) for value in values] == pytest.approx(truth[name], abs=0.08)
    assert max(abs(point.y_parallax) for point in found.points if point.y_parallax is not None) < 0.01
    assert found.file == "MAIN.PRE"
    assert cliff.line.station.state.automatic is True


def test_ground_points_become_control(cliff):
    before = (cliff.folder / "CLIFF.PNT").read_text()
    found = cliff.ground("DRIVE OBJECT 60 8 45; FOOT RIGHT; MOVE 1 0 0; FOOT RIGHT; KEY ZERO", model="1-1",
                         target="PNT", first="G9", error=-0.5)  # fmt: skip
    assert [point.name for point in found.points] == ["G9", "G10"]
    after = (cliff.folder / "CLIFF.PNT").read_text()
    assert after.startswith(before.rstrip("\n"))
    first, second = (line.split() for line in after.splitlines()[-2:])
    assert list(map(float, first[1:])) == pytest.approx([60.0, 8.0, 45.0, -0.5, -0.5, -0.5], abs=1e-3)
    assert list(map(float, second[1:4])) == pytest.approx([61.0, 8.0, 45.0], abs=1e-3)


def test_ground_usage(cliff):
    with pytest.raises(UsageError, match="a control point needs an a-priori error"):
        cliff.ground("", model="1-1", target="PNT", names=("1",))
    with pytest.raises(UsageError, match="name the points"):
        cliff.ground("", model="1-1", target="PRE")
    with pytest.raises(InputError, match=r"in CLIFF\.PNT already: CP1"):
        cliff.ground("", model="1-1", target="PNT", names=("CP1",), error=0.1)
    with pytest.raises(ProcessorFault):
        Bench(cliff.folder).ground("", model="1-1", target="PRE", names=("1",))


# who digitises


def test_a_dry_run_shows_what_would_be_done(cliff):
    before = contents(cliff.folder / "films"), sorted(path.name for path in cliff.folder.iterdir())
    choice = PointChoice(again=True, points=("1112", "1102"))
    trial = digitise_points(rehearsal(cliff.folder, LOG, cliff.said.append), None, choice)
    assert (contents(cliff.folder / "films"), sorted(path.name for path in cliff.folder.iterdir())) == before
    assert trial.is_trial
    found = cliff.points((DAY1, DAY2), again=True, points=("1112", "1102"))
    assert [(entry.owner, entry.name, entry.driven) for entry in trial.entries] == [
        (entry.owner, entry.name, entry.driven) for entry in found.entries
    ]


def test_an_operator_at_the_processor_is_waited_for(new_cliff, monkeypatch):
    waited = []

    def sleep(seconds):
        waited.append(seconds)
        if len(waited) % 3 == 0:
            new_cliff.link.foot("RIGHT")

    monkeypatch.setattr(digitise_operator.time, "sleep", sleep)
    found = new_cliff.template("LEFT", AtTheProcessor())
    assert did(found) == [(name, "digitised") for name in "1234"]
    assert len(waited) == 12


def test_a_refused_request_of_a_script(cliff):
    with pytest.raises(ProcessorFault, match="311"):
        cliff.template("LEFT", "DRIVE PLATE UPPER 1e6 0; FOOT RIGHT")


def test_lines_of_a_script():
    found = script_requests(["! all of it", "move 1 2  # a bit", "CLEAR", "", "FOOT RIGHT"], "script.txt")
    assert found.value == ["move 1 2", "FOOT RIGHT"]
    (complaint,) = found.complaints
    assert str(complaint).startswith("script.txt:3: 'CLEAR' is not an operator's request; write one of FOOT, KEY")


def test_typed_requests():
    said = []
    assert list(typed_requests(["FOOT RIGHT\n", "QUIT\n", "\n", "KEY 3"], said.append)) == ["FOOT RIGHT", "KEY 3"]
    assert said == [
        "'QUIT' is not an operator's request; write one of FOOT, KEY, MOVE, DRIVE, GUIDE, LOCK, PRISM, NAME"
    ]


def test_control_or_tie_points_alone(cliff):
    lines = (cliff.folder / "CLIFF.PNT").read_text().splitlines()
    control = {line.split()[0] for line in lines if line[:1] not in ("", "!")}

    def digitised(only):
        found = Bench(cliff.folder).points((DAY1, DAY2), again=True, only=only)
        return [(entry.owner, entry.name) for entry in found.entries]

    every, of_control, of_tie = digitised(None), digitised("control"), digitised("tie")
    assert {name for _, name in of_control} == {name for _, name in every} & control != set()
    assert {name for _, name in of_tie} == {name for _, name in every} - control != set()
    assert sorted(of_control + of_tie) == sorted(every)
