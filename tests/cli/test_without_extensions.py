"""The program where there was no compiler: slower, and with the same results."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

WITHOUT = """
import sys
sys.modules.update({"orip.bundle.compiled._observation_loop": None, "orip.prelim._kernels": None})
from orip.cli.main import main
sys.argv[0] = "orip"
main()
"""


def test_a_project_without_orientations_is_solved(tmp_path: Path) -> None:
    program = [sys.executable, "-c", WITHOUT]
    subprocess.run([*program, "init", "--sample", "small_frame_block", tmp_path / "a"], check=True)
    subprocess.run([*program, "-q", "-C", tmp_path / "a", "run", "--no-report"], check=True)
    result = json.loads((tmp_path / "a" / "result.json").read_text(encoding="utf-8"))
    # as the sample's README says
    assert result["sigma0"] == pytest.approx(1.006, abs=0.0005)
    status = [*program, "-C", tmp_path / "a", "-v", "status"]
    said = subprocess.run(status, check=True, capture_output=True, text=True)
    assert "numpy" in (said.stdout + said.stderr).lower()
