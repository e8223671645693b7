"""Measurement text (.MEA): a log in the order in which it is replayed; its plain lines many at a time."""

from __future__ import annotations

import difflib
import re
from array import array
from collections.abc import Sequence
from itertools import count
from pathlib import Path
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.errors import Complaint
from orip.files.log.blocks import (
    ACTIONS,
    BLOCK_KINDS,
    KEYWORDS,
    MeasurementBlock,
    names_columns,
    read_edit,
    read_header,
    read_measurement,
)
from orip.files.log.writing import points_header
from orip.files.text.decimal_numbers import LARGEST_NUMBER, ORDINARY_NUMBER, is_number
from orip.files.text.lines import FieldReader, read_sound_bytes, split_line
from orip.files.text.shown import Parsed, shown_token
from orip.number_text import shortest_texts
from orip.progress import stage
from orip.records.measurement import LogRecord
from orip.records.names import RESERVED_NAMES

# Nearly all lines of a large log are such lines: they are read together, and without the fields with columns that
# messages need. What is no such line, keywords among them, ends a run.


try:
    from orip.files.log import _plain_lines as compiled
except ImportError:  # the extension is built where there is a compiler
    compiled = None  # type: ignore[assignment]

_MOST_COMPLAINTS = 2000
"""After so many errors the rest of a log is not read: it is probably of another form."""

LINES_AT_A_TIME = 1000
"""Most lines of a run, after which to tell how far reading is."""

_NOT_NAMES = tuple(sorted(word.encode("ascii") for word in KEYWORDS | RESERVED_NAMES))
_NOT_PLAIN = b"|".join(map(re.escape, _NOT_NAMES))
_NUMBER = ORDINARY_NUMBER.encode("ascii")
_LINE = (
    rb"[ \t]*+(?![!#]|(?i:" + _NOT_PLAIN + rb")[ \t])[!-~]++[ \t]++" + _NUMBER + rb"[ \t]++" + _NUMBER + rb"[ \t]*+\n"
)
_RUN = re.compile(rb"(?:" + _LINE + rb"){1,%d}+" % LINES_AT_A_TIME)


def is_compiled() -> bool:
    """Tell whether the extension was built."""
    return compiled is not None


class PlainLines(NamedTuple):
    """A run of lines.

    Attributes
    ----------
    end : int
        Of the run in the text.
    coordinates : array of float
        x and y of each name in turn.
    """

    end: int
    names: list[str]
    coordinates: array[float]


def plain_lines(text: bytes, place: int) -> PlainLines | None:
    """Return the run of plain lines that begins at a place of a text; None where there is none.

    Parameters
    ----------
    text : bytes
        UTF-8, lines that end in newlines.
    place : int
        Where a line begins.
    """
    if is_compiled():
        end, names, coordinates = compiled.plain_lines(text, place, LINES_AT_A_TIME, _NOT_NAMES, LARGEST_NUMBER)
        return PlainLines(end, names, array("d", coordinates)) if names else None
    run = _RUN.match(text, place)
    if run is None:
        return None
    fields = run.group().decode("ascii").split()
    measured = array("d", bytes(16 * (len(fields) // 3)))
    measured[::2], measured[1::2] = (array("d", map(float, fields[axis::3])) for axis in (1, 2))
    if max(map(abs, measured)) <= LARGEST_NUMBER:
        return PlainLines(run.end(), fields[::3], measured)
    # up to the line with a number that is refused
    rows = next(row for row, size in enumerate(map(abs, measured)) if size > LARGEST_NUMBER) // 2
    end = place + sum(len(line) + 1 for line in run.group().split(b"\n")[:rows])
    return PlainLines(end, fields[: 3 * rows : 3], measured[: 2 * rows]) if rows else None


# A line is the first line of a block, an edit, or a measurement of the block above. A point, mark or tick may be called
# like a keyword: a line whose second and third fields are both numbers is a measurement, with one exception. In
# ``POINTS 1 101`` two unsigned whole numbers are taken as the names of a bundle and a photo, because such names are
# common and a point called POINTS is not; ``POINTS 1.0 101.0`` measures such a point. Outside a block a keyword is
# always one. An edit ends the block above it.


def read_measurements(path: Path, shown: str) -> Parsed[tuple[LogRecord, ...]]:
    """Read a measurement log into its records, in the order of the text.

    Parameters
    ----------
    shown : str
        The file as the user would name it; it is also in each record's place.
    """
    text = read_sound_bytes(path, shown)
    log = _Log(shown)
    log.read(text.value)
    return Parsed(tuple(log.records), (*text.complaints, *log.complaints))


class _Log:
    """Reads a log line by line. `block` is the open one; `skips` is set after a line that no block can be made of."""

    def __init__(self, shown: str) -> None:
        self.shown = shown
        self.records: list[LogRecord] = []
        self.complaints: list[Complaint] = []
        self.block: MeasurementBlock | None = None
        self.skips = False

    def read(self, text: bytes) -> None:
        lines = text.count(b"\n")
        with stage(f"reading {Path(self.shown).name}", lines) as advance:
            number = place = refused = 0
            while number < lines:
                run = plain_lines(text, place) if self.block and number >= refused else None
                if self.block and run:
                    end = number + len(run.names)
                    if _take_run(self.block, run, number + 1):
                        number, place = end, run.end
                        advance(number)
                        continue
                    refused = end
                end_of_line = text.index(b"\n", place)
                line = text[place:end_of_line].decode("utf-8")
                number, place = number + 1, end_of_line + 1
                if line and not line.isspace():
                    self._read_line(line, number)
                if len(self.complaints) >= _MOST_COMPLAINTS:
                    message = f"after {_MOST_COMPLAINTS} errors the rest of this file is not read; correct those first"
                    self.complaints.append(Complaint(message, self.shown, number + 1))
                    break
        self._close_block()
        self.complaints.sort(key=lambda complaint: complaint.line or 0)

    def _read_line(self, line: str, number: int) -> None:
        """Read a line that is not just a name and two numbers."""
        split = split_line(line, number)
        if split is None:
            return
        reader = FieldReader(split, self.shown)
        is_measurement = _is_measurement(reader)
        keyword = reader.text(0).upper()
        if keyword in KEYWORDS and not (is_measurement and self.block):
            self._read_keyword(reader, keyword)
        elif self.skips:
            return
        elif self.block is None or (not is_measurement and _is_like_keyword(reader)):
            self._refuse(reader, is_measurement=is_measurement)
        else:
            read_measurement(reader, self.block)
        self.complaints += reader.complaints

    def _read_keyword(self, reader: FieldReader, keyword: str) -> None:
        self._close_block()
        self.skips = False
        if keyword in ACTIONS:
            edit = read_edit(reader, self.shown)
            if edit is not None:
                self.records.append(edit)
        else:
            self.block = read_header(reader, self.shown)

    def _refuse(self, reader: FieldReader, *, is_measurement: bool) -> None:
        """Complain of a line that belongs nowhere, once for all lines up to the next keyword."""
        word = reader.shown_text(0)
        if is_measurement:
            reader.complain(
                f"the measurement of '{word}' is outside a block; write a line such as POINTS bundle photo above it "
                f"(blocks: {', '.join(BLOCK_KINDS)})"
            )
        elif names_columns(reader):
            reader.complain(
                "this is a heading of columns; begin it with ! or remove it. A log is in blocks: write a line such as "
                "POINTS bundle photo for each photo, and below it name x y of each point, separated by blanks"
            )
        else:
            near = _near_keywords(word)
            words = ", ".join((*BLOCK_KINDS, *ACTIONS))
            guess = f"did you mean {near[0]}?" if near else f"write one of {words}, or begin a remark with !"
            reader.complain(f"'{word}' is not a keyword; {guess}", 0)
        self._close_block()
        self.skips = True

    def _close_block(self) -> None:
        block, self.block = self.block, None
        if block is None or block.build is None:
            return
        if block.name_lines:
            self.records.append(block.build(block))
        elif not block.has_faults:
            message = f"{block.title} has no measurements; write them below it or remove it"
            self.complaints.append(Complaint(message, self.shown, block.line))


def _take_run(block: MeasurementBlock, run: PlainLines, first: int) -> bool:
    """Take a run of lines, the first of which has this number, into the block; False if they need a closer look."""
    names = dict(zip(run.names, count(first), strict=False))
    if len(names) != len(run.names) or not names.keys().isdisjoint(block.name_lines):
        return False
    block.name_lines.update(names)
    block.measured += run.coordinates
    return True


def _is_measurement(reader: FieldReader) -> bool:
    if reader.count < 3 or not (is_number(reader.text(1)) and is_number(reader.text(2))):
        return False
    names_of_numbers = reader.count == 3 and reader.text(1).isdigit() and reader.text(2).isdigit()
    return not (names_of_numbers and reader.text(0).upper() == "POINTS")


def _is_like_keyword(reader: FieldReader) -> bool:
    """Tell whether a line of a block that is no measurement is rather a misspelt keyword than a misspelt number."""
    if names_columns(reader):
        return False
    word = reader.text(0)
    others = [reader.text(index) for index in range(1, min(reader.count, 3))]
    return word.isalpha() and any(other[0].isalpha() for other in others) and bool(_near_keywords(word))


def _near_keywords(word: str) -> list[str]:
    return difflib.get_close_matches(shown_token(word).upper(), sorted(KEYWORDS), 1)


def points_blocks(
    bundle: str, photo: str, names: Sequence[str], image: FloatArray, errors: FloatArray, is_active: BoolArray
) -> str:
    """Return the measurements of a photo: a block, and further ones for points that are measured again.

    Parameters
    ----------
    names : sequence of k str
        Of points.
    image : array (k, 2)
        Pixels or millimetres, as the photo is measured.
    errors : array (k,)
        A-priori errors of both coordinates, pixels; NaN: that of the bundle.
    is_active : array (k,) of bool
        False: the line is disregarded.
    """
    columns, rows = (shortest_texts(values, "nan") for values in np.ascontiguousarray(image.T))
    ends = [""] * len(names)
    if np.isfinite(errors).any() or not is_active.all():
        texts = shortest_texts(errors, "")
        ends = [_end(error, active) for error, active in zip(texts, is_active.tolist(), strict=True)]
    lines = [f"  {name} {x} {y}{end}" for name, x, y, end in zip(names, columns, rows, ends, strict=True)]
    header = points_header(bundle, photo)
    return "".join("\n".join([header, *(lines[n] for n in block.tolist()), ""]) for block in _blocks(names))


def _end(error: str, is_active: bool) -> str:
    own = f" {error}px {error}px" if error else ""
    return own if is_active else f"{own} -"


def _blocks(names: Sequence[str]) -> list[IntArray]:
    """Return the places of names in blocks in which none occurs twice."""
    left = list(range(len(names)))
    if len(set(names)) == len(names):
        return [np.arange(len(names))]
    blocks = []
    while left:
        seen: set[str] = set()
        block = [n for n in left if not (names[n] in seen or seen.add(names[n]))]  # type: ignore[func-returns-value]
        blocks.append(np.array(block, dtype=np.int64))
        left = sorted(set(left) - set(block))
    return blocks
