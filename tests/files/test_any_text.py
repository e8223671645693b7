"""Whatever a text holds, a reader returns what it found, and a refused text changes no store.

The long tests do the same as the quick ones with so many more texts: over 100 000 in all.
"""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from functools import update_wrapper
from pathlib import Path
from typing import Any

import pytest
from cli.command_line import orip
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from workflow.commands import edit_observations, initialise, measure
from workflow.small_projects import contents, film_project

from orip.errors import InputError, OripError
from orip.files.control.preliminary_text import read_preliminary
from orip.files.control.text import parse_directions, parse_distances, parse_elements, parse_points
from orip.files.log.text import read_measurements
from orip.files.project.reader import read_project
from orip.files.project.toml_lines import TomlLines
from orip.files.stores.dump import dump, load
from orip.files.text.decimal_numbers import parse_gate
from orip.files.text.lines import read_lines
from orip.files.text.shown import Parsed
from orip.records.names import name_fault

Reader = Callable[[Path, str], Parsed[Any]]

LOG = """\
TEMPLATE T A UPPER
1 2 3 -
PHOTO P C
1 2 3 = 4 5 -
POINTS M P
1 2 3 0.5px -1 -
2 3 4
KILL POINT M * *
TICKS T
1 2 3
FIDUCIALS C corners
1 2 3
"""
PROJECT = """\
[project]
name = "Z"
[[camera]]
name = "O"
c = 8.5
fiducials = [{ name = "1", x = 1, y = 2 },
]
distortion = { A1 = 0.0 }
unknown = ["C"]
[[temtick]]
name = "G"
ticks = []
[[template]]
name = "T"
temtick = "G"
photos = ["A", "B"]
scan = { pixel = [0.1, 0.1] }
[[photo]]
name = "A"
camera = "O"
X0 = 1
[[photo]]
name = "B"
camera = "O"
constant = ["X0"]
[[bundle]]
name = "M"
measurement_precision = "0.5px"
[[bundle.model]]
name = "1"
left = "A"
right = "B"
row = 1
column = 1
"""


def of_file(parse: Callable[[Parsed[list[str]], str], Parsed[Any]]) -> Reader:
    """Return what reads a file with a function that parses lines; it has the name of that function."""
    return update_wrapper(lambda path, shown: parse(read_lines(path, shown), shown), parse)


SAMPLES: list[tuple[Reader, str]] = [
    (of_file(parse_points), "1 1.5D0 -2 3 0.1 0 -1 ! c\n2 - 2 3 - 1 1 x\n"),
    (of_file(parse_elements), "O CAMERA C 8.6 0.01\nP PHOTO KAPPA 1 1\nS THEODOLITE R 1 1\n"),
    (of_file(parse_distances), "D 1 2 XYZ 10 0.1\nE 1 2 X -3 0\n"),
    (of_file(parse_directions), "S A B 1 1 90 1\nS A C 2 1\n"),
    (read_preliminary, "1 1 2 3 0.1 0.2 0.3\n2 1 2 3\n"),
    (read_measurements, LOG),
    (read_project, PROJECT),
]
READERS = pytest.mark.parametrize(("reader", "sample"), SAMPLES, ids=lambda value: getattr(value, "__name__", ""))
ANY_FILE = settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
PIECES = ["-", "=", "!", "#", '"', "'", "[", "]", "{", "}", ",", ".", "nan", "1e999", "\n", "\r", "\t", "0", "PHOTO"]
PIECES += ["\x00", "é", "\u00a0", "[[photo]]\n", "9" * 5000, "*", "px", "\x1b", '"""', "=inf", "1979-05-27", "true"]


def assert_reads(reader: Reader, path: Path) -> None:
    parsed = reader(path, "F")
    assert isinstance(parsed, Parsed)
    for complaint in parsed.complaints:
        assert str(complaint).startswith("F:") or complaint.line is None
        assert complaint.message.isprintable()
        assert len(complaint.message) < 600


@READERS
def test_the_samples_are_valid(tmp_path: Path, reader: Reader, sample: str) -> None:
    (tmp_path / "F").write_text(sample)
    assert not reader(tmp_path / "F", "F").complaints


@READERS
@given(data=st.binary() | st.text().map(lambda text: text.encode("utf-8", "surrogatepass")))
@ANY_FILE
def test_any_text_is_read_or_complained_of(tmp_path: Path, reader: Reader, sample: str, data: bytes) -> None:
    (tmp_path / "F").write_bytes(data)
    assert_reads(reader, tmp_path / "F")


def spoilt(text: str, seed: int, edits: int) -> str:
    """Return a text with so many places struck out, doubled, moved or overwritten with what is unlikely there."""
    chance = random.Random(seed)
    for _ in range(edits):
        start = chance.randrange(len(text) + 1)
        end = min(len(text), start + chance.choice([0, 0, 1, 1, 5, 20]))
        text = text[:start] + chance.choice([*PIECES, "", text[end : end + 20]]) + text[end:]
        if chance.random() < 0.1:
            lines = text.splitlines(keepends=True) or [""]
            lines.insert(chance.randrange(len(lines) + 1), lines.pop(chance.randrange(len(lines))))
            text = "".join([*lines, chance.choice(["", *lines])])
    return text


SPOILT = given(seed=st.integers(0, 2**32), edits=st.integers(1, 6))


def read_spoilt(reader: Reader, sample: str, path: Path, seed: int, edits: int) -> None:
    path.write_text(spoilt(sample, seed, edits), encoding="utf-8", newline="")
    assert_reads(reader, path)


@READERS
@SPOILT
@settings(ANY_FILE, max_examples=100)
def test_nearly_valid_text_is_read_or_complained_of(
    tmp_path: Path, reader: Reader, sample: str, seed: int, edits: int
) -> None:
    read_spoilt(reader, sample, tmp_path / "F", seed, edits)


@pytest.mark.long
@pytest.mark.timeout(3600)
@READERS
@SPOILT
@settings(ANY_FILE, max_examples=12_000)
def test_many_nearly_valid_texts_are_read_or_complained_of(
    tmp_path: Path, reader: Reader, sample: str, seed: int, edits: int
) -> None:
    read_spoilt(reader, sample, tmp_path / "F", seed, edits)


# gates


def gate_fault(text: str) -> str:
    """Return what is wrong with a gate; empty for a sound one."""
    try:
        gate = parse_gate(text)
    except ValueError as fault:
        return str(fault)
    assert gate.name
    assert abs(gate.limit) < float("inf")
    return ""


def parse_spoilt_gate(text: str) -> None:
    fault = gate_fault(text)
    assert not fault or fault.isprintable()
    assert len(fault) < 600


GATES = st.text(max_size=40) | st.builds(
    spoilt, st.sampled_from(["sigma0<=1.5", "singular == 0", "rms.x>-1e-3"]), st.integers(0, 2**32), st.integers(1, 3)
)


@given(GATES)
def test_any_gate_is_parsed_or_complained_of(text: str) -> None:
    parse_spoilt_gate(text)


@pytest.mark.long
@given(GATES)
@settings(deadline=None, max_examples=12_000)
def test_many_gates_are_parsed_or_complained_of(text: str) -> None:
    parse_spoilt_gate(text)


# stores: dumps that are loaded, and the texts of a project

STORES = ("CAMERAS.CAM", "FIRST.PHO", "FIRST.EXT", "MAIN.EXO")
TEXTS = {
    "FIRST.PNT": None,
    "FIRST.MEA": None,
    "orip.toml": None,
    "EDITS.MEA": "DISREGARD POINT MAIN left P1\nINCLUDE MARK * *\nPOINTS MAIN left\n P1 104.4 100.9 0.01 -1 -\n",
    "MAIN.PRE": "1 1 2 3\nP1 1100 2050 100 1 1 1\n",
    "FIRST.ELE": "C35 CAMERA C 35 0.1\nleft PHOTO X0 1068.8 1\n",
    "FIRST.STA": "right 1132 2077.3 329.8 1 1 1 -0.5 0.9 -0.4 1 1 1 12.5 S1 0.1 0 0\n",
    "FIRST.LEN": "D 1 2 XYZ 166.6 0.1\n",
    "FIRST.DIR": "S 1 2 88.4 0.1\nS 1 3 1.1 0.1 88.4 0.1\n",
    "FIRST.CON": "F HEIGHT 1 0.1\nF HEIGHT 2 -0.1\nD DIRECTION 1 0.1 2 0 1 0\n",
}
"""Texts of a project; those that the small project does not have are written beside its own."""


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An adjusted project."""
    folder = film_project(tmp_path_factory.mktemp("any") / "film")
    assert orip(folder, "run").code == 0
    return folder


def load_complaints(store: Path, text: str) -> list[str] | None:
    """Load a dump and return what is wrong with it; None if nothing is."""
    try:
        load(text.splitlines(keepends=True), store)
    except InputError as error:
        return [complaint.message for complaint in error.complaints]
    return None


def load_spoilt(store: Path, seed: int, edits: int) -> None:
    held = store.read_bytes()
    found = load_complaints(store, spoilt("".join(f"{line}\n" for line in dump(store)), seed, edits))
    if found is None:
        assert list(dump(store))
        store.write_bytes(held)
    else:
        assert found
        assert all(map(str.isprintable, found))
        assert store.read_bytes() == held


@pytest.mark.parametrize("name", STORES)
@SPOILT
@settings(ANY_FILE, max_examples=25)
def test_spoilt_dump_is_loaded_or_leaves_the_store(project: Path, name: str, seed: int, edits: int) -> None:
    load_spoilt(project / name, seed, edits)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", STORES)
@SPOILT
@settings(ANY_FILE, max_examples=2_500)
def test_many_spoilt_dumps_are_loaded_or_leave_the_store(project: Path, name: str, seed: int, edits: int) -> None:
    load_spoilt(project / name, seed, edits)


def use_spoilt(project: Path, folder: Path, name: str, seed: int, edits: int) -> None:
    """Spoil one text of a project and do what its stores depend on."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(project, folder)
    sample = TEXTS[name] or (folder / name).read_text(encoding="utf-8")
    (folder / name).write_text(spoilt(sample, seed, edits), encoding="utf-8", newline="")
    for work in (initialise, measure, lambda place: edit_observations(place, "DISREGARD", "POINT", "left", ["1"])):
        before = contents(folder)
        try:
            work(folder)
        except OripError:
            assert contents(folder) == before
    before = contents(folder)
    code = orip(folder, "-q", "solve").code
    assert code in {0, 3, 4}
    assert code != InputError.exit_code or contents(folder) == before


@pytest.mark.parametrize("name", TEXTS)
@SPOILT
@settings(ANY_FILE, max_examples=4)
def test_spoilt_text_is_used_or_changes_nothing(
    project: Path, tmp_path: Path, name: str, seed: int, edits: int
) -> None:
    use_spoilt(project, tmp_path / "film", name, seed, edits)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("name", TEXTS)
@SPOILT
@settings(ANY_FILE, max_examples=150)
def test_many_spoilt_texts_are_used_or_change_nothing(
    project: Path, tmp_path: Path, name: str, seed: int, edits: int
) -> None:
    use_spoilt(project, tmp_path / "film", name, seed, edits)


@given(st.text(alphabet="[]{}=,.#\"'\\\n ab1", max_size=60))
def test_line_numbers_can_be_asked_for_in_any_text(text: str) -> None:
    assert TomlLines(text).line_of(("a", 0, "b")) >= 1


def test_deep_nesting_is_a_complaint(tmp_path: Path) -> None:
    (tmp_path / "F").write_text("a = " + "[" * 100_000 + "]" * 100_000)
    (complaint,) = read_project(tmp_path / "F", "F").complaints
    assert "more brackets are open in one another, and up to 12 are read" in complaint.message


# found by these tests


def test_name_with_a_blank_that_cannot_be_printed_is_shown_as_an_escape() -> None:
    assert name_fault("MA\u00a0N") == "'MA\\xa0N' has a blank; names are one word"
    assert name_fault("\x1b[2J x") == "'\\x1b[2J x' has a blank; names are one word"
    assert name_fault("P 1") == "'P 1' has a blank; names are one word"


@pytest.mark.parametrize(("line", "column"), [("S 1 2 30 0", 10), ("S 1 2 30 0.1 90 0", 17)])
def test_direction_with_the_a_priori_error_0_is_complained_of(tmp_path: Path, line: str, column: int) -> None:
    (tmp_path / "F").write_text(line)
    (complaint,) = of_file(parse_directions)(tmp_path / "F", "F").complaints
    assert (complaint.line, complaint.column) == (1, column)
    assert "an a-priori error of 0 is not possible for a direction" in complaint.message


def test_dump_whose_kind_cannot_be_printed_is_shown_with_an_escape(tmp_path: Path) -> None:
    header = '{"format": "orip.dump/1", "kind": ".\u00a0AM", "schema": 1, "run": null}'
    found = load_complaints(tmp_path / "A.CAM", header)
    assert found
    assert ".\\xa0AM" in found[0]
    assert all(map(str.isprintable, found))
