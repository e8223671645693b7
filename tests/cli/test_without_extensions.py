"""The program where there was no compiler: what needs preliminary values says what is missing, and how to get it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli.command_line import orip as called
from support.long_cases import every
from workflow.small_projects import REPOSITORY

PROGRAM = [sys.executable, str(REPOSITORY / "tests" / "kernels" / "without_extensions.py")]
SAID = "install a wheel of orip, or a C compiler"


def orip(folder: Path, *arguments: str, without: str | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ if without is None else {**os.environ, "ORIP_WITHOUT": without}
    words = [*PROGRAM, "-C", str(folder), *arguments]
    return subprocess.run(words, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("without extensions") / "a"
    subprocess.run([*PROGRAM, "init", "--sample", "small_frame_block", made], check=True)
    assert called(made, "init").code == called(made, "measure").code == 0
    return made


@pytest.mark.parametrize("command", every(2, ["run --no-report", "prelim"]))
def test_commands_that_need_preliminary_values_say_so_in_one_sentence(folder: Path, command: str) -> None:
    said = orip(folder, *command.split())
    assert said.returncode == 1
    (line,) = (line for line in said.stderr.splitlines() if "compiled" in line)
    assert "preliminary values need the compiled part of orip" in line
    assert SAID in line
    assert "Traceback" not in said.stderr
    assert not (folder / "result.json").exists()


def test_verbose_status_says_it(folder: Path) -> None:
    said = orip(folder, "-v", "status")
    assert said.returncode == 0
    assert "without preliminary values" in said.stdout + said.stderr


def test_without_the_loop_over_photo_points_it_is_slower_and_the_same(folder: Path) -> None:
    said = orip(folder, "run", "--no-report", without="orip.bundle.compiled._observation_loop")
    assert said.returncode == 0, said.stderr
    assert said.stderr.count(SAID) == 1, "said once, with what helps"
    result = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    # as the sample's README says
    assert result["sigma0"] == pytest.approx(1.006, abs=0.0005)
