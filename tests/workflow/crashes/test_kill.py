"""Commands that are killed while they write: stores in the old state or the new one as a whole, texts whole.

Each command starts from a finished project whose texts have changed since, so that it changes several stores and
outputs at once; `init` also from texts alone. After a kill the project is looked at, and then the same command is run
again, which has to end as if nothing had happened.
"""

from __future__ import annotations

import random
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import pytest
from msgspec import Struct
from workflow.commands import initialise, measure
from workflow.killed_here import Killed, killed_at
from workflow.killed_orip import MOMENT
from workflow.quiet import run_quietly, solve_quietly
from workflow.small_projects import contents, film_project, replace_in

from orip.files.stores.dump import dump

KILLED_ORIP = Path(__file__).parents[1] / "killed_orip.py"
MOMENTS = {"init": 1, "measure": 2, "solve": 5}
"""Commits and renames of each command."""
COMMANDS = {"init": initialise, "measure": measure, "solve": solve_quietly}
WORDS = {"init": ("init",), "measure": ("measure",), "solve": ("solve", "--no-report")}
"""The same on the command line."""
STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO")
OUTPUTS = ("INTERIOR_RESULT.OUT", "BUNDLE_RESULT.OUT", "BUNDLE_ERROR.OUT", "result.json", "residuals.csv")
# SQLite's rollback journals and the one that ties them together, and texts that had not got their name yet
LEFTOVER = re.compile(r".*-journal|.*-mj[0-9A-F]{8,9}|\.orip-[0-9a-f]{8}-\d+-\d+-[0-9a-f]{16}\.tmp")
# SQLite never removes the file that ties journals together if it is killed before a journal names it: of no effect
ORPHAN = re.compile(r".*-mj[0-9A-F]{8,9}")
CASES = ("init-new", "init", "measure", "solve")


class Case(Struct, frozen=True):
    """A command, the project before it and after it, undisturbed."""

    command: str
    before: Path
    after: Path
    dumps_before: list[list[str]]
    dumps_after: list[list[str]]


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Case]:
    folder = tmp_path_factory.mktemp("cases")
    found = {}
    new = film_project(folder / "new")
    found["init-new"] = _case("init", new)
    start = film_project(folder / "start")
    run_quietly(start)
    replace_in(start / "orip.toml", "c = 35.0", "c = 35.2")
    replace_in(start / "orip.toml", "X0 = 1070.0", "X0 = 1071.0")
    replace_in(start / "orip.toml", "measurement_precision = 0.003", "measurement_precision = 0.004")
    replace_in(start / "FIRST.MEA", "PHOTO left A", "PHOTO left C")
    replace_in(start / "FIRST.MEA", "POINTS MAIN left\n", "POINTS MAIN left\nP2 100.0 100.0\n")
    replace_in(start / "FIRST.MEA", "POINTS MAIN right\n", "POINTS MAIN right\nP2 91.5 100.0\n")
    replace_in(start / "FIRST.PNT", "1012.40", "1012.41")
    for command in COMMANDS:
        found[command] = _case(command, start)
        start = found[command].after
    return found


def _case(command: str, before: Path) -> Case:
    after = before.with_name(f"{before.name}-{command}")
    shutil.copytree(before, after)
    COMMANDS[command](after)
    return Case(command, before, after, _dumps(before), _dumps(after))


def _dumps(folder: Path) -> list[list[str]]:
    return [list(dump(folder / name)) for name in STORES]


def _check(case: Case, folder: Path) -> None:
    """Check what a kill has left, then that the command run again ends as if nothing had happened."""
    before, after = contents(case.before), contents(case.after)
    left = contents(folder)
    strangers = {name for name in left if name not in {**before, **after} and not LEFTOVER.fullmatch(name)}
    assert not strangers
    for name in OUTPUTS:
        assert left.get(name) in (before.get(name), after.get(name)), f"{name} is neither old nor new"
    dumps = _dumps(folder)
    for name in STORES:
        if (folder / name).is_file():
            with closing(sqlite3.connect(folder / name)) as store:
                assert store.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
    assert dumps in (case.dumps_before, case.dumps_after), "stores of different states"
    COMMANDS[case.command](folder)
    assert _dumps(folder) == case.dumps_after
    final = contents(folder)
    assert {name for name in final if not ORPHAN.fullmatch(name)} == set(after)
    for name in OUTPUTS:
        assert final.get(name) == after.get(name)


def _start(case: Case, step: int, folder: Path) -> subprocess.Popen[bytes]:
    shutil.copytree(case.before, folder)
    words = [sys.executable, str(KILLED_ORIP), str(step), "-q", "-C", str(folder), *WORDS[case.command]]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)


def _steps(case: Case, folder: Path) -> int:
    process = _start(case, 0, folder)
    out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    return int(out.split()[-1])


def _kill_at_steps(case: Case, tmp_path: Path, chosen: int | None) -> int:
    """Kill before each step, or before some of them, the last ones among them: these are commit and outputs."""
    total = _steps(case, tmp_path / "counted")
    steps: Sequence[int] = range(1, total + 1)
    if chosen is not None:
        steps = [*random.Random(1).sample(range(1, total - 3), chosen - 1), total - 3]
    for step in steps:
        folder = tmp_path / f"killed-{step}"
        process = _start(case, step, folder)
        process.communicate(timeout=60)
        assert process.returncode == -signal.SIGKILL
        _check(case, folder)
        shutil.rmtree(folder)
    return len(steps)


def _kill_from_outside(case: Case, tmp_path: Path, times: int) -> int:
    """Kill at random moments: after the start of the program, or after one of its commits or renames begins."""
    moments = random.Random(case.command)
    killed = 0
    for number in range(times):
        folder = tmp_path / f"random-{number}"
        process = _start(case, -1, folder)
        assert process.stdout is not None
        if number % 3:
            for _ in range(moments.randint(1, MOMENTS[case.command])):
                if process.stdout.readline() != MOMENT:
                    break
            time.sleep(moments.choice([0.0, 0.0005, 0.001, 0.002, 0.005, 0.01]))
        else:
            time.sleep(moments.uniform(0.05, 0.4))
        process.kill()
        process.communicate(timeout=60)
        killed += process.returncode == -signal.SIGKILL
        _check(case, folder)
        shutil.rmtree(folder)
    return killed


@pytest.mark.parametrize("name", CASES)
def test_killed_at_some_steps(cases: dict[str, Case], name: str, tmp_path: Path) -> None:
    case = cases[name]
    with killed_at(None) as steps:
        COMMANDS[case.command](Path(shutil.copytree(case.before, tmp_path / "counted")))
    # the last ones are commit and outputs
    for step in (*random.Random(1).sample(range(1, steps() - 3), 2), steps() - 3):
        folder = Path(shutil.copytree(case.before, tmp_path / f"killed-{step}"))
        with pytest.raises(Killed), killed_at(step):
            COMMANDS[case.command](folder)
        _check(case, folder)


def test_a_process_killed_while_it_commits(cases: dict[str, Case], tmp_path: Path) -> None:
    assert _kill_at_steps(cases["measure"], tmp_path, chosen=1) == 1


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", CASES)
def test_killed_at_every_step(cases: dict[str, Case], name: str, tmp_path: Path) -> None:
    # every statement, flush and rename: all commands together have several hundred
    assert _kill_at_steps(cases[name], tmp_path, chosen=None) > 20


@pytest.mark.long
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", CASES)
def test_killed_at_random_moments(cases: dict[str, Case], name: str, tmp_path: Path) -> None:
    # some come too late, as the machine's speed varies; half of them at least must have hit
    assert _kill_from_outside(cases[name], tmp_path, times=60) >= 30
