"""Links, pipes, devices, folders and files of the system in the places of a project's files, and names that lead there.

    PYTHONPATH=tests python -m hostile.path_attacks 2000

Each attack puts one to three of them into a project and runs a command. It has to end in time and in words, and
nothing beside the project may have changed.
"""

from __future__ import annotations

import os
import random
import re
import shlex
import shutil
import signal
import socket
import stat
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from unittest.mock import patch

from cli.command_line import commands_put_together_once
from cli.command_line import orip as called
from hostile.confinement import as_plain_user, confined, in_private_mounts
from hostile.killed_commands import CONTROL_TEXTS
from workflow.small_projects import film_project

from orip.cli.main import main as orip
from orip.files.stores.dump import dump

_LONGEST = 60.0
"""Seconds, on a busy machine; the commands take less than one, and what waits for a pipe waits for ever."""

PROJECT, BESIDE = "project", "beside"

COMMANDS = (
    "init", "measure", "solve", "run", "report", "status", "results points", "prelim", "prelim update", "check",
    "update points", "update photos", "export-toml --output orip.toml --force", "export-toml --output new.toml",
    "observations disregard point left P1", "observations todo --output todo.txt", "observations remeasure again.txt",
    "control points edit 1 X=1012.5", "control distances add D9 from=3 to=4 code=XYZ distance=136.7 a=0.05",
    "control preliminary kill P1 --yes", "camera edit C35 c=35.3", "bundle rename MAIN OTHER", "bundle copy MAIN OTHER",
    "photo add NEW camera=C35", "drive table", "dump FIRST.PHO", "load FIRST.PHO FIRST.dump", "measure again.txt",
    "compare result.json result.json", "init --sample small_frame_block new", "init MINE new",
)  # fmt: skip

TEXTS = (
    "orip.toml", "FIRST.MEA", "FIRST.PNT", "FIRST.ELE", "FIRST.LEN", "FIRST.DIR", "FIRST.CON", "MAIN.PRE", "EDITS.MEA",
    "again.txt", "FIRST.dump",
)  # fmt: skip
OUTPUTS = (
    "INTERIOR_RESULT.OUT", "PRELIM_RESULT.OUT", "BUNDLE_RESULT.OUT", "BUNDLE_ERROR.OUT", "result.json", "residuals.csv",
    "report.html", "MAIN.DRV", "todo.txt", "new.toml", "new", "orip.toml.bak", "OTHER.PRE",
)  # fmt: skip
STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO", "OTHER.EXO")
BESIDE_STORES = tuple(
    f"{name}{end}" for name in STORES for end in ("-journal", "-undo", "-pact", "-wal", "-mj12345678")
)

_SYSTEM_FILES = (
    "/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/tty", "/dev/stdin", "/proc/self/maps",
    "/proc/self/environ", "/proc/self/fd/0", "/proc/kmsg", "/proc/self/root/etc/passwd", "/sys/kernel/uevent_seqnum",
    "/etc/passwd", "/", "..", ".",
)  # fmt: skip
_NAMES = (
    "/dev/zero",
    "../beside/text.txt",
    "loop",
    "fifo",
    "../../../../../../dev/null",
    "/proc/self/mem",
    "..",
    "new/",
)


def _link(target: str) -> Callable[[Path], None]:
    return lambda path: path.symlink_to(target)


def _circle(path: Path) -> None:
    other = path.with_name(f"{path.name}.circle")
    other.unlink(missing_ok=True)
    other.symlink_to(path.name)
    path.symlink_to(other.name)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener, suppress(OSError):  # the name may be too long for a socket
        listener.bind(str(path))


def _device(path: Path) -> None:
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 3))  # that of /dev/null
    except OSError:
        path.symlink_to("/dev/null")


def _full_folder(path: Path) -> None:
    path.mkdir()
    (path / "file.txt").write_text("here\n")


def _huge(path: Path) -> None:
    path.write_bytes(b"")
    os.truncate(path, 1 << 35)  # sparse: it takes no room


def _no_permission(path: Path) -> None:
    path.write_text("nothing\n")
    path.chmod(0)


ANYWHERE: tuple[Callable[[Path], None], ...] = (
    *(_link(target) for target in _SYSTEM_FILES),
    *(_link(f"../{BESIDE}/{name}") for name in ("text.txt", "gone.txt", "folder", "fifo", "far")),
    _circle, _socket, _device, _full_folder, _huge, _no_permission, os.mkfifo,
)  # fmt: skip


def _second_name(path: Path) -> None:
    os.link(path.parent.parent / BESIDE / "text.txt", path)


def attack(place: Path, chance: random.Random) -> str:
    """Put something hostile into a project, and say what and where."""
    names = (*TEXTS, *OUTPUTS, *STORES, *BESIDE_STORES)
    if chance.random() < 0.15:
        return _name_in_text(place, chance)
    path = place / chance.choice(chance.choice((TEXTS, OUTPUTS, STORES, names)))
    make = chance.choice((*ANYWHERE, _second_name))
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    make(path)
    return f"{path.name}: {_what(path)}"


def _what(path: Path) -> str:
    return f"link to {path.readlink()}" if path.is_symlink() else stat.filemode(path.lstat().st_mode)


def _name_in_text(place: Path, chance: random.Random) -> str:
    """Let orip.toml name something hostile."""
    for name, make in (("loop", _circle), ("fifo", os.mkfifo)):
        for path in (place / name, place / f"{name}.CAM"):
            if not os.path.lexists(path):
                make(path)
    name = chance.choice(_NAMES)
    key = chance.choice(("camera_file", "temtick_file", "project_files", "control_files", "measurement_files"))
    # with its suffix a name beside the project is a store that orip is asked to make there
    if key in ("camera_file", "temtick_file") and BESIDE not in name and chance.random() < 0.5:
        name += ".CAM" if key == "camera_file" else ".TIK"
    value = f'["{name}"]' if key == "measurement_files" else f'"{name}"'
    text = place / "orip.toml"
    if _is_own_text(text):
        old = text.read_text(encoding="utf-8")
        text.write_text(re.sub(r'(project = \{ name = "FIRST")', rf"\1, {key} = {value}", old), encoding="utf-8")
    return f"{key} = {value}"


def _is_own_text(path: Path) -> bool:
    """Tell whether a file can be rewritten by an attack: it is the project's alone, readable, and no huge one."""
    if not path.is_file() or path.is_symlink() or not os.access(path, os.R_OK):
        return False
    status = path.stat()
    return status.st_nlink == 1 and status.st_size < 1 << 20


def attacks(count: int, seed: int, folder: Path) -> Counter[int]:
    """Attack `count` times in a folder that `prepare` has filled; return how often each exit code was seen.

    Raises
    ------
    AssertionError
        With the attack that did not end in time and in words, or reached something beside the project.
    """
    chance, codes = random.Random(seed), Counter[int]()
    before = _state_of(folder / BESIDE)
    for _ in range(count):
        place = folder / PROJECT
        shutil.copytree(folder / chance.choice(("adjusted", "new")), place)
        done = [attack(place, chance) for _ in range(chance.choice((1, 1, 2, 3)))]
        words = chance.choice(COMMANDS)
        code, told = _run(place, folder / "told", shlex.split(words))
        case = f"orip {words} with {'; '.join(done)}: {told[-2000:]}"
        assert code in range(7), f"exit code {code} of {case}"
        assert "Traceback" not in told, case
        assert "internal error" not in told, case
        assert _state_of(folder / BESIDE) == before, f"reached beside the project: {case}"
        left = [path.name for path in place.iterdir() if path.name.startswith(".orip-")]
        assert not left, f"{left} left by {case}"
        codes[code] += 1
        for path in place.rglob("*"):
            if path.is_dir() and not path.is_symlink():
                path.chmod(0o700)
        shutil.rmtree(place)
    return codes


def _run(place: Path, told: Path, words: list[str]) -> tuple[int, str]:
    """Run a command in a process of its own; return its exit code, -1 if it did not end in time, and what it said."""
    child = os.fork()
    if child == 0:
        code = 97
        try:
            nowhere, stream = os.open(os.devnull, os.O_RDWR), os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for descriptor, source in ((0, nowhere), (1, stream), (2, stream)):
                os.dup2(source, descriptor)
            argv = ["orip", "-C", str(place), *words]
            with commands_put_together_once(), patch.object(sys, "argv", argv):
                orip()
        except SystemExit as end:
            code = int(end.code or 0)
        finally:
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
    code = code_in_time(child, _LONGEST)
    return code, told.read_text(encoding="utf-8", errors="replace")


def code_in_time(child: int, seconds: float) -> int:
    """Wait for a process and return its exit code; one that does not end in time is killed: -1."""
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return -1


def _state_of(folder: Path) -> dict[str, tuple[object, ...]]:
    """Return what may not change of a folder: kinds, permissions and times of all in it, and what files hold."""
    found = {}
    for path in sorted(folder.rglob("*")):
        status = path.lstat()
        content = path.read_bytes() if stat.S_ISREG(status.st_mode) else b""
        found[str(path.relative_to(folder))] = (
            status.st_ino,
            status.st_mode,
            status.st_size,
            status.st_mtime_ns,
            content,
        )
    return found


def prepare(folder: Path) -> None:
    """Write the projects that are attacked, one adjusted and one new, and what is beside them; load all commands."""
    new = film_project(folder / "new")
    for name, text in CONTROL_TEXTS.items():
        (new / name).write_text(text)
    (new / "FIRST.dump").write_text("no dump\n")
    adjusted = Path(shutil.copytree(new, folder / "adjusted"))
    assert called(adjusted, "run").code == 0
    (adjusted / "FIRST.dump").write_text("\n".join(dump(adjusted / "FIRST.PHO")) + "\n")
    beside = folder / BESIDE
    (beside / "folder").mkdir(parents=True)
    (beside / "folder" / "file.txt").write_text("of somebody else\n")
    (beside / "text.txt").write_text("of somebody else\n")
    os.mkfifo(beside / "fifo")
    (beside / "far").symlink_to("folder/file.txt")
    _load_commands(folder, adjusted)


def _load_commands(folder: Path, adjusted: Path) -> None:
    """Run all commands once, so that no attack has to load what a confined process cannot read."""
    import_module("encodings.idna")
    for number, words in enumerate((*COMMANDS, "status --json", "no such command")):
        called(Path(shutil.copytree(adjusted, folder / f"load-{number}")), *shlex.split(words))
        shutil.rmtree(folder / f"load-{number}")


def confined_attacks(how: Callable[[Path], None], count: int, seed: int, folder: Path) -> Counter[int]:
    """Attack in a process that is confined to the folder that `prepare` has filled.

    Raises
    ------
    NotAllowedError
        If this system does not allow it.
    AssertionError
        As `attacks`.
    """
    found = confined(how, folder, partial(attacks, count, seed, folder))
    return Counter({int(code): number for code, number in found.items()})


def main() -> None:
    """Attack as often as the command line says, in both ways."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    for how in (in_private_mounts, as_plain_user):
        began = time.monotonic()
        with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
            Path(folder).chmod(0o755)
            prepare(Path(folder))
            found = confined_attacks(how, count, seed, Path(folder))
        seconds = time.monotonic() - began
        print(f"{count} attacks {how.__name__} in {seconds:.0f} s, exit codes:", dict(found), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
