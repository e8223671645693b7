"""A measurement log that is written mark by mark: whole at any moment."""

from __future__ import annotations

import pytest
from workflow.killed_here import Killed, killed_at

from orip.errors import InputError, OripError
from orip.files.log import writing as log_writing
from orip.files.log.text import read_measurements
from orip.files.log.writing import (
    LogFile,
    kill_line,
    measurement_line,
    photo_header,
    points_header,
    template_header,
)

OLD = "! by hand\nPOINTS MAIN 1\n  A 1.0 2.0"


def line(name, x=1.0):
    return measurement_line(name, (x, -2.0))


def names(path):
    """Return the names of each block of a log that nothing is wrong with."""
    found = read_measurements(path, path.name)
    assert found.complaints == ()
    return [(record.photo, record.names) if hasattr(record, "photo") else record.action for record in found.value]


def test_blocks_grow_in_their_chapter(tmp_path):
    path = tmp_path / "NEW.MEA"
    log = LogFile(path, path.name)
    log.chapter("model 1-1")
    assert not path.exists()
    log.put("POINTS MAIN 1", [line("A")])
    log.put("POINTS MAIN 2", [line("A")])
    log.put("POINTS MAIN 1", [line("A"), line("B")])
    log.chapter("model 1-2")
    log.put("POINTS MAIN 2", [line("B")])
    assert names(path) == [("1", ("A", "B")), ("2", ("A",)), ("2", ("B",))]
    assert path.read_text() == (
        "! model 1-1\n"
        "POINTS MAIN 1\n  A             1.0000     -2.0000\n  B             1.0000     -2.0000\n"
        "POINTS MAIN 2\n  A             1.0000     -2.0000\n"
        "\n! model 1-2\n"
        "POINTS MAIN 2\n  B             1.0000     -2.0000\n"
    )


def test_what_is_there_stays_to_the_letter(tmp_path):
    path = tmp_path / "OLD.MEA"
    path.write_text(OLD)  # without the end of its last line
    log = LogFile(path, path.name)
    log.chapter("more")
    log.put("POINTS MAIN 2", [line("B")])
    assert path.read_text().startswith(f"{OLD}\n\n! more\nPOINTS MAIN 2\n")


def test_a_block_without_lines_is_none(tmp_path):
    path = tmp_path / "OLD.MEA"
    path.write_text(OLD)
    log = LogFile(path, path.name)
    log.chapter("more")
    log.put("POINTS MAIN 2", [line("B")])
    log.put("POINTS MAIN 2", [])
    assert path.read_text() == OLD


def test_an_edit_stands_behind_what_was_measured(tmp_path):
    path = tmp_path / "NEW.MEA"
    log = LogFile(path, path.name)
    log.chapter("again")
    log.put("POINTS MAIN 1", [line("A")])
    log.edit(kill_line("MAIN", "1", "B"))
    log.put("POINTS MAIN 1", [line("C")])
    assert names(path) == [("1", ("A",)), "KILL", ("1", ("C",))]


def test_what_somebody_else_writes_meanwhile_is_not_lost(tmp_path):
    path = tmp_path / "BOTH.MEA"
    log = LogFile(path, path.name)
    log.chapter("one")
    log.put("POINTS MAIN 1", [line("A")])
    with path.open("a") as other:
        other.write("POINTS MAIN 9\n  Z 1.0 1.0\n")
    log.put("POINTS MAIN 1", [line("A"), line("B")])
    # all of this chapter stands once more behind it: measured again, the later counts
    assert names(path) == [("1", ("A",)), ("9", ("Z",)), ("1", ("A", "B"))]


def test_headers_and_lines_are_read_back(tmp_path):
    path = tmp_path / "NEW.MEA"
    log = LogFile(path, path.name)
    log.chapter("all kinds")
    log.put(
        template_header("T", "C", "LOWER"), [line("1"), measurement_line("2", (-0.00001, 1e3), is_disregarded=True)]
    )
    log.put(photo_header("P", "A"), [measurement_line("PHOTO", (1.5, 2.5), (-12.0, 0.125))])
    log.put(points_header("MAIN", "P"), [measurement_line("POINTS", (1.0, 101.0))])
    found = read_measurements(path, path.name)
    assert found.complaints == ()
    template, photo, points = found.value
    assert (template.transformation, template.stage) == ("C", "LOWER")
    assert template.marks.disregarded.tolist() == [False, True]
    assert template.marks.measured.tolist() == [[1.0, -2.0], [0.0, 1000.0]]
    assert photo.marks.given.tolist() == [[-12.0, 0.125]]
    assert points.names == ("POINTS",)


def put_three(path):
    """Put three measurements; return how many were there when the machine went down."""
    done = 0
    try:
        log = LogFile(path, path.name)
        log.chapter("three")
        for count in (1, 2, 3):
            log.put("POINTS MAIN 1", [line(name) for name in "BCD"[:count]])
            done = count
    except Killed:
        pass
    return done


def test_killed_at_any_moment_nothing_is_lost(tmp_path):
    with killed_at(None) as steps:
        assert put_three(tmp_path / "FULL.MEA") == 3
    assert steps() >= 6  # a flush and a new name at least for each measurement
    for step in range(1, steps() + 1):
        path = tmp_path / f"KILLED{step}.MEA"
        path.write_text(OLD)
        with killed_at(step):
            done = put_three(path)
        there = names(path)
        assert there[0] == ("1", ("A",))
        written = "".join(there[1][1]) if len(there) > 1 else ""
        # the current measurement may be there already
        assert written in ("BCD"[:done], "BCD"[: done + 1])


def test_a_log_that_cannot_be_written(tmp_path, monkeypatch):
    def refuse(*_):
        raise OSError(28, "No space left on device")

    path = tmp_path / "NEW.MEA"
    log = LogFile(path, path.name)
    monkeypatch.setattr(log_writing, "replace_text", refuse)
    with pytest.raises(OripError, match="cannot be written: No space left"):
        log.put("POINTS MAIN 1", [line("A")])


def test_a_log_that_cannot_be_read(tmp_path):
    path = tmp_path / "OLD.MEA"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        LogFile(path, path.name)
    with pytest.raises(InputError, match="folder"):
        LogFile(tmp_path, "here")
