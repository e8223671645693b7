"""Texts are replaced whole, and nothing is left lying about."""

from __future__ import annotations

import os
import secrets
import socket
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from orip.files.text.atomic import remove_leftovers, replace_text, temporary_beside
from orip.files.text.regular_file import NoRegularFileError

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
@pytest.mark.parametrize("target", ["target", "gone", "link"])
def test_a_link_gives_way_and_what_it_leads_to_stays(tmp_path: Path, target: str) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "target").write_text("old")
    (tmp_path / "link").symlink_to("link" if target == "link" else Path("elsewhere", target))
    if target == "link":  # in a circle
        with pytest.raises(OSError, match="symbolic links"):
            replace_text(tmp_path / "link", "new")
    else:
        replace_text(tmp_path / "link", "new")
        assert not (tmp_path / "link").is_symlink()
        assert (tmp_path / "link").read_text() == "new"
    assert names_in(tmp_path) == ["elsewhere", "link"]
    assert names_in(tmp_path / "elsewhere") == ["target"]
    assert (tmp_path / "elsewhere" / "target").read_text() == "old"


@posix
@pytest.mark.parametrize("is_linked", [False, True])
@pytest.mark.parametrize("kind", ["pipe", "device", "folder", "socket"])
def test_what_is_no_file_is_not_replaced(tmp_path: Path, kind: str, is_linked: bool) -> None:
    target = Path("/dev/null") if kind == "device" else tmp_path / "target"
    if kind == "pipe":
        os.mkfifo(target)
    elif kind == "folder":
        target.mkdir()
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(str(target))
    path = target
    if is_linked:
        path = tmp_path / "link"
        path.symlink_to(target)
    elif kind == "device":
        pytest.skip("the device itself is not put at risk")
    before = target.lstat()
    with pytest.raises(NoRegularFileError, match=kind):
        replace_text(path, "new")
    assert (target.lstat().st_ino, target.lstat().st_mode) == (before.st_ino, before.st_mode)
    assert not [name for name in names_in(tmp_path) if name.startswith(".orip")]


@pytest.mark.parametrize("failing", ["fsync", "replace"])
def test_after_a_failure_the_old_text_stands_and_no_temporary_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str
) -> None:
    path = tmp_path / "a"
    path.write_text("old")

    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, failing, fail)
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


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="only /proc says when a process began")
def test_leftovers_of_gone_processes_are_removed_and_no_others(tmp_path: Path) -> None:
    mine = temporary_beside(tmp_path / "a").name
    _dot, host, process, began, _random = mine.split("-")

    def temporary(host: str, process: object, began: object) -> Path:
        path = tmp_path / f".orip-{host}-{process}-{began}-{secrets.token_hex(8)}.tmp"
        path.write_text("")
        return path

    gone = [
        temporary(host, gone_process(), began),
        temporary(host, "9" * 18, began),
        temporary(host, process, int(began) + 1),  # its number is that of a later process
        temporary("0" * 8, process, began),
    ]
    running = [temporary(host, process, began), temporary("0" * 8, gone_process(), began)]
    others = [tmp_path / "orip.toml", tmp_path / ".orip-notes.tmp"]
    for path in others:
        path.write_text("")
    old = time.time() - 90_000
    for path in (gone[3], running[0]):  # age counts for those of other hosts alone
        os.utime(path, (old, old))
    assert sorted(remove_leftovers(tmp_path)) == sorted(path.name for path in gone)
    assert names_in(tmp_path) == sorted(path.name for path in (*running, *others))


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
