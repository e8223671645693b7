"""Two runs in one folder at once: each is done or says that it is not, and the project is sound."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest
from workflow.commands import project_status
from workflow.small_projects import contents, film_project, replace_in

from orip.errors import LockedError
from orip.files.text.own_files import locked

RUN = [sys.executable, "-m", "orip.cli.main", "-q", "-C"]


def test_two_runs_at_once(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    command = [*RUN, str(folder), "run", "--no-report"]
    for value in ("35.0", "35.1"):
        if value != "35.0":
            replace_in(folder / "orip.toml", f"c = {float(value) - 0.1:.1f}", f"c = {value}")
        processes = [subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)]
        for process in processes:
            _, err = process.communicate(timeout=60)
            assert process.returncode in (0, 6), err
            assert (process.returncode == 0) == (err == "")
        assert project_status(folder).next_command is None
        assert not [name for name in contents(folder) if name.endswith((".tmp", "-journal"))]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such locks")
def test_an_edit_of_a_project_without_stores_waits_for_another_one(tmp_path: Path) -> None:
    folder = film_project(tmp_path / "film")
    before = contents(folder)
    held, began = threading.Event(), time.monotonic()

    def hold() -> None:
        with locked(folder / "orip.toml", "orip.toml"):
            held.set()
            time.sleep(2.0)

    other = threading.Thread(target=hold)
    other.start()
    held.wait()
    edit = [*RUN, str(folder), "control", "points", "add", "9999", "X=1", "Y=2", "Z=3", "aX=1", "aY=1", "aZ=1"]
    done = subprocess.run(edit, capture_output=True, text=True, check=False)
    assert (done.returncode, other.is_alive()) == (0, False), done.stderr
    assert time.monotonic() - began > 2.0
    assert contents(folder).keys() == before.keys()
    with (
        locked(folder / "orip.toml", "orip.toml"),
        pytest.raises(LockedError, match=r"orip\.toml is locked by another run"),
        locked(folder / "orip.toml", "orip.toml", timeout=0.1),
    ):
        pass
