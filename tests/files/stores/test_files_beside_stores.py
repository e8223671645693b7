"""Journals, copies and links beside the stores of somebody else's project: nothing of the user's goes or changes."""

from __future__ import annotations

import hashlib
import json
import os
import random
import struct
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import film_project

from orip.errors import InputError
from orip.files.stores.transaction import reading, writing

_PAGE = 4096
_MAGIC = bytes((0xD9, 0xD5, 0x05, 0xF9, 0x20, 0xA1, 0x63, 0xD7))


def hot_journal(store: Path, super_journal: Path) -> None:
    """Write a journal without pages that names a super-journal (sqlite.org/fileformat, section 3)."""
    header = struct.pack(">8s5I", _MAGIC, 0, 0x12345678, store.stat().st_size // _PAGE, 512, _PAGE).ljust(512, b"\0")
    name = os.fsencode(super_journal)
    signed = sum(byte if byte < 128 else byte - 256 for byte in name) & 0xFFFFFFFF
    tail = struct.pack(">I", 0x40000000 // _PAGE + 1) + name + struct.pack(">II", len(name), signed) + _MAGIC
    store.with_name(f"{store.name}-journal").write_bytes(header + tail)


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = film_project(tmp_path_factory.mktemp("adjusted"))
    assert orip(folder, "run").code == 0
    return folder


@pytest.fixture
def project(adjusted: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "project"
    folder.mkdir()
    for path in adjusted.iterdir():
        (folder / path.name).write_bytes(path.read_bytes())
    return folder


def journal_of_others(folder: Path, name: str, content: bytes) -> tuple[Path, Path]:
    """Let the journal of a store name a file beside the project."""
    home = folder.parent / "home"
    home.mkdir(exist_ok=True)
    victim = home / name
    victim.write_bytes(content)
    hot_journal(folder / "FIRST.PHO", victim)
    return folder / "FIRST.PHO", victim


@pytest.mark.parametrize("words", [("status",), ("run",), ("dump", "FIRST.PHO"), ("photo", "edit", "left", "X0=1071")])
@pytest.mark.parametrize("name", ["thesis.txt", "OTHER.PHO-mj01234567"])
def test_opening_a_store_removes_no_file_that_its_journal_names(
    project: Path, words: tuple[str, ...], name: str
) -> None:
    _, victim = journal_of_others(project, name, b"my thesis, plain text\n")
    said = orip(project, *words)
    assert said.code == 3
    assert "FIRST.PHO: the journal beside this store names the file" in said.err
    assert f"remove '{'FIRST.PHO-journal'}'" in said.err
    assert victim.read_bytes() == b"my thesis, plain text\n"
    (project / "FIRST.PHO-journal").unlink()
    assert orip(project, "status").code == 0


def test_a_super_journal_of_another_project_is_kept(project: Path) -> None:
    others = b"/home/somebody/OTHER.PHO-journal\0/home/somebody/OTHER.EXT-journal\0"
    _, victim = journal_of_others(project, "OTHER.PHO-mj01234567", others)
    assert orip(project, "status").code == 3
    assert victim.read_bytes() == others


def test_a_super_journal_that_is_a_link_is_not_taken(project: Path) -> None:
    store, victim = journal_of_others(project, "list", os.fsencode(f"{project / 'FIRST.PHO-journal'}\0"))
    link = project / "FIRST.PHO-mj01234567"
    link.symlink_to(victim)
    hot_journal(store, link)
    assert orip(project, "status").code == 3
    assert victim.exists()
    assert link.is_symlink()


def test_an_interrupted_commit_is_rolled_back_with_its_own_super_journal(project: Path) -> None:
    store, super_journal = project / "FIRST.PHO", project / "FIRST.PHO-mj01234567"
    super_journal.write_bytes(os.fsencode(f"{store}-journal\0"))
    hot_journal(store, super_journal)
    before = store.read_bytes()
    assert orip(project, "status").code == 0
    assert store.read_bytes() == before
    assert not list(project.glob("FIRST.PHO-*"))


def test_a_journal_of_a_finished_commit_is_of_no_effect(project: Path) -> None:
    hot_journal(project / "FIRST.PHO", project.parent / "FIRST.PHO-mj01234567")
    assert orip(project, "status").code == 0
    assert not (project / "FIRST.PHO-journal").exists()


def test_a_reader_removes_a_super_journal_that_no_journal_names(project: Path) -> None:
    (project / "FIRST.PHO-mj01234567").write_bytes(os.fsencode(f"{project / 'FIRST.PHO-journal'}\0"))
    (project / "GONE.PHO-mj01234567").write_bytes(b"of no store\n")
    assert orip(project, "status").code == 0
    assert [path.name for path in project.glob("*-mj*")] == ["GONE.PHO-mj01234567"]


def test_a_copy_of_a_store_that_names_a_file_of_the_user_removes_nothing(project: Path) -> None:
    store = project / "CAMERAS.CAM"
    for name, content in {
        "settings.json": '{"token": "secret"}',
        "list.json": "[]",
        "OTHER.CAM-pact": '["OTHER.CAM"]',
        "DEEP.CAM-pact": "[" * 100_000,
    }.items():
        victim = project.parent / name
        victim.write_text(content)
        for shown in (f"../{name}", str(victim)):
            head = {"pact": shown, "sha256": hashlib.sha256(store.read_bytes()).hexdigest()}
            (project / "CAMERAS.CAM-undo").write_bytes(json.dumps(head).encode() + b"\n" + store.read_bytes())
            for words in (("status",), ("run",)):
                said = orip(project, *words)
                assert said.code == 3, said.err
                assert "CAMERAS.CAM-undo: the store is damaged" in said.err or "is not a list of stores" in said.err
            assert victim.read_text() == content


def test_a_pact_touches_no_copies_that_do_not_name_it(project: Path) -> None:
    """A stranger lists a store of the user, beside which an interrupted run has left its copy."""
    other = project.parent / "OTHER.PHO-undo"
    other.write_bytes(b'{"pact": "MINE.PHO-pact", "sha256": ""}\n')
    store = project / "CAMERAS.CAM"
    head = {"pact": "CAMERAS.CAM-pact", "sha256": hashlib.sha256(store.read_bytes()).hexdigest()}
    (project / "CAMERAS.CAM-undo").write_bytes(json.dumps(head).encode() + b"\n" + store.read_bytes())
    (project / "CAMERAS.CAM-pact").write_text(json.dumps(["CAMERAS.CAM", "../OTHER.PHO"]))
    orip(project, "status")
    assert other.read_bytes() == b'{"pact": "MINE.PHO-pact", "sha256": ""}\n'


@pytest.mark.parametrize("name", ["FIRST.EXT", "CAMERAS.CAM"])
def test_a_store_that_is_a_link_is_not_changed_through_it(project: Path, name: str) -> None:
    mine = project.parent / name
    (project / name).rename(mine)
    (project / name).symlink_to(f"../{name}")
    before = mine.read_bytes()
    said = orip(project, "photo", "edit", "left", "X0=1071")
    assert said.code == 3
    assert f"{name}: this is a link to ../{name}; put the store itself in the place of the link" in said.err
    assert ("camera_file in orip.toml" in said.err) == (name == "CAMERAS.CAM")
    assert mine.read_bytes() == before


def test_a_store_with_a_second_name_is_not_changed_under_both(project: Path) -> None:
    mine = project.parent / "MINE.PHO"
    mine.hardlink_to(project / "FIRST.PHO")
    before = mine.read_bytes()
    assert orip(project, "status").code == 0, "it may be read"
    said = orip(project, "photo", "edit", "left", "X0=1071")
    assert said.code == 3
    assert "FIRST.PHO: this file has a second name (a hard link)" in said.err
    hot_journal(project / "FIRST.PHO", Path("gone"))
    (project / "FIRST.PHO-journal").rename(project / "journal")
    (project / "FIRST.PHO-journal").hardlink_to(project / "journal")
    assert orip(project, "status").code == 3
    assert mine.read_bytes() == before


def test_a_store_with_another_file_format_or_exchanged_pages_is_damaged(project: Path) -> None:
    """Each way of damaging it ends in words, never in an internal error."""
    chance = random.Random(1)
    sound = {path: path.read_bytes() for path in project.glob("*.*") if path.suffix in (".PHO", ".TEM", ".EXT", ".EXO")}
    for number in range(60):
        path = chance.choice(sorted(sound))
        pages = [sound[path][start : start + _PAGE] for start in range(0, len(sound[path]), _PAGE)]
        if number % 3 and len(pages) > 2:
            first, second = chance.sample(range(1, len(pages)), 2)
            pages[first], pages[second] = pages[second], pages[first]
        else:
            place = 47 if not number else chance.randrange(100)
            pages[0] = pages[0][:place] + bytes([99 if not number else chance.randrange(256)]) + pages[0][place + 1 :]
        path.write_bytes(b"".join(pages))
        said = orip(project, "dump", path.name)
        assert said.code in (0, 3), said.err
        assert "internal error" not in said.err
        path.write_bytes(sound[path])


def test_stores_are_looked_at_before_they_are_opened(tmp_path: Path) -> None:
    (tmp_path / "A.TIK").symlink_to("B.TIK")
    with writing([tmp_path / "B.TIK"]):
        pass
    for transaction in (reading, writing):
        with pytest.raises(InputError, match="this is a link to"), transaction([tmp_path / "A.TIK"]):
            pass


def test_a_journal_that_is_not_played_back_keeps_no_super_journal(project: Path) -> None:
    """Journals of a run killed before it had synchronised them begin with zeros: SQLite leaves them alone."""
    store, super_journal = project / "FIRST.PHO", project / "FIRST.PHO-mj01234567"
    super_journal.write_bytes(os.fsencode(f"{store}-journal\0"))
    hot_journal(store, super_journal)
    journal = project / "FIRST.PHO-journal"
    journal.write_bytes(b"\0" * 8 + journal.read_bytes()[8:])
    assert orip(project, "status").code == 0
    assert not super_journal.exists()


@pytest.mark.skipif(os.name != "posix", reason="the bits are those of POSIX")
def test_no_file_that_runs_as_its_owner_is_written(project: Path) -> None:
    (project / "BUNDLE_RESULT.OUT").chmod(0o4755)
    (project / "FIRST.PHO").chmod(0o6755)
    said = orip(project, "photo", "edit", "left", "X0=1071")
    assert said.code == 3
    assert "FIRST.PHO: whoever runs this file does so as its owner (a set-ID bit)" in said.err
    (project / "FIRST.PHO").chmod(0o644)
    assert orip(project, "photo", "edit", "left", "X0=1071").code == 0
    assert orip(project, "solve", "--no-report").code == 0
    assert (project / "BUNDLE_RESULT.OUT").stat().st_mode & 0o7777 == 0o755
