"""Whatever a file holds, a reader returns what it found and raises nothing."""

from __future__ import annotations

import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from orip.files.control_text import read_directions, read_distances, read_elements, read_points
from orip.files.measurement_text import read_measurements
from orip.files.parsed import Parsed
from orip.files.preliminary_text import read_preliminary
from orip.files.project_toml import read_project
from orip.files.toml_lines import TomlLines

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
SAMPLES: list[tuple[Reader, str]] = [
    (read_points, "1 1.5D0 -2 3 0.1 0 -1 ! c\n2 - 2 3 - 1 1 x\n"),
    (read_elements, "O CAMERA C 8.6 0.01\nP PHOTO KAPPA 1 1\nS THEODOLITE R 1 1\n"),
    (read_distances, "D 1 2 XYZ 10 0.1\nE 1 2 X -3 0\n"),
    (read_directions, "S A B 1 1 90 1\nS A C 2 1\n"),
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


@READERS
@given(seed=st.integers(0, 2**32), edits=st.integers(1, 6))
@settings(ANY_FILE, max_examples=300)
def test_nearly_valid_text_is_read_or_complained_of(
    tmp_path: Path, reader: Reader, sample: str, seed: int, edits: int
) -> None:
    chance = random.Random(seed)
    text = sample
    for _ in range(edits):
        start = chance.randrange(len(text) + 1)
        end = min(len(text), start + chance.choice([0, 0, 1, 1, 5, 20]))
        text = text[:start] + chance.choice([*PIECES, "", text[end : end + 20]]) + text[end:]
    (tmp_path / "F").write_text(text, encoding="utf-8", newline="")
    assert_reads(reader, tmp_path / "F")


@given(st.text(alphabet="[]{}=,.#\"'\\\n ab1", max_size=60))
def test_line_numbers_can_be_asked_for_in_any_text(text: str) -> None:
    assert TomlLines(text).line_of(("a", 0, "b")) >= 1


def test_deep_nesting_is_a_complaint(tmp_path: Path) -> None:
    (tmp_path / "F").write_text("a = " + "[" * 100_000 + "]" * 100_000)
    (complaint,) = read_project(tmp_path / "F", "F").complaints
    assert "nested too deeply" in complaint.message
