"""Names in orip.toml that no file can have, links in a circle, and a reader that is not ready yet."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli.command_line import orip
from workflow.small_projects import contents

LONG = "x" * 300


@pytest.mark.parametrize(
    ("key", "value", "sentence"),
    [
        ("camera_file", "FIRST.PHO", "camera_file 'FIRST.PHO' does not end in .CAM, as this store does"),
        ("camera_file", "orip.toml", "camera_file 'orip.toml' does not end in .CAM"),
        ("camera_file", "a\0.CAM", r"camera_file 'a\x00.CAM' has characters that cannot be printed"),
        ("camera_file", f"{LONG}.CAM", "has 304 bytes, and names of files have up to 200; choose a shorter one"),
        ("camera_file", f"{'x/' * 3000}A.CAM", "has 6005 bytes, and paths have up to 1000; choose a shorter one"),
        ("temtick_file", "CAMERAS.CAM", "temtick_file 'CAMERAS.CAM' does not end in .TIK"),
        ("project_files", LONG, "has 300 bytes, and names of files have up to 200"),
        ("control_files", LONG, "has 300 bytes, and names of files have up to 200"),
        ("measurement_files", "/**/*", "'/**/*' of measurement_files has wildcards and begins at the top of the disk"),
        ("measurement_files", "**x", "'**x' of measurement_files has ** beside other characters"),
        ("measurement_files", "a\0.MEA", r"'a\x00.MEA' of measurement_files has characters that cannot be printed"),
        ("measurement_files", f"{LONG}*", "of measurement_files has 301 bytes"),
    ],
)
def test_a_name_that_no_file_can_have_is_told_with_its_line(project: Path, key: str, value: str, sentence: str) -> None:
    text = (project / "orip.toml").read_text()
    written = '"' + value.replace("\0", "\\u0000") + '"'
    line = f"{key} = [{written}]" if key == "measurement_files" else f"{key} = {written}"
    (project / "orip.toml").write_text(
        text.replace('project = { name = "FIRST" }', f'[project]\nname = "FIRST"\n{line}')
    )
    before = contents(project)
    said = orip(project, "run")
    assert said.code == 3
    (error,) = (line for line in said.err.splitlines() if line.startswith("error: "))
    assert error.startswith("error: orip.toml:3: ")
    assert sentence in error
    assert contents(project) == before


def test_a_bundle_has_a_name_that_its_files_can_have(project: Path) -> None:
    text = (project / "orip.toml").read_text()
    (project / "orip.toml").write_text(text.replace('"MAIN"', f'"{LONG}"'))
    said = orip(project, "run")
    assert said.code == 3
    assert "has 300 bytes, and names of files have up to 200; its files have the same name" in said.err


@pytest.mark.skipif(os.name != "posix", reason="links in a circle are those of POSIX")
def test_links_in_a_circle(project: Path) -> None:
    (project / "loop.MEA").symlink_to("loop.MEA")
    said = orip(project, "run")
    assert said.code == 3
    assert "loop.MEA: the file cannot be read (Too many levels of symbolic links)" in said.err
    assert orip(project, "measure", "loop.MEA").code == 3
    (project / "loop.MEA").unlink()
    (project / "CAMERAS.CAM").symlink_to("CAMERAS.CAM")
    said = orip(project, "run")
    assert said.code == 3
    assert "CAMERAS.CAM: this link points to CAMERAS.CAM, which does not exist" in said.err


@pytest.mark.skipif(os.name != "posix", reason="pipes are those of POSIX")
def test_a_full_pipe_that_does_not_wait_loses_nothing(initialised: Path) -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    filled = 0
    try:
        while True:
            filled += os.write(writing, b" " * 4096)
    except BlockingIOError:
        pass
    program = [sys.executable, "-m", "orip", "-C", str(initialised), "status"]
    with subprocess.Popen(program, stdout=writing, stderr=subprocess.PIPE) as process:
        os.close(writing)
        with os.fdopen(reading, "rb") as stream:
            taken = stream.read()
        assert process.wait(120) == 0
    assert taken[filled:].startswith(b"project  FIRST")
