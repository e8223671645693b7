"""Columns of names: joined, and asked by the different ones."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from orip.records.coded_names import coded, joined

COLUMN = st.lists(st.sampled_from(["A", "B", "a", "1", "01", ""]))


@given(st.lists(COLUMN))
def test_joined_columns_are_the_names_one_after_the_other(columns: list[list[str]]) -> None:
    found = joined(columns)
    assert list(found) == [name for column in columns for name in column]
    assert len(set(found.distinct)) == len(found.distinct)


@given(COLUMN)
def test_a_name_without_a_place_is_at_minus_one(names: list[str]) -> None:
    place = {"A": 0, "01": 5}
    assert coded(names).places(place).tolist() == [place.get(name, -1) for name in names]
