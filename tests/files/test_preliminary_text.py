"""Preliminary coordinates: reading, writing, and that writing loses nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orip.files.control.preliminary_text import preliminary_text, read_preliminary
from orip.records.names import name_fault
from orip.records.observations.control import PreliminaryPoint
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
