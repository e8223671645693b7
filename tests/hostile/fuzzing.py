"""Readers given inputs that are nearly right: every one is read or refused in words, and nothing else happens.

    PYTHONPATH=tests python -m hostile.fuzzing 1000000
    PYTHONPATH=tests python -m hostile.fuzzing 100000 --sources     # projects of other programs

Readers are called in this process, so that a million inputs take minutes. Inputs are sound texts with some bytes
flipped, removed, doubled, put elsewhere or exchanged for those that readers stumble over.
"""

from __future__ import annotations

import json
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

from link.served import TABLE, loaded_station
from msgspec import Struct
from workflow.quiet import run_quietly
from workflow.small_projects import film_project

from orip.errors import OripError
from orip.files.control.preliminary_text import parse_preliminary
from orip.files.control.stations_text import parse_stations
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_figures, parse_points
from orip.files.log.text import read_measurements
from orip.files.project.reader import parse_project
from orip.files.result.reader import read_result
from orip.files.stores.dump import PRIVATE, dump, read_dump
from orip.files.stores.identity import create
from orip.files.stores.store import Store
from orip.files.stores.transaction import connected
from orip.files.text.decimal_numbers import parse_gate
from orip.files.text.lines import decode_lines
from orip.multimodel.digitising.operator import script_requests
from orip.multimodel.emulation import read_processor_state
from orip.multimodel.link.protocol import answer
from orip.multimodel.table_text import read_drive_table

_NUMBERS = b"nan inf -inf 1e999 -1e-999 1,5 0x10 1d400 1e30 +-1 .e1 -0 9999999999999999999999 1_0 \xc2\xb2 \xd9\xa1"
_BYTES = b"\0 \r \n\n \t \xff\xfe \xef\xbb\xbf \x1a \x85 \xe2\x80\xa8 \xed\xa0\x80 # ! = - [ ] { } \" ' \\ \\u0000"
_WORDS = b"POINTS TEMPLATE PHOTO KILL POINT MAIN left NULL true null [[ ]] ''' \"\"\" x = [[[[[[[[ name"
TOKENS = tuple(token for tokens in (_NUMBERS, _BYTES, _WORDS) for token in tokens.split(b" "))
_STATIONS = "left 1 2 3 0.1 0.1 -1\nright - - - - - - 1 2 3 0 1 1\nX 1 2 3 1 1 1 - - - - - - 12.5 S1 0.5 0 -.2 ! all\n"
_DIRECTIONS = "SET T1 1 AUTO\n  2 H 12.5 0.001\n  3 V 101.5 0.002\n"
_MOST_EDITS = 4
_LONGEST = 20_000
_MOST_MEMORY = 2 << 30


class Target(Struct, frozen=True):
    """A reader, and sound inputs of it; `many`: how many inputs it gets for one of the slowest."""

    read: Callable[[bytes], object]
    seeds: tuple[bytes, ...]
    many: int = 10


def targets(folder: Path) -> Mapping[str, Target]:
    """Return all readers of texts and requests, with inputs that they read; files go to the folder."""
    project = film_project(folder / "film")
    run_quietly(project)
    of = {path.name: path.read_bytes() for path in project.iterdir()}
    log = (of["FIRST.MEA"], b"KILL POINT MAIN left 1\nDISREGARD POINT MAIN left 2\n" + of["FIRST.MEA"])
    station = loaded_station()
    requests = (
        b"DRIVE OBJECT 1 2 3;MOVE 1 2 3;PROFILE 0 0 0 9 9 9 1;LOCK LEFT;PRISM LEFT 90;KEY 3;POS PHOTO;WHICH 1 2 3"
    )
    state = {
        "schema": "orip.plate-processor/1",
        "table": "",
        "model": "-",
        "plates": [[0.0, 0.0], [0.0, 0.0]],
        "mark": None,
        "condition": "OUTSIDE",
    }
    return {
        "orip.toml": Target(lambda data: _of_text(parse_project, data), (of["orip.toml"],), 1),
        ".MEA": Target(_of_file(folder / "fuzzed.MEA", read_measurements), log),
        ".PNT": Target(lambda data: _of_lines(parse_points, data), (of["FIRST.PNT"],)),
        ".PRE": Target(lambda data: _of_lines(parse_preliminary, data), (b"P1 1 2 3\nP2 4 5 - ! no height\n",)),
        ".ELE": Target(lambda data: _of_lines(parse_elements, data), (b"PHOTO left KAPPA 1.5 0.1\n",)),
        ".LEN": Target(lambda data: _of_lines(parse_distances, data), (b"1 2 100.0 0.01\n3 4 50 0.02\n",)),
        ".DIR": Target(lambda data: _of_lines(parse_directions, data), (_DIRECTIONS.encode(),)),
        ".CON": Target(lambda data: _of_lines(parse_figures, data), (b"WALL PLANE 1 0.01\nLAKE HEIGHT 2 -0.02\n",)),
        ".STA": Target(
            lambda data: _of_lines(parse_stations, data),
            (_STATIONS.encode(), b"CRS EPSG:4258\nANGLES ROLL PITCH HEADING\n" + _STATIONS.encode()),
        ),
        ".DRV": Target(read_drive_table, (TABLE,), 1),
        "result.json": Target(_of_file(folder / "fuzzed.json", read_result), (of["result.json"],), 1),
        "state": Target(_of_file(folder / "fuzzed.state", read_processor_state), (json.dumps(state).encode(),)),
        "gate": Target(lambda data: _refusing(parse_gate, data), (b"sigma0<=1.5", b"points.sd.max < 0.02")),
        "dump": Target(_of_dump, tuple("\n".join(dump(project / name)).encode() for name in ("FIRST.PHO", "MAIN.EXO"))),
        "request": Target(lambda data: answer(station, data), tuple(requests.split(b";")), 20),
        "script": Target(_of_script, (b"MOVE 1 2\nFOOT RIGHT\nKEY ENTER\n",), 20),
    }


def mutated(data: bytes, chance: random.Random) -> bytes:
    """Return an input that is nearly the one given."""
    changed = bytearray(data)
    for _ in range(chance.randint(1, _MOST_EDITS)):
        _EDITS[chance.randrange(len(_EDITS))](changed, chance)
    return bytes(changed[:_LONGEST])


def fuzz(count: int, seed: int, folder: Path) -> Counter[str]:
    """Give `count` inputs to all readers; return how many of each were given.

    Raises
    ------
    AssertionError
        With the input that ended in anything but a value or a refusal.
    """
    chance, readers = random.Random(seed), targets(folder)
    names = [name for name, target in readers.items() for _ in range(target.many)]
    given: Counter[str] = Counter()
    for _ in range(count):
        name = names[chance.randrange(len(names))]
        target = readers[name]
        data = mutated(chance.choice(target.seeds), chance)
        try:
            target.read(data)
        except OripError as error:
            require_words(str(error))
        except Exception as error:
            message = f"{name} of {data!r} ended in {type(error).__name__}: {error}"
            raise AssertionError(message) from error
        given[name] += 1
    return given


def require_words(text: str) -> None:
    """A refusal says something that can be printed."""
    assert text
    text.encode("utf-8")


def _of_file(path: Path, read: Callable[[Path, str], object]) -> Callable[[bytes], object]:
    def run(data: bytes) -> object:
        path.write_bytes(data)
        found = read(path, path.name)
        _require_complaints(found)
        return found

    return run


def _of_lines(parse: Callable[..., object], data: bytes) -> None:
    _require_complaints(parse(decode_lines(data, "fuzzed"), "fuzzed"))


def _of_text(parse: Callable[[str], object], data: bytes) -> None:
    decoded = decode_lines(data, "fuzzed")
    _require_complaints(decoded if decoded.complaints else parse("\n".join(decoded.value)))


def _of_script(data: bytes) -> None:
    _require_complaints(script_requests(decode_lines(data, "fuzzed").value, "fuzzed"))


def _refusing(parse: Callable[[str], object], data: bytes) -> None:
    try:
        parse(data.decode("utf-8", "replace"))
    except ValueError as fault:
        require_words(str(fault))


def _of_dump(data: bytes) -> None:
    kind = "EXO" if b'"EXO"' in data[:100] else "PHO"
    with closing(connected(PRIVATE, 0.0)) as connection:
        store = Store(Path(f"Z.{kind}"), kind, connection, "main", present=True)
        connection.execute("BEGIN")
        create(store, packed=False)
        read_dump(data.decode("utf-8", "replace").split("\n"), store, "fuzzed")


def _require_complaints(found: object) -> None:
    for complaint in getattr(found, "complaints", ()):
        require_words(str(complaint))


def _flip(data: bytearray, chance: random.Random) -> None:
    if data:
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)


def _cut(data: bytearray, chance: random.Random) -> None:
    start = chance.randrange(len(data) + 1)
    del data[start : start + chance.randint(1, 30)]


def _end(data: bytearray, chance: random.Random) -> None:
    del data[chance.randrange(len(data) + 1) :]


def _double(data: bytearray, chance: random.Random) -> None:
    start = chance.randrange(len(data) + 1)
    part = data[start : start + chance.randint(1, 60)]
    place = chance.randrange(len(data) + 1)
    data[place:place] = part * chance.choice((1, 1, 2, 50))


def _put(data: bytearray, chance: random.Random) -> None:
    place = chance.randrange(len(data) + 1)
    data[place : place + chance.choice((0, 0, 1, 5))] = chance.choice(TOKENS)


def _exchange(data: bytearray, chance: random.Random) -> None:
    words = bytes(data).split(b" ")
    words[chance.randrange(len(words))] = chance.choice(TOKENS)
    data[:] = b" ".join(words)


_EDITS = (_flip, _cut, _end, _double, _put, _put, _exchange, _exchange)


def fuzz_sources(count: int, seed: int) -> Counter[str]:
    """Import projects of all formats so often, each time with one of their files changed, in memory that is bounded.

    Raises
    ------
    AssertionError
        With the file that ended in anything but a project or complaints.
    """
    import resource

    from exchange.fuzzed.test_hostile_projects import SOUND
    from exchange.fuzzed.test_hostile_projects import fuzz as fuzz_source

    resource.setrlimit(resource.RLIMIT_AS, (_MOST_MEMORY, _MOST_MEMORY))
    for name in SOUND:
        with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
            fuzz_source(Path(folder), name, count // len(SOUND), seed)
    return Counter(dict.fromkeys(SOUND, count // len(SOUND)))


def main() -> None:
    """Fuzz as often as the command line says."""
    words = [word for word in sys.argv[1:] if word != "--sources"]
    count, seed = int(words[0]), int(words[1]) if len(words) > 1 else 1
    if "--sources" in sys.argv:
        print(dict(fuzz_sources(count, seed)))  # noqa: T201
        return
    began = time.monotonic()
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        given = fuzz(count, seed, Path(folder))
    print(f"{sum(given.values())} inputs in {time.monotonic() - began:.0f} s:", dict(given))  # noqa: T201


if __name__ == "__main__":
    main()
