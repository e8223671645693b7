"""Blocks of a measurement log: their first lines, and the lines below one of them."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable, Mapping
from typing import Literal, TypeVar, get_args

import numpy as np
from msgspec import Struct, field

from orip.arrays import BoolArray, FloatArray
from orip.files.text.decimal_numbers import parse_photo_error
from orip.files.text.lines import FieldReader
from orip.records.control import PHOTO_ERRORS, PIXEL_ERRORS
from orip.records.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    MeasuredMarks,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TextPlace,
    TicksRecord,
    TransformationKind,
)
from orip.records.photo import Stage

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
    title : str
        The block's first line, as messages call it.
    build : callable or None
        Makes the log record of the full block; None where the first line was wrong and nothing can be made.
    name_lines : dict of str to int
        Line of each name, in the order of measurement.
    measured : array of float
        x and y of each name in turn.
    own_errors, in_pixels, given : dict of int to pairs
        By index of the name; only where the line has them.
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


_COLUMNS = frozenset(
    {"x", "y", "u", "v", "column", "col", "row", "line", "sample", "px", "py", "i", "j", "r", "c", "spalte", "zeile"}
)


def names_columns(reader: FieldReader) -> bool:
    """Tell whether a line is a heading such as ``name column row``, ``point x (mm) y (mm)`` or ``photo;point;x;y``."""
    words = re.split(r"[\s;,]+", " ".join(map(reader.text, range(reader.count))).lower())
    if len(words) < 3 or not words[1][:1].isalpha():
        return False
    return len(_COLUMNS & {re.split(r"[^a-z]", word, maxsplit=1)[0] for word in words[1:]}) > 1


def read_measurement(reader: FieldReader, block: MeasurementBlock) -> None:
    """Take one line of any form into its block; what is wrong stays with the reader."""
    count = reader.count
    is_disregarded = count > 3 and reader.text(count - 1) == "-"
    body = count - 1 if is_disregarded else count
    is_heading = count > 2 and names_columns(reader) and reader.is_heading((1, 2))
    if is_heading or not _has_form(reader, block, body, is_disregarded=is_disregarded):
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
        parts = f"{reader.shown_text(0)} {reader.shown_text(1)}"
        blank = f" (a name has no blank: write '{parts.replace(' ', '_')}')" if body == 4 else ""
        reader.complain(f"'{reader.shown_text(3)}' does not fit here{blank}; a line of {block.title} is: {form}", 3)
    return False


def _own_error(reader: FieldReader, position: int) -> tuple[float, bool]:
    """Return an own a-priori error and whether it is in pixels."""
    try:
        value, in_pixels = parse_photo_error(reader.text(position))
    except ValueError as fault:
        reader.complain(str(fault), position)
        return float("nan"), False
    if value == 0:
        text = "an a-priori error of 0 is not allowed here; write a positive one, or a negative one to disregard it"
        reader.complain(text, position)
    impossible = (PIXEL_ERRORS if in_pixels else PHOTO_ERRORS).fault(value)
    if impossible is not None:
        reader.complain(impossible, position)
    return value, in_pixels


Action = Literal["DISREGARD", "INCLUDE", "KILL", "RENAME"]
Edited = Literal["POINT", "MARK", "TICK"]
Arrangement = Literal["corners", "midsides"]
Word = TypeVar("Word", bound=str)

BLOCK_KINDS: tuple[BlockKind, ...] = get_args(BlockKind)
ACTIONS: tuple[Action, ...] = get_args(Action)
KEYWORDS: frozenset[str] = frozenset((*BLOCK_KINDS, *ACTIONS))

_EDITED: tuple[Edited, ...] = get_args(Edited)
_ARRANGEMENTS: tuple[Arrangement, ...] = get_args(Arrangement)
_KINDS: tuple[TransformationKind, ...] = get_args(TransformationKind)
_STAGES: tuple[Stage, ...] = get_args(Stage)
_TRANSFORMATION = "a transformation (A affine, C conformal, W conformal without scale)"

_HEADER_FORMS: Mapping[BlockKind, tuple[tuple[int, ...], str]] = {
    "TEMPLATE": ((3, 4), "TEMPLATE name A|C|W, and UPPER or LOWER"),
    "PHOTO": ((3,), "PHOTO name A|C|W"),
    "POINTS": ((3,), "POINTS bundle photo"),
    "FIDUCIALS": ((3,), "FIDUCIALS camera corners|midsides"),
    "TICKS": ((2,), "TICKS temtick"),
}
_EDIT_FORMS: Mapping[Edited, tuple[int, str]] = {
    "POINT": (5, "POINT bundle photo|* point|*"),
    "MARK": (4, "MARK photo|* mark|*"),
    "TICK": (4, "TICK template|* tick|*"),
}
_RENAMING_FORM = (6, "POINT bundle photo|* point new_name")


def read_header(reader: FieldReader, shown: str) -> MeasurementBlock:
    """Begin the block that a keyword line opens; after a faulty line its block can still be checked, not built."""
    kind = _keyword(reader, BLOCK_KINDS)
    counts, form = _HEADER_FORMS[kind]
    titled = 3 if kind == "POINTS" else 2
    title = " ".join([kind, *(reader.shown_text(index) for index in range(1, min(reader.count, titled)))])
    build = None
    if reader.has_fields(counts, form):
        build = _BUILDERS[kind](reader, TextPlace(shown, reader.number))
    return MeasurementBlock(kind, title, reader.number, None if reader.complaints else build)


def read_edit(reader: FieldReader, shown: str) -> EditRecord | None:
    """Read ``DISREGARD``, ``INCLUDE``, ``KILL`` or ``RENAME``; None, and complaints kept, if it is faulty."""
    action = _keyword(reader, ACTIONS)
    if action == "RENAME":
        return _read_renaming(reader, shown)
    if reader.count < 2:
        reader.has_fields((4, 5), f"{action} POINT bundle photo|* point|*, or MARK photo|* mark|*, or TICK ...")
        return None
    what = reader.word(1, _EDITED, f"something to {action.lower()}")
    if what is None:
        return None
    count, form = _EDIT_FORMS[what]
    if not reader.has_fields((count,), f"{action} {form}"):
        return None
    names = [reader.name(index) for index in range(2, count)]
    if reader.complaints:
        return None
    bundle = names[0] if what == "POINT" else None
    return EditRecord(TextPlace(shown, reader.number), action, what, bundle, names[-2], names[-1])


def _read_renaming(reader: FieldReader, shown: str) -> EditRecord | None:
    count, form = _RENAMING_FORM
    if not reader.has_fields((count,), f"RENAME {form}") or reader.word(1, ("POINT",), "something to rename") is None:
        return None
    bundle, owner, name, new_name = (reader.name(index) for index in range(2, count))
    for index, text in ((4, name), (5, new_name)):
        if text == "*":
            reader.complain("one point is renamed at a time; write its name in place of '*'", index)
    if reader.complaints:
        return None
    return EditRecord(TextPlace(shown, reader.number), "RENAME", "POINT", bundle, owner, name, new_name)


def _keyword(reader: FieldReader, allowed: tuple[Word, ...]) -> Word:
    written = reader.text(0).upper()
    return next(word for word in allowed if word == written)


Builder = Callable[[MeasurementBlock], LogRecord]


def _template_builder(reader: FieldReader, place: TextPlace) -> Builder | None:
    name = reader.name(1)
    kind = reader.word(2, _KINDS, _TRANSFORMATION)
    stage = reader.word(3, _STAGES, "a stage") if reader.count == 4 else None
    if kind is None:
        return None
    return lambda block: TemplateRecord(place, name, kind, stage, block.marks())


def _photo_builder(reader: FieldReader, place: TextPlace) -> Builder | None:
    name = reader.name(1)
    kind = reader.word(2, _KINDS, _TRANSFORMATION)
    if kind is None:
        return None
    return lambda block: PhotoRecord(place, name, kind, block.marks())


def _points_builder(reader: FieldReader, place: TextPlace) -> Builder:
    bundle, photo = reader.name(1), reader.name(2)
    return lambda block: PointsRecord(
        place,
        bundle,
        photo,
        names=tuple(block.name_lines),
        measured=block.coordinates(),
        errors=block.pairs(block.own_errors),
        errors_in_pixels=block.pixel_flags(),
        disregarded=block.disregarded_flags(),
        lines=np.array(list(block.name_lines.values()), dtype=np.int64),
    )


def _fiducials_builder(reader: FieldReader, place: TextPlace) -> Builder | None:
    camera = reader.name(1)
    arrangement = reader.word(2, _ARRANGEMENTS, "an arrangement of fiducials")
    if arrangement is None:
        return None
    return lambda block: FiducialsRecord(place, camera, arrangement, block.marks())


def _ticks_builder(reader: FieldReader, place: TextPlace) -> Builder:
    temtick = reader.name(1)
    return lambda block: TicksRecord(place, temtick, block.marks())


_BUILDERS: Mapping[BlockKind, Callable[[FieldReader, TextPlace], Builder | None]] = {
    "TEMPLATE": _template_builder,
    "PHOTO": _photo_builder,
    "POINTS": _points_builder,
    "FIDUCIALS": _fiducials_builder,
    "TICKS": _ticks_builder,
}
