"""No warning of NumPy or another library reaches the user; in the tests each is an error."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from cli.command_line import orip

SCRIPT = """
import sys
import numpy as np
from orip.cli.main import main
import orip.workflow.status as status

found = status.project_status

def overflowing(*given, **named):
    np.float64(1e308) * np.array([10.0])
    return found(*given, **named)

status.project_status = overflowing
sys.argv = ["orip", "-C", sys.argv[1], "status"]
main()
"""


@pytest.mark.parametrize("asked", [False, True])
def test_a_warning_of_numpy_is_kept_back(project: Path, asked: bool) -> None:
    environment = {"ORIP_TRACEBACK": "1"} if asked else {}
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(project)], capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("project  ")
    assert ("RuntimeWarning: overflow" in done.stderr) is asked


def test_warnings_are_errors_in_the_tests() -> None:
    with pytest.raises(RuntimeWarning):
        np.float64(1e308) * np.array([10.0])


def test_warnings_are_shown_again_after_a_command(project: Path) -> None:
    before = warnings.showwarning
    orip(project, "status")
    assert warnings.showwarning is before
