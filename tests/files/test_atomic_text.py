"""Texts are replaced whole, and nothing is left lying about."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from orip.files.text.atomic import remove_leftovers, replace_text

posix = pytest.mark.skipif(os.name != "posix", reason="permissions and process numbers are those of POSIX")


def names_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def gone_process() -> int:
    with subprocess.Popen([sys.executable, "-c", ""]) as process:
        process.wait()
    return process.pid


def test_text_is_written_as_utf8_with_its_own_line_ends(tmp_path: Path) -> None:
    path = tmp_path / "BUNDLE_RESULT.OUT"
    replace_text(path, "old\n")
    replace_text(path, "Zürich\n")
    assert path.read_bytes() == "Zürich\n".encode()
    assert names_in(tmp_path) == ["BUNDLE_RESULT.OUT"]


@posix
def test_a_new_file_has_the_usual_permissions_and_an_old_one_keeps_its_own(tmp_path: Path) -> None:
    path, usual = tmp_path / "a", tmp_path / "b"
    usual.write_text("")
    replace_text(path, "1")
    assert path.stat().st_mode == usual.stat().st_mode
    path.chmod(0o640)
    replace_text(path, "2")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640


@posix
def test_a_link_is_followed(tmp_path: Path) -> None:
    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to("target")
    replace_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_after_a_failure_the_old_text_stands_and_no_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    path = tmp_path / "a"
    path.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    owner: object = os if failing == "fsync" else Path
    monkeypatch.setattr(owner, failing, fail)
    with pytest.raises(OSError, match="No space"):
        replace_text(path, "new")
    monkeypatch.undo()
    assert path.read_text() == "old"
    assert names_in(tmp_path) == ["a"]


def test_an_interrupt_leaves_no_temporary_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        replace_text(tmp_path / "a", "new")
    assert names_in(tmp_path) == []


def test_text_that_is_no_unicode_touches_nothing(tmp_path: Path) -> None:
    with pytest.raises(UnicodeEncodeError):
        replace_text(tmp_path / "a", "\ud800")
    assert names_in(tmp_path) == []


def test_a_folder_in_the_way_is_an_error_without_leftovers(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    with pytest.raises(OSError, match="a"):
        replace_text(tmp_path / "a", "new")
    assert names_in(tmp_path) == ["a"]


@posix
def test_leftovers_of_gone_writers_and_old_ones_are_removed_and_no_others(tmp_path: Path) -> None:
    gone = tmp_path / f".orip-{gone_process()}-{'0' * 16}.tmp"
    impossible = tmp_path / f".orip-{'9' * 18}-{'3' * 16}.tmp"
    old = tmp_path / f".orip-{os.getppid()}-{'1' * 16}.tmp"
    running = tmp_path / f".orip-{os.getppid()}-{'2' * 16}.tmp"
    others = [tmp_path / "orip.toml", tmp_path / ".orip-notes.tmp"]
    for path in (gone, impossible, old, running, *others):
        path.write_text("")
    day_ago = time.time() - 86400
    os.utime(old, (day_ago, day_ago))
    assert sorted(remove_leftovers(tmp_path)) == sorted([gone.name, impossible.name, old.name])
    assert names_in(tmp_path) == sorted([running.name, *(path.name for path in others)])


@posix
def test_a_killed_writer_leaves_the_old_text_and_what_it_left_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("old")
    program = (
        "import os, signal, sys\n"
        "from pathlib import Path\n"
        "from orip.files.text.atomic import replace_text\n"
        "os.fsync = lambda _: os.kill(os.getpid(), signal.SIGKILL)\n"
        "replace_text(Path(sys.argv[1]), 'new')\n"
    )
    done = subprocess.run([sys.executable, "-c", program, str(path)], check=False)
    assert done.returncode == -9
    assert path.read_text() == "old"
    assert len(names_in(tmp_path)) == 2
    assert len(remove_leftovers(tmp_path)) == 1
    assert names_in(tmp_path) == ["a"]
