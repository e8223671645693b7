"""Transactions over more stores than one SQLite connection attaches: whole or nothing, whoever is killed when."""

from __future__ import annotations

import multiprocessing
import sqlite3
import threading
from functools import partial
from pathlib import Path

import pytest
from workflow.killed_here import Killed, killed_at

from orip.errors import InputError, LockedError
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import TEMTICKS
from orip.files.stores.transaction import reading, writing
from orip.records.camera import Mark
from orip.records.photo import Temtick

MANY = 13
"""Two connections."""


def paths_in(folder: Path) -> list[Path]:
    return [folder / f"S{number:02d}.TIK" for number in range(MANY)]


def write(folder: Path, name: str, timeout: float = 10.0) -> None:
    """Give all stores one record of a name."""
    with writing(paths_in(folder), timeout=timeout) as stores:
        for path in paths_in(folder):
            TEMTICKS.write(stores[path], [StoredRecord(Temtick(name, (Mark("1", 0.0, 0.0),)))])


def names(folder: Path) -> list[str]:
    """Return the names of the records of each store."""
    with reading(paths_in(folder)) as stores:
        return [" ".join(stored.record.name for stored in TEMTICKS.read(stores[path])) for path in paths_in(folder)]


def files_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_many_stores_are_written_and_read(tmp_path):
    write(tmp_path, "OLD")
    assert names(tmp_path) == ["OLD"] * MANY
    write(tmp_path, "NEW")
    assert names(tmp_path) == ["NEW"] * MANY
    assert files_in(tmp_path) == [path.name for path in paths_in(tmp_path)]


@pytest.mark.parametrize("before", [None, "OLD"])
def test_killed_at_any_step_all_stores_are_old_or_all_are_new(tmp_path, before):
    """Also stores that the transaction makes; what the killed process leaves goes with the next transaction."""
    old = ["" if before is None else before] * MANY
    (tmp_path / "count").mkdir()
    if before:
        write(tmp_path / "count", before)
    with killed_at(None) as steps:
        write(tmp_path / "count", "NEW")
    total, seen = steps(), set()
    commits = range(total - 60, total + 1)  # the pact, the copies, two commits
    for step in sorted({*range(1, total, total // 4), *commits[::10], *commits[-5:]}):
        folder = tmp_path / str(step)
        folder.mkdir()
        if before:
            write(folder, before)
        with pytest.raises(Killed), killed_at(step):
            write(folder, "NEW")
        found = names(folder)
        assert found in (old, ["NEW"] * MANY)
        seen.add(found[0])
        write(folder, "LAST")
        assert names(folder) == ["LAST"] * MANY
        assert files_in(folder) == [path.name for path in paths_in(folder)]
    assert seen == {old[0], "NEW"}


def test_killed_while_putting_back(tmp_path):
    """What is put back in part is put back again."""
    write(tmp_path, "OLD")
    killed_between_commits(tmp_path)
    step, is_killed = 1, True
    while is_killed:
        try:
            with killed_at(step):
                names(tmp_path)
            is_killed = False
        except Killed:
            step += 9
    assert step > 20
    assert names(tmp_path) == ["OLD"] * MANY


def killed_between_commits(folder: Path) -> None:
    """Leave a transaction of which some connections are committed."""
    commits = 0

    class Connection(sqlite3.Connection):
        def execute(self, sql, *parameters):
            nonlocal commits
            commits += sql == "COMMIT"
            if commits == 2:
                raise Killed
            return super().execute(sql, *parameters)

    connect = sqlite3.connect
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sqlite3, "connect", lambda *args, **options: connect(*args, factory=Connection, **options))
        with pytest.raises(Killed):
            write(folder, "NEW")


def test_stores_that_are_moved_together_are_put_back(tmp_path):
    (tmp_path / "here").mkdir()
    write(tmp_path / "here", "OLD")
    killed_between_commits(tmp_path / "here")
    (tmp_path / "here").rename(tmp_path / "there")
    with reading([tmp_path / "there" / "S12.TIK"]) as stores:  # one of them is enough
        assert [stored.record.name for stored in TEMTICKS.read(stores[tmp_path / "there" / "S12.TIK"])] == ["OLD"]
    assert names(tmp_path / "there") == ["OLD"] * MANY
    assert files_in(tmp_path / "there") == [path.name for path in paths_in(tmp_path)]


def test_a_reader_that_holds_one_store_keeps_all_from_changing(tmp_path):
    write(tmp_path, "OLD")
    held, go = threading.Event(), threading.Event()

    def hold() -> None:
        with reading([paths_in(tmp_path)[-1]]):
            held.set()
            go.wait(30.0)

    thread = threading.Thread(target=hold)
    thread.start()
    try:
        assert held.wait(10.0)
        with pytest.raises(LockedError):
            write(tmp_path, "NEW", timeout=0.2)
    finally:
        go.set()
        thread.join()
    assert names(tmp_path) == ["OLD"] * MANY
    assert files_in(tmp_path) == [path.name for path in paths_in(tmp_path)]


def test_a_copy_that_is_damaged_is_said(tmp_path):
    write(tmp_path, "OLD")
    killed_between_commits(tmp_path)
    copy = tmp_path / "S03.TIK-undo"
    copy.write_bytes(copy.read_bytes()[:-1])
    with pytest.raises(InputError, match=r"S03\.TIK-undo: the store is damaged \(it is not a copy of a store\)"):
        names(tmp_path)


@pytest.mark.timeout(60)
@pytest.mark.parametrize("target", ["gone", "S04.TIK"])
def test_a_copy_that_is_a_link_is_refused(tmp_path, target):
    write(tmp_path, "OLD")
    (tmp_path / "S03.TIK-undo").symlink_to(target)
    for transaction in (names, partial(write, name="NEW")):
        with pytest.raises(InputError, match=r"S03\.TIK-undo: the store is damaged \(it is a link"):
            transaction(tmp_path)


def _alternate(folder: str, name: str, rounds: int) -> None:
    for _ in range(rounds):
        write(Path(folder), name)


def test_readers_among_writers_see_one_state(tmp_path):
    """Two processes write in turns, this one reads: no mixture."""
    write(tmp_path, "A")
    spawn = multiprocessing.get_context("spawn")
    writers = [spawn.Process(target=_alternate, args=(str(tmp_path), name, 3)) for name in "AB"]
    for process in writers:
        process.start()
    seen = set()
    while any(process.is_alive() for process in writers):
        found = names(tmp_path)
        assert len(set(found)) == 1
        seen.add(found[0])
    for process in writers:
        process.join()
        assert process.exitcode == 0
    assert seen <= {"A", "B"}
