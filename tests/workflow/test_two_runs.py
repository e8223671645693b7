"""Two runs in one folder at once: each is done or says that it is not, and the project is sound."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from workflow.commands import project_status
from workflow.small_projects import contents, film_project, replace_in

RUN = [sys.executable, "-m", "orip.cli.main", "-q", "-C"]


def test_two_runs_at_once(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    for value in ("35.0", "35.1"):
        if value != "35.0":
            replace_in(folder / "orip.toml", f"c = {float(value) - 0.1:.1f}", f"c = {value}")
        processes = [subprocess.Popen([*RUN, str(folder), "run"], stderr=subprocess.PIPE, text=True) for _ in range(3)]
        for process in processes:
            _, err = process.communicate(timeout=60)
            assert process.returncode in (0, 6), err
            assert (process.returncode == 0) == (err == "")
        assert project_status(folder).next_command is None
        assert not [name for name in contents(folder) if name.endswith((".tmp", "-journal"))]
