"""Several stores change together or not at all; what is no store is refused and left alone."""

import contextlib
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest
import store_samples as samples

from orip.errors import InputError, LockedError, OripError, UsageError
from orip.files.stores import digest as provenance
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import CAMERAS, PHOTO_ORIENTATIONS, PHOTOS, TEMTICKS
from orip.files.stores.identity import SCHEMA_VERSION, is_older_store
from orip.files.stores.transaction import reading, remove_empty, writing
from orip.records.photo import Photo, Temtick


@pytest.fixture
def tik(tmp_path):
    """A store with one temtick."""
    path = tmp_path / "T.TIK"
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick("TT", ()))])
    return path


def names_in(path):
    with reading([path]) as stores:
        return [item.record.name for item in TEMTICKS.read(stores[path])]


def test_a_new_store_tells_what_it_is(tik):
    header = tik.read_bytes()[:100]
    assert header[68:72] == b"ORIP"
    assert header[60:64] == SCHEMA_VERSION.to_bytes(4, "big")
    assert header[18:20] == b"\x01\x01"  # rollback journal, not WAL
    with contextlib.closing(sqlite3.connect(tik)) as connection:
        tables = connection.execute("SELECT name, strict FROM pragma_table_list WHERE schema = 'main'").fetchall()
    assert {name for name, strict in tables if strict} == {"meta", "text_input", "checksum", "temtick", "tick"}


def test_a_store_alone_is_durable(tik):
    with writing([tik]) as stores:
        assert stores[tik].connection.execute("PRAGMA main.synchronous").fetchone()[0] == 3  # EXTRA


def test_every_attached_store_is_durable(tmp_path):
    paths = [tmp_path / "T.TIK", tmp_path / "C.CAM", tmp_path / "Z.PHO"]
    with writing(paths) as stores:
        for path in paths:
            store = stores[path]
            settings = [
                store.connection.execute(f"PRAGMA {store.schema}.{name}").fetchone()[0]
                for name in ("synchronous", "journal_mode", "foreign_keys")
            ]
            assert settings == [2, "delete", 1]  # FULL: the removal of the journal that names all is flushed anyway
        main = stores[paths[1]].connection.execute("SELECT file FROM pragma_database_list WHERE seq = 0").fetchone()[0]
    assert Path(main) == paths[1].resolve()


def test_a_missing_store_is_read_as_empty_and_not_created(tmp_path):
    paths = [tmp_path / name for name in samples.filled_stores(tmp_path)]
    with reading(paths) as stores:
        assert not any(stores[path].present for path in paths)
        assert CAMERAS.read(stores[tmp_path / "C.CAM"]) == ()
        assert PHOTO_ORIENTATIONS.read(stores[tmp_path / "Z.PHO"]) == {}
        assert provenance.run_of(stores[tmp_path / "Z.PHO"]) is None
    assert list(tmp_path.iterdir()) == []


def test_a_store_of_no_bytes_counts_as_absent(tmp_path):
    path = tmp_path / "T.TIK"
    path.touch()
    assert names_in(path) == []
    assert path.stat().st_size == 0
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick("TT", ()))])
    assert names_in(path) == ["TT"]


def test_an_error_inside_rolls_all_stores_back(tmp_path, tik):
    pho = tmp_path / "Z.PHO"
    before = tik.read_bytes()
    with contextlib.suppress(ZeroDivisionError), writing([tik, pho]) as stores:
        TEMTICKS.write(stores[tik], [StoredRecord(Temtick("other", ()))])
        PHOTOS.write(stores[pho], [StoredRecord(Photo("P1", "C"))])
        raise ZeroDivisionError
    assert tik.read_bytes() == before
    with reading([tik, pho]) as stores:
        assert not stores[pho].present


def test_one_file_named_twice_is_one_store(tik):
    roundabout = tik.parent / ".." / tik.parent.name / tik.name
    with writing([tik, roundabout]) as stores:
        assert stores[tik] is stores[roundabout]


def test_a_locked_store_is_told_after_the_timeout(tik):
    with writing([tik]):
        began = time.monotonic()
        with (
            pytest.raises(LockedError, match=r"T\.TIK is locked by another run of orip; wait for it"),
            writing([tik], timeout=0.2),
        ):
            pass
        assert 0.1 < time.monotonic() - began < 5
        assert names_in(tik) == ["TT"]  # readers do not wait for a writer that has not committed


def test_a_commit_that_readers_hold_up_is_rolled_back_and_told(tik, tmp_path):
    pho = tmp_path / "Z.PHO"
    told = pytest.raises(LockedError, match=r"\(one of them\) is locked")
    with reading([tik]), told, writing([tik, pho], timeout=0.2) as stores:
        TEMTICKS.write(stores[tik], [])
    assert names_in(tik) == ["TT"]
    with reading([pho]) as stores:
        assert not stores[pho].present


def test_readers_see_one_state_while_a_writer_commits(tmp_path, tik):
    with reading([tik]) as before:
        with pytest.raises(LockedError), writing([tik], timeout=0.1) as stores:
            TEMTICKS.write(stores[tik], [])
        assert len(TEMTICKS.read(before[tik])) == 1


def foreign_text(path):
    path.write_text("TT 1 2 3\n" * 200)


def foreign_database(path):
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.executescript("PRAGMA journal_mode = WAL; CREATE TABLE t (x);")


def other_kind(path):
    pho = path.with_suffix(".PHO")
    with writing([pho]):
        pass
    pho.rename(path)


def newer(path):
    with writing([path]):
        pass
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA user_version = 99")


def without_table(path):
    with writing([path]):
        pass
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("DROP TABLE tick")


def older(path):
    without_table(path)
    with contextlib.closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA user_version = 1")


def cut_short(path):
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick(f"T{number}", ())) for number in range(2000)])
    os.truncate(path, path.stat().st_size // 2)


def cut_in_header(path):
    with writing([path]):
        pass
    os.truncate(path, 50)


def overwritten(path):
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick(f"T{number}", ())) for number in range(2000)])
    content = bytearray(path.read_bytes())
    content[8192:-4096] = b"\xa5" * (len(content) - 8192 - 4096)
    path.write_bytes(content)


def not_utf8(path):
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick("MARKME", ()))])
    path.write_bytes(path.read_bytes().replace(b"MARKME", b"MARK\xff\xfe"))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (foreign_text, "not a record store; move it away"),
        (foreign_database, "belongs to another program"),
        (other_kind, r"made as \.PHO and is not a \.TIK"),
        (newer, "newer orip .*update orip"),
        (older, r"older orip .this one writes schema .*move it away: 'orip run' creates"),
        (without_table, "damaged .*tick.*last dump"),
        (cut_short, "damaged"),
        (cut_in_header, "damaged"),
        (overwritten, "damaged"),
        (not_utf8, "damaged"),
    ],
)
def test_what_is_no_sound_store_is_refused_with_its_name_and_left_alone(tmp_path, make, message):
    path = tmp_path / "T.TIK"
    make(path)
    before = path.read_bytes()
    with pytest.raises(InputError, match=rf"T\.TIK: .*{message}"):
        names_in(path)
    with pytest.raises(InputError, match=r"T\.TIK"), writing([path]) as stores:
        TEMTICKS.read(stores[path])
    assert path.read_bytes() == before


def test_any_flipped_byte_gives_a_value_or_a_damage_report_but_no_other_error(tmp_path):
    source = tmp_path / "T.TIK"
    with writing([source]) as stores:
        TEMTICKS.write(stores[source], [StoredRecord(Temtick(f"T{number}", ())) for number in range(30)])
    content = source.read_bytes()
    generator = random.Random(5)
    for _ in range(150):
        changed = bytearray(content)
        changed[generator.randrange(len(content))] ^= generator.randrange(1, 256)
        source.write_bytes(changed)
        with contextlib.suppress(InputError):
            names_in(source)


def test_a_store_left_in_wal_mode_returns_to_the_rollback_journal(tik):
    with contextlib.closing(sqlite3.connect(tik)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
    assert names_in(tik) == ["TT"]
    with writing([tik]):
        pass
    assert tik.read_bytes()[18:20] == b"\x01\x01"


def test_what_no_store_is_called_is_a_usage_error(tmp_path):
    with (
        pytest.raises(UsageError, match=r"Z\.XYZ' is not a record store: stores end in \.CAM"),
        reading([tmp_path / "Z.XYZ"]),
    ):
        pass


def test_a_folder_in_place_of_a_store_is_refused(tmp_path):
    (tmp_path / "T.TIK").mkdir()
    with pytest.raises(InputError, match="this is a folder, not a file"), reading([tmp_path / "T.TIK"]):
        pass


def test_a_missing_folder_is_told(tmp_path):
    with pytest.raises(UsageError, match=r"folder of .* does not exist"), writing([tmp_path / "no" / "T.TIK"]):
        pass


def test_an_old_sqlite_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr(sqlite3, "sqlite_version_info", (3, 31, 1))
    with pytest.raises(OripError, match=r"need SQLite 3\.37"), reading([tmp_path / "T.TIK"]):
        pass


def test_names_with_signs_of_urls_are_files(tmp_path):
    path = tmp_path / "a?mode=ro#b%41 ü.TIK"
    with writing([path]):
        pass
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_a_store_in_a_folder_without_permission_to_write_can_be_read(tik):
    tik.chmod(0o444)
    tik.parent.chmod(0o555)
    try:
        assert names_in(tik) == ["TT"]
        with pytest.raises(OripError, match="permissions"), writing([tik]) as stores:
            TEMTICKS.write(stores[tik], [])
    finally:
        tik.parent.chmod(0o755)


def test_reading_rolls_back_what_a_killed_run_left_half_written(tmp_path):
    path, copy = tmp_path / "T.TIK", tmp_path / "C.TIK"
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(Temtick(f"T{number}", ())) for number in range(2000)])
    before = path.read_bytes()
    with contextlib.closing(sqlite3.connect(path, isolation_level=None)) as connection:
        # A cache of one page makes SQLite write changed pages to the file before the commit.
        connection.execute("PRAGMA cache_size = 1")
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("UPDATE temtick SET origin = 'half done'")
        copy.write_bytes(path.read_bytes())
        journal = tmp_path / "C.TIK-journal"
        journal.write_bytes((tmp_path / "T.TIK-journal").read_bytes())
    assert copy.read_bytes() != before
    with reading([copy]) as stores:
        assert {item.origin for item in TEMTICKS.read(stores[copy])} == {None}
    assert copy.read_bytes() == before
    assert not journal.exists()


WRITER = """
import sys
from pathlib import Path
from orip.files.stores.contents.stores import CAMERAS, PHOTOS, PHOTO_ORIENTATIONS, TEMTICKS
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.transaction import writing
from orip.records.photo import Photo, Temtick

tik, pho, pause = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3]
generation = int(sys.argv[4])
while True:
    generation += 1
    with writing([tik, pho]) as stores:
        TEMTICKS.write(stores[tik], [StoredRecord(Temtick(f"{generation}-{n}", ())) for n in range(300)])
        if pause == "between writes":
            print("here", flush=True)
            sys.stdin.read()
        PHOTOS.write(stores[pho], [StoredRecord(Photo(f"{generation}-{n}", "C")) for n in range(300)])
        if pause == "before the commit":
            print("here", flush=True)
            sys.stdin.read()
    print("here", flush=True)
"""


def generations(tik, pho):
    """Return the generations that the two stores hold, which must each be whole."""
    with reading([tik, pho]) as stores:
        first = [item.record.name for item in TEMTICKS.read(stores[tik])]
        second = [item.record.name for item in PHOTOS.read(stores[pho])]
    assert first == second
    assert len(first) in {0, 300}
    return {int(name.split("-")[0]) for name in first} or {0}


def run_and_kill(tik, pho, pause, generation, delay):
    command = [sys.executable, "-c", WRITER, str(tik), str(pho), pause, str(generation)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        child.stdout.readline()
        time.sleep(delay)
        child.send_signal(signal.SIGKILL)


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
@pytest.mark.parametrize("pause", ["between writes", "before the commit"])
def test_a_run_killed_inside_a_transaction_leaves_the_old_state(tmp_path, pause):
    tik, pho = tmp_path / "T.TIK", tmp_path / "Z.PHO"
    run_and_kill(tik, pho, pause, 0, 0.0)
    assert generations(tik, pho) == {0}
    run_and_kill(tik, pho, "never", 0, 0.0)
    (old,) = generations(tik, pho)
    assert old >= 1
    run_and_kill(tik, pho, pause, old, 0.0)
    assert generations(tik, pho) == {old}


def kills(count, tmp_path):
    tik, pho = tmp_path / "T.TIK", tmp_path / "Z.PHO"
    generator = random.Random(11)
    last = 0
    for _ in range(count):
        run_and_kill(tik, pho, "never", last, generator.uniform(0, 0.05))
        (found,) = generations(tik, pho)
        assert found > last
        last = found


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_runs_killed_at_any_instant_leave_both_stores_in_one_state(tmp_path):
    kills(6, tmp_path)


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
def test_two_hundred_kills_leave_both_stores_in_one_state(tmp_path):
    kills(200, tmp_path)


@pytest.mark.skipif(not Path("/proc/kmsg").exists(), reason="this system has no file that waits for its messages")
@pytest.mark.timeout(20)
def test_a_file_of_the_running_system_is_no_store_and_is_not_waited_for(tmp_path):
    path = tmp_path / "FIRST.EXO"
    path.symlink_to("/proc/kmsg")
    assert not is_older_store(path)
    assert not remove_empty(path, lambda _: True)
    assert path.is_symlink()
