"""Preliminary coordinates: reading, writing, and that writing loses nothing."""

from __future__ import annotations

from pathlib import Path
from unittest import mock

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orip.files.control import preliminary_text as module
from orip.files.control.preliminary_text import parse_preliminary, preliminary_text, read_preliminary
from orip.files.text.shown import Parsed
from orip.records.control import PreliminaryPoint
from orip.records.names import name_fault
from orip.structs import replace

finite = st.floats(-1e30, 1e30)
deviation = st.floats(0.0, 1e30)
names = st.text(min_size=1, max_size=8).filter(lambda name: name_fault(name) is None)
points = st.builds(
    PreliminaryPoint, names, st.tuples(finite, finite, finite), st.none() | st.tuples(deviation, deviation, deviation)
)


@given(st.lists(points, unique_by=lambda point: point.name, max_size=8))
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_back_exactly(tmp_path: Path, given_points: list[PreliminaryPoint]) -> None:
    path = tmp_path / "MAIN.PRE"
    path.write_text(preliminary_text(given_points), encoding="utf-8", newline="")
    parsed = read_preliminary(path, "MAIN.PRE")
    assert not parsed.complaints
    assert [replace(point, line=0) for point in parsed.value] == given_points


def test_decimal_points_stand_below_each_other() -> None:
    text = preliminary_text(
        [
            PreliminaryPoint("1", (1.5, -200.25, 3.0), (0.1, 0.2, 0.3)),
            PreliminaryPoint("1001", (-10000.125, 2.0, 1e-07)),
        ]
    )
    first, second = text.splitlines()
    assert first.index(".") == second.index(".")
    assert first.startswith("1" + " " * 10 + "1.5 ")
    assert second.endswith("1e-07")


@pytest.mark.parametrize(
    "point",
    [
        PreliminaryPoint("a b", (0, 0, 0)),
        PreliminaryPoint("1", (0, float("nan"), 0)),
        PreliminaryPoint("1", (0, 0, 0), (0, -1, 0)),
        PreliminaryPoint("1", (0, 0, 0), (0, float("inf"), 0)),
    ],
)
def test_what_could_not_be_read_is_not_written(point: PreliminaryPoint) -> None:
    with pytest.raises(ValueError, match="'"):
        preliminary_text([point])


@pytest.mark.parametrize(
    ("text", "place", "words"),
    [
        ("1 2 3", "M:1:7: ", "a field is missing"),
        ("name X Y Z", "M:1: ", "this line has no numbers; begin a heading with ! or remove it"),
        ("1 2 3 4 5", "M:1:11: ", "a field is missing, 5 found"),
        ("1 2 3 4 5 6 7 8", "M:1:15: ", "too many"),
        ("1 2 3 4 5 -6 7", "M:1:11: ", "standard deviation -6 is negative"),
        ("1 2 3 4\n1 2 3 4", "M:2: ", "point '1' is already on line 1"),
        ("1 2 3 4,5", "M:1:7: ", "decimal comma"),
    ],
)
def test_faulty_lines(tmp_path: Path, text: str, place: str, words: str) -> None:
    path = tmp_path / "M"
    path.write_text(text)
    (complaint,) = read_preliminary(path, "M").complaints
    assert str(complaint).startswith(place)
    assert words in complaint.message


def test_an_absent_file_has_no_points(tmp_path: Path) -> None:
    parsed = read_preliminary(tmp_path / "M.PRE", "M.PRE")
    assert (parsed.value, parsed.complaints) == ((), ())


_ODD = st.sampled_from(
    ["P1", "P1", "7", "-", "=", "!7", "#", "7#a", "pünkt", "a\u00a0b", "\x1b", "1.5", "-.5", "+2.", "1e3", "1d3", "1,5",
     "nan", "1e31", "9" * 40, "5e", ".", "0x1p3", "1_0"]
)  # fmt: skip


@given(
    rows=st.lists(st.lists(_ODD, min_size=0, max_size=8), max_size=6), gap=st.sampled_from([" ", "\t", "  ", "\x0b"])
)
def test_plain_lines_are_read_as_all_lines_are(rows: list[list[str]], gap: str) -> None:
    lines = Parsed([gap.join(row) for row in rows], ())
    with mock.patch.object(module, "_plain_point", return_value=None):
        field_by_field = parse_preliminary(lines, "B.PRE")
    assert parse_preliminary(lines, "B.PRE") == field_by_field


def test_a_line_without_deviations_is_plain() -> None:
    point = PreliminaryPoint("1001", (600123.25, -12.5, 1e-3), None, 7)
    assert module._plain_point(preliminary_text([point]).rstrip("\n"), 7) == point
