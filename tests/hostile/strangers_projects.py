"""Projects of strangers: whatever is in one, opening it harms nobody.

    PYTHONPATH=tests python -m hostile.strangers_projects 10000
    PYTHONPATH=tests python -m hostile.strangers_projects 10000 SEED FIRST_NUMBER

A sound project with everything that orip makes gets one to four things of `strangers_plants`, and commands are run on
it, each in a forked process. Beside the project nothing may change, in it nothing that orip did not make; every command
has to end within a minute and two gigabytes, in words that a terminal can show. All holes are collected and told, with
the number of the project, which makes the same project again.
"""

from __future__ import annotations

import codecs
import json
import os
import random
import re
import resource
import shlex
import shutil
import signal
import stat
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

import numpy as np
from cli.command_line import commands_put_together_once
from cli.command_line import orip as called
from hostile.confinement import as_plain_user, confined, in_private_mounts
from hostile.killed_commands import CONTROL_TEXTS
from hostile.path_attacks import code_in_time
from hostile.strangers_plants import FOREIGN, HOME, TEMPORARY, plant
from msgspec import Struct
from workflow.small_projects import film_project, first_project

from orip.archive.cluster.sub_block_files import write_sub_blocks
from orip.archive.run_files import ArchivePlan, ResultsFolder, write_finished, write_plan
from orip.archive.tables import ProjectOutcome
from orip.cli.main import main as orip
from orip.files.stores.dump import dump

PROJECT = "project"
COMMANDS_OF_EACH = 3
SECONDS, BYTES, LARGEST = 60, 2 << 30, 1 << 30
"""Limits of a command: time, memory, and the size of a file that it writes."""

READING = (
    "", "status", "check sigma0<=1.5", "results points", "results cameras --json", "results residuals",
    "compare result.json result.json", "dump FIRST.PHO", "dump CAMERAS.CAM", "dump MAIN.EXO", "prelim show",
    "prelim connect", "camera list", "camera show C35", "camera plot C35", "photo list --json", "template list",
    "bundle list", "bundle show MAIN", "model list", "temtick list", "observations list", "observations todo",
    "control points list", "control preliminary list", "control stations list", "archive status results",
)  # fmt: skip
ADJUSTING = (
    "init", "measure", "solve", "run", "run --no-report", "report", "prelim", "drive table", "solve --snoop",
    "archive report results", "export colmap out", "export micmac out", "export opensfm out", "export blocks out.xml",
    "export csv out", "export geojson out.json", "export dxf out.dxf", "export geopackage out.gpkg", "export bingo out",
    "export patb out", "export metashape out.xml", "export bundler out", "export nvm out.nvm", "export bal out.txt",
    "export openmvg out.json", "export alicevision out.sfm",
    "export", "export out", "export geojson FIRST.PNT", "export dxf orip.toml", "export bal FIRST.MEA",
)  # fmt: skip
CHANGING = (
    "update points", "update photos", "update cameras", "update --undo", "load FIRST.PHO FIRST.dump",
    "export-toml --output orip.toml --force", "export-toml --output new.toml", "online", "prelim update",
    "observations disregard point left P1", "observations include point left 4", "observations todo --output todo.txt",
    "observations remeasure again.txt", "observations kill point left P1 --yes", "control points edit 1 X=1012.5",
    "control points kill 1 --yes", "control distances add D9 from=3 to=4 code=XYZ distance=136.7 a=0.05",
    "control preliminary kill P1 --yes", "camera edit C35 c=35.3", "camera rename C35 OTHER", "photo rename left OTHER",
    "photo add NEW camera=C35", "photo delete left --with-referents --yes",
    "template add T temtick=S stage=UPPER photos=[]",
    "bundle rename MAIN OTHER", "bundle copy MAIN OTHER", "bundle edit MAIN measurement_precision=0.004",
    "bundle delete MAIN --with-referents --yes", "init MINE new", "init --sample small_frame_block new",
    "stations import flown.csv --camera C35 --replace", "digitise points --list again.txt --simulate FIRST.MEA",
    "import colmap ../source new", "import csv out new",
)  # fmt: skip
COMMANDS = (*READING, *ADJUSTING, *CHANGING)
"""Those of `ADJUSTING` and `READING` leave the texts of the project as they are."""

ONLINE = '{"do":"show"}\n{"do":"measure","photo":"left","point":"P1","x":104.4,"y":100.9}\n{"do":"undo"}\nnonsense\n'
_CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")
_TEXTS = ("orip.toml", "FIRST.MEA", "FIRST.PNT", "FIRST.ELE", "FIRST.LEN", "FIRST.DIR", "FIRST.CON", "FIRST.STA")

_ENCODINGS = (
    *("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32", "utf-32-le", "utf-32-be"),
    *("latin-1", "cp1252", "idna", "unicode_escape", "raw_unicode_escape", "ascii"),
)
State = dict[str, tuple[object, ...]]


class Hole(Struct, frozen=True):
    """What a command did that it may not do, with the number of the project that makes it do so again."""

    number: int
    what: str
    words: str
    planted: tuple[str, ...]
    told: str

    def __str__(self) -> str:
        return (
            f"{self.what}\n    {self.number}: orip {self.words} with {'; '.join(self.planted)}\n    {self.told[-500:]}"
        )


def prepare(folder: Path) -> None:
    """Write the sound projects, what is beside the stranger's, and load what commands need."""
    film, source = folder / "film", folder / "first"
    film_project(film)
    for name, text in CONTROL_TEXTS.items():
        (film / name).write_text(text)
    _called(film, "run")
    _called(film, "update", "points")
    _called(film, "solve", "--no-report")
    (film / "FIRST.dump").write_text("\n".join(dump(film / "FIRST.PHO")) + "\n")
    _called(first_project(source), "run", "--no-report")
    _called(source, "export", "colmap", str(folder / "source"))
    _called(folder, "import", "colmap", str(folder / "source"), str(folder / "imported"))
    _called(folder / "imported", "run", "--no-report")
    for sound in (film, folder / "imported"):
        _filled(sound)
    _home(folder / HOME, film)
    shutil.copytree(film, folder / "warm")
    for words in COMMANDS:  # modules are loaded here, and not by each child
        called(folder / "warm", "-q", *shlex.split(words)) if words not in ("", "online") else None
    shutil.rmtree(folder / "warm")
    _load_modules(folder)
    for path in (folder / HOME).rglob("*"):
        assert os.path.lexists(path)


def _called(folder: Path, *words: str) -> None:
    said = called(folder, "-q", *words)
    assert said.code == 0, said


def _load_modules(folder: Path) -> None:
    """Load what a child loads, so that those of the attacks need not."""
    place = folder / PROJECT
    shutil.copytree(folder / "film", place)
    for words in ("online", "run", "export colmap out"):
        run(place, folder / "told", shlex.split(words), tell_modules=True)
        for name in (folder / "told.modules").read_text().split():
            with suppress(ImportError):
                import_module(name)
    shutil.rmtree(place)
    for encoding in _ENCODINGS:
        codecs.lookup(encoding)  # a plain user may not be able to load them


def _filled(project: Path) -> None:
    """Add what other commands leave in a project, and what orip did not make."""
    write_sub_blocks(project, [{"xy": np.zeros((3, 2)), "front": np.array(1)}])
    results = ResultsFolder(project / "results")
    write_plan(results, ArchivePlan(str(project.parent), (PROJECT,), "0" * 64, "reduced weights", "0", "", 1.0))
    write_finished(results, ProjectOutcome(PROJECT, "wrong", "one of its texts"), "0" * 64, 2.0)
    results.lock.touch()
    for name, content in FOREIGN.items():
        path = project / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)


def _home(home: Path, film: Path) -> None:
    """Write what its owner has beside a stranger's project, which orip could take for its own by names and contents."""
    texts = {
        "thesis.txt": "plain text\n", "settings.json": '{"token": "secret"}\n', "list.json": '["a", "b"]\n',
        ".config/settings.json": '"secret"\n', "stolen.xml": "<xml/>\n", "stolen.txt": "mine\n", "names.csv": "a,b\n",
        "Documents/thesis.txt": "precious\n", "Documents/0123456789abcdef0123456789abcdef/000000.npz": "mine",
        "photos/complete": "", "complete": "", "FIRST.PHO-mj12345678": "mine", "MAIN.EXO-journal": "mine",
        "stores.json": json.dumps(["MAIN.EXO", "FIRST.PHO"]), "MAIN.EXO-undo": "mine", TEMPORARY: "mine",
        f"Documents/{TEMPORARY}": "mine", "archive.json": "{}", "result.json": "{}", "finished/1/1.json": "{}",
    }  # fmt: skip
    for name, text in texts.items():
        (home / name).parent.mkdir(parents=True, exist_ok=True)
        (home / name).write_text(text)
    for name in ("MAIN.EXO", "FIRST.PHO", "CAMERAS.CAM"):
        shutil.copyfile(film / name, home / name)
    head = {"pact": "stores.json", "sha256": "0" * 64}
    (home / "CAMERAS.CAM-undo").write_text(json.dumps(head) + "\n")
    first_project(home / "neighbour")
    (home / "settings.json").chmod(0o600)
    (home / "thesis.txt").chmod(0o4755)
    (home / "here").symlink_to("Documents")
    (home / "gone").symlink_to("nowhere")
    os.mkfifo(home / "pipe")
    os.mkfifo(home / "pipe-journal")


def strangers(
    count: int, seed: int, folder: Path, first: int = 0, tell: Callable[[list[Hole]], None] | None = None
) -> tuple[Counter[int], list[Hole]]:
    """Make `count` projects in a folder that `prepare` has filled; return how often each exit code was seen, and holes.

    Holes are also told as they are found.
    """
    codes, holes, home = Counter[int](), list[Hole](), folder / HOME
    if not (folder / "kept").exists():
        shutil.copytree(home, folder / "kept", symlinks=True, copy_function=_copy_any)
    sound = state_of(home)
    for number in range(first, first + count):
        chance, place = random.Random(f"{seed} {number}"), folder / PROJECT
        shutil.copytree(folder / chance.choice(("film", "film", "film", "imported")), place)
        planted = tuple(plant(place, chance) for _ in range(chance.choice((1, 1, 2, 3, 4))))
        assert state_of(home) == sound, f"the generator itself has changed something: {number} {planted}"
        for _ in range(COMMANDS_OF_EACH):
            words = chance.choice(chance.choice((READING, ADJUSTING, CHANGING)))
            before = state_of(place)
            code, told = run(place, folder / "told", shlex.split(words))
            codes[code] += 1
            found = [*_of_words(code, told), *_of_project(before, state_of(place), words)]
            after = state_of(home)
            if after != sound:
                found.append(f"beside the project: {_difference(sound, after)}")
                shutil.rmtree(home)
                shutil.copytree(folder / "kept", home, symlinks=True, copy_function=_copy_any)
                sound = state_of(home)
            for what in found:
                holes.append(Hole(number, what, words, planted, told))
                if tell is not None:
                    tell(holes)
        _removed(place)
    return codes, holes


def _copy_any(source: str, target: str, **_: object) -> None:
    if stat.S_ISFIFO(os.lstat(source).st_mode):
        os.mkfifo(target)
    else:
        shutil.copy2(source, target, follow_symlinks=False)


def _of_words(code: int, told: str) -> Iterable[str]:
    """Yield what is wrong with how a command ended."""
    if code not in range(7):
        yield {-1: f"not ended in {SECONDS} s"}.get(code, f"exit code {code}")
    for fault in ("Traceback", "internal error", "out of memory", "Exception ignored"):
        if fault in told:
            yield f"{fault}{told[told.index(fault) :][len(fault) : 160]}".split("\n")[0]
    if control := _CONTROLS.search(told):
        yield f"control character {control[0]!r}: {told[max(control.start() - 40, 0) : control.start() + 20]!r}"


def _of_project(before: State, after: State, words: str) -> Iterable[str]:
    """Yield what a command changed in the project though orip did not make it, and permissions that it gave."""
    kept = [name for name in FOREIGN if name in before]
    if words in READING or words in ADJUSTING:
        kept += [name for name in _TEXTS if name in before and not before[name][-1]]
    changed = [name for name in kept if before[name] != after.get(name)]
    if changed:
        yield f"changed in the project: {', '.join(changed)}"
    for name, state in after.items():
        mode = state[0]
        if isinstance(mode, int) and stat.S_ISREG(mode) and mode & 0o6000 and before.get(name) != state:
            yield f"set-uid file made: {name}"
    if left := [
        name for name in after if name not in before and Path(name).name.startswith(".orip-") and name.endswith(".tmp")
    ]:
        yield f"temporary file left: {left}"


def _difference(before: State, after: State) -> str:
    gone, new = sorted(before.keys() - after.keys()), sorted(after.keys() - before.keys())
    changed = sorted(name for name in before.keys() & after.keys() if before[name] != after[name])
    return "; ".join(
        f"{what} {', '.join(names)}" for what, names in (("gone", gone), ("new", new), ("changed", changed)) if names
    )


def state_of(folder: Path) -> State:
    """Return what may not change: modes, sizes, contents of all in a folder; last, whether it is a link."""
    found: State = {}
    for root, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(root, name)
            try:
                status = path.lstat()
            except PermissionError:  # in a folder whose names can be read, and no more
                continue
            content: object = None
            if stat.S_ISREG(status.st_mode) and status.st_size < 1 << 22:
                with suppress(OSError):
                    content = path.read_bytes()
            elif stat.S_ISLNK(status.st_mode):
                content = str(path.readlink())
            size = status.st_size if stat.S_ISREG(status.st_mode) else 0
            found[os.path.relpath(path, folder)] = (status.st_mode, size, content, stat.S_ISLNK(status.st_mode))
    return found


def run(place: Path, told: Path, words: list[str], *, tell_modules: bool = False) -> tuple[int, str]:
    """Run a command in a process of its own with its limits; return its exit code (-1: too long) and its words."""
    given = told.with_suffix(".given")
    given.write_text(ONLINE if words == ["online"] else "")
    child = os.fork()
    if child == 0:
        code = 97
        try:
            source, stream = os.open(given, os.O_RDONLY), os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for descriptor, opened in ((0, source), (1, stream), (2, stream)):
                os.dup2(opened, descriptor)
            sys.stdin = os.fdopen(0, encoding="utf-8")
            sys.stdout, sys.stderr = (os.fdopen(descriptor, "w", encoding="utf-8") for descriptor in (1, 2))
            os.setpgid(0, 0)
            if not tell_modules:
                limit_resources()
            with commands_put_together_once(), patch.object(sys, "argv", ["orip", "-C", str(place), *words]):
                orip()
        except SystemExit as end:
            code = int(end.code or 0)
        except BaseException as error:  # noqa: BLE001  # told as what a user would see
            os.write(2, f"Traceback of {type(error).__name__}: {error}".encode("utf-8", "replace"))
        finally:
            with suppress(Exception):
                sys.stdout.flush()
                sys.stderr.flush()
                if tell_modules:
                    told.with_suffix(".modules").write_text("\n".join(sys.modules))
            os._exit(code)
    code = code_in_time(child, SECONDS)
    with suppress(OSError):
        os.killpg(child, signal.SIGKILL)  # what it has started
    return code, told.read_text(encoding="utf-8", errors="replace")


def _removed(place: Path) -> None:
    place.chmod(0o700)
    for root, folders, _ in os.walk(place):
        for name in folders:
            path = Path(root, name)
            if not path.is_symlink():
                path.chmod(0o700)
    shutil.rmtree(place)


def _kind(hole: Hole) -> str:
    return re.sub(r"[0-9a-f]{6,}|[0-9]+|'[^']*'", "#", hole.what)[:90]


def _tell_new(holes: list[Hole]) -> None:
    """Print the last hole if it is the first of its kind."""
    if _kind(holes[-1]) not in map(_kind, holes[:-1]):
        print(f"{time.strftime('%T')} {holes[-1]}", flush=True)  # noqa: T201


def told(holes: Iterable[Hole]) -> str:
    """Return holes as text, one of each kind."""
    kinds: dict[str, list[Hole]] = {}
    for hole in holes:
        kinds.setdefault(_kind(hole), []).append(hole)
    ordered = sorted(kinds.values(), key=len, reverse=True)
    shortest = [(len(found), min(found, key=lambda hole: len(hole.planted))) for found in ordered]
    return "\n".join(f"{count} x {hole}" for count, hole in shortest)


def confined_strangers(
    how: Callable[[Path], None], count: int, seed: int, folder: Path, first: int = 0, *, tells: bool = False
) -> tuple[Counter[int], list[Hole]]:
    """Make projects in a process that is confined to the folder that `prepare` has filled.

    Raises
    ------
    NotAllowedError
        If this system does not allow it.
    """

    def work() -> object:
        codes, holes = strangers(count, seed, folder, first, _tell_new if tells else None)
        return codes, [[hole.number, hole.what, hole.words, hole.planted, hole.told[-600:]] for hole in holes]

    codes, holes = confined(how, folder, work)
    found = [Hole(number, what, words, tuple(planted), said) for number, what, words, planted, said in holes]
    return Counter({int(code): number for code, number in codes.items()}), found


def limit_resources() -> None:
    """Limit the memory and the files of this process; the tests that ran before have loaded much."""
    most = BYTES + int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST, LARGEST))


def main() -> None:
    """Make as many projects as the command line says, half of them as a plain user."""
    count, seed, first = (*map(int, sys.argv[1:]), *(1, 0)[len(sys.argv) - 2 :])
    failed = False
    for how in (in_private_mounts, as_plain_user):
        with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
            Path(folder).chmod(0o755)
            prepare(Path(folder))
            began = time.monotonic()
            codes, holes = confined_strangers(how, max(count // 2, 1), seed, Path(folder), first, tells=True)
            seconds = time.monotonic() - began
        print(f"{count // 2} projects {how.__name__} in {seconds:.0f} s, exit codes:", dict(codes), flush=True)  # noqa: T201
        print(f"{len(holes)} holes\n{told(holes)}", flush=True)  # noqa: T201
        failed |= bool(holes)
    sys.exit(failed)


if __name__ == "__main__":
    main()
