"""`orip update` killed while it writes: preliminary values are the old ones or the new ones, all of them."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from workflow.commands import undo_update, update
from workflow.killed_here import Killed, killed_at
from workflow.quiet import run_quietly
from workflow.small_projects import contents, first_project, replace_in

from orip.files.stores.dump import dump
from orip.workflow.adjust.update import What

KILLED_ORIP = Path(__file__).parents[1] / "killed_orip.py"
State = tuple[list[list[str]], str]
STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO")


def _state(folder: Path) -> State:
    text = folder / "MAIN.PRE"
    return [list(dump(folder / name)) for name in STORES], text.read_text() if text.exists() else ""


def _run(what: What, step: int, folder: Path) -> subprocess.CompletedProcess[bytes]:
    words = [sys.executable, str(KILLED_ORIP), str(step), "-q", "-C", str(folder), "update", what]
    return subprocess.run(words, capture_output=True, check=False, timeout=60)


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = first_project(tmp_path_factory.mktemp("update") / "before")
    replace_in(folder / "orip.toml", 'name = "C35"', 'name = "C35"\nunknown = ["C"]')
    (folder / "MAIN.PRE").write_text("far 1 2 3\nP1 1100 2050 100\n")
    run_quietly(folder)
    return folder


def _check(what: What, folder: Path, states: tuple[State, State]) -> None:
    """Check what a kill has left, then that the command run again ends as if nothing had been, and can be undone."""
    assert _state(folder) in states
    update(folder, what)
    assert _state(folder) == states[1]
    undo_update(folder)
    assert _state(folder) == states[0]
    run_quietly(folder)
    assert not [name for name in contents(folder) if name.endswith(".tmp")]


def _updated(what: What, before: Path, tmp_path: Path) -> tuple[int, tuple[State, State]]:
    """Update undisturbed; return the number of steps, and the states before and after."""
    after = Path(shutil.copytree(before, tmp_path / "after"))
    with killed_at(None) as steps:
        assert update(after, what).changed
    states = _state(before), _state(after)
    assert states[0] != states[1]
    return steps(), states


@pytest.mark.parametrize("what", ["cameras", "photos", "points"])
def test_killed_at_some_steps(what: What, before: Path, tmp_path: Path) -> None:
    total, states = _updated(what, before, tmp_path)
    for step in (*random.Random(what).sample(range(1, total - 2), 1), total - 1, total):
        folder = Path(shutil.copytree(before, tmp_path / f"killed-{step}"))
        with pytest.raises(Killed), killed_at(step):
            update(folder, what)
        _check(what, folder, states)


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("what", ["cameras", "photos", "points"])
def test_a_process_killed_at_every_step(what: What, before: Path, tmp_path: Path) -> None:
    _, states = _updated(what, before, tmp_path)
    counted = _run(what, 0, Path(shutil.copytree(before, tmp_path / "counted")))
    assert counted.returncode == 0
    total = int(counted.stdout.split()[-1])
    assert total > 20
    for step in range(1, total + 1):
        folder = Path(shutil.copytree(before, tmp_path / f"killed-{step}"))
        assert _run(what, step, folder).returncode == -signal.SIGKILL
        _check(what, folder, states)
        shutil.rmtree(folder)
