"""Links, pipes, devices and files of the system in the places of a project's files: refused at once, never replaced."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import contents

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="pipes and devices are those of POSIX"),
    pytest.mark.timeout(60),  # what waits for a pipe waits for ever
]

OUTPUTS = ("BUNDLE_RESULT.OUT", "INTERIOR_RESULT.OUT", "result.json", "residuals.csv", "report.html")
TEXTS = ("orip.toml", "FIRST.MEA", "FIRST.PNT", "FIRST.ELE", "MAIN.PRE", "EDITS.MEA")


def test_outputs_that_are_links_get_their_own_files(project: Path, tmp_path: Path) -> None:
    elsewhere = tmp_path / "elsewhere.txt"
    elsewhere.write_text("of somebody else\n")
    for name in OUTPUTS:
        (project / name).symlink_to(elsewhere)
    assert orip(project, "run").code == 0
    assert elsewhere.read_text() == "of somebody else\n"
    for name in OUTPUTS:
        assert not (project / name).is_symlink()
        assert (project / name).stat().st_size > 0


@pytest.mark.parametrize("name", ["INTERIOR_RESULT.OUT", "result.json"])
def test_an_output_that_leads_to_a_device_is_refused(project: Path, name: str) -> None:
    (project / name).symlink_to("/dev/null")
    said = orip(project, "run")
    assert said.code == 1
    assert f"{name} cannot be written: this is a device, not a file; the results are safe" in said.err
    assert (project / name).is_symlink()
    assert Path("/dev/null").is_char_device()
    (project / name).unlink()
    assert orip(project, "run").code == 0
    assert "everything is up to date" in orip(project, "status").out


def test_a_text_is_not_edited_through_a_link(project: Path, tmp_path: Path) -> None:
    shared = tmp_path / "shared.PNT"
    (project / "FIRST.PNT").rename(shared)
    (project / "FIRST.PNT").symlink_to(shared)
    assert orip(project, "run").code == 0, "it is read through a link"
    before = contents(project)
    said = orip(project, "control", "points", "add", "99", "X=1", "Y=2", "Z=3", "aX=1", "aY=1", "aZ=1")
    assert said.code == 1
    assert f"FIRST.PNT cannot be written: it is a link to {shared}; change that file" in said.err
    assert contents(project) == before


@pytest.mark.parametrize("name", TEXTS)
def test_a_pipe_in_the_place_of_a_text_is_refused_at_once(project: Path, name: str) -> None:
    (project / name).unlink(missing_ok=True)
    os.mkfifo(project / name)
    said = orip(project, "run")
    assert said.code == 3
    assert f"{name}: this is a pipe (FIFO), not a file; name the file itself" in said.err


@pytest.mark.parametrize("name", ["FIRST.PHO", "FIRST.PHO-journal"])
def test_a_pipe_in_the_place_of_a_store_is_refused_at_once(project: Path, name: str) -> None:
    assert orip(project, "run").code == 0
    (project / name).unlink(missing_ok=True)
    os.mkfifo(project / name)
    for words in (["run"], ["status"]):
        said = orip(project, *words)
        assert said.code == 3
        assert f"{name}: this is a pipe (FIFO), not a file; a record store is one file" in said.err


@pytest.mark.parametrize(("target", "kind"), [("/", "a folder"), ("..", "a folder"), ("/dev/null", "a device")])
@pytest.mark.parametrize("words", [("run",), ("status",), ("bundle", "copy", "MAIN", "OTHER")])
def test_a_store_that_leads_to_a_folder_or_a_device(
    project: Path, words: tuple[str, ...], target: str, kind: str
) -> None:
    assert orip(project, "init").code == 0
    (project / "FIRST.EXT").unlink()
    (project / "FIRST.EXT").symlink_to(target)
    said = orip(project, *words)
    assert said.code == 3
    assert f"FIRST.EXT: this is {kind}, not a file; a record store is one file" in said.err


@pytest.mark.parametrize(("target", "kind"), [("/dev/zero", "a device"), ("/proc/self/maps", "a file of the running")])
@pytest.mark.parametrize("name", ["FIRST.MEA", "orip.toml"])
def test_devices_and_files_of_the_system_are_no_texts(project: Path, name: str, target: str, kind: str) -> None:
    if not Path(target).exists():
        pytest.skip(f"this system has no {target}")
    (project / name).unlink()
    (project / name).symlink_to(target)
    said = orip(project, "run")
    assert said.code == 3
    assert f"{name}: this is {kind}" in said.err


@pytest.mark.parametrize(
    "words",
    [
        ("load", "FIRST.PHO", "pipe.txt"),
        ("compare", "pipe.txt", "pipe.txt"),
        ("measure", "pipe.txt"),
        ("drive", "emulate", "--state", "pipe.txt", "--listen", "127.0.0.1:0"),
    ],
)
def test_a_pipe_that_a_command_names_is_refused_at_once(project: Path, words: tuple[str, ...]) -> None:
    assert orip(project, "init").code == 0
    os.mkfifo(project / "pipe.txt")
    words = tuple(str(project / word) if word == "pipe.txt" and "emulate" in words else word for word in words)
    said = orip(project, *words)
    assert said.code in (2, 3)
    assert "pipe (FIFO)" in said.err or "no such file" in said.err


def test_a_text_larger_than_any_text_is_not_read(project: Path) -> None:
    with (project / "FIRST.MEA").open("r+b") as log:
        log.truncate(1 << 34)  # sparse: it takes no room
    said = orip(project, "run")
    assert said.code == 3
    assert "FIRST.MEA: the file cannot be read (it is larger than 1024 MiB)" in said.err


@pytest.mark.parametrize("make", [lambda path: path.symlink_to(path.name), lambda path: path.symlink_to("gone.CAM")])
def test_a_store_that_is_a_link_to_nowhere(project: Path, make: Callable[[Path], None]) -> None:
    make(project / "CAMERAS.CAM")
    said = orip(project, "run")
    assert said.code == 3
    assert "CAMERAS.CAM: this link points to" in said.err
    assert not (project / "gone.CAM").exists()
