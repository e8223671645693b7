"""Points and marks that the operator names while he measures them, and what he is told meanwhile."""

from __future__ import annotations

import io
import shutil
import time

import numpy as np
import pytest
from support.sample_projects import sample
from workflow.commands import initialise, measure
from workflow.digitise.digitising_bench import Bench, codes, did
from workflow.small_projects import replace_in

from orip.errors import UsageError
from orip.files.log.text import read_measurements
from orip.multimodel.digitising.operator import AtTheProcessor, TypedNames, Visit, WaitingHint, script_requests
from orip.multimodel.digitising.wanted import MarkChoice
from orip.workflow.observations.films import mounted_films
from orip.workflow.project.state import read_project


@pytest.fixture(scope="module")
def marked_cliff(tmp_path_factory):
    """The cliff with oriented photos of one strip, and no points."""
    folder = sample(tmp_path_factory.mktemp("cliff"), "small_frame_block")
    day1 = (folder / "DAY1.MEA").read_text()
    (folder / "films").mkdir()
    for name in ("DAY1.MEA", "DAY2.MEA"):
        (folder / name).rename(folder / "films" / name)
    (folder / "DAY1.MEA").write_text(without_points(day1))
    initialise(folder)
    measure(folder)
    return folder


@pytest.fixture
def cliff(marked_cliff, tmp_path):
    return shutil.copytree(marked_cliff, tmp_path / "cliff")


def without_points(text):
    kept, is_point = [], False
    for line in text.splitlines():
        if line[:1].strip():
            is_point = line.startswith("POINTS")
        if not is_point:
            kept.append(line)
    return "\n".join(kept) + "\n"


def points_in(path):
    """Return by (photo, point) what a log has measured."""
    records = read_measurements(path, "log").value
    return {
        (record.photo, name): tuple(xy)
        for record in records
        if hasattr(record, "bundle") and hasattr(record, "photo")
        for name, xy in zip(record.names, record.measured.tolist(), strict=True)
    }


def test_a_strip_is_measured_model_by_model_with_names_of_the_operator(cliff):
    """All points of the first day that lie in a model, each transferred with the plate of its first photo locked."""
    bench = Bench(cliff)
    found = bench.new_points((cliff / "films/DAY1.MEA",), first="G1")
    there = points_in(cliff / "films/DAY1.MEA")
    again = points_in(cliff / "NEW.MEA")
    assert found.ending == "complete"
    assert len(again) > 200
    assert all(again[key] == pytest.approx(there[key], abs=1e-3) for key in again)
    models = [said for said in bench.said if said.startswith("model ")]
    assert [said.split(":")[0] for said in models] == [f"model {r}-{c}" for r in (1, 2) for c in range(1, 6)]
    assert models[0] == "model 1-1: left photo 101 on the UPPER stage, right photo 102 on the LOWER stage (1 of 10)"
    assert any(said.startswith("in one of the two only: 1101, ") for said in bench.said)
    locked = {stage for sought, stage, *_ in bench.operator.seen if len(sought) == 1}
    assert locked == {"UPPER", "LOWER"}
    measure(cliff)
    assert len(read_project(cliff, "observations").measured.observations["MAIN"].points) == len(again)


def test_points_are_numbered_or_named_at_the_keypad_or_by_a_typed_word(cliff):
    """Taken numbers are left out, also those of control points; ENTER alone leads to the next model."""
    replace_in(cliff / "CLIFF.PNT", "CP1 ", "8   ")
    bench = Bench(cliff)
    script = (
        "FOOT RIGHT;MOVE 1 0;FOOT RIGHT;"  # 7, 9: 8 is a control point
        "KEY 2;KEY 5;KEY ENTER;FOOT RIGHT;NAME ROCK;FOOT RIGHT;KEY ENTER;"
        "NAME ROCK;FOOT RIGHT;KEY ZERO"
    )
    found = bench.new_points(script, first="7")
    assert found.ending == "ended by the operator"
    assert did(found) == [(name, "digitised") for name in ("7", "7", "9", "9", "25", "25", "ROCK", "ROCK", "ROCK")]
    assert [entry.owner for entry in found.entries][-3:] == ["101", "102", "103"]
    assert any("name 25" in said for said in bench.said)


def test_a_named_point_that_is_not_transferred_and_one_that_is_measured(cliff):
    bench = Bench(cliff)
    found = bench.new_points("NAME A;FOOT RIGHT;NAME A;NAME B;KEY ENTER;KEY 12", model="1-1")
    assert did(found) == [("A", "digitised"), ("A", "digitised")]
    assert "point A is measured here; --point A --again, without --new, measures it again" in bench.said


def test_with_one_eye_photo_by_photo(cliff):
    found = Bench(cliff).new_points(
        "FOOT RIGHT;FOOT LEFT;FOOT RIGHT;KEY ENTER;FOOT RIGHT;KEY ENTER", photos=("103", "101")
    )
    assert [(entry.owner, *name) for entry, name in zip(found.entries, did(found), strict=True)] == [
        ("103", "1", "digitised"), ("103", "2", "skipped"), ("103", "3", "digitised"), ("101", "4", "digitised"),
    ]  # fmt: skip
    assert found.ending == "complete"


def test_new_point_usage(cliff):
    bench = Bench(cliff)
    with pytest.raises(UsageError, match="no model 9-9"):
        bench.new_points("KEY ZERO", model="9-9")
    with pytest.raises(UsageError, match="a model is for stereo"):
        bench.new_points("KEY ZERO", model="1-1", viewing="mono")
    with pytest.raises(UsageError, match="photos are for one eye"):
        bench.new_points("KEY ZERO", photos=("101",), viewing="stereo")
    with pytest.raises(UsageError, match="--first: '-' is not allowed"):
        bench.new_points("KEY ZERO", first="-")
    assert not (cliff / "NEW.MEA").exists()


def test_names_in_a_script():
    found = script_requests(["NAME G1", "name -", "NAME", "NAME A B"], "script")
    assert found.value == ["NAME G1"]
    assert [complaint.line for complaint in found.complaints] == [2, 3, 4]


def test_the_orientation_is_told_after_every_mark(cliff):
    """Parameters and residuals as the listing has them at the end, from the third mark on."""
    bench = Bench(cliff)
    found = bench.template("LEFT", (cliff / "films/DAY1.MEA",))
    told = [said for said in bench.said if said.startswith("  ")]
    assert [said.split()[0] for said in told] == ["not", "not", "x0", "VX", "x0", "VX"]
    assert "no redundancy" in told[2]
    summary, residuals = found.orientations[0].summary, found.orientations[0].residuals
    assert told[4].split()[1::2][:2] == [f"{summary.x0:.4f}", f"{summary.y0:.4f}"]
    assert f"s0 {summary.s0:.4f}, redundancy 2" in told[4]
    assert [float(word) for word in told[5].split()[3:5]] == pytest.approx(residuals[0].tolist(), abs=5e-5)


def test_one_mark_alone_is_measured_again_and_a_new_one_is_added(cliff):
    """The others stay as they were; the new one carries its template coordinates into the log."""
    before = mounted_films(cliff, cliff / "NEW.MEA").measured.templates["LEFT"].marks
    bench = Bench(cliff)
    found = bench.template(
        "LEFT", "MOVE 0.01 0;FOOT RIGHT;FOOT RIGHT", chosen=[MarkChoice("2"), MarkChoice("9", (0.0, 50.0))]
    )
    assert did(found) == [("2", "digitised"), ("9", "digitised")]
    after = mounted_films(cliff, cliff / "NEW.MEA").measured.templates["LEFT"].marks
    assert set(after.names) == {*before.names, "9"}
    moved = after.measured[after.names.index("2")] - before.measured[before.names.index("2")]
    assert moved == pytest.approx([0.01, 0.0], abs=1e-3)
    assert after.given[after.names.index("9")].tolist() == [0.0, 50.0]
    assert np.array_equal(after.measured[after.names.index("3")], before.measured[before.names.index("3")])
    with pytest.raises(UsageError, match=r"has no mark 7.*a new one has its coordinates: 7,X,Y"):
        bench.template("LEFT", "KEY ZERO", chosen=[MarkChoice("7")])
    with pytest.raises(UsageError, match="mark 2 of template LEFT has the coordinates"):
        bench.template("LEFT", "KEY ZERO", chosen=[MarkChoice("2", (1.0, 2.0))])


MARKS = "DRIVE PLATE UPPER -18 -12;FOOT RIGHT;DRIVE PLATE UPPER 18 -12;FOOT RIGHT;DRIVE PLATE UPPER 18 12;FOOT RIGHT;"


def test_fiducial_marks_of_a_camera(cliff):
    """Turned by the rule of the fiducial system; the log has nothing before the fourth mark."""
    bench = Bench(cliff)
    few = bench.fiducials("REFLEX35", f"{MARKS}KEY ENTER")
    assert codes(few) == ["too-few-marks"]
    assert not (cliff / "NEW.MEA").exists()
    found = bench.fiducials("REFLEX35", f"{MARKS}NAME UL;DRIVE PLATE UPPER -18 12;FOOT RIGHT;KEY ENTER")
    assert did(found) == [(name, "digitised") for name in ("1", "2", "3", "UL")]
    assert bench.said[-3] == "  1 -18.0000 -12.0000  2 18.0000 -12.0000  3 18.0000 12.0000  UL -18.0000 12.0000"
    camera = mounted_films(cliff, cliff / "NEW.MEA").definitions.cameras["REFLEX35"]
    assert [mark.name for mark in camera.fiducials] == ["1", "2", "3", "UL"]


def test_fiducial_marks_that_are_named_before(cliff):
    bench = Bench(cliff)
    found = bench.fiducials("reflex35", f"{MARKS}DRIVE PLATE UPPER -18 12;FOOT RIGHT", names=("A", "B", "C", "D"))
    assert did(found) == [(name, "digitised") for name in "ABCD"]
    assert found.ending == "complete"
    with pytest.raises(UsageError, match="camera NONE is not defined"):
        bench.fiducials("NONE", "KEY ZERO")
    with pytest.raises(UsageError, match="a mark is named twice"):
        bench.fiducials("REFLEX35", "KEY ZERO", names=("A", "A"))


def test_tick_marks_of_a_temtick(cliff):
    """Taken as they are on the plate."""
    bench = Bench(cliff)
    name = next(iter(mounted_films(cliff, cliff / "NONE.MEA").definitions.temticks.values())).name
    found = bench.ticks(name, f"{MARKS}KEY ENTER")
    assert did(found) == [(name, "digitised") for name in "123"]
    ticks = mounted_films(cliff, cliff / "NEW.MEA").definitions.temticks[name].ticks
    assert [(tick.name, tick.x, tick.y) for tick in ticks] == [
        ("1", -18.0, -12.0),
        ("2", 18.0, -12.0),
        ("3", 18.0, 12.0),
    ]


def test_what_is_waited_for_is_said_once_for_each_kind_of_visit():
    said = []
    hint = WaitingHint(said.append, "tcp://here")
    for visit in (Visit((), "FOOT LEFT"), Visit((), "FOOT LEFT"), Visit((), "KEY ENTER", True, True)):
        hint(visit)
    assert len(said) == 2
    assert "the left one skips; ENTER keeps; ZERO or another key ends" in said[0]
    assert "'orip drive watch --link tcp://here'" in said[0]
    assert "locks or unlocks a plate; digits and ENTER" in said[1]


def test_names_are_typed_beside_the_plate_processor(cliff):
    typed = ["ROCK"]

    class Hands(AtTheProcessor):
        def act(self, link, visit):
            if visit.sought[0].name == "ROCK":
                link.request("FOOT RIGHT")
            elif not typed:
                link.request("KEY ZERO")
            return super().act(link, visit)

    found = Bench(cliff).new_points(Hands(typed=lambda: typed.pop() if typed else None), model="1-1")
    assert did(found) == [("ROCK", "digitised"), ("ROCK", "digitised")]


def test_typed_names_at_fault_are_reported(monkeypatch):
    class Keyboard(io.StringIO):
        def isatty(self):
            return True

    monkeypatch.setattr("sys.stdin", Keyboard("two words\nROCK\n"))
    said, deadline = [], time.monotonic() + 10.0
    names = TypedNames(said.append)
    while (name := names()) is None and time.monotonic() < deadline:
        time.sleep(0.01)
    assert name == "ROCK"
    (fault,) = said
    assert fault.startswith("'two words' has a blank; names are one word; type a name, or press ENTER")
