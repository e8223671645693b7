"""Record and control commands killed while they write: stores and texts are the old ones or the new ones."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from workflow.commands import delete_record, edit_control, edit_record, export_toml, initialise, measure, rename_record
from workflow.killed_here import Killed, killed_at
from workflow.small_projects import contents, film_project

from orip.errors import UsageError
from orip.files.stores.contents import observations
from orip.files.stores.dump import dump
from orip.files.stores.transaction import reading
from orip.workflow.records.edits import RecordName

STORES = ("CAMERAS.CAM", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO", "ALL.EXO")
TEXTS = ("FIRST.PNT", "orip.toml", "MAIN.PRE", "ALL.PRE")

COMMANDS: dict[str, Callable[[Path], object]] = {
    "photo rename": lambda folder: rename_record(folder, RecordName("photo", "left"), "west"),
    "photo delete": lambda folder: delete_record(folder, RecordName("photo", "left"), with_referents=True),
    "bundle rename": lambda folder: rename_record(folder, RecordName("bundle", "MAIN"), "ALL"),
    "control": lambda folder: edit_control(folder, "points", "1", ["X=5"]),
    "export-toml": lambda folder: export_toml(folder, Path("orip.toml"), force=True),
}


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = film_project(tmp_path_factory.mktemp("before") / "film")
    (folder / "MAIN.PRE").write_text("P1 1 2 3\n")
    initialise(folder)
    measure(folder)
    edit_record(folder, RecordName("camera", "C35"), ["c=35.1"])
    return folder


def state(folder: Path) -> tuple[list[list[str]], list[str]]:
    """Return what stores and texts say; a store that is absent, or has no rows, says nothing."""
    stores = [list(dump(folder / name)) for name in STORES[:4]]
    for name in STORES[4:]:
        with reading([folder / name]) as found:
            said = observations.read(found[folder / name]) is not None
        stores.append(list(dump(folder / name)) if said else [])
    return stores, [(folder / name).read_text() if (folder / name).exists() else "" for name in TEXTS]


def steps_of(folder: Path, command: Callable[[Path], object]) -> int:
    with killed_at(None) as steps:
        command(folder)
    return steps()


@pytest.mark.parametrize("name", COMMANDS)
def test_killed_at_some_steps(name: str, before: Path, tmp_path: Path) -> None:
    command = COMMANDS[name]
    after = Path(shutil.copytree(before, tmp_path / "after"))
    total = steps_of(after, command)
    old, new = state(before), state(after)
    assert old != new
    seen = set()
    for step in sorted({*range(1, total + 1, max(total // 6, 1)), *range(max(total - 5, 1), total + 1)}):
        folder = Path(shutil.copytree(before, tmp_path / str(step)))
        with pytest.raises(Killed), killed_at(step):
            command(folder)
        stores, texts = state(folder)
        done = (stores == new[0] and stores != old[0]) or (old[0] == new[0] and texts == new[1])
        seen.add(done)
        assert stores in (old[0], new[0])
        if not done and name != "bundle rename":  # a copy of MAIN.PRE may be there already
            assert texts == old[1]
        if done:
            # a text of the old name may be left: then nothing of it is lost
            assert all(text in (found, "") for text, found in zip(new[1], texts, strict=True))
        else:
            command(folder)
            assert state(folder) == new
        assert not [content for content in contents(folder) if content.endswith("-journal")]
    assert False in seen


def test_a_rename_that_was_done_says_so(before: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(before, tmp_path / "again"))
    COMMANDS["bundle rename"](folder)
    with pytest.raises(UsageError, match="there is no bundle 'MAIN'; known are: ALL"):
        COMMANDS["bundle rename"](folder)
