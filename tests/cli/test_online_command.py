"""`orip online` as a program: lines in, lines out; and the simulated session."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from workflow.small_projects import first_project

PROGRAM = [sys.executable, "-m", "orip"]
ENVIRONMENT = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}


def test_each_line_is_answered_by_a_line(tmp_path: Path) -> None:
    folder = first_project(tmp_path / "first")
    subprocess.run([*PROGRAM, "-C", folder, "init", "-q"], check=True, env=ENVIRONMENT)
    requests = '{"do": "show", "what": "photos"}\nthis is none\n\n{"do": "quit"}\n{"do": "show"}\n'
    done = subprocess.run(
        [*PROGRAM, "-C", folder, "online"], input=requests, capture_output=True, text=True, check=True, env=ENVIRONMENT
    )
    summary, photos, fault = map(json.loads, done.stdout.splitlines())
    assert "2 photos oriented" in summary["summary"]
    assert photos == {"photos": ["left", "right"]}
    assert "no request" in fault["error"]


def test_demonstration_names_the_three_blunders() -> None:
    done = subprocess.run(
        [*PROGRAM, "--json", "online", "--demo"], capture_output=True, text=True, check=True, env=ENVIRONMENT
    )
    found = json.loads(done.stdout)
    wrong = [line.split(" by ")[0].strip() for line in done.stderr.splitlines() if " by (" in line]
    assert len(wrong) == 3
    assert sorted(found["suspects"]) == sorted(wrong)
