"""A block of a measurement log: the lines below one TEMPLATE, PHOTO, POINTS, FIDUCIALS or TICKS line."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray
from orip.files.text.decimal_numbers import parse_photo_error
from orip.files.text.field_reader import FieldReader
from orip.records.observations.control import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.observations.measurement import LogRecord, MeasuredMarks

BlockKind = Literal["TEMPLATE", "PHOTO", "POINTS", "FIDUCIALS", "TICKS"]

LINE_FORMS: Mapping[BlockKind, str] = {
    "TEMPLATE": "name x y, = and its own coordinates if the temtick has no such mark, - to disregard",
    "PHOTO": "name x y, = and its own coordinates if the camera has no such mark, - to disregard",
    "POINTS": "name x y, ex ey for own a-priori errors, - to disregard",
    "FIDUCIALS": "name x y",
    "TICKS": "name x y",
}
"""What a line of a block may hold."""


class MeasurementBlock(Struct):
    """The measurements of one block as they come in.

    Parameters
    ----------
    kind : str
    title : str
        The block's first line, as messages call it.
    line : int
    build : callable or None
        Makes the log record of the full block; None where the first line was wrong and nothing can be made.
    name_lines : dict of str to int
        Line of each name, in the order of measurement.
    measured : array of float
        x and y of each name in turn.
    own_errors, in_pixels, given : dict of int to pairs
        By index of the name; only where the line has them.
    disregarded : list of int
    has_faults : bool
        A line was wrong, so that the block is not empty though nothing may be in it.
    """

    kind: BlockKind
    title: str
    line: int
    build: Callable[[MeasurementBlock], LogRecord] | None
    name_lines: dict[str, int] = field(default_factory=dict)
    measured: array[float] = field(default_factory=lambda: array("d"))
    own_errors: dict[int, tuple[float, float]] = field(default_factory=dict)
    in_pixels: dict[int, tuple[bool, bool]] = field(default_factory=dict)
    given: dict[int, tuple[float, float]] = field(default_factory=dict)
    disregarded: list[int] = field(default_factory=list)
    has_faults: bool = False

    def coordinates(self) -> FloatArray:
        """Return the measured coordinates, shape (n, 2)."""
        return np.array(self.measured, dtype=np.float64).reshape(-1, 2)

    def disregarded_flags(self) -> BoolArray:
        """Return which names are disregarded, shape (n,)."""
        flags = np.zeros(len(self.name_lines), dtype=np.bool_)
        flags[self.disregarded] = True
        return flags

    def pairs(self, known: Mapping[int, tuple[float, float]]) -> FloatArray:
        """Return pairs by index as an array (n, 2), NaN where there are none."""
        values = np.full((len(self.name_lines), 2), np.nan)
        for index, pair in known.items():
            values[index] = pair
        return values

    def pixel_flags(self) -> BoolArray:
        """Return which own errors are in pixels, shape (n, 2)."""
        flags = np.zeros((len(self.name_lines), 2), dtype=np.bool_)
        for index, pair in self.in_pixels.items():
            flags[index] = pair
        return flags

    def marks(self) -> MeasuredMarks:
        """Return the measurements as marks."""
        return MeasuredMarks(
            tuple(self.name_lines), self.coordinates(), self.disregarded_flags(), self.pairs(self.given)
        )


def read_measurement(reader: FieldReader, block: MeasurementBlock) -> None:
    """Take one line of any form into its block; what is wrong stays with the reader."""
    count = reader.count
    is_disregarded = count > 3 and reader.text(count - 1) == "-"
    body = count - 1 if is_disregarded else count
    if not _has_form(reader, block, body, is_disregarded=is_disregarded):
        block.has_faults = True
        return
    name = reader.name(0)
    first = block.name_lines.get(name)
    if first is not None:
        reader.complain(
            f"'{reader.shown_text(0)}' is measured twice in {block.title}, first on line {first}; "
            "remove or rename one, or measure again in a later block"
        )
    x, y = reader.decimal(1), reader.decimal(2)
    own_errors = [_own_error(reader, position) for position in (3, 4)] if body == 5 else []
    given = (reader.decimal(4), reader.decimal(5)) if body == 6 else None
    if reader.complaints:
        block.has_faults = True
        return
    index = len(block.name_lines)
    block.name_lines[name] = reader.number
    block.measured.extend((x, y))
    if own_errors:
        block.own_errors[index] = own_errors[0][0], own_errors[1][0]
        block.in_pixels[index] = own_errors[0][1], own_errors[1][1]
    if given is not None:
        block.given[index] = given
    if is_disregarded:
        block.disregarded.append(index)


def _has_form(reader: FieldReader, block: MeasurementBlock, body: int, *, is_disregarded: bool) -> bool:
    """Check how many fields there are and that the kind of block has such lines."""
    form = LINE_FORMS[block.kind]
    has_given = body == 6 and reader.text(3) == "="
    if body < 3 or (body == 3 and reader.text(2) == "-"):
        reader.complain(f"a coordinate is missing{reader.part_by_blanks()}; a line of {block.title} is: {form}")
    elif is_disregarded and block.kind in {"FIDUCIALS", "TICKS"}:
        reader.complain("a digitised mark is taken as it is; remove the '-', or the whole line", reader.count - 1)
    elif body == 3 or (body == 5 and block.kind == "POINTS") or (has_given and block.kind in {"TEMPLATE", "PHOTO"}):
        return True
    else:
        reader.complain(f"'{reader.shown_text(3)}' does not fit here; a line of {block.title} is: {form}", 3)
    return False


def _own_error(reader: FieldReader, position: int) -> tuple[float, bool]:
    """Return an own a-priori error and whether it is in pixels."""
    try:
        value, in_pixels = parse_photo_error(reader.text(position))
    except ValueError as fault:
        reader.complain(str(fault), position)
        return float("nan"), False
    if value == 0:
        reader.complain("an own a-priori error of 0 is not allowed; write one above 0, or below to disregard", position)
    impossible = (PIXEL_ERRORS if in_pixels else PHOTO_ERRORS).fault(value)
    if impossible is not None:
        reader.complain(impossible, position)
    return value, in_pixels
