"""Columns of long lists as bytes and back."""

import numpy as np
import pytest

from orip.files.stores.packed_columns import packed_column, unpacked_column
from orip.files.stores.table import StoreColumn
from orip.records.coded_names import CodedNames, coded

NOISE = np.random.default_rng(5).normal(size=5000)
COLUMNS = {
    "noise": (StoreColumn("x", "REAL"), NOISE),
    "constant": (StoreColumn("x", "REAL"), np.full(5000, 0.003)),
    "special": (StoreColumn("x", "REAL"), np.array([np.nan, np.inf, -np.inf, 0.0, 5e-324])),
    "numbers": (StoreColumn("n", "INTEGER"), np.arange(-2, 4998)),
    "flags": (StoreColumn("f", "INTEGER", flag=True), NOISE > 0.0),
    "names": (StoreColumn("t", "TEXT"), ("P1", "größe", "", "P1", "a\0b", "点")),
}


@pytest.mark.parametrize("name", COLUMNS)
def test_a_column_comes_back_exactly_and_always_gives_the_same_bytes(name):
    column, values = COLUMNS[name]
    data = packed_column(column, values)
    assert data == packed_column(column, values)
    found = unpacked_column(column, data, len(values))
    if column.type == "TEXT":
        assert found == values
    else:
        assert found.dtype == values.dtype
        assert found.tobytes() == values.tobytes()


def test_what_does_not_compress_stays_as_it_is_and_the_rest_is_small():
    assert NOISE.nbytes < len(packed_column(*COLUMNS["noise"])) < NOISE.nbytes + 100
    assert len(packed_column(*COLUMNS["constant"])) < 100
    assert len(packed_column(*COLUMNS["numbers"])) < 0.2 * NOISE.nbytes


@pytest.mark.parametrize("name", COLUMNS)
def test_bytes_of_another_length_are_refused(name):
    column, values = COLUMNS[name]
    data = packed_column(column, values)
    for damaged, count in ((data[:-1], len(values)), (data + b"\0", len(values)), (data, len(values) + 1), (b"", 1)):
        with pytest.raises(ValueError, match=r"length|incomplete|values"):
            unpacked_column(column, damaged, count)


def test_coded_names_are_a_sequence_of_names():
    names = ("b", "a", "b", "c", "a")
    found = coded(names)
    assert found == names == tuple(found)
    assert found.distinct == ("b", "a", "c")
    assert found[1:3] == ("a", "b")
    assert isinstance(found[np.array([True, False, False, True, False])], CodedNames)
    assert found.where("a".__eq__).tolist() == [False, True, False, False, True]
    assert found[3:].occurring() == ("c", "a")
    assert found != ("b", "a", "b", "c", "b")
