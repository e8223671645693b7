"""`orip update` killed while it writes: preliminary values are the old ones or the new ones, all of them."""

from __future__ import annotations

import random
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from workflow.commands import update
from workflow.quiet import run_quietly
from workflow.small_projects import contents, first_project, replace_in

from orip.files.stores.dump import dump
from orip.workflow.adjust.update import What

KILLED_ORIP = Path(__file__).with_name("killed_orip.py")
STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO")


def _state(folder: Path) -> tuple[list[list[str]], str]:
    text = folder / "MAIN.PRE"
    return [list(dump(folder / name)) for name in STORES], text.read_text() if text.exists() else ""


def _run(what: What, step: int, folder: Path) -> subprocess.CompletedProcess[bytes]:
    words = [sys.executable, str(KILLED_ORIP), str(step), "-q", "-C", str(folder), "update", what]
    return subprocess.run(words, capture_output=True, check=False, timeout=60)


def _kill(what: What, tmp_path: Path, chosen: int | None) -> int:
    before = first_project(tmp_path / "before")
    replace_in(before / "orip.toml", 'name = "C35"', 'name = "C35"\nunknown = ["C"]')
    (before / "MAIN.PRE").write_text("far 1 2 3\nP1 1100 2050 100\n")
    run_quietly(before)
    after = tmp_path / "after"
    shutil.copytree(before, after)
    assert update(after, what).changed
    old, new = _state(before), _state(after)
    assert old != new
    shutil.copytree(before, tmp_path / "counted")
    counted = _run(what, 0, tmp_path / "counted")
    assert counted.returncode == 0
    total = int(counted.stdout.split()[-1])
    steps: Sequence[int] = range(1, total + 1)
    if chosen is not None:
        steps = [*random.Random(what).sample(range(1, total - 2), chosen - 2), total - 1, total]
    for step in steps:
        folder = tmp_path / f"killed-{step}"
        shutil.copytree(before, folder)
        assert _run(what, step, folder).returncode == -signal.SIGKILL
        assert _state(folder) in (old, new)
        update(folder, what)
        assert _state(folder) == new
        run_quietly(folder)
        assert not [name for name in contents(folder) if name.endswith(".tmp")]
        shutil.rmtree(folder)
    return len(steps)


@pytest.mark.parametrize("what", ["cameras", "photos", "points"])
def test_killed_at_some_steps(what: What, tmp_path: Path) -> None:
    assert _kill(what, tmp_path, chosen=3) == 3


@pytest.mark.long
@pytest.mark.parametrize("what", ["cameras", "photos", "points"])
def test_killed_at_every_step(what: What, tmp_path: Path) -> None:
    assert _kill(what, tmp_path, chosen=None) > 20
