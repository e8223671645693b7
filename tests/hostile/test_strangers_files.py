"""Files of strangers that once harmed whoever opened them: each is refused in words, or does nothing."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import shlex
import shutil
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli.command_line import orip as called
from hostile.confinement import confined
from hostile.killing import fork
from hostile.strangers_projects import SECONDS, limit_resources, run, state_of
from support.long_cases import every, in_turn
from workflow.killed_orip import Steps
from workflow.small_projects import film_project, first_project

pytestmark = pytest.mark.skipif(os.name != "posix", reason="commands are run in forked processes with limits")

CASES = Path(__file__).parent / "cases"


class Opened:
    """A sound project on film and its owner's folder beside it."""

    def __init__(self, folder: Path, project: Path) -> None:
        self.folder, self.project, self.home = folder, project, folder / "home"
        self.home.mkdir()
        (self.home / "thesis.txt").write_text("my thesis\n")
        (self.home / "settings.json").write_text('{"token": "secret"}\n')
        self.before = state_of(self.home)

    def orip(self, words: str, place: Path | None = None) -> tuple[int, str]:
        """Run a command within its limits; it ends in words, and nothing beside the project has changed."""
        ended = ended_in_words(words, *run(place or self.project, self.folder / "told", shlex.split(words)))
        assert state_of(self.home) == self.before
        return ended

    def together(self, work: Callable[[Callable[[str], tuple[int, str]]], object]) -> None:
        """Do some work that runs commands in the project, as `orip`, all of them in one forked process."""

        def command(words: str) -> tuple[int, str]:
            signal.alarm(SECONDS)
            said = called(self.project, *shlex.split(words))
            return ended_in_words(words, said.code, said.told)

        def limit(_: Path) -> None:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            limit_resources()

        confined(limit, self.folder, lambda: work(command) and None)
        assert state_of(self.home) == self.before

    def done(self, words: str, place: Path | None = None) -> str:
        """Run a command that has to succeed."""
        code, told = self.orip(words, place)
        assert code == 0, told
        return told


def ended_in_words(words: str, code: int, told: str) -> tuple[int, str]:
    assert code in range(7), f"orip {words}: {code} {told}"
    assert not re.search("internal error|Traceback|out of memory", told), told
    assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f]", told), ascii(told)
    return code, told


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("adjusted")
    film_project(folder / "film")
    for words in ("run --no-report", "dump FIRST.PHO", "status", "--help", "export --list", "archive --help"):
        assert called(folder / "film", "-q", *words.split()).code == 0  # here, so that no child has to load all this
    return folder / "film"


@pytest.fixture
def opened(adjusted: Path, tmp_path: Path) -> Opened:
    return Opened(tmp_path, Path(shutil.copytree(adjusted, tmp_path / "project")))


def put_hot_journal(store: Path, super_journal: str) -> None:
    """Write a journal without pages that is to be rolled back, and whose super-journal SQLite then removes."""
    magic, page, name = bytes.fromhex("d9d505f920a163d7"), 4096, super_journal.encode()
    head = magic + struct.pack(">5I", 0, 0x12345678, store.stat().st_size // page, 512, page)
    total = sum(byte if byte < 128 else byte - 256 for byte in name) & 0xFFFFFFFF
    end = struct.pack(">I", 0x40000000 // page + 1) + name + struct.pack(">II", len(name), total) + magic
    store.with_name(f"{store.name}-journal").write_bytes(head.ljust(512, b"\0") + end)


@pytest.mark.parametrize("words", ["status", "run --no-report", "dump FIRST.PHO", "photo edit left X0=1071"])
@pytest.mark.parametrize("is_absolute", [True, False])
def test_a_hot_journal_deletes_no_file_beside_the_project(
    opened: Opened, words: str, is_absolute: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    victim = opened.home / "thesis.txt"
    name = str(victim) if is_absolute else os.path.relpath(victim, opened.project)
    put_hot_journal(opened.project / "FIRST.PHO", name)
    monkeypatch.chdir(opened.project)  # SQLite takes the name from where orip was started
    opened.orip(words)


@pytest.mark.parametrize("words", ["status", "solve --no-report", "dump CAMERAS.CAM", "camera edit C35 c=35.3"])
@pytest.mark.parametrize("is_absolute", [True, False])
def test_an_undo_file_deletes_no_file_beside_the_project(opened: Opened, words: str, is_absolute: bool) -> None:
    store, victim = opened.project / "CAMERAS.CAM", opened.home / "settings.json"
    pact = str(victim) if is_absolute else os.path.relpath(victim, opened.project)
    put_undo(store, pact)
    opened.orip(words)


def put_undo(store: Path, pact: str) -> None:
    """Write a copy of a store as of a transaction that was not finished."""
    content = store.read_bytes()
    head = json.dumps({"pact": pact, "sha256": hashlib.sha256(content).hexdigest()})
    store.with_name(f"{store.name}-undo").write_bytes(head.encode() + b"\n" + content)


def test_an_undo_file_deletes_no_other_file_of_the_project(opened: Opened) -> None:
    notes = opened.project / "notes.json"
    notes.write_text('["mine"]')
    put_undo(opened.project / "CAMERAS.CAM", "notes.json")
    opened.orip("status")
    assert notes.read_text() == '["mine"]'


def test_sub_blocks_that_are_a_link_delete_no_folders(opened: Opened) -> None:
    pytest.importorskip("distributed")
    (opened.home / "Documents").mkdir()
    (opened.home / "Documents" / "thesis.txt").write_text("precious\n")
    opened.before = state_of(opened.home)
    (opened.project / ".orip-sub-blocks").symlink_to("../home")
    told = _program(opened.project, "solve", "--no-report", "--dask", "local", "--workers", "1")
    assert "internal error" not in told
    assert state_of(opened.home) == opened.before


@pytest.mark.long
def test_sub_blocks_that_somebody_changed_are_not_taken(opened: Opened) -> None:
    pytest.importorskip("distributed")
    words = ("solve", "--no-report", "--dask", "local", "--workers", "1")
    _program(opened.project, *words)
    before = _figures(opened.project)
    (file,) = opened.project.glob(".orip-sub-blocks/*/000000.npz")
    with np.load(file) as arrays:
        changed = dict(arrays)
    changed["xy"] = changed["xy"] + 0.5
    with file.open("wb") as stream:
        np.savez(stream, allow_pickle=False, **changed)
    told = _program(opened.project, *words)
    assert _figures(opened.project) == before, told


def _figures(project: Path) -> list[str]:
    with (project / "residuals.csv").open(encoding="utf-8") as stream:
        return stream.read().splitlines()[1:]


def _program(project: Path, *words: str) -> str:
    """Run orip as a program of its own, as Dask's workers need it."""
    ended = subprocess.run(
        [sys.executable, "-m", "orip", "-C", str(project), *words],
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )
    return ended.stdout + ended.stderr


@pytest.mark.parametrize(
    "name", every(3, ["../../../stolen", "../home/stolen", "..", "{home}/stolen", "a/b", "", "a\0b"])
)
def test_names_of_an_imported_camera_write_nothing_beside_the_copy(opened: Opened, name: str) -> None:
    first = first_project(opened.folder / "first")
    opened.done("-q run --no-report", first)
    opened.done("-q export micmac ../Ori-Z", first)
    (opened.home / "stolen.xml").write_text("precious\n")
    opened.before = state_of(opened.home)
    rows = io.StringIO()
    table = csv.writer(rows)
    table.writerows(
        [("kind", "orip", "original"), ("camera", "D1", name.format(home=opened.home)), ("photo", "left", name)]
    )
    for camera in re.findall(r'^name = "([^"]*)"', (first / "orip.toml").read_text(), re.MULTILINE):
        table.writerow(("camera", camera, name.format(home=opened.home)))
    (first / "names.csv").write_text(rows.getvalue())
    (first / "exchange.toml").write_text('[source]\nformat = "micmac"\npath = "../Ori-Z"\n')
    beside = _names_beside(opened.folder)
    opened.orip("export micmac ../out", first)
    assert _names_beside(opened.folder) - beside <= {"out"}
    assert not (opened.folder.parent / "stolen.xml").exists()


def _names_beside(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir() if not path.name.startswith("told")}


def test_photos_with_a_zero_character_in_their_original_name_are_exported_or_refused(opened: Opened) -> None:
    (opened.project / "names.csv").write_text(
        'kind,orip,original\nphoto,left,"a\0b"\npoint,P1,"a\0b"\ncamera,C35,"a\0b"\n'
    )
    forms = ("micmac", "colmap", "opensfm", "bundler", "bingo", "patb", "csv")
    opened.together(lambda orip: [orip(f"export {form} out-{form}") for form in forms])


@pytest.mark.parametrize(
    ("form", "text"),
    in_turn(
        ["geojson", "dxf", "bal", "nvm", "openmvg", "alicevision", "geopackage", "blocks", "metashape"],
        ["orip.toml", "FIRST.PNT", "FIRST.MEA", "FIRST.PHO", "result.json"],
    ),
)
def test_an_export_does_not_take_the_place_of_a_text_of_the_project(opened: Opened, form: str, text: str) -> None:
    before = (opened.project / text).read_bytes()
    code, told = opened.orip(f"export {form} {text}")
    assert (opened.project / text).read_bytes() == before, told
    assert code != 0, told


def test_an_image_whose_name_is_not_utf8_is_named(opened: Opened) -> None:
    place = opened.folder / "images"
    place.mkdir()
    for name in (b"\xff\xfe.jpg", b"a.jpg", b"\x1b[2J.jpg"):
        Path(os.fsdecode(os.fsencode(place) + b"/" + name)).write_bytes(_jpeg())
    opened.orip("photos images out", opened.folder)


def _jpeg() -> bytes:
    """Return the head of a picture of 40 by 30 pixels, which is all that is read."""
    frame = b"\xff\xc0" + struct.pack(">HBHHB", 11, 8, 30, 40, 1) + b"\x01\x11\0"
    return b"\xff\xd8" + frame + b"\xff\xd9"


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 2**200])
@pytest.mark.parametrize("key", ["row", "column"])
def test_a_row_of_a_model_beyond_64_bits_is_refused(opened: Opened, key: str, value: int) -> None:
    other = "column" if key == "row" else "row"
    with (opened.project / "orip.toml").open("a") as text:
        text.write(f'\n[[bundle.model]]\nname = "M"\nleft = "left"\nright = "right"\n{key} = {value}\n{other} = 1\n')
    code, told = opened.orip("init")
    assert code != 0
    assert "orip.toml:" in told, told


def test_a_long_dotted_key_takes_no_gigabytes(opened: Opened) -> None:
    for text in (".".join("a" for _ in range(40_000)) + " = 1", "x = " + "[" * 100_000,
                 "[" + ".".join("a" * 40_000) + "]", "".join(f"[a{n}.b.c.d.e.f]\n" for n in range(40_000)),
                 "x = " + "{a=" * 20_000, "x = {" + ".".join("a" * 40_000) + " = 1}"):  # fmt: skip
        path = opened.project / "orip.toml"
        before = path.read_text()
        path.write_text(f"{before}\n{text}\n")
        began = time.monotonic()
        code, told = opened.orip("init")
        assert code != 0, told
        assert time.monotonic() - began < 20
        path.write_text(before)
    (opened.project / "exchange.toml").write_text(".".join("a" for _ in range(40_000)) + " = 1\n")
    opened.orip("export csv tables")
    opened.orip("export")


def test_a_name_of_megabytes_is_told_in_a_few_lines(opened: Opened) -> None:
    with (opened.project / "FIRST.MEA").open("a") as text:
        text.write(f"POINTS MAIN {'x' * 3_000_000}\n  1 2 3\n")
    code, told = opened.orip("init")
    assert code == 3
    assert len(told) < 10_000
    assert "FIRST.MEA:" in told


@pytest.mark.parametrize("words", ["archive report r", "archive status r", "archive run . --out r --workers 1"])
@pytest.mark.parametrize("name", ["archive.json", "archive.lock", "index.html", "finished/1/1.json", "tables"])
def test_an_archive_with_a_pipe_is_not_waited_for(opened: Opened, words: str, name: str) -> None:
    pytest.importorskip("pyarrow")
    if "run" in words and name not in ("archive.json", "archive.lock"):
        pytest.skip("a run comes to these after it has started its workers")
    path = opened.folder / "empty" / "r" / name
    path.parent.mkdir(parents=True)
    os.mkfifo(path)
    if name != "archive.json":
        plan = {"schema": "orip.archive/1", "base": "/", "projects": ["p"], "settings": "0", "method": "m", "orip": "0",
                "dashboard": "", "began": 1.0}  # fmt: skip
        (opened.folder / "empty" / "r" / "archive.json").write_text(json.dumps(plan))
    opened.orip(words, opened.folder / "empty")


@pytest.mark.parametrize(
    "reconstruction",
    [
        {"points": "x"}, {"points": ["a"]}, {"points": {"1": "x"}}, {"points": 1}, {"shots": "x"}, {"shots": ["a"]},
        {"cameras": "x"}, {"cameras": {"c": 1}}, {"shots": {"a.jpg": 1}}, {"points": {"1": {"coordinates": "abc"}}},
        {"shots": {"\ud800.jpg": {"rotation": [3.14, 0, 0], "translation": [0, 0, 10], "camera": "c"}}},
        {"reference_lla": "x"}, {"points": {"\ud800": {"coordinates": [0, 0, 0]}}}, {"rig_cameras": "x"},
    ],
)  # fmt: skip
def test_a_reconstruction_of_other_types_or_with_half_a_character_is_refused(
    opened: Opened, reconstruction: Any
) -> None:
    place = opened.folder / "sfm"
    place.mkdir()
    camera = {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.8, "k1": 0.0, "k2": 0.0}
    shots = {f"{n}.jpg": {"rotation": [3.14, 0, 0], "translation": [n, 0, 10], "camera": "c"} for n in (0, 1)}
    sound = {"cameras": {"c": camera}, "shots": shots, "points": {}}
    (place / "reconstruction.json").write_text(json.dumps([{**sound, **reconstruction}]))
    (place / "tracks.csv").write_text("OPENSFM_TRACKS_VERSION_v2\n" + "".join(
        f"{n}.jpg\t{t}\t{t}\t{0.1 * t - 0.05 * n}\t{0.03 * t}\t0.001\t1\t2\t3\t-1\t-1\n"
        for n in (0, 1) for t in range(6)
    ))  # fmt: skip
    opened.orip("import opensfm sfm new", opened.folder)


def test_a_project_whose_measurements_are_in_one_place_is_refused(opened: Opened) -> None:
    shutil.copytree(CASES / "gubaio", opened.folder / "source")
    opened.orip("adjust --frame 4000x3000 --exact-distortion gubaio source out", opened.folder)


@pytest.mark.parametrize("begin", every(6, range(6)))
@pytest.mark.parametrize(("store", "value"), in_turn(("MAIN.EXO", "CAMERAS.CAM", "FIRST.PHO"), (0, 0x63, 0xFF)))
def test_a_store_of_another_format_of_sqlite_is_damaged(opened: Opened, store: str, value: int, begin: int) -> None:
    path = opened.project / store
    whole = path.read_bytes()

    def dump_damaged(orip: Callable[[str], object]) -> None:
        for place in range(17 + begin, 100, 6):  # the head of the file, where 44 to 47 are the format of the schema
            path.write_bytes(whole[:place] + bytes([value]) + whole[place + 1 :])
            orip(f"dump {store}")

    opened.together(dump_damaged)


@pytest.mark.parametrize("store", every(4, ["FIRST.PHO", "MAIN.EXO", "CAMERAS.CAM", "FIRST.TEM"]))
def test_a_store_whose_pages_were_swapped_is_damaged(opened: Opened, store: str) -> None:
    path = opened.project / store
    whole = path.read_bytes()
    pages = [whole[at : at + 4096] for at in range(0, len(whole), 4096)]
    sound = opened.done(f"dump {store}")

    def dump_swapped(orip: Callable[[str], tuple[int, str]]) -> None:
        for one in range(1, len(pages)):
            for other in range(one + 1, min(len(pages), one + 4)):
                swapped = list(pages)
                swapped[one], swapped[other] = swapped[other], swapped[one]
                path.write_bytes(b"".join(swapped))
                code, told = orip(f"dump {store}")
                assert code != 0 or told == sound

    opened.together(dump_swapped)


@pytest.mark.parametrize("case", ["no-control-affinity", "tiny-control"])
def test_a_block_of_which_nothing_is_determined_has_not_converged(opened: Opened, case: str) -> None:
    place = Path(shutil.copytree(CASES / case, opened.folder / case))
    code, told = opened.orip("run", place)
    assert code == 4, told


@pytest.mark.parametrize(
    ("name", "old"),
    in_turn(
        ["../home/stolen", "a/b", "..", "a\0b", "\x1b[2J", "\ud800", "n" * 100_000, ""], ['"left"', '"C35"', '"FIRST"']
    ),
)
def test_names_of_a_loaded_dump_are_names(opened: Opened, name: str, old: str) -> None:
    dump = opened.done("dump FIRST.PHO")
    (opened.project / "FIRST.dump").write_text(dump.replace(old, json.dumps(name)))
    commands = (
        *("load FIRST.PHO FIRST.dump", "photo list", "status", "solve --no-report", "export csv tables"),
        "export-toml --output new.toml",
    )
    opened.together(lambda orip: [orip(words) for words in commands])


def test_an_import_into_an_empty_folder_that_was_killed_can_be_repeated(opened: Opened) -> None:
    first = first_project(opened.folder / "first")
    opened.done("-q run --no-report", first)
    opened.done("-q export colmap model", first)
    for step in range(1, 40):
        (first / "out").mkdir()
        status = fork(first, ("import", "colmap", "model", "out"), Steps(step))
        if not os.WIFSIGNALED(status):
            break
        opened.done("import colmap model out", first)
        assert not [path.name for path in (first / "out").iterdir() if path.name.endswith(".tmp")]
        shutil.rmtree(first / "out")
    assert step > 5


@contextmanager
def served(project: Path, *words: str) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """Run a server of orip's, and return it with its port."""
    server = subprocess.Popen(
        [sys.executable, "-u", "-m", "orip", "-C", str(project), *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    assert server.stdout is not None
    try:
        found = None
        while found is None:
            line = server.stdout.readline()
            assert line, "the server has ended"
            found = re.search(r"127\.0\.0\.1:(\d+)", line)
        yield server, int(found[1])
    finally:
        server.kill()
        server.wait()
        server.stdout.close()


def _posted(port: int, body: bytes) -> bytes:
    """Send what a page of another site may let a browser send; return what is answered."""
    head = (
        f"POST / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUser-Agent: Mozilla/5.0\r\nOrigin: http://evil.example\r\n"
        f"Content-Type: text/plain;charset=UTF-8\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    answer = b""
    with socket.create_connection(("127.0.0.1", port)) as stream, suppress(OSError):
        stream.settimeout(3)
        stream.sendall(head.encode() + body)
        while data := stream.recv(1 << 16):
            answer += data
    return answer


def test_a_web_page_measures_nothing_in_a_session(opened: Opened) -> None:
    with served(opened.project, "online", "--listen", "127.0.0.1:0") as (_, port):
        _posted(port, b'{"do": "measure", "photo": "left", "point": "9999", "x": 104.0, "y": 100.0}\n')
        edits = opened.project / "EDITS.MEA"
        assert not edits.exists() or "9999" not in edits.read_text()


def test_a_web_page_moves_no_plate(opened: Opened) -> None:
    with served(opened.project, "drive", "emulate", "--listen", "127.0.0.1:0") as (_, port):
        _posted(port, b"OPERATE\nMOVE 1 2\nSTATUS\n")
        with socket.create_connection(("127.0.0.1", port)) as stream:
            stream.settimeout(3)
            stream.sendall(b"STATUS\n")
            told = stream.recv(1 << 16)
        assert b"OPERATING" not in told, told


@pytest.mark.parametrize("length", every(3, [70_000, 5000, 1_200_000]))
def test_a_long_line_hangs_no_session(opened: Opened, length: int) -> None:
    with served(opened.project, "online", "--listen", "127.0.0.1:0") as (server, port):
        with closing(socket.create_connection(("127.0.0.1", port))) as sound, sound.makefile("rb") as replies:
            sound.settimeout(8)
            replies.readline()
            with closing(socket.create_connection(("127.0.0.1", port))) as other, suppress(OSError):
                for _ in range(2):
                    other.sendall(b"A" * length)
                    time.sleep(0.3)
                other.sendall(b"\n")
                time.sleep(0.3)
            sound.sendall(b'{"do":"show"}\n')
            assert replies.readline(), "the other program is not answered any more"
        server.send_signal(signal.SIGINT)
        server.wait(10)


def _projects(folder: Path, count: int) -> Path:
    (folder / "surveys").mkdir()
    for number in range(count):
        first_project(folder / "surveys" / f"p{number}")
    return folder / "surveys"


def _children(process: int, words: str) -> list[int]:
    """Return the children of a process, and theirs, that have words in their command line."""
    parents: dict[int, list[int]] = {}
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            with suppress(OSError, IndexError, ValueError):
                parents.setdefault(int((entry / "stat").read_text().rpartition(")")[2].split()[1]), []).append(
                    int(entry.name)
                )
    found, waiting = [], [process]
    while waiting:
        waiting += (children := parents.get(waiting.pop(), []))
        found += children
    return [one for one in found if words in _command_line(one)]


def _command_line(process: int) -> str:
    with suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_text()
    return ""


@contextmanager
def archive_running(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Run an archive of a few projects on one worker."""
    words = (
        "archive",
        "run",
        str(_projects(folder, 3)),
        "--workers",
        "1",
        "--no-report",
        "--out",
        str(folder / "results"),
    )
    running = subprocess.Popen(
        [sys.executable, "-m", "orip", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        yield running
    finally:
        running.kill()
        running.wait()
        running.stdout.close()  # type: ignore[union-attr]


def _until(look: Callable[[], Any], seconds: float = 30) -> Any:
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        if found := look():
            return found
        time.sleep(0.02)
    return look()


@pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")
@pytest.mark.timeout(120)
def test_an_archive_whose_worker_is_killed_at_its_start_goes_on_or_says_so(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with archive_running(tmp_path) as running:
        for worker in _until(lambda: _children(running.pid, "spawn_main")):
            os.kill(worker, signal.SIGKILL)
        told, _ = running.communicate(timeout=100)
    assert "internal error" not in told, told
    assert "Traceback" not in told, told


_CLIENT = """
import logging, sys
logging.disable(50)
from distributed import Client
try:
    print("ran", Client(f"tcp://127.0.0.1:{sys.argv[1]}", timeout=3).run_on_scheduler(lambda: 7))
except BaseException as error:
    print("refused", type(error).__name__)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="ports are found in /proc")
@pytest.mark.timeout(120)
@pytest.mark.long
def test_another_user_runs_nothing_on_the_scheduler_of_an_archive(tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    with archive_running(tmp_path) as running:
        _until(lambda: _children(running.pid, "spawn_main"))
        ports = _ports([running.pid, *_children(running.pid, "")])
        told = [
            subprocess.run(
                [sys.executable, "-c", _CLIENT, str(port)], capture_output=True, text=True, timeout=60, check=False
            ).stdout
            for port in sorted(ports)
        ]
    assert not [line for line in told if "ran" in line], told


def _ports(processes: list[int]) -> set[int]:
    """Return the TCP ports on which processes listen."""
    sockets = set()
    for process in processes:
        with suppress(OSError):
            for descriptor in Path(f"/proc/{process}/fd").iterdir():
                with suppress(OSError):
                    sockets.add(str(descriptor.readlink()))
    lines = Path("/proc/net/tcp").read_text().splitlines()[1:]
    listening = [line.split() for line in lines if line.split()[3] == "0A"]
    return {int(fields[1].split(":")[1], 16) for fields in listening if f"socket:[{fields[9]}]" in sockets}
