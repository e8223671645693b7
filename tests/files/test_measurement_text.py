"""Measurement logs: blocks, edits, names like keywords, and what is said of faulty lines."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from orip.files.log.text import is_compiled, plain_lines, read_measurements
from orip.files.text.shown import Parsed
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TextPlace,
    TicksRecord,
)

LOG = """\
TEMPLATE T1  A  UPPER  ! mounted
  1    10.0123  220.1130
  2    11.0  221.0  -
photo P101 w
  1   1.0D1 2
  9   12.0 3.5 = 100 0
  10  12.0 3.5 = 100 -1.5 -   # own coordinates, disregarded
POINTS MAIN P101
  1001  35.2310  -12.0040
  1002  30.1180   -9.7710  0.004 -0.5px
  1003  30.1180   -9.7710  0.004 0.004 -
  1004\t30 -9 -
DISREGARD POINT MAIN P101 1001
include mark * 2
KILL TICK T1 *
RENAME POINT MAIN P101 1001 1002
FIDUCIALS CAM Midsides
  1 2 3
TICKS TT1
  1 2 3
"""


def parse(folder: Path, text: str) -> Parsed[tuple[LogRecord, ...]]:
    path = folder / "S1.MEA"
    path.write_text(text, encoding="utf-8", newline="")
    return read_measurements(path, "S1.MEA")


def complaints(folder: Path, text: str) -> list[str]:
    return [str(complaint) for complaint in parse(folder, text).complaints]


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_all_records_in_the_order_of_the_log(tmp_path: Path, line_end: str) -> None:
    parsed = parse(tmp_path, LOG.replace("\n", line_end))
    assert not parsed.complaints
    template, photo, points, *edits, fiducials, ticks = parsed.value

    assert isinstance(template, TemplateRecord)
    assert (template.place, template.template) == (TextPlace("S1.MEA", 1), "T1")
    assert (template.transformation, template.stage) == ("A", "UPPER")
    assert template.marks.names == ("1", "2")
    assert template.marks.disregarded.tolist() == [False, True]
    assert np.isnan(template.marks.given).all()

    assert isinstance(photo, PhotoRecord)
    assert (photo.place.line, photo.photo, photo.transformation) == (4, "P101", "W")
    np.testing.assert_array_equal(photo.marks.measured, [[10, 2], [12, 3.5], [12, 3.5]])
    np.testing.assert_array_equal(photo.marks.given, [[np.nan, np.nan], [100, 0], [100, -1.5]])
    assert photo.marks.disregarded.tolist() == [False, False, True]

    assert isinstance(points, PointsRecord)
    assert (points.bundle, points.photo, points.names) == ("MAIN", "P101", ("1001", "1002", "1003", "1004"))
    np.testing.assert_array_equal(points.measured[0], [35.231, -12.004])
    np.testing.assert_array_equal(points.errors, [[np.nan, np.nan], [0.004, -0.5], [0.004, 0.004], [np.nan, np.nan]])
    assert points.errors_in_pixels.tolist() == [[False, False], [False, True], [False, False], [False, False]]
    assert points.disregarded.tolist() == [False, False, True, True]
    assert points.lines.tolist() == [9, 10, 11, 12]

    assert edits == [
        EditRecord(TextPlace("S1.MEA", 13), "DISREGARD", "POINT", "MAIN", "P101", "1001"),
        EditRecord(TextPlace("S1.MEA", 14), "INCLUDE", "MARK", None, "*", "2"),
        EditRecord(TextPlace("S1.MEA", 15), "KILL", "TICK", None, "T1", "*"),
        EditRecord(TextPlace("S1.MEA", 16), "RENAME", "POINT", "MAIN", "P101", "1001", "1002"),
    ]
    assert isinstance(fiducials, FiducialsRecord)
    assert (fiducials.camera, fiducials.arrangement) == ("CAM", "midsides")
    assert isinstance(ticks, TicksRecord)
    assert (ticks.temtick, ticks.marks.names) == ("TT1", ("1",))


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("POINTS M P\n1 2 3,5", ":2:5: ", "decimal comma; write a decimal point: 3.5"),
        ("POINTS M P\n1 nan 3", ":2:3: ", "'nan' is not allowed"),
        ("POINTS M P\n1 1e308 3", ":2:3: ", "'1e308' is too large for a number"),
        ("POINTS M P\n1 1_0 3", ":2:3: ", "'1_0' is not a number"),
        ("POINTS M P\n1 2", ":2: ", "a coordinate is missing; a line of POINTS M P is: name x y"),
        ("POINTS M P\n1 2 -", ":2: ", "a coordinate is missing"),
        ("POINTS M P\n1 2 3 4", ":2:7: ", "'4' does not fit here"),
        ("POINTS M P\n1 2 3 = 4 5", ":2:7: ", "'=' does not fit here"),
        ("POINTS M P\n1 2 3 0 1", ":2:7: ", "an a-priori error of 0 is not allowed here"),
        ("POINTS M P\n1 2 3 1 -0.0px", ":2:9: ", "of 0 is not allowed"),
        ("POINTS M P\n1 2 3 1 xpx", ":2:9: ", "'xpx' is not a number of pixels; write for example 0.5px"),
        ("POINTS M P\n= 2 3", ":2:1: ", "'=' is not allowed as a name"),
        ("POINTS M P\n1 2 3\n1 4 5", ":3: ", "'1' is measured twice in POINTS M P, first on line 2"),
        ("PHOTO P A\n1 2 3\n\n1 4 5 -", ":4: ", "'1' is measured twice in PHOTO P, first on line 2"),
        ("PHOTO P A\n1 2 3 4 5", ":2:7: ", "a line of PHOTO P is: name x y, = and its own coordinates"),
        ("TICKS T\n1 2 3 -", ":2:7: ", "a digitised mark is taken as it is"),
        ("FIDUCIALS C corners\n1 2 3 = 4 5", ":2:7: ", "'=' does not fit"),
        ("POINTS M P", ":1: ", "POINTS M P has no measurements"),
        ("POINTS M P\n!1 2 3\nPHOTO P A\n1 2 3", ":1: ", "POINTS M P has no measurements"),
        ("1 2 3\n2 3 4\n", ":1: ", "the measurement of '1' is outside a block"),
        ("POINTS M P\n1 2 3\nKILL MARK P 1\n2 3 4", ":4: ", "outside a block"),
        ("PHOTO P\n1 2 3", ":1:9: ", "a field is missing, 2 found; the line is: PHOTO name A|C|W"),
        (
            "PHOTO P Q\n1 2 3",
            ":1:9: ",
            "'Q' is not a transformation (A affine, C conformal, W conformal without scale)",
        ),
        ("PHOTO P A UPPER\n1 2 3", ":1:11: ", "'UPPER' is one field too many"),
        ("TEMPLATE T A UPER\n1 2 3", ":1:14: ", "'UPER' is not a stage; did you mean UPPER?"),
        ("FIDUCIALS C corner\n1 2 3", ":1:13: ", "did you mean corners?"),
        ("TICKS\n1 2 3", ":1:7: ", "the line is: TICKS temtick"),
        ("POINTS = P\n1 2 3", ":1:8: ", "'=' is not allowed as a name"),
        ("FOTO P A\n1 2 3", ":1:1: ", "'FOTO' is not a keyword; did you mean PHOTO?"),
        ("POINTS M P\n1 2 3\nPHOTOS P A\n1 2 3\n2 2 3", ":3:1: ", "'PHOTOS' is not a keyword; did you mean PHOTO?"),
        ("POINTS M P\nname column row\n1 2 3", ":2: ", "this line has no numbers; begin a heading with ! or remove it"),
        ("POINTS M P\npoint x[mm] y[mm]\n", ":2: ", "this line has no numbers"),
        (
            "name x y\nPOINTS M P\n1 2 3",
            ":1: ",
            "this is a heading of columns; begin it with ! or remove it. A log is in",
        ),
        ("Photo;Point;x;y\nP;1;2;3", ":1: ", "this is a heading of columns"),
        ("Punkt Spalte Zeile", ":1: ", "this is a heading of columns"),
        ("xyzzy", ":1:1: ", "'xyzzy' is not a keyword; write one of TEMPLATE, PHOTO"),
        ("Block 7, May 1987", ":1:1: ", "or begin a remark with !"),
        ("KILL", ":1:6: ", "the line is: KILL POINT bundle photo|* point|*"),
        ("KILL POINTS M P 1", ":1:6: ", "'POINTS' is not something to kill; did you mean POINT?"),
        ("KILL POINT P 1", ":1:16: ", "the line is: KILL POINT bundle photo|* point|*"),
        ("DISREGARD MARK P 1 2", ":1:20: ", "the line is: DISREGARD MARK photo|* mark|*"),
        ("INCLUDE TICK - 2", ":1:14: ", "'-' is not allowed as a name"),
    ],
)
def test_faulty_logs(tmp_path: Path, text: str, place: str, words: str) -> None:
    (complaint,) = complaints(tmp_path, text)
    assert complaint.startswith(f"S1.MEA{place}")
    assert words in complaint


def test_all_faults_come_at_once_in_the_order_of_the_lines(tmp_path: Path) -> None:
    found = complaints(tmp_path, "PHOTO P Q\n1 2 x\nPOINTS M P\nTICKS T\n1 - 2\n2 3\nKILL IT\n")
    assert [complaint.split(" ")[0] for complaint in found] == [
        "S1.MEA:1:9:",
        "S1.MEA:2:5:",
        "S1.MEA:3:",
        "S1.MEA:5:3:",
        "S1.MEA:6:",
        "S1.MEA:7:6:",
    ]


def test_points_may_be_called_like_keywords(tmp_path: Path) -> None:
    text = "POINTS M P\nPHOTO 1 2\nKill 3.5 4\nPOINTS 5.0 6.0\nTICKS 7 8 -\nTEMPLATE 9 10 0.1 0.1\n"
    parsed = parse(tmp_path, text)
    assert not parsed.complaints
    (record,) = parsed.value
    assert isinstance(record, PointsRecord)
    assert record.names == ("PHOTO", "Kill", "POINTS", "TICKS", "TEMPLATE")


def test_bundles_and_photos_may_be_called_by_numbers(tmp_path: Path) -> None:
    parsed = parse(tmp_path, "PHOTO 101 A\n1 2 3\nPOINTS 1 101\n1 2 3\nPOINTS 1 102\n1 2 3\n")
    assert not parsed.complaints
    assert [type(record) for record in parsed.value] == [PhotoRecord, PointsRecord, PointsRecord]


def test_a_run_of_plain_lines_is_read_as_line_by_line(tmp_path: Path) -> None:
    lines = [f"  {n}   {n / 7.0!r} {-n}e-1 " for n in range(1, 2500)]
    closely = [f"{line}! looked at field by field" for line in lines]
    both = []
    for text in (lines, closely):
        log = tmp_path / "A.MEA"
        log.write_text("\n".join(["POINTS 1 101", *text, "POINTS 1 102", "7 1 2", ""]), encoding="utf-8")
        both.append(read_measurements(log, "A.MEA").value)
    for one, other in zip(*both, strict=True):
        assert isinstance(one, PointsRecord)
        assert isinstance(other, PointsRecord)
        assert (one.photo, one.names) == (other.photo, other.names)
        np.testing.assert_array_equal(one.measured, other.measured)
        np.testing.assert_array_equal(one.lines, other.lines)


def test_a_repeated_name_in_a_run_of_plain_lines_is_named_with_both_lines(tmp_path: Path) -> None:
    log = tmp_path / "A.MEA"
    log.write_text("POINTS 1 101\n1 1 2\n2 1 2\n1 3 4\n3 1 2\n", encoding="utf-8")
    (complaint,) = read_measurements(log, "A.MEA").complaints
    assert complaint.line == 4
    assert "first on line 2" in complaint.message


def test_the_same_name_in_a_later_block_is_a_new_measurement(tmp_path: Path) -> None:
    parsed = parse(tmp_path, "POINTS M P\n1 2 3\nPOINTS M P\n1 2 4\n")
    assert not parsed.complaints
    assert len(parsed.value) == 2


def test_names_of_other_scripts_are_names(tmp_path: Path) -> None:
    parsed = parse(tmp_path, "POINTS M P\nMühle_1 2 3\n")
    assert isinstance(parsed.value[0], PointsRecord)
    assert parsed.value[0].names == ("Mühle_1",)


def test_a_missing_log_is_named(tmp_path: Path) -> None:
    (complaint,) = read_measurements(tmp_path / "S2.MEA", "S2.MEA").complaints
    assert str(complaint).startswith("S2.MEA: there is no such file")


_PLAIN = ("1 2 3", "  A.1\t-0.5 +.25  ", "p 1. 1e-7", "x 1234567890123456789 0.1234567890123456789", "y -1e22 1e-22")
_NOT_PLAIN = (
    "POINTS 1 2", "points 1 2", "- 1 2", "= 1 2", "! 1 2", "#x 1 2", "p 1", "p 1 2 3", "p 1 x", "p 1e 2", "p . 2",
    "p + 2", "p 1 2d3", "p 1e31 2", "p 1 -1e400", "é 1 2", "p 1,2 3", "p 1 2 !", "", " ", "p ١ 2", "p 1 2e",
    "p " + 70 * "9" + " 2",
)  # fmt: skip


@pytest.mark.parametrize("line", _NOT_PLAIN)
def test_what_is_no_plain_line_ends_a_run(line: str) -> None:
    text = f"1 2 3\n{line}\n4 5 6\n".encode()
    run = plain_lines(text, 0)
    assert run is not None
    assert (run.end, run.names) == (6, ["1"])
    assert plain_lines(text, 6) is None


def test_numbers_of_plain_lines_are_those_of_python() -> None:
    generator = random.Random(7)
    numbers = ["".join(generator.choices("0123456789", k=generator.randint(1, 22))) for _ in range(600)]
    signs, points = ("", "-", "+"), ("", ".", ".5", ".125", ".00000000000000000001")
    texts = [generator.choice(signs) + number[:14] + generator.choice(points) for number in numbers]
    texts += [f"{number[:3]}.{number[3:]}e{generator.randint(-60, 3)}" for number in numbers]
    texts += [repr(generator.gauss(0.0, 100.0)) for _ in range(600)]
    lines = [f"p{row} {x} {y}" for row, (x, y) in enumerate(zip(texts[::2], texts[1::2], strict=True))]
    run = plain_lines(("\n".join(lines) + "\n").encode(), 0)
    assert run is not None
    assert list(run.coordinates) == list(map(float, texts))
    assert run.names == [f"p{row}" for row in range(len(lines))]


@pytest.mark.skipif(not is_compiled(), reason="there is no compiler")
def test_plain_lines_are_the_same_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = random.Random(8)
    text = "".join(f"{generator.choice((*_PLAIN, *_PLAIN, *_NOT_PLAIN))}\n" for _ in range(400)).encode()
    places = [0, *(place + 1 for place, byte in enumerate(text[:-1]) if byte == ord("\n"))]
    found = [plain_lines(text, place) for place in places]
    monkeypatch.setattr("orip.files.log.text.compiled", None)
    monkeypatch.setattr("orip.files.log.text.is_compiled", lambda: False)
    assert found == [plain_lines(text, place) for place in places]
    assert sum(run is not None for run in found) > 100


@pytest.mark.skipif(not is_compiled(), reason="there is no compiler")
@pytest.mark.parametrize(
    "wrong", [(-1, 1, ()), (9, 1, ()), (0, 0, ()), (0, 1, ("text",)), (0, 1, 65 * (b"word",)), (0, 1, [b"word"])]
)
def test_wrong_calls_of_the_compiled_reader_are_refused(wrong: tuple[Any, ...]) -> None:
    from orip.files.log import _plain_lines

    with pytest.raises((TypeError, ValueError)):
        _plain_lines.plain_lines(b"1 2 3\n", *wrong, 1e30)
