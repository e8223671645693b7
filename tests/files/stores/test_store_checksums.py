"""What somebody else has changed in a store is found by whoever reads it, and named; nothing of it is obeyed."""

from __future__ import annotations

import contextlib
import random
import sqlite3
import sys
from pathlib import Path

import numpy as np
import pytest
import store_samples as samples

from orip.errors import InputError
from orip.files.stores.contents import observations, solutions
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import TEMTICKS
from orip.files.stores.dump import dump
from orip.files.stores.packed_columns import packed_column
from orip.files.stores.table import StoreColumn
from orip.files.stores.transaction import connected, reading, writing
from orip.records.measurement import PhotoObservations
from orip.records.photo import Temtick


def observed(count: int) -> PhotoObservations:
    generator = np.random.default_rng(3)
    return PhotoObservations(
        "MAIN",
        ("P1",) * count,
        tuple(map(str, range(count))),
        generator.normal(size=(count, 2)),
        np.full((count, 2), np.nan),
        np.zeros(count, dtype=np.bool_),
    )


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Photo observations of three points."""
    path = tmp_path / "MAIN.EXO"
    with writing([path]) as stores:
        observations.write(stores[path], observed(3))
    return path


def changed_by(path: Path, *statements: str) -> None:
    """Change a store behind orip's back."""
    with contextlib.closing(sqlite3.connect(path)) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()


def read(path: Path) -> object:
    with reading([path]) as stores:
        return observations.read(stores[path])


def test_every_flipped_bit_that_changes_what_is_read_is_found(store: Path) -> None:
    whole, text = store.read_bytes(), list(dump(store))
    generator = random.Random(7)
    found = 0
    for _ in range(300):
        damaged = bytearray(whole)
        damaged[generator.randrange(len(whole))] ^= 1 << generator.randrange(8)
        store.write_bytes(damaged)
        try:
            is_same = list(dump(store)) == text
        except InputError as error:
            is_same, found = store.name in str(error), found + 1
        assert is_same, "a changed value was read as if it were sound, or the file was not named"
    assert found > 10, "some bits are in the rows, most in the room between them"


def test_a_flipped_bit_is_named_with_its_table(store: Path) -> None:
    whole = store.read_bytes()
    column = packed_column(StoreColumn("x", "REAL"), read(store).measured[:, 0])  # type: ignore[attr-defined]
    assert whole.count(column) == 1
    place = whole.index(column) + len(column) // 2
    store.write_bytes(whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1 :])
    with pytest.raises(InputError, match=r"MAIN\.EXO: .*table observation: its content is not what orip wrote"):
        read(store)
    with pytest.raises(InputError, match="table observation"):
        list(dump(store))


@pytest.mark.parametrize(
    ("statement", "finding"),
    [
        ("UPDATE observation SET x = y", "table observation: its content"),
        ("UPDATE observation SET row_count = 2", "table observation: its content"),
        ("DELETE FROM observation", "table observation: its content"),
        ("UPDATE observed_bundle SET name = 'OTHER'", "table observed_bundle: its content"),
        ("DELETE FROM checksum", "its content is not what orip wrote"),
        ("UPDATE observation SET x = zeroblob(3)", "table observation: its content"),
        ("CREATE TABLE further (a)", "the table 'further' was not made by orip"),
        ("CREATE INDEX further ON observation (x)", "the index 'further' was not made by orip"),
        ("CREATE VIEW further AS SELECT 1", "the view 'further' was not made by orip"),
        (
            "CREATE TRIGGER further AFTER INSERT ON observation BEGIN DELETE FROM observation; END",
            "the trigger 'further' was not made by orip",
        ),
        ("ALTER TABLE observation ADD COLUMN further REAL", "table observation was not made by orip"),
        ("DROP TABLE text_input", "without text_input"),
    ],
)
def test_what_somebody_else_changed_is_refused_by_name(store: Path, statement: str, finding: str) -> None:
    changed_by(store, statement)
    before = store.read_bytes()
    with pytest.raises(InputError, match=rf"MAIN\.EXO: the store is damaged \(.*{finding}"):
        read(store)
    with pytest.raises(InputError, match=r"MAIN\.EXO"), writing([store]) as stores:
        observations.read(stores[store])
    assert store.read_bytes() == before


def test_a_view_in_the_place_of_a_table_is_not_run(store: Path) -> None:
    endless = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT 'kind' AS key, i AS value FROM n"
    changed_by(store, "DROP TABLE meta", f"CREATE VIEW meta AS {endless} WHERE i < 0")
    with pytest.raises(InputError, match="damaged"):
        read(store)


@pytest.mark.parametrize("is_written_again", [False, True])
def test_solutions_have_sums_of_their_own(tmp_path: Path, is_written_again: bool) -> None:
    path = tmp_path / "Z.EXT"
    one, other = samples.rich_solution("ONE"), samples.rich_solution("OTHER")
    for solution in (one, other):
        with writing([path]) as stores:
            solutions.write(stores[path], solution)
    if is_written_again:
        with writing([path]) as stores:
            solutions.write(stores[path], one)
    changed_by(path, "UPDATE point_estimate SET X = Y WHERE bundle = 'OTHER'")
    with reading([path]) as stores:
        assert samples.same(solutions.read(stores[path], "one"), one)
        with pytest.raises(InputError, match="table point_estimate of OTHER: its content"):
            solutions.read(stores[path], "OTHER")
    with writing([path]) as stores:
        solutions.delete(stores[path], "OTHER")
    assert list(dump(path))


def test_records_of_a_whole_dump_are_missing(tmp_path: Path) -> None:
    path = tmp_path / "Z.EXT"
    with writing([path]) as stores:
        solutions.write(stores[path], samples.rich_solution("ONE"))
    changed_by(path, "DELETE FROM residual")
    with pytest.raises(InputError, match="table residual: the rows of ONE are missing"):
        list(dump(path))


def test_a_store_that_changes_bit_by_bit_keeps_its_sums(tmp_path: Path) -> None:
    path = tmp_path / "T.TIK"
    for names in (["A"], ["A", "B"], [], ["B", "C"]):
        with writing([path]) as stores:
            TEMTICKS.write(stores[path], [StoredRecord(Temtick(name, ())) for name in names])
        assert list(dump(path))
        with reading([path]) as stores:
            assert [item.record.name for item in TEMTICKS.read(stores[path])] == names


def test_sqlite_trusts_no_file() -> None:
    with contextlib.closing(connected(":memory:", 1.0)) as connection:
        settings = {
            name: connection.execute(f"PRAGMA {name}").fetchone()[0]
            for name in ("trusted_schema", "cell_size_check", "foreign_keys")
        }
        assert settings == {"trusted_schema": 0, "cell_size_check": 1, "foreign_keys": 1}
        with pytest.raises(sqlite3.DataError):
            connection.execute("SELECT zeroblob(2000000000)").fetchone()
        if sys.version_info >= (3, 12):
            assert connection.getconfig(sqlite3.SQLITE_DBCONFIG_DEFENSIVE)
