"""First lines of the blocks of a measurement log, and its edit lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, TypeVar, get_args

import numpy as np

from orip.files.log.blocks import BlockKind, MeasurementBlock
from orip.files.text.field_reader import FieldReader
from orip.records.observations.measurement import (
    EditRecord,
    FiducialsRecord,
    LogRecord,
    PhotoRecord,
    PointsRecord,
    TemplateRecord,
    TextPlace,
    TicksRecord,
    TransformationKind,
)
from orip.records.project.photo import Stage

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
