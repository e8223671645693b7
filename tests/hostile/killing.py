"""Commands killed at random steps and moments: stores in the old state or the new one, texts whole.

    PYTHONPATH=tests python -m hostile.killing 10000

A child is forked from this process, which has loaded orip, and runs the command; a third of them die before a random
statement, flush or rename, a third before a random system call that changes something on the disk, where they can be
counted, the others whenever it hits them. So ten thousand kills take minutes.
"""

from __future__ import annotations

import os
import random
import shlex
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import numpy as np
from cli.command_line import commands_put_together_once
from cli.command_line import orip as called
from cli.test_digitise_commands import emulator, new_cliff
from hostile.killed_commands import (
    CONTROL_TEXTS,
    DRIVABLE,
    EXCHANGED,
    FILM,
    FIRST,
    FLOWN,
    JOINED,
    KILLED,
    MANY_BUNDLES,
    ONLINE,
    OPERATED,
    PICTURED,
    UPDATED,
)
from hostile.system_calls import CAN_COUNT, ended_by, let_count
from msgspec import Struct
from workflow.killed_orip import Steps, counted
from workflow.small_projects import film_project, first_project, many_bundles, replace_in

from orip.cli.main import main as orip
from orip.files.log.text import read_measurements
from orip.files.stores.dump import dump
from orip.files.stores.identity import TABLES_OF_KIND

PROJECT = "project"
_AGAIN = 0.3
"""After this part of the kills the command is run again, and has to end as if nothing had happened."""

_UNFINISHED = ("-journal", "-undo", "-pact")
"""Beside stores whose transaction was not finished."""


class Case(Struct, frozen=True):
    """A command on a prepared folder.

    Parameters
    ----------
    words : tuple of str
    stages : tuple of Path
        The folder before the command, after each of its commits, and after the whole of it, undisturbed.
    steps, calls : int
        What the system sees of the command, and its system calls that change something on the disk.
    seconds : float
        How long it takes here.
    """

    words: tuple[str, ...]
    stages: tuple[Path, ...]
    steps: int
    calls: int
    seconds: float

    @property
    def is_digitising(self) -> bool:
        """Tell whether the log is written mark by mark, so that it may be anything between old and new."""
        return self.words[0] in ("digitise", "online")


def fork(
    folder: Path, words: Sequence[str], steps: Steps, kill_after: float | None = None, last_call: int | None = None
) -> int:
    """Run a command in a forked process, and return its wait status.

    Perhaps it is killed after some seconds, or before a system call that changes something; 0 writes how many it did.
    """
    given = folder.parent / "given"
    given.write_text(ONLINE if words[0] == "online" else "")
    child = os.fork()
    if child == 0:
        nowhere = os.open(os.devnull, os.O_RDWR)
        for descriptor in (1, 2):
            os.dup2(nowhere, descriptor)
        os.dup2(os.open(given, os.O_RDONLY), 0)
        sys.stdin = os.fdopen(0, encoding="utf-8")
        code = 1
        try:
            if last_call is not None:
                let_count()
            argv = ["orip", "-q", "-C", str(folder), *words]
            with commands_put_together_once(), patch.object(sys, "argv", argv), counted(steps):
                orip()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            if steps.last <= 0 and kill_after is None and last_call is None:
                (folder.parent / "steps").write_text(str(steps.count))
                (folder.parent / "modules").write_text("\n".join(sys.modules))
            os._exit(code)
    if kill_after is not None:
        time.sleep(kill_after)
        os.kill(child, signal.SIGKILL)
    if last_call is not None:
        status, count = ended_by(child, last_call)
        (folder.parent / "calls").write_text(str(count))
        return status
    return os.waitpid(child, 0)[1]


@contextmanager
def prepared(folder: Path) -> Iterator[list[Case]]:
    """Prepare all cases: their projects, and a plate processor."""
    for arguments in ((), *((group,) for group in {words.split()[0] for _, words in KILLED})):
        called(folder, *arguments, "--help")  # so that no child has to put these commands together
    _film(folder / FILM)
    _joined(folder / JOINED)
    _half_digitised(folder / OPERATED)
    _load_modules(folder)
    _done(folder / FILM, "init", "--sample", "small_frame_block", str(folder / DRIVABLE))
    _done(folder / DRIVABLE, "run")
    _load_modules(folder)
    _done(folder, "init", "--sample", "zurich_city_hall", str(folder / EXCHANGED))
    _done(folder / EXCHANGED, "run", "--no-report")
    _done(folder / EXCHANGED, "export", "colmap", "model")
    (folder / EXCHANGED / "empty").mkdir()
    _load_modules(folder)
    shutil.copytree(folder / FILM, folder / UPDATED)
    for words in (("run",), ("update", "points")):
        _done(folder / UPDATED, *words)
    _done(first_project(folder / FIRST), "run")
    for form, name in (("colmap", "model"), ("micmac", "Ori-Z")):
        _done(folder / FIRST, "export", form, name)
    (folder / FIRST / "empty").mkdir()
    _partly_flown(folder)
    _pictured(folder / PICTURED)
    _load_modules(folder)
    (folder / DRIVABLE / "STEREO.STE").write_text("POINT ROCK 1\n  101 0 0 102 -13.2 0\n", encoding="utf-8")
    _done(folder / DRIVABLE, "restitute", "compute", "STEREO.STE")
    (folder / DRIVABLE / "STEREO.STE").write_text("POINT ROCK 2\n  101 1 0 102 -12.2 0\n", encoding="utf-8")
    (folder / DRIVABLE / "collected.txt").write_text("FOOT RIGHT\nMOVE 1 0\nFOOT RIGHT\nKEY ZERO\n", encoding="utf-8")
    for name in ("MAIN.DRV", "report.html"):
        (folder / DRIVABLE / name).unlink()
    with emulator(folder / OPERATED) as url:
        link = ("--link", url, "--simulate", "films/DAY1.MEA")
        _done(folder / OPERATED, "digitise", "template", "LEFT", *link)
        _done(folder / OPERATED, "digitise", "photo", "--template", "LEFT", *link)
        _load_modules(folder)
        yield [
            _case(folder, number, project, words.replace("{}", url)) for number, (project, words) in enumerate(KILLED)
        ]


def _load_modules(folder: Path) -> None:
    """Load what the last command has loaded, so that those to be killed need not."""
    for name in (folder / "modules").read_text().split():
        with suppress(ImportError):
            import_module(name)


def _film(folder: Path) -> None:
    film_project(folder)
    for name, text in CONTROL_TEXTS.items():
        (folder / name).write_text(text)
    with (folder / "FIRST.PNT").open("a") as control:
        control.write("5 1012 2008 101 -1 -1 -1\n")
    _done(folder, "run")
    (folder / "report.html").unlink()
    (folder / "FIRST.dump").write_text("\n".join(dump(folder / "FIRST.PHO")) + "\n")
    _change_film(folder)
    replace_in(folder / "FIRST.PNT", "1012.40", "1012.41")


def _partly_flown(folder: Path) -> None:
    """Make a project whose plan has changed since, and of which a strip has not been flown."""
    _done(folder, "init", "--sample", "drone_rtk", str(folder / FLOWN))
    _done(folder / FLOWN, "plan", "make")
    replace_in(folder / FLOWN / "orip.toml", "forward = 68.5", "forward = 72.0")
    stations = folder / FLOWN / "DRONE.STA"
    flown = [line for line in stations.read_text().splitlines(keepends=True) if " S4 " not in line]
    stations.write_text("".join(flown))


def _pictured(folder: Path) -> None:
    """Make a folder with a folder of photographs."""
    from PIL import Image

    (folder / "images").mkdir(parents=True)
    for number in range(3):
        grey = np.random.default_rng(number).integers(0, 255, (120, 160)).astype(np.uint8)
        Image.fromarray(grey).save(folder / "images" / f"A{number}.png")


def _change_film(folder: Path) -> None:
    replace_in(folder / "orip.toml", "c = 35.0", "c = 35.2")
    replace_in(folder / "orip.toml", "X0 = 1070.0", "X0 = 1071.0")
    replace_in(folder / "FIRST.MEA", "P1 104.4010", "P1 104.4030")


def _joined(folder: Path) -> None:
    many_bundles(film_project(folder), MANY_BUNDLES)
    _done(folder, "init")
    _done(folder, "measure")
    _change_film(folder)


def _half_digitised(folder: Path) -> None:
    new_cliff(folder.with_suffix(".sample")).rename(folder)
    (folder / "first.txt").write_text("POINTS MAIN 101\nCP1\n1103\n1104\nPOINTS MAIN 103\n1103\n1104\n")
    square = ("0.3 0", "0 0.3", "-0.3 0", "0 -0.3")
    (folder / "panel.txt").write_text("".join(f"FOOT RIGHT\nMOVE {side}\n" for side in square))


def _done(folder: Path, *words: str) -> None:
    status = fork(folder, words, Steps(-2))
    assert status == 0, f"{words} ended with {os.waitstatus_to_exitcode(status)}"


def _case(folder: Path, number: int, project: str, words: str) -> Case:
    start, given = folder / project, tuple(shlex.split(words))
    after = Path(shutil.copytree(start, folder / f"after-{number}" / PROJECT))
    began = time.monotonic()
    status = fork(after, given, Steps(0))
    assert status == 0, f"{words} ended with {os.waitstatus_to_exitcode(status)}"
    seconds = time.monotonic() - began
    steps = int((after.parent / "steps").read_text())
    assert steps, f"{words} wrote nothing"
    calls = _calls(start, after.parent / "counted", given)
    return Case(given, (start, *_between(start, after.parent, given), after), steps, calls, seconds)


def _calls(start: Path, folder: Path, words: tuple[str, ...]) -> int:
    """Return how many system calls of a command change something; 0 where they cannot be counted."""
    if not CAN_COUNT:
        return 0
    place = Path(shutil.copytree(start, folder / PROJECT))
    fork(place, words, Steps(-2), last_call=0)
    return int((folder / "calls").read_text())


def _between(start: Path, folder: Path, words: tuple[str, ...]) -> Iterator[Path]:
    """Yield the stages inside a command: those of `run` are commands of their own."""
    for name in ("init", "measure") if words == ("run",) else ():
        start = Path(shutil.copytree(start, folder / name))
        _done(start, name)
        yield start


def kill(case: Case, folder: Path, chance: random.Random, *, again: bool) -> bool:
    """Kill a command once, look at what it left, and tell whether it was killed in time."""
    place = folder / PROJECT
    shutil.copytree(case.stages[0], place)
    how = chance.choice(("step", "call", "moment") if case.calls else ("step", "moment"))
    if how == "step":
        status = fork(place, case.words, Steps(chance.randint(1, max(case.steps, 1))))
    elif how == "call":
        status = fork(place, case.words, Steps(-2), last_call=chance.randint(1, case.calls))
    else:
        status = fork(place, case.words, Steps(-2), chance.uniform(0.0, case.seconds))
    check(case, place)
    if again:
        ended = os.waitstatus_to_exitcode(fork(place, case.words, Steps(-2)))
        assert ended in (0, 2, 3), f"{case.words} run again ended with {ended}"
        check(case, place)
        left = [str(path.relative_to(place)) for path in place.rglob("*") if _is_leftover(path)]
        assert ended != 0 or not left, f"{case.words} run again left {left}"
        if ended == 0 and not case.is_digitising:
            names = {path.name for path in place.iterdir()}
            more = names - {path.name for path in case.stages[-1].iterdir()}
            assert not more, f"{case.words} run again left {more}"
        if case.words[0] in ("import", "export", "solve", "adjust"):
            assert ended == 0 or _is_done(case, place), f"{case.words} run again ended with {ended}"
    shutil.rmtree(place)
    return os.WIFSIGNALED(status)


def _is_done(case: Case, place: Path) -> bool:
    """Tell whether a command was done before it was killed, so that it cannot be done once more."""
    done = case.stages[-1]
    return all(_content(place / path.name, place) == _content(path, done) for path in done.iterdir() if path.is_dir())


def check(case: Case, place: Path) -> None:
    """Check that all stores are those of one stage, and that every text is whole."""
    if _bytes_of(place) not in map(_bytes_of_stage, case.stages):
        stages = _rows_of(case.stages)
        found = {name: _rows(place / name) for name in stages[0]}
        assert found in stages, f"{case.words}: stores are neither old nor new"
    for path in place.iterdir():
        if path.suffix[1:] in TABLES_OF_KIND or path.suffix == ".html" or _is_leftover(path):
            continue
        if case.is_digitising and path.suffix == ".MEA":
            assert not read_measurements(path, path.name).complaints
        else:
            wholes = [_content(stage / path.name, stage) for stage in case.stages]
            assert _content(path, place) in wholes, f"{case.words}: {path.name} is neither old nor new"


def _is_leftover(path: Path) -> bool:
    """Tell whether a name is that of a text or a transaction that was not finished."""
    return path.name.startswith(".orip-") or path.name.endswith(_UNFINISHED) or "-mj" in path.name


def _content(path: Path, project: Path) -> object:
    """Return the bytes of a file, or those of the files of a folder; one without any is as good as none.

    An imported project says where its source is, which does not count here; of an adjusted one, whose run ids depend on
    it, the names alone count.
    """
    if path.is_dir():
        files = [file for file in path.iterdir() if not file.name.startswith(".orip-")]
        is_adjusted_elsewhere = path.name.endswith("_orip")
        return {file.name: None if is_adjusted_elsewhere else _content(file, project) for file in files} or None
    return path.read_bytes().replace(bytes(project), b"") if path.exists() else None


def _bytes_of(folder: Path) -> dict[str, bytes]:
    """Return the bytes of all stores, and of journals that would change them."""
    stores = [path for path in folder.iterdir() if path.suffix[1:].partition("-")[0] in TABLES_OF_KIND]
    return {path.name: path.read_bytes() for path in stores}


_bytes_of_stage = cache(_bytes_of)


@cache
def _rows_of(stages: tuple[Path, ...]) -> list[dict[str, list[str]]]:
    """Return the rows of all stores at each stage."""
    names = sorted({path.name for folder in stages for path in _stores_in(folder)})
    return [{name: _rows(folder / name) for name in names} for folder in stages]


def _stores_in(folder: Path) -> list[Path]:
    return [path for path in folder.iterdir() if path.suffix[1:] in TABLES_OF_KIND]


def _rows(path: Path) -> list[str]:
    """Return the rows of a store; one that is absent, or was never filled, has none."""
    lines = list(dump(path)) if path.is_file() else []
    rows = [line for line in lines if line.startswith("[")]
    return [*lines[:1], *rows] if rows else []


def kills(count: int, seed: int, folder: Path) -> tuple[Counter[str], list[str]]:
    """Kill commands `count` times; return how often each was killed in time, and what was wrong afterwards."""
    chance, killed, faults = random.Random(seed), Counter[str](), list[str]()
    with prepared(folder) as cases:
        for number in range(count):
            case = cases[number % len(cases)]
            if number % 500 == 0:
                print(f"{time.strftime('%T')} {number} runs, {sum(killed.values())} killed", flush=True)  # noqa: T201
            name = f"{case.stages[0].name}: {' '.join(case.words[:3])}"
            try:
                killed[name] += kill(case, folder, chance, again=chance.random() < _AGAIN)
            except AssertionError as fault:
                faults.append(str(fault).split("\nassert")[0])
                print(f"{number}: {faults[-1][:300]}", flush=True)  # noqa: T201
                shutil.rmtree(folder / PROJECT)
    return killed, faults


def main() -> None:
    """Kill as often as the command line says."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    began = time.monotonic()
    base = "/dev/shm" if Path("/dev/shm").is_dir() else None
    with tempfile.TemporaryDirectory(dir=base) as folder:
        killed, faults = kills(count, seed, Path(folder))
    print(  # noqa: T201
        f"{count} runs, {len(faults)} faults, {sum(killed.values())} killed in {time.monotonic() - began:.0f} s:",
        dict(killed),
        flush=True,
    )
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
