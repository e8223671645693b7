"""Commands killed at random steps and moments: stores in the old state or the new one, texts whole.

    PYTHONPATH=tests python -m hostile.killing 10000

A child is forked from this process, which has loaded orip, and runs the command; every second one dies before a
random statement, flush or rename, the others whenever it hits them. So ten thousand kills take minutes.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from unittest.mock import patch

from cli.test_digitise_commands import emulator, new_cliff
from workflow.killed_orip import Steps, counted
from workflow.quiet import run_quietly
from workflow.small_projects import film_project, replace_in

from orip.cli.main import main as orip
from orip.files.log.text import read_measurements
from orip.files.stores.dump import dump
from orip.files.stores.schema import TABLES_OF_KIND

PROJECT = "project"
_AGAIN_EVERY = 20
"""Of so many kills the command is run again after one, and has to end as if nothing had happened."""


@dataclass(frozen=True)
class Case:
    """A command on a prepared folder.

    Parameters
    ----------
    words : sequence of str
        With {} where the URL of the plate processor stands.
    before, after : Path
        The folder before the command and after it, undisturbed.
    steps : int
        What the system sees of the command.
    seconds : float
        How long it takes here.
    """

    words: Sequence[str]
    before: Path
    after: Path
    steps: int
    seconds: float

    @property
    def is_digitising(self) -> bool:
        """Tell whether the log is written mark by mark, so that it may be anything between old and new."""
        return self.words[0] == "digitise"


COMMANDS = (
    "init",
    "measure",
    "solve",
    "run",
    "prelim",
    "report",
    "update photos",
    "update points",
    "camera edit C35 c=35.3",
    "photo rename left west",
    "photo delete left --with-referents --yes",
    "bundle rename MAIN ALL",
    "bundle copy MAIN SECOND",
    "control points edit 1 X=1012.5",
    "observations disregard point left P1",
    "observations kill point left P1 --yes",
    "export-toml --output orip.toml --force",
    "load FIRST.PHO FIRST.dump",
    "init --sample small_frame_block sample",
)
"""All commands that write a project, but `digitise` and `drive`, which need a plate processor or models."""

DIGITISING = ("digitise template LEFT --link {} --simulate films/DAY1.MEA", "drive table", "drive download --link {}")


def fork(folder: Path, words: Sequence[str], steps: Steps, kill_after: float | None = None) -> int:
    """Run a command in a forked process, perhaps kill it after some seconds, and return its wait status."""
    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in range(3):
            os.dup2(nowhere, descriptor)
        code = 1
        try:
            with patch.object(sys, "argv", ["orip", "-q", "-C", str(folder), *words]), counted(steps):
                orip()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            if steps.last == 0:
                (folder.parent / "steps").write_text(str(steps.count))
            os._exit(code)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    return os.waitpid(child, 0)[1]


@contextmanager
def cases(folder: Path, chosen: Sequence[str], url: str) -> Iterator[list[Case]]:
    """Prepare all cases: a finished film project whose texts have changed since, and films to digitise."""
    film = film_project(folder / "film")
    run_quietly(film)
    (film / "FIRST.dump").write_text("\n".join(dump(film / "FIRST.PHO")) + "\n")
    replace_in(film / "orip.toml", "c = 35.0", "c = 35.2")
    replace_in(film / "orip.toml", "X0 = 1070.0", "X0 = 1071.0")
    replace_in(film / "FIRST.PNT", "1012.40", "1012.41")
    yield [_case(folder, film, words, url) for words in chosen]


def _case(folder: Path, start: Path, words: str, url: str) -> Case:
    after = folder / f"after-{words.replace(' ', '-').replace('/', '_')[:40]}" / PROJECT
    if words.startswith("digitise"):
        start = folder / "cliff"
    elif words.startswith("drive"):
        start = folder / "drivable"
    given = words.format(url).split()
    shutil.copytree(start, after)
    began = time.monotonic()
    status = fork(after, given, Steps(0))
    assert status == 0, f"{words} ended with {os.waitstatus_to_exitcode(status)}"
    return Case(given, start, after, int((after.parent / "steps").read_text()), time.monotonic() - began)


def kill(case: Case, folder: Path, chance: random.Random, *, again: bool) -> bool:
    """Kill a command once, look at what it left, and tell whether it was killed in time."""
    place = folder / PROJECT
    shutil.copytree(case.before, place)
    if chance.random() < 0.5:
        status = fork(place, case.words, Steps(chance.randint(1, max(case.steps, 1))))
    else:
        status = fork(place, case.words, Steps(-2), chance.uniform(0.0, case.seconds))
    check(case, place)
    if again:
        ended = os.waitstatus_to_exitcode(fork(place, case.words, Steps(-2)))
        assert ended in (0, 2, 3), f"{case.words} run again ended with {ended}"
        check(case, place)
        temporary = [path.name for path in place.iterdir() if path.name.startswith(".orip-")]
        assert ended != 0 or not temporary, f"{case.words} run again left {temporary}"
    shutil.rmtree(place)
    return os.WIFSIGNALED(status)


def check(case: Case, place: Path) -> None:
    """Check that stores are all old or all new, and that every text is whole."""
    old, new = _state(case.before, case.after)
    found = {name: _rows(place / name) for name in old}
    assert found in (old, new), f"{case.words}: stores are neither old nor new"
    for path in place.iterdir():
        if path.suffix[1:] in TABLES_OF_KIND or path.name.startswith(".orip-") or "-mj" in path.name:
            continue
        if path.is_dir() or path.name.endswith("-journal") or path.suffix == ".html":
            continue
        known = {folder / path.name for folder in (case.before, case.after)}
        wholes = {other.read_bytes() for other in known if other.is_file()}
        if case.is_digitising and path.suffix == ".MEA":
            assert not read_measurements(path, path.name).complaints
        else:
            assert path.read_bytes() in wholes, f"{case.words}: {path.name} is neither old nor new"


@cache
def _state(before: Path, after: Path) -> tuple[dict[str, list[str]], dict[str, list[str]]]:
    """Return the rows of all stores before and after a command."""
    names = sorted({path.name for folder in (before, after) for path in _stores_in(folder)})
    old, new = ({name: _rows(folder / name) for name in names} for folder in (before, after))
    return old, new


def _stores_in(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.suffix[1:] in TABLES_OF_KIND]


def _rows(path: Path) -> list[str]:
    """Return the rows of a store; one that is absent, or was never filled, has none."""
    lines = list(dump(path)) if path.is_file() else []
    rows = [line for line in lines if line.startswith("[")]
    return [*lines[:1], *rows] if rows else []


def kills(count: int, seed: int, folder: Path, commands: Sequence[str] = COMMANDS, url: str = "") -> Counter[str]:
    """Kill commands `count` times; return how often each was killed in time."""
    chance, killed = random.Random(seed), Counter[str]()
    with cases(folder, commands, url) as prepared:
        for number in range(count):
            case = prepared[number % len(prepared)]
            killed[" ".join(case.words[:2])] += kill(case, folder, chance, again=number % _AGAIN_EVERY == 0)
    return killed


@contextmanager
def digitising(folder: Path) -> Iterator[str]:
    """Serve a plate processor, with a project before it and one that can be driven in; yield the URL."""
    cliff = new_cliff(folder / "original")
    cliff.rename(folder / "cliff")
    assert fork(folder, ["init", "--sample", "small_frame_block", "drivable"], Steps(-2)) == 0
    assert fork(folder / "drivable", ["run"], Steps(-2)) == 0
    (folder / "drivable" / "MAIN.DRV").unlink(missing_ok=True)
    with emulator(folder / "cliff") as url:
        yield url


def main() -> None:
    """Kill as often as the command line says."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    began = time.monotonic()
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=base) as folder, digitising(Path(folder)) as url:
        killed = kills(count, seed, Path(folder), (*COMMANDS, *DIGITISING), url)
    print(f"{count} runs, {sum(killed.values())} killed in {time.monotonic() - began:.0f} s:", dict(killed), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
