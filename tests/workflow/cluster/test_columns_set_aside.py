"""Columns that are set aside in files: the same numbers, no memory, and no file that is left."""

from __future__ import annotations

import sys
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from bundle.blocking.divided_blocks import with_blunders

from orip import set_aside as module
from orip.archive.blocking.divided_problem import pose_divided
from orip.bundle.compiled.photo_loop import is_compiled
from orip.bundle.methods import Method, adjust_block
from orip.errors import OripError
from orip.files.stores.digest import same_record
from orip.set_aside import ColumnByParts, columns_in_files, set_aside

LARGEST_PART = 4


@pytest.fixture
def _of_any_size(monkeypatch):
    monkeypatch.setattr(module, "_LEAST_BYTES", 1)


def resident_bytes() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * 4096


def test_elsewhere_an_array_stays_where_it_is():
    values = np.arange(6.0).reshape(3, 2)
    assert set_aside(values) is values


@pytest.mark.usefixtures("_of_any_size")
@pytest.mark.parametrize(
    "values",
    [
        np.arange(6.0).reshape(3, 2),
        np.arange(6.0).reshape(3, 2).T,
        np.array([True, False]),
        np.arange(7, dtype=np.uint8)[::2],
        np.zeros((0, 3)),
        np.broadcast_to(np.nan, (2, 2)),
    ],
)
def test_what_is_set_aside_has_the_same_values_and_cannot_be_changed(tmp_path, values):
    with columns_in_files(tmp_path):
        found = set_aside(values)
    assert found.dtype == values.dtype
    assert np.array_equal(found, values, equal_nan=found.dtype == np.float64)
    if found is not values:
        assert not found.flags.writeable
        assert list(tmp_path.iterdir()) == []


def test_a_column_is_made_part_after_part(tmp_path):
    made = []
    for folder in (nullcontext(), columns_in_files(tmp_path)):
        with folder:
            column = ColumnByParts(np.dtype(np.float64))
            for part in (np.arange(3), np.zeros((0, 2)), np.array([[0.5, 1.5], [2.5, 3.5]])[:, ::-1]):
                column.append(part)
            made.append(column.whole())
            assert ColumnByParts(np.dtype(np.bool_)).whole().tolist() == []
    assert made[0].flags.writeable
    assert not made[1].flags.writeable
    assert made[0].tolist() == made[1].tolist() == [0.0, 1.0, 2.0, 1.5, 0.5, 3.5, 2.5]


@pytest.mark.skipif(sys.platform != "linux", reason="other systems show a process's memory elsewhere")
def test_what_is_set_aside_takes_no_memory_once_it_is_not_looked_at(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_LOOKED_AT_SECONDS", 0.001)
    size = 32 << 20
    with columns_in_files(tmp_path):
        found = set_aside(np.ones(size // 8))
        before = resident_bytes()
        assert found.sum() == size // 8
        for _ in range(1000):
            if resident_bytes() < before + size // 8:
                break
            module.Event().wait(0.001)
        assert resident_bytes() < before + size // 8


def test_a_disk_without_room_is_told(tmp_path, monkeypatch):
    def full(*_arguments, **_names):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module.tempfile, "TemporaryFile", full)
    monkeypatch.setattr(module, "_LEAST_BYTES", 1)
    with columns_in_files(tmp_path), pytest.raises(OripError, match=r"has no room .*No space left on device.*; make"):
        set_aside(np.ones(3))


@pytest.mark.skipif(not is_compiled(), reason="sub-blocks need the compiled loop")
def test_an_adjustment_with_columns_in_files_is_the_same_to_the_last_digit(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "_LEAST_BYTES", 1000)
    block = with_blunders(9)

    def adjusted():
        return adjust_block(
            block, Method(), lambda _: None, lambda: False, lambda posed: pose_divided(posed, largest=LARGEST_PART)
        )[0]

    in_memory = adjusted()
    with columns_in_files(tmp_path):
        in_files = adjusted()
    assert not in_files.residuals.w.flags.writeable
    assert same_record(in_files, in_memory)
