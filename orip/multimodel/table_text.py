"""The drive table's text, BUNDLE.DRV: written and read without loss, and refused if a byte of it is wrong.

    ORIPDRIVE 3
    BLOCK <bundle>
    PROJECT <project>
    USER <user, percent-encoded where it is not ASCII; - for none>
    UNITS PLATE mm|px PHOTO mm OBJECT <ground unit>
    STAGE UPPER <x min> <x max> <y min> <y max> <least count>
    STAGE LOWER …
    CAMERA <name> PERSPECTIVE|EQUIDISTANT <C> <DX> <DY> <FX> <FY>
    DISTORTION <camera> IDEAL|MEASURED <A1> <A3> <A5> <A7> <A9> <P1> <P2> <B1> <B2>
    SET <camera> EBNER|GRUEN <base> <values>
    TEMPLATE <name> UPPER|LOWER
    PHOTO <name> <camera> <template or -> UPPER|LOWER <X0> <Y0> <Z0> <r11> <r12> <r13> <r21> … <r33>
    AFFINE <photo> <a0> <a1> <a2> <b0> <b1> <b2>
    MODEL <name> <row> <column> <left photo> <right photo> NORMAL|SWAPPED
    START <X> <Y> <Z>
    END <number of lines before this> <CRC-32 of all bytes before this line>

The kinds of lines come in this order, words are separated by single blanks, lines end in LF, and all is ASCII. Here
only the form is read; whether the parts agree is for `orip.multimodel.processor`.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Iterator
from typing import NamedTuple

from orip.multimodel.table_lines import TableLines, user_text
from orip.records.drive_table import (
    DriveCamera,
    DriveCode,
    DriveFault,
    DriveModel,
    DrivePhoto,
    DriveTable,
    StageLimits,
)

MOST_LINES = 100_000
LONGEST_LINE = 4096
"""Bytes; the longest line, of a set of 44 parameters with 24 characters each, has some 1100."""

MOST_BYTES = 64 * 1024 * 1024

_END = re.compile(rb"END (0|[1-9][0-9]*) ([0-9a-f]{8})\n")


class ReadTable(NamedTuple):
    """A table that was read, or None and why not: one fault or several, each with its code."""

    table: DriveTable | None
    faults: tuple[DriveFault, ...]


def drive_table_text(table: DriveTable) -> str:
    """Return the text of a table; reading it gives an equal table."""
    lines = list(_lines(table))
    body = "".join(f"{line}\n" for line in lines)
    return f"{body}END {len(lines)} {zlib.crc32(body.encode('ascii')):08x}\n"


def read_drive_table(data: bytes) -> ReadTable:
    """Read a table from the bytes of its text."""
    fault = _size_fault(data) or _damage(data)
    if fault is not None:
        return ReadTable(None, (fault,))
    lines = data.decode("ascii", errors="replace").split("\n")[:-2]
    reader = TableLines(lines)
    table = reader.table()
    return ReadTable(None if reader.faults else table, tuple(reader.faults))


def _size_fault(data: bytes) -> DriveFault | None:
    if len(data) > MOST_BYTES:
        return DriveFault(DriveCode.TABLE_TOO_LARGE, f"{len(data)} bytes; at most {MOST_BYTES} are read")
    lines = data.split(b"\n")
    if len(lines) - 1 > MOST_LINES:
        return DriveFault(DriveCode.TABLE_TOO_LARGE, f"{len(lines) - 1} lines; at most {MOST_LINES} are read")
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            text = f"line {number} has {len(line)} bytes; at most {LONGEST_LINE} are read"
            return DriveFault(DriveCode.TABLE_TOO_LARGE, text)
    return None


def _damage(data: bytes) -> DriveFault | None:
    """Say whether the text is not what was written, by its last line."""
    start = data.rfind(b"\n", 0, max(len(data) - 1, 0)) + 1
    end = _END.fullmatch(data, start)
    if end is None:
        return DriveFault(DriveCode.TABLE_DAMAGED, "the last line is not END with the number of lines and the CRC-32")
    found, stated = data.count(b"\n", 0, start), int(end.group(1))
    if found != stated:
        return DriveFault(DriveCode.TABLE_DAMAGED, f"{found} lines before END, which states {stated}")
    crc = b"%08x" % zlib.crc32(data[:start])
    if crc != end.group(2):
        text = f"the CRC-32 is {crc.decode()}, END states {end.group(2).decode()}; the text is damaged or was edited"
        return DriveFault(DriveCode.TABLE_DAMAGED, text)
    return None


def _lines(table: DriveTable) -> Iterator[str]:
    yield "ORIPDRIVE 3"
    yield f"BLOCK {table.block}"
    yield f"PROJECT {table.project}"
    yield f"USER {user_text(table.user)}"
    yield f"UNITS PLATE {table.plate_unit} PHOTO mm OBJECT {table.object_unit}"
    yield f"STAGE UPPER {_limits(table.upper)}"
    yield f"STAGE LOWER {_limits(table.lower)}"
    for camera in table.cameras:
        yield f"CAMERA {camera.name} {camera.projection.upper()} {_numbers(*camera.parameters[:3], *camera.frame)}"
    for camera in table.cameras:
        yield f"DISTORTION {camera.name} {camera.distortion_at.upper()} {_numbers(*camera.parameters[3:])}"
    for camera in table.cameras:
        yield from _set(camera)
    for template in table.templates:
        yield f"TEMPLATE {template.name} {template.stage}"
    for photo in table.photos:
        yield _photo(photo)
    for photo in table.photos:
        yield f"AFFINE {photo.name} {_numbers(*photo.affine)}"
    for model in table.models:
        yield _model(model)
    yield f"START {_numbers(*table.start)}"


def _limits(limits: StageLimits) -> str:
    return _numbers(limits.x_min, limits.x_max, limits.y_min, limits.y_max, limits.least_count)


def _set(camera: DriveCamera) -> Iterator[str]:
    if camera.additional is not None:
        parameters = camera.additional
        yield f"SET {camera.name} {parameters.name} {_numbers(parameters.base, *parameters.values)}"


def _photo(photo: DrivePhoto) -> str:
    numbers = _numbers(*photo.centre, *photo.rotation)
    return f"PHOTO {photo.name} {photo.camera} {photo.template or '-'} {photo.stage} {numbers}"


def _model(model: DriveModel) -> str:
    return f"MODEL {model.name} {model.row} {model.column} {model.left} {model.right} {model.optics}"


def _numbers(*values: float) -> str:
    return " ".join(f"{value:.17g}" for value in values)
