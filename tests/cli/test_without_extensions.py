"""The program where there was no compiler: slower, and with the same results."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from workflow.small_projects import REPOSITORY

PROGRAM = [sys.executable, str(REPOSITORY / "tests" / "kernels" / "without_extensions.py")]


def test_a_project_without_orientations_is_solved(tmp_path: Path) -> None:
    subprocess.run([*PROGRAM, "init", "--sample", "small_frame_block", tmp_path / "a"], check=True)
    run = [*PROGRAM, "-C", tmp_path / "a", "run", "--no-report"]
    said = subprocess.run(run, check=True, capture_output=True, text=True)
    assert said.stderr.count("has no compiled loops") == 1, "said once, with what helps"
    assert "install a wheel of orip, or a C compiler" in said.stderr
    result = json.loads((tmp_path / "a" / "result.json").read_text(encoding="utf-8"))
    # as the sample's README says
    assert result["sigma0"] == pytest.approx(1.006, abs=0.0005)
    status = [*PROGRAM, "-C", tmp_path / "a", "-v", "status"]
    said = subprocess.run(status, check=True, capture_output=True, text=True)
    assert "numpy" in (said.stdout + said.stderr).lower()
