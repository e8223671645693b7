"""What killed runs leave is gone after the next command that writes, and nothing else is."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.commands import edit_control, rename_record
from workflow.killed_here import Killed
from workflow.small_projects import contents

from orip.files.stores.contents import observations
from orip.files.stores.transaction import reading, remove_empty, writing
from orip.files.text.atomic import temporary_beside
from orip.workflow.records.edits import RecordName

SUPER_JOURNAL = "CAMERAS.CAM-mj0A1B2C3D9"


def leave_temporary(folder: Path) -> Path:
    """Leave a temporary file of a process that has the number of this one, and began at another time."""
    name = temporary_beside(folder / "a").name.split("-")
    path = folder / "-".join([*name[:3], str(int(name[3]) + 1), name[4]])
    path.write_text("half a text")
    return path


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="only /proc says when a process began")
@pytest.mark.parametrize("words", ["init", "camera edit C35 c=35.1", "control points edit 1 X=1012.5", "report"])
def test_the_next_command_that_writes_removes_temporary_files(adjusted: Path, words: str) -> None:
    left = leave_temporary(adjusted)
    assert orip(adjusted, "status").code == 0
    assert left.exists(), "what only reads removes nothing"
    assert orip(adjusted, *words.split()).code == 0
    assert not left.exists()


def test_a_file_that_ties_no_journals_together_is_removed(initialised: Path) -> None:
    orphan, foreign = initialised / SUPER_JOURNAL, initialised / "OTHER.CAM-mj0A1B2C3D9"
    for path in (orphan, foreign):
        path.write_bytes(bytes(initialised / "CAMERAS.CAM-journal") + b"\0")
    assert orip(initialised, "init").code == 0
    assert not orphan.exists()
    assert foreign.exists(), "its store was not locked"


def test_a_file_that_a_journal_names_stays(initialised: Path) -> None:
    tie, journal = initialised / SUPER_JOURNAL, initialised / "elsewhere" / "Z.PHO-journal"
    journal.parent.mkdir()
    journal.write_bytes(b"pages of a store " + SUPER_JOURNAL.encode() + bytes(16))
    tie.write_bytes(bytes(initialised / "CAMERAS.CAM-journal") + b"\0" + bytes(journal) + b"\0")
    assert orip(initialised, "init").code == 0
    assert tie.exists()
    journal.unlink()
    assert orip(initialised, "init").code == 0
    assert not tie.exists()


def test_a_bundle_renamed_by_a_killed_run_leaves_no_empty_store(
    adjusted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (adjusted / "HAND.EXO").touch()

    def die(_path: Path, **_options: object) -> None:
        raise Killed

    monkeypatch.setattr(Path, "unlink", die)  # the first thing to be removed: the commit is done
    with pytest.raises(Killed):
        rename_record(adjusted, RecordName("bundle", "MAIN"), "ALL")
    monkeypatch.undo()
    names = set(contents(adjusted))
    assert {"MAIN.EXO", "ALL.EXO", "HAND.EXO"} <= names
    text = (adjusted / "orip.toml").read_text()
    (adjusted / "orip.toml").write_text(text.replace('"MAIN"', '"ALL"'))
    edit_control(adjusted, "points", "1", ["X=1012.5"])
    names = set(contents(adjusted))
    assert "ALL.EXO" in names
    assert not {"MAIN.EXO", "HAND.EXO"} & names
    with reading([adjusted / "ALL.EXO"]) as stores:
        assert observations.read(stores[adjusted / "ALL.EXO"]) is not None


def test_a_store_with_observations_of_another_project_stays(adjusted: Path) -> None:
    (adjusted / "MAIN.EXO").rename(adjusted / "THEIRS.EXO")
    before = (adjusted / "THEIRS.EXO").read_bytes()
    assert orip(adjusted, "init").code == 0
    assert (adjusted / "THEIRS.EXO").read_bytes() == before


def test_who_waits_for_a_store_that_is_removed_writes_to_a_new_one(tmp_path: Path) -> None:
    path = tmp_path / "M.EXO"
    path.touch()
    waiting, written = threading.Event(), threading.Event()

    def write() -> None:
        waiting.set()
        with writing([path]) as stores:
            stores[path].insert(observations.BUNDLE, [(1, "M")])
        written.set()

    with writing([tmp_path / "A.CAM", path]):
        thread = threading.Thread(target=write)
        thread.start()
        waiting.wait(10)
        written.wait(0.5)  # it waits for the lock by then
        path.unlink()
    thread.join(30)
    assert written.is_set()
    with reading([path]) as stores:
        assert list(stores[path].rows(observations.BUNDLE)) == [(1, "M")]
    assert not remove_empty(path, lambda store: observations.read(store) is None), "it is not empty"
