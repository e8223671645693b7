"""Photo points during a replay, against a dictionary that takes one point after the other."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from orip.geometry.plane import IDENTITY
from orip.interior.measured_points import MeasuredPoints, points_of_record
from orip.records.measurement import EditRecord, PhotoObservations, PointsRecord, TextPlace
from orip.records.photo import Photo

PLACE = TextPlace("DAY.MEA", 1)
PHOTOS = {name: Photo(name, "CAM") for name in ("P1", "P2")}
POINTS = st.sampled_from(["a", "b", "c", "d"])

MEASURE = st.tuples(st.sampled_from(sorted(PHOTOS)), st.lists(POINTS, min_size=1, max_size=6), st.floats(0.0, 9.0))
EDIT = st.tuples(
    st.sampled_from(["DISREGARD", "INCLUDE", "KILL"]), st.sampled_from(["*", *PHOTOS]), st.sampled_from("*abcd")
)

Expected = dict[str, dict[str, tuple[float, bool]]]


def record(photo: str, names: list[str], x: float) -> PointsRecord:
    count = len(names)
    coordinates = np.column_stack([x + np.arange(count), np.zeros(count)])
    return PointsRecord(
        PLACE, "B", photo, tuple(names), coordinates, np.full((count, 2), np.nan), np.zeros((count, 2), dtype=bool),
        np.zeros(count, dtype=bool), np.arange(count),
    )  # fmt: skip


def observed(points: MeasuredPoints) -> PhotoObservations:
    found = points.observations({"B": "B"}, PHOTOS, lambda *_: IDENTITY, lambda *_: (1.0, 1.0))
    return found["B"]


def rows_of(found: PhotoObservations) -> list[tuple[str, str, float, bool]]:
    columns = (found.photos, found.points, found.measured[:, 0].tolist(), found.disregarded.tolist())
    return list(zip(*columns, strict=True))


def take(expected: Expected, photo: str, names: list[str], x: float) -> int:
    again = 0
    for number, name in enumerate(names):
        again += name in expected[photo]
        expected[photo][name] = (x + number, False)
    return again


def edit(expected: Expected, action: str, owner: str, name: str) -> int:
    found = [(photo, point) for photo in expected for point in expected[photo] if owner in ("*", photo)]
    found = [(photo, point) for photo, point in found if name in ("*", point)]
    for photo, point in found:
        if action == "KILL":
            del expected[photo][point]
        else:
            expected[photo][point] = (expected[photo][point][0], action == "DISREGARD")
    return len(found)


@given(st.lists(MEASURE | EDIT, min_size=1))
def test_measuring_and_editing_is_that_of_a_dictionary(log: list[tuple]) -> None:
    points, again = MeasuredPoints({}), 0
    points.measure("B", "P1", points_of_record(record("P1", ["a"], 0.0), np.zeros((1, 2)), 0))
    expected: Expected = {"P1": {"a": (0.0, False)}, "P2": {}}
    for first, second, third in log:
        if first in PHOTOS:
            given_ = record(first, second, third)
            points.measure("B", first, points_of_record(given_, given_.measured, 0))
            again += take(expected, first, second, third)
            assert given_.measured[0, 0] == third  # what the log holds stays as it is
            assert not given_.disregarded.any()
        else:
            assert points.edit("B", EditRecord(PLACE, first, "POINT", "B", second, third)) == edit(
                expected, first, second, third
            )
    assert points.remeasured == again
    listed = [(photo, name, *expected[photo][name]) for photo in PHOTOS for name in expected[photo]]
    assert rows_of(observed(points)) == listed


def test_stored_points_come_back_as_they_were() -> None:
    stored = PhotoObservations(
        "B", ("P2", "P1", "p2"), ("a", "a", "b"), np.arange(6.0).reshape(3, 2), np.full((3, 2), np.nan),
        np.array([False, True, False]),
    )  # fmt: skip
    assert rows_of(observed(MeasuredPoints({"B": stored}))) == [
        ("P1", "a", 2.0, True), ("P2", "a", 0.0, False), ("P2", "b", 4.0, False),
    ]  # fmt: skip


def test_nothing_stored_is_nothing_measured() -> None:
    empty = PhotoObservations("B", (), (), np.empty((0, 2)), np.empty((0, 2)), np.empty(0, dtype=bool))
    assert rows_of(observed(MeasuredPoints({"B": empty}))) == []
