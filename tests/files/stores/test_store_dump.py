"""Dumps are canonical, lossless, and checked before they touch a store."""

import json
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import store_samples as samples
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from orip.errors import InputError, UsageError
from orip.files.stores import digest as provenance
from orip.files.stores import store
from orip.files.stores.contents import observations, solutions
from orip.files.stores.contents.definitions import StoredRecord
from orip.files.stores.contents.stores import (
    BUNDLES,
    CAMERAS,
    PHOTO_ORIENTATIONS,
    PHOTOS,
    TEMPLATE_ORIENTATIONS,
    TEMTICKS,
    read_bundles,
)
from orip.files.stores.dump import dump, load
from orip.files.stores.identity import DUMP_VERSION
from orip.files.stores.transaction import reading, writing
from orip.records.camera import Camera, Mark
from orip.records.photo import Temtick
from orip.records.results.solution import Residuals

KINDS = ["C.CAM", "T.TIK", "Z.PHO", "Z.TEM", "Z.EXT", "MAIN.EXO"]


def make(path):
    """Make the rich store of the samples."""
    with writing([path]) as stores:
        samples.filled_stores(path.parent)[path](stores[path])
        provenance.write_inputs(stores[path], "init", [("orip.toml", "ab")])
        provenance.set_run(stores[path], "run-1")
    return path


@pytest.mark.parametrize("name", KINDS)
def test_a_loaded_dump_gives_the_same_dump(tmp_path, name):
    path = make(tmp_path / name)
    lines = list(dump(path))
    (tmp_path / "copy").mkdir()
    copy = tmp_path / "copy" / name
    load(lines, copy)
    assert list(dump(copy)) == lines
    with writing([path]) as stores:
        provenance.set_run(stores[path], "run-2")
    first, *others = dump(path)
    assert first != lines[0]
    assert others == lines[1:]


def test_a_dump_survives_a_text_file(tmp_path):
    path = make(tmp_path / "Z.EXT")
    text = tmp_path / "Z.txt"
    with text.open("w", encoding="utf-8", newline="\r\n") as stream:
        stream.writelines(f"{line}\n" for line in dump(path))
    assert len(text.read_text(encoding="utf-8").splitlines()) == len(list(dump(path)))
    before = list(dump(path))
    path.unlink()
    with text.open(encoding="utf-8") as stream:
        load(stream, path)
    assert list(dump(path)) == before
    with reading([path]) as stores:
        assert samples.same(solutions.read(stores[path], "MAIN"), samples.rich_solution())


def test_an_absent_store_has_the_dump_of_an_empty_one(tmp_path):
    path = tmp_path / "C.CAM"
    absent = list(dump(path))
    assert not path.exists()
    with writing([path]):
        pass
    assert list(dump(path)) == absent


def test_a_dump_given_up_half_way_holds_no_lock(tmp_path):
    path = make(tmp_path / "Z.EXT")
    lines = dump(path)
    for _ in range(12):
        next(lines)
    lines.close()
    with writing([path], timeout=0.1) as stores:
        solutions.delete(stores[path], "MAIN")


@pytest.mark.parametrize("name", ["Z.PHO", "Z.TEM"])
def test_equal_data_give_equal_dumps_whatever_the_order_of_writing(tmp_path, name):
    path = make(tmp_path / name)
    tables = {"Z.PHO": PHOTO_ORIENTATIONS, "Z.TEM": TEMPLATE_ORIENTATIONS}[name]
    before = list(dump(path))
    with writing([path]) as stores:
        orientations = list(tables.read(stores[path]).values())
        tables.write(stores[path], reversed(orientations))
    assert list(dump(path)) == before


def test_equal_data_give_equal_dumps_whatever_the_history(tmp_path):
    path = make(tmp_path / "Z.EXT")
    before = list(dump(path))
    with writing([path]) as stores:
        solutions.delete(stores[path], "MAIN")
        definitions = read_bundles(stores[path])
        BUNDLES.write(stores[path], ())
    with writing([path]) as stores:
        for name in ("zz", "MAIN", "aa"):
            solutions.write(stores[path], samples.rich_solution(name))
        BUNDLES.write(stores[path], definitions)
        for name in ("aa", "ZZ"):
            solutions.delete(stores[path], name)
    assert list(dump(path)) == before


@settings(max_examples=15, deadline=None)
@given(samples.stored_records(samples.photo), samples.photo_orientations(), samples.photo_observations())
def test_any_store_survives_dump_and_load(definitions, orientations, observed):
    with tempfile.TemporaryDirectory() as folder:
        pho, exo = Path(folder) / "Z.PHO", Path(folder) / "A.EXO"
        with writing([pho, exo]) as stores:
            PHOTOS.write(stores[pho], definitions)
            PHOTO_ORIENTATIONS.write(stores[pho], orientations)
            observations.write(stores[exo], observed)
        for path, other in ((pho, Path(folder) / "Y.PHO"), (exo, Path(folder) / "B.EXO")):
            load(dump(path), other)
            assert list(dump(other)) == list(dump(path))
        with reading([Path(folder) / "Y.PHO", Path(folder) / "B.EXO"]) as stores:
            assert samples.same(PHOTOS.read(stores[Path(folder) / "Y.PHO"]), definitions)
            assert samples.same(observations.read(stores[Path(folder) / "B.EXO"]), observed)


def edited(lines, old, new):
    changed = [line.replace(old, new) for line in lines]
    assert changed != list(lines)
    return changed


FAULTS = {
    "no JSON": ('["TT", 0,', '["TT", 0 ', r"d\.txt:\d+:\d+: Expecting"),
    "a number too many": ('"1", 0.0, 1.0]', '"1", 0.0, 1.0, 2.0]', "6 values, 5 are needed"),
    "text for a number": ('"1", 0.0,', '"1", "0.0",', r"tick: column x: '0\.0' is no REAL"),
    "no value": ('"1", 0.0,', '"1", null,', "column x: null, but a value is needed"),
    "NaN": ('"1", 0.0,', '"1", NaN,', "column x: NaN is not allowed; a number is needed"),
    "a bool": ('["TT", 0, "1"', '["TT", true, "1"', "position: True is no INTEGER"),
    "a huge number": ('["TT", 0, "1"', f'["TT", {2**63}, "1"', "more than 64 bits"),
    "a huge number for a real": ('"1", 0.0,', f'"1", {10**400},', "is no REAL"),
    "an unknown owner": ('["TT", 0, "1"', '["TX", 0, "1"', "table temtick has no 'TX'; add it there"),
    "a broken rule": ('["TT", 0, "1"', '["TT", -1, "1"', r'this rule is broken: \("position" >= 0\)'),
    "a name with a blank": ('["TT", 0, "ddd', '["T T", 0, "ddd', "'T T' has a blank"),
    "half a surrogate": ('["TT", 0, "ddd', '["TT", 0, "\\ud800ddd', "half a surrogate"),
    "an unknown table": ('{"table": "tick"', '{"table": "tock"', 'expected {"table": "tick"'),
    "an unknown column": ('"name", "x"', '"name", "u"', "expected"),
    "an unknown format": ("orip.dump/1", "orip.dump/9", "not a dump of a store"),
    "a newer schema": (
        f'"schema": {DUMP_VERSION}',
        f'"schema": {DUMP_VERSION + 1}',
        f"schema {DUMP_VERSION + 1}.*knows schema {DUMP_VERSION}",
    ),
    "another kind": ('"kind": "TIK"', '"kind": "CAM"', r"dump of a \.CAM"),
    "a run that is no text": ('"run": "run-1"', '"run": 5', "run 5 is neither"),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_dump_with_a_fault_is_refused_by_line_and_the_store_keeps_its_bytes(tmp_path, case):
    path = make(tmp_path / "T.TIK")
    old, new, message = FAULTS[case]
    lines = edited(dump(path), old, new)
    before = path.read_bytes()
    with pytest.raises(InputError, match=rf"d\.txt:\d+.*{message}|{message}"):
        load(lines, path, source="d.txt")
    assert path.read_bytes() == before
    path.unlink()
    with pytest.raises(InputError, match=r"^d\.txt:\d+"):
        load(lines, path, source="d.txt")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", KINDS)
def test_a_dump_cut_short_anywhere_is_refused(tmp_path, name):
    path = make(tmp_path / name)
    lines, before = list(dump(path)), path.read_bytes()
    for count in range(len(lines)):
        with pytest.raises(InputError):
            load(lines[:count], path)
    assert path.read_bytes() == before


def test_what_follows_the_end_is_refused(tmp_path):
    path = make(tmp_path / "T.TIK")
    lines = list(dump(path))
    load([*lines, "", "\n"], path)
    with pytest.raises(InputError, match="ended before this line"):
        load([*lines, lines[-1]], path)


def test_all_faults_are_told_at_once_and_lists_of_a_refused_record_are_not(tmp_path):
    path = tmp_path / "T.TIK"
    records = [Temtick(name, (Mark("1", 0.0, 0.0), Mark("2", 0.5, 0.0))) for name in ("A", "B", "C")]
    with writing([path]) as stores:
        TEMTICKS.write(stores[path], [StoredRecord(record) for record in records])
    lines = edited(dump(path), '["A", 0, null', '["A", "first", null')
    lines = edited(lines, '["C", 1, "2"', '["C", 1, "1"')
    with pytest.raises(InputError) as caught:
        load(lines, path, source="d.txt")
    found = [(complaint.line, complaint.message) for complaint in caught.value.complaints]
    assert [line for line, _message in found] == [
        next(number for number, line in enumerate(lines, 1) if line.startswith('["A", "first"')),
        next(number for number, line in enumerate(lines, 1) if line.startswith('["C", 1, "1"')),
    ]
    assert "'first' is no INTEGER" in found[0][1]
    assert "a row with the same temtick, name stands before" in found[1][1]


def test_names_that_differ_in_case_alone_are_refused(tmp_path):
    path = tmp_path / "C.CAM"
    with writing([path]) as stores:
        CAMERAS.write(stores[path], [StoredRecord(Camera(name, (0.0,) * 13)) for name in ("ä", "b")])
    with pytest.raises(InputError, match=r"'ä' and 'Ä' are one name"):
        load(edited(dump(path), '["b"', '["Ä"'), path)


def test_a_flood_of_faults_is_cut_off(tmp_path):
    path = make(tmp_path / "T.TIK")
    lines = list(dump(path))
    with pytest.raises(InputError) as caught:
        load([lines[0], *["?"] * 5000], path)
    assert len(caught.value.complaints) == 101
    assert "too many faults" in caught.value.complaints[-1].message


@settings(max_examples=60, deadline=None)
@given(st.lists(st.one_of(st.text(max_size=30), st.from_regex(r"[\[{]{1,3}.*[\]}]", fullmatch=True)), max_size=4))
def test_arbitrary_text_is_refused_without_another_error(lines):
    header = f'{{"format": "orip.dump/1", "kind": "TIK", "schema": {DUMP_VERSION}, "run": null}}'
    with tempfile.TemporaryDirectory() as folder:
        for text in (lines, [header, *lines]):
            with pytest.raises(InputError):
                load(text, Path(folder) / "T.TIK")
        assert list(Path(folder).iterdir()) == []


def test_deeply_nested_text_is_refused(tmp_path):
    with pytest.raises(InputError):
        load(["[" * 100_000], tmp_path / "T.TIK")


def test_rows_edited_by_hand_may_have_whole_numbers(tmp_path):
    path = make(tmp_path / "T.TIK")
    load(edited(dump(path), '"1", 0.0, 1.0]', '"1", 0, 7]'), path)
    with reading([path]) as stores:
        assert samples.same(TEMTICKS.read(stores[path])[0].record.ticks, (Mark("1", 0.0, 7.0),))


def test_a_foreign_file_is_not_overwritten_by_a_load(tmp_path):
    path = make(tmp_path / "T.TIK")
    lines = list(dump(path))
    path.write_text("a text of the user's\n" * 50)
    with pytest.raises(InputError, match="not a record store"):
        load(lines, path)
    assert path.read_text().startswith("a text")
    with pytest.raises(UsageError):
        load(lines, tmp_path / "T.txt")


def test_a_dump_reads_as_json_line_by_line_and_tells_its_columns(tmp_path):
    path = make(tmp_path / "Z.EXT")
    values = [json.loads(line) for line in dump(path)]
    assert values[0] == {"format": "orip.dump/1", "kind": "EXT", "schema": DUMP_VERSION, "run": "run-1"}
    tables = {value["table"]: value["columns"] for value in values if isinstance(value, dict) and "table" in value}
    with closing(sqlite3.connect(path)) as connection:
        for table, columns in tables.items():
            names = [row[1] for row in connection.execute(f'PRAGMA table_info("{table}")')]
            # of a long list many rows are one, with a BLOB for each column
            assert names in (columns, [columns[0], "first_row", "row_count", *columns[2:]])


@pytest.mark.parametrize("name", ["Z.EXT", "MAIN.EXO"])
def test_a_long_list_may_be_several_rows_of_the_file(tmp_path, monkeypatch, name):
    whole = list(dump(make(tmp_path / name)))
    (tmp_path / "parts").mkdir()
    monkeypatch.setattr(store, "CELLS_OF_PART", 22)  # two residuals, or two observations
    path = make(tmp_path / "parts" / name)
    table = {"Z.EXT": "residual", "MAIN.EXO": "observation"}[name]
    with closing(sqlite3.connect(path)) as connection:
        parts = connection.execute(f"SELECT first_row, row_count FROM {table}").fetchall()
    assert (2, 1) in parts or (2, 2) in parts
    assert list(dump(path)) == whole
    load(whole, path)
    assert list(dump(path)) == whole
    with reading([path]) as stores:
        stores[path].verify()
        if name == "Z.EXT":
            assert samples.same(solutions.read(stores[path], "MAIN"), samples.rich_solution())


@pytest.mark.parametrize("cells", [22, 10 << 20])
def test_a_solution_is_known_again_and_so_is_any_change_of_it(tmp_path, monkeypatch, cells):
    monkeypatch.setattr(store, "CELLS_OF_PART", cells)
    path, solution = make(tmp_path / "Z.EXT"), samples.rich_solution()
    residuals = solution.residuals
    columns = {name: getattr(residuals, name) for name in residuals.__struct_fields__}
    with reading([path]) as stores:
        assert solutions.is_stored(stores[path], solution)
        assert not solutions.is_stored(stores[path], replace(solution, bundle="OTHER"))
        assert not solutions.is_stored(stores[path], replace(solution, sigma0=solution.sigma0 + 1.0))
        shorter = {name: values[:-1] for name, values in columns.items()}
        assert not solutions.is_stored(stores[path], replace(solution, residuals=Residuals(**shorter)))
        for name, values in columns.items():
            last = values[-1]
            other = "other" if isinstance(last, str) else np.nan_to_num(last) + 1
            changed = [*list(values)[:-1], other]
            column = tuple(changed) if isinstance(last, str) else np.array(changed, dtype=values.dtype)
            assert not solutions.is_stored(
                stores[path], replace(solution, residuals=replace(residuals, **{name: column}))
            ), name
