"""`orip init --sample`: a newcomer's first project, written as a whole or not at all."""

from __future__ import annotations

import os
import shlex
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.killed_orip import Steps
from workflow.small_projects import REPOSITORY, contents

from orip.files.project.file_names import IGNORED
from orip.workflow.sample_projects import SAMPLES

FOLDER = REPOSITORY / "sample_projects"
SMALLEST = "dcs260_calibration"


def in_repository(name: str) -> set[str]:
    """Return what git keeps of a sample project, where the tests run in a clone."""
    done = subprocess.run(["git", "ls-files", "."], cwd=FOLDER / name, capture_output=True, text=True, check=False)
    if done.returncode or not done.stdout:
        pytest.skip("not in a clone of the repository")
    return set(done.stdout.split())


def test_every_sample_is_listed_on_stdout_with_what_to_write(tmp_path: Path) -> None:
    said = orip(tmp_path, "init", "--sample")
    assert said.code == 0
    assert [line.split()[0] for line in said.out.splitlines()] == list(SAMPLES)
    assert {path.name for path in FOLDER.iterdir() if path.is_dir() and path.name[0] != "_"} == set(SAMPLES)
    assert "orip init --sample NAME DIR" in said.err
    assert all(len(line) <= 110 for line in said.out.splitlines())
    rows = orip(tmp_path, "init", "--sample", "--json").document["samples"]
    assert {row["name"]: row["text"] for row in rows} == dict(SAMPLES)
    assert contents(tmp_path) == {}


@pytest.mark.parametrize("name", SAMPLES)
def test_what_is_written_is_what_the_repository_keeps(tmp_path: Path, name: str) -> None:
    assert orip(tmp_path, "init", "--sample", name, "mine").code == 0
    written = contents(tmp_path / "mine")
    assert written.pop(".gitignore").decode() == IGNORED
    assert set(written) == in_repository(name)
    for file, content in written.items():
        assert content == (FOLDER / name / file).read_bytes()


def test_the_next_command_that_it_names_gives_a_result_and_a_report(tmp_path: Path) -> None:
    said = orip(tmp_path, "init", "--sample", SMALLEST, "my first")
    assert said.out == ""
    (next_line,) = [line for line in said.err.splitlines() if line.startswith("next ")]
    words = shlex.split(next_line.removeprefix("next"))
    assert words == ["orip", "-C", str(tmp_path / "my first"), "run"]
    assert orip(Path(words[2]), *words[3:]).code == 0
    assert {"result.json", "report.html"} <= set(contents(tmp_path / "my first"))


def test_the_folder_is_named_after_the_sample_unless_told_otherwise(tmp_path: Path) -> None:
    document = orip(tmp_path, "init", "--sample", SMALLEST, "--json").document
    assert document["folder"] == str(tmp_path / SMALLEST)
    assert document["files"][-1] == "orip.toml"
    assert set(document["files"]) == set(contents(tmp_path / SMALLEST))


def test_in_an_empty_folder_of_ones_own_it_stays_the_same_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    before = tmp_path.stat().st_ino
    said = orip(Path(), "init", "--sample", SMALLEST, ".")
    assert said.code == 0
    assert "next     orip run" in said.err, "the user already exists"
    assert tmp_path.stat().st_ino == before
    assert (tmp_path / "orip.toml").exists()


def test_folders_above_are_made(tmp_path: Path) -> None:
    assert orip(tmp_path, "init", "--sample", SMALLEST, "a/b/c").code == 0
    assert (tmp_path / "a" / "b" / "c" / "orip.toml").exists()


@pytest.mark.parametrize("mine", ["notes.txt", "orip.toml", "DCS260.MEA"])
def test_a_folder_with_something_in_it_is_refused_and_stays_as_it_is(tmp_path: Path, mine: str) -> None:
    (tmp_path / mine).write_text("mine\n")
    said = orip(tmp_path, "init", "--sample", SMALLEST, ".")
    assert said.code == 2
    assert said.err.count("error:") == 1
    assert f"has something in it already ({mine}); a sample is written into a new or empty folder" in said.err
    assert contents(tmp_path) == {mine: b"mine\n"}


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("")
    said = orip(tmp_path, "init", "--sample", SMALLEST, "mine")
    assert said.code == 2
    assert "is not a folder" in said.err


def test_an_unknown_sample_is_answered_with_the_list(tmp_path: Path) -> None:
    said = orip(tmp_path, "init", "--sample", "zurich", "mine")
    assert said.code == 2
    first, *lines = said.err.splitlines()
    assert first == "error: no sample project is called 'zurich'; write one of these:"
    assert [line.split()[0] for line in lines] == list(SAMPLES)
    assert contents(tmp_path) == {}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("small_frame_block",), "small_frame_block is a sample: write it with 'orip init --sample small_frame_block'"),
        (("try", "--prefer", "text"), "--prefer is for 'orip init' without a name"),
        (("--sample", SMALLEST, "--prefer", "text"), "--prefer cannot be combined with --sample"),
    ],
)
def test_words_that_do_not_go_together(tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    said = orip(tmp_path, "init", *words)
    assert said.code == 2
    assert sentence in said.err
    assert contents(tmp_path) == {}


def _killed(folder: Path, step: int) -> int:
    """Return the exit code of a process that is killed before a step; 0: it is let live, and writes their number."""
    from hostile.killing import fork  # as it is of POSIX alone

    return os.waitstatus_to_exitcode(fork(folder, ("init", "--sample", SMALLEST, "mine"), Steps(step)))


@pytest.fixture(scope="module")
def steps(tmp_path_factory: pytest.TempPathFactory) -> int:
    folder = tmp_path_factory.mktemp("steps") / "counted"
    folder.mkdir()
    assert _killed(folder, 0) == 0
    return int((folder.parent / "steps").read_text())


def _chosen(steps: int) -> Iterator[int]:
    yield from (1, steps // 2, steps)  # the first text, one of the others, and taking the name


@pytest.mark.skipif(os.name != "posix", reason="kills by SIGKILL")
def test_killed_it_leaves_no_project_and_repeated_it_is_whole(tmp_path: Path, steps: int) -> None:
    assert steps >= 3 * 4
    for step in _chosen(steps):
        folder = tmp_path / str(step)
        folder.mkdir()
        assert _killed(folder, step) == -9
        assert not (folder / "mine").exists()
        assert orip(folder, "init", "--sample", SMALLEST, "mine").code == 0
        assert [path.name for path in folder.iterdir()] == ["mine"], "what was left is removed"
        assert set(contents(folder / "mine")) == {".gitignore", "orip.toml", "README.md", "DCS260.MEA", "DCS260.PNT"}


@pytest.mark.skipif(os.name != "posix", reason="kills by SIGKILL")
def test_killed_in_an_empty_folder_the_project_file_is_missing_and_repeated_it_is_whole(
    tmp_path: Path, steps: int
) -> None:
    for step in (1, steps // 2):
        folder = tmp_path / str(step) / "mine"
        folder.mkdir(parents=True)
        assert _killed(folder.parent, step) == -9
        assert not (folder / "orip.toml").exists()
        assert orip(folder.parent, "init", "--sample", SMALLEST, "mine").code == 0
        assert set(contents(folder)) == {".gitignore", "orip.toml", "README.md", "DCS260.MEA", "DCS260.PNT"}


@pytest.mark.parametrize("exists", [True, False])
def test_a_disk_that_refuses_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exists: bool) -> None:
    if exists:
        (tmp_path / "mine").mkdir()
    count = 0

    def full(_descriptor: int) -> None:
        nonlocal count
        count += 1
        if count >= 4:  # that of a folder may fail: some systems cannot
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    said = orip(tmp_path, "init", "--sample", SMALLEST, "mine")
    assert said.code == 1
    assert "No space left" in said.err
    assert [path.name for path in tmp_path.rglob("*")] == (["mine"] if exists else [])
