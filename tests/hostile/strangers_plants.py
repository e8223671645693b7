"""What a stranger can put into a project folder: journals, copies, views, links and names that lead elsewhere."""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import random
import shutil
import sqlite3
import stat
import struct
import zipfile
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path

from hostile.path_attacks import ANYWHERE, OUTPUTS, TEXTS

HOME = "home"
"""The folder beside the project: what its owner has there may not change."""

STORES = ("CAMERAS.CAM", "TEMTICKS.TIK", "FIRST.PHO", "FIRST.TEM", "FIRST.EXT", "MAIN.EXO")
ENDS = ("-journal", "-wal", "-shm", "-undo", "-pact", "-mj12345678", "-mj0123456789ABCDEF")
TEMPORARY = ".orip-0123abcd-999999999-1-0123456789abcdef.tmp"
"""The name of what a run on another host has left."""

BELOW = (
    ".orip-sub-blocks", ".orip-sub-blocks/{}", ".orip-sub-blocks/{}/000000.npz", ".orip-sub-blocks/{}/complete",
    f".orip-sub-blocks/{TEMPORARY}", "results", "results/archive.json", "results/archive.lock", "results/finished",
    "results/finished/{}", "results/tables", "results/tables/points", "results/index.html", "older-stores",
)  # fmt: skip
OTHERS = ("names.csv", "exchange.toml", ".gitignore", "before_update.json", TEMPORARY, "residuals.npz", "state", "out")
NAMES = (*TEXTS, *OUTPUTS, *STORES, *OTHERS, *(f"{name}{end}" for name in STORES for end in ENDS))

VICTIMS = (
    "thesis.txt", "settings.json", "list.json", "stores.json", ".config/settings.json", "FIRST.PHO-mj12345678",
    "MAIN.EXO", "MAIN.EXO-journal", "CAMERAS.CAM-undo", "stolen.xml", "Documents", "Documents/thesis.txt", TEMPORARY,
    "complete", "neighbour/orip.toml", "gone.txt",
)  # fmt: skip
FOREIGN = {
    "diary.txt": b"mine\n", "notes.json": b'{"mine": true}', "FIRST.PHO.copy": b"mine", "MAIN.EXO-mine": b"mine",
    "FIRST.PHO-mj1": b"mine", ".orip-notes.tmp": b"mine", "photos/101.jpg": b"\xff\xd8mine", "result.json.old": b"[]",
    ".orip-sub-blocks/mine.txt": b"mine", "results/mine.txt": b"mine", "FIRST.PHO-undo.txt": b"mine",
}  # fmt: skip
"""What orip did not make, in the project: it stays as it is."""

HOSTILE_NAMES = (
    "../home/stolen", "/dev/shm/orip-stolen", "..", ".", "a/b", "a\\b", "a\0b", "n" * 300, "\x1b[2J\x1b]0;t\x07",
    "\u202e",
    "\x9b31m", "\ud800", "CON", "-rf", "", " ", "../../../../../../home/stolen", "MAIN.EXO", "a\nb", "a\rb", "%s%n{0}",
    "<script>alert(1)</script>",
)  # fmt: skip

Plant = Callable[[Path, random.Random], str]


def plant(project: Path, chance: random.Random) -> str:
    """Put one thing into a project, and say what."""
    try:
        return chance.choice(PLANTS)(project, chance)
    except PermissionError as error:  # another plant has taken the permission away
        return f"nothing: {error.filename} may not be written"


def _name_taken(project: Path, chance: random.Random) -> str:
    """Put a link, a pipe, a device, a folder or a huge file in the place of any name of orip's."""
    name = chance.choice(chance.choice((NAMES, BELOW))).format(_first_below(project))
    path = project / name
    if not path.parent.is_dir() or not path.parent.resolve().is_relative_to(project.resolve()):
        return f"{name}: cannot be"
    _remove(path)
    if chance.random() < 0.5:
        ANYWHERE[chance.randrange(len(ANYWHERE))](path)
    else:
        target = project.parent / HOME / chance.choice(VICTIMS)
        path.symlink_to(target if chance.random() < 0.5 else os.path.relpath(target, path.parent))
    kind = f"link to {path.readlink()}" if path.is_symlink() else stat.filemode(path.lstat().st_mode)
    return f"{name}: {kind}"


def _second_name(project: Path, chance: random.Random) -> str:
    """Give a file beside the project a second name in it, where orip puts a new file in place of an old one."""
    name = chance.choice((*OUTPUTS[:6], *OTHERS[:4], "FIRST.PHO-undo", "FIRST.PHO-pact", "MAIN.EXO-mj12345678"))
    path = project / name
    _remove(path)
    os.link(project.parent / HOME / "settings.json", path)
    return f"{name}: second name of settings.json"


def _hot_journal(project: Path, chance: random.Random) -> str:
    """Write a journal of SQLite's that is to be rolled back, with a page of its own or the name of a super-journal."""
    store, page = project / chance.choice(STORES), 4096
    if not _is_own(store):
        return f"{store.name}: no journal"
    pages = store.stat().st_size // page
    data, count, said = b"", 0, "nothing"
    if chance.random() < 0.6:
        number = chance.randint(1, max(pages, 1))
        content = bytes(chance.choice((b"\0", b"\x0d", b"S"))) * page
        content = (
            (content + bytes(page))[:page] if chance.random() < 0.5 else _page_of(store, chance.randint(1, number))
        )
        total = (0x12345678 + sum(content[at] for at in range(page - 200, 0, -200))) & 0xFFFFFFFF
        data, count, said = struct.pack(">I", number) + content + struct.pack(">I", total), 1, f"page {number}"
    before = chance.choice((pages, 1, max(pages - 1, 1)))
    head = bytes.fromhex("d9d505f920a163d7") + struct.pack(">5I", count, 0x12345678, before, 512, page)
    if chance.random() < 0.7:
        victim = project.parent / HOME / chance.choice(VICTIMS)
        name = str(victim if chance.random() < 0.5 else os.path.relpath(victim, project)).encode()
        signed = sum(byte if byte < 128 else byte - 256 for byte in name) & 0xFFFFFFFF
        data += struct.pack(">I", 0x40000000 // page + 1) + name + struct.pack(">II", len(name), signed) + head[:8]
        said += f", super-journal {name.decode()}"
    _put(store.with_name(f"{store.name}-journal"), head.ljust(512, b"\0") + data)
    return f"{store.name}-journal: {said}, {before} of {pages} pages"


def _log_ahead(project: Path, chance: random.Random) -> str:
    """Leave a store with a write-ahead log of a transaction that nobody has checked."""
    store = project / chance.choice(STORES)
    if not _is_own(store):
        return f"{store.name}: no log"
    work = project.parent / "log-ahead"
    shutil.copyfile(store, work)
    with suppress(sqlite3.Error), closing(sqlite3.connect(work)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("CREATE TABLE planted (x)")
        connection.commit()
        kept = {end: Path(f"{work}{end}").read_bytes() for end in ("-wal", "-shm") if Path(f"{work}{end}").exists()}
        if chance.random() < 0.6:
            store.write_bytes(work.read_bytes())
        for end, content in kept.items():
            _put(store.with_name(store.name + end), content)
    for end in ("", "-wal", "-shm", "-journal"):
        Path(f"{work}{end}").unlink(missing_ok=True)
    return f"{store.name}-wal"


def _undo(project: Path, chance: random.Random) -> str:
    """Write a copy of a store that names a pact, or a pact that lists stores, elsewhere."""
    store = project / chance.choice(STORES)
    victim = project.parent / HOME / chance.choice(VICTIMS)
    name = str(victim) if chance.random() < 0.5 else os.path.relpath(victim, project)
    if chance.random() < 0.3:
        name = chance.choice((f"{STORES[0]}-pact", store.name, "notes.json", "orip.toml", "result.json", "/dev/zero"))
    content = store.read_bytes() if _is_own(store) and chance.random() < 0.7 else chance.choice((b"", b"not a store"))
    head = {"pact": name, "sha256": hashlib.sha256(content).hexdigest()}
    _put(store.with_name(f"{store.name}-undo"), json.dumps(head).encode() + b"\n" + content)
    said = f"{store.name}-undo of {name}"
    if chance.random() < 0.5:
        listed = [store.name, os.path.relpath(project.parent / HOME / "MAIN.EXO", project), str(victim), "notes.json"]
        shape = chance.choice((listed, listed[1:], {"a": 1}, "text", [1, 2], [["x"]], None))
        pact = project / f"{chance.choice((store.name, STORES[0]))}-pact"
        _put(pact, json.dumps(shape).encode())
        said += f", {pact.name} {shape}"
    return said


def _super_journal(project: Path, chance: random.Random) -> str:
    """Write an orphaned super-journal that lists journals elsewhere."""
    store = project / chance.choice(STORES)
    home = project.parent / HOME
    names = [str(home / name) for name in ("MAIN.EXO-journal", "thesis.txt", "pipe-journal")]
    _put(store.with_name(f"{store.name}-mj12345678"), "\0".join([*names, ""]).encode())
    return f"{store.name}-mj12345678 of {names}"


def _damaged_store(project: Path, chance: random.Random) -> str:
    """Flip bytes of a store, swap or repeat its pages, or cut it."""
    store = project / chance.choice(STORES)
    if not _is_own(store) or store.stat().st_size < 8192:
        return f"{store.name}: not damaged"
    data, how = bytearray(store.read_bytes()), chance.choice(("header", "bytes", "swap", "repeat", "cut"))
    pages = len(data) // 4096
    one, other = chance.randrange(pages), chance.randrange(1, pages)
    if how == "header":
        at = chance.randrange(16, 100)
        data[at] = chance.choice((0, 1, 0x63, 0xFF))
        how = f"byte {at} is {data[at]}"
    elif how == "bytes":
        for at in (chance.randrange(len(data)) for _ in range(chance.choice((1, 5, 50)))):
            data[at] ^= 1 << chance.randrange(8)
    elif how == "cut":
        del data[one * 4096 + chance.choice((0, 1, 2048)) :]
    else:
        first, second = slice(one * 4096, one * 4096 + 4096), slice(other * 4096, other * 4096 + 4096)
        kept = data[second]
        data[second] = data[first]
        if how == "swap":
            data[first] = kept
        how += f" {one} {other}"
    store.write_bytes(data)
    return f"{store.name}: {how}"


_ENDLESS = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r)"


def _schema(project: Path, chance: random.Random) -> str:
    """Give a store a view that never ends, a trigger, or a table of another shape."""
    store = project / chance.choice(STORES)
    if not _is_own(store):
        return f"{store.name}: no view"
    work = project.parent / "changed"  # beside its journal SQLite would obey it
    shutil.copyfile(store, work)
    said = "no view"
    with suppress(sqlite3.Error), closing(sqlite3.connect(work)) as connection:
        tables = [row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = chance.choice(tables)
        columns = [row[1] for row in connection.execute(f"PRAGMA table_info('{table}')")]
        listed = ", ".join(f'1 AS "{name}"' for name in columns)
        statement = chance.choice(
            (
                f'ALTER TABLE "{table}" RENAME TO kept; CREATE VIEW "{table}" AS {_ENDLESS} SELECT {listed} FROM r',
                f'ALTER TABLE "{table}" RENAME TO kept; CREATE VIEW "{table}" AS SELECT * FROM kept',
                f"CREATE VIEW more AS {_ENDLESS} SELECT n FROM r",
                f'CREATE TRIGGER more AFTER INSERT ON "{table}" BEGIN DELETE FROM "{table}"; END',
                f'CREATE TRIGGER more BEFORE DELETE ON "{table}" BEGIN DELETE FROM kept; END',
                f'DROP TABLE "{table}"; CREATE TABLE "{table}" (x)',
                f'ALTER TABLE "{table}" ADD COLUMN more DEFAULT (zeroblob(1000000000))',
                f'UPDATE "{table}" SET "{columns[-1]}" = zeroblob(900000000)',
                f'CREATE INDEX more ON "{table}" ("{columns[0]}")',
                f'UPDATE "{table}" SET "{columns[0]}" = char(27, 91, 50, 74)',
            )
        )
        connection.executescript(statement)
        connection.commit()
        said = statement[:150]
        store.write_bytes(work.read_bytes())
    for end in ("", "-journal"):
        Path(f"{work}{end}").unlink(missing_ok=True)
    return f"{store.name}: {said}"


class _Runs:
    """What unpickles itself by running something."""

    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[object, ...]:
        return os.system, (self.command,)


def _pickled(project: Path, chance: random.Random) -> str:
    """Put a pickle in the place of a file of arrays, or a text."""
    content = pickle.dumps(_Runs(f"echo run > '{project.parent / HOME / 'thesis.txt'}'"))
    names = (
        ".orip-sub-blocks/{}/000000.npz",
        "residuals.npz",
        "before_update.json",
        "result.json",
        "results/archive.json",
    )
    name = chance.choice(names).format(_first_below(project))
    path = project / name
    if path.parent.is_dir() and path.parent.resolve().is_relative_to(project.resolve()):
        _put(path, content)
        if path.suffix == ".npz" and chance.random() < 0.5:
            with zipfile.ZipFile(path, "w") as archive:
                archive.writestr(
                    "xy.npy",
                    b"\x93NUMPY\x01\0\x46\0" + b"{'descr':'|O','fortran_order':False,'shape':(1,)}".ljust(70) + content,
                )
    return f"{name}: pickle"


def _named(project: Path, chance: random.Random) -> str:
    """Let a text of the project name something hostile."""
    name, toml = chance.choice(HOSTILE_NAMES), project / "orip.toml"
    kind = chance.choice(("project", "bundle", "camera", "photo", "names", "source", "key", "dump", "log", "control"))
    quoted = json.dumps(name.encode("utf-8", "replace").decode())
    said = f"{kind} {name[:40]!r}"
    if kind in ("project", "bundle", "camera", "photo") and _is_own(toml):
        old = {"project": '"FIRST"', "bundle": '"MAIN"', "camera": '"C35"', "photo": '"left"'}[kind]
        toml.write_text(toml.read_text().replace(old, quoted.replace("\\u202e", "\u202e")))
    elif kind == "names":
        rows = "".join(
            f'{kind},{orip},"{name}"\n' for kind, orip in (("camera", "C35"), ("photo", "left"), ("point", "P1"))
        )
        _put(
            project / "names.csv",
            f"kind,orip,original\n{rows}".encode("utf-8", "surrogateescape" if name != "\ud800" else "replace"),
        )
    elif kind == "source":
        form = chance.choice(
            ("colmap", "micmac", "opensfm", "blocks", "nvm", "bundler", "bingo", "patb", "bal", "openmvg", "csv")
        )
        place = chance.choice(
            ("../home", "/", "/dev/zero", "../home/pipe", "../home/thesis.txt", "../home/Documents", ".")
        )
        _put(project / "exchange.toml", f'[source]\nformat = "{form}"\npath = {json.dumps(place)}\n'.encode())
        said = f"exchange.toml {form} {place}"
    elif kind == "key" and _is_own(toml):
        key = chance.choice(("camera_file", "temtick_file", "project_files", "output_folder", "control_files"))
        value = chance.choice(('"../home/"', '"../home/MAIN"', '"/dev/shm"', quoted, '"results"', '".orip-sub-blocks"'))
        toml.write_text(toml.read_text().replace('name = "FIRST"', f'name = "FIRST", {key} = {value}', 1))
        said = f"{key} = {value}"
    elif kind == "dump" and _is_own(project / "FIRST.dump"):
        text = (project / "FIRST.dump").read_text()
        (project / "FIRST.dump").write_text(
            text.replace(chance.choice(('"left"', '"C35"', '"FIRST"')), json.dumps(name))
        )
    elif kind in ("log", "control"):
        path = project / {"log": chance.choice(("FIRST.MEA", "EDITS.MEA")), "control": "FIRST.PNT"}[kind]
        if _is_own(path):
            path.write_bytes(path.read_bytes() + f"{name} 1 2 3 1 1 1\n".encode("utf-8", "surrogatepass"))
    return said


def _permissions(project: Path, chance: random.Random) -> str:
    """Take permissions of a file or folder away, or let it run with those of its owner."""
    found = sorted(path for path in (project, *project.rglob("*")) if not path.is_symlink())
    path, mode = chance.choice(found), chance.choice((0, 0o400, 0o500, 0o555, 0o4755, 0o6777, 0o2777, 0o1777))
    status = path.lstat()
    if path.is_dir() or (stat.S_ISREG(status.st_mode) and status.st_nlink == 1):
        with suppress(OSError):
            path.chmod(mode)
    return f"{path.relative_to(project)}: {mode:o}"


def _sparse(project: Path, chance: random.Random) -> str:
    """Let a file that is read be large without taking room."""
    name = chance.choice(
        (
            *TEXTS,
            *STORES,
            "result.json",
            "names.csv",
            "exchange.toml",
            "before_update.json",
            "MAIN.DRV",
            "CAMERAS.CAM-undo",
            "CAMERAS.CAM-pact",
            "FIRST.PHO-journal",
            "CAMERAS.CAM-mj12345678",
        )
    )
    size = chance.choice((1 << 24, 1 << 28, (1 << 30) - 1))
    path = project / name
    if not path.exists() or _is_own(path):
        with path.open("ab") as stream:
            stream.truncate(size)
    return f"{name}: {size} bytes"


PLANTS: tuple[Plant, ...] = (
    _name_taken, _name_taken, _name_taken, _name_taken, _second_name, _hot_journal, _hot_journal, _log_ahead, _undo,
    _undo, _super_journal, _damaged_store, _damaged_store, _schema, _pickled, _named, _named, _named, _permissions,
    _sparse,
)  # fmt: skip


def _first_below(project: Path) -> str:
    with suppress(OSError):
        for path in sorted((project / ".orip-sub-blocks").iterdir()):
            if not path.name.startswith((".", "mine")):
                return path.name
    return "1"


def _page_of(store: Path, number: int) -> bytes:
    return store.read_bytes()[(number - 1) * 4096 : number * 4096].ljust(4096, b"\0")


def _is_own(path: Path) -> bool:
    """Tell whether a file is the project's alone, readable and of ordinary size."""
    if path.is_symlink() or not path.is_file() or not os.access(path, os.R_OK | os.W_OK):
        return False
    return path.stat().st_nlink == 1 and path.stat().st_size < 1 << 22


def _put(path: Path, content: bytes) -> None:
    _remove(path)
    path.write_bytes(content)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
