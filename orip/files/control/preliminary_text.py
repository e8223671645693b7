"""Preliminary coordinates of points as text (.PRE)."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from orip.errors import Complaint
from orip.files.text.decimal_numbers import LARGEST_NUMBER, ORDINARY_NUMBER
from orip.files.text.lines import FieldReader, read_lines, split_line
from orip.files.text.shown import Parsed
from orip.records.control import PreliminaryPoint
from orip.records.names import RESERVED_NAMES, name_fault

if TYPE_CHECKING:
    from orip.arrays import FloatArray


_PLAIN = re.compile(r"[ \t]*+(?![!#])([!-~]++)" + 3 * rf"[ \t]++({ORDINARY_NUMBER})" + r"[ \t]*+")
"""A line that is a name and three ordinary numbers, as nearly all are; the others are read field by field."""


def read_preliminary(path: Path, shown: str) -> Parsed[tuple[PreliminaryPoint, ...]]:
    """Read preliminary points: ``name X Y Z [sX sY sZ]``, ground units.

    A file that is absent has no records: nothing was computed yet.
    """
    return parse_preliminary(read_lines(path, shown, may_be_absent=True), shown)


def parse_preliminary(text: Parsed[list[str]], shown: str) -> Parsed[tuple[PreliminaryPoint, ...]]:
    """Read a text as `read_preliminary` reads a file."""
    points: list[PreliminaryPoint] = []
    complaints: list[Complaint] = list(text.complaints)
    first_lines: dict[str, int] = {}
    for number, written in enumerate(text.value, start=1):
        plain = _plain_point(written, number)
        if plain is not None and first_lines.setdefault(plain.name, number) == number:
            points.append(plain)
            continue
        line = split_line(written, number)
        if line is None:
            continue
        reader = FieldReader(line, shown)
        point = _read_point(reader)
        name = reader.text(0)
        first = first_lines.setdefault(name, line.number)
        if first != line.number:
            reader.complain(f"point '{reader.shown_text(0)}' is already on line {first}; keep one of the two lines")
        complaints += reader.complaints
        if point is not None and not reader.complaints:
            points.append(point)
    return Parsed(tuple(points), tuple(complaints))


def _plain_point(line: str, number: int) -> PreliminaryPoint | None:
    """Return the point of a plain line; None for every other one."""
    found = _PLAIN.fullmatch(line)
    if found is None:
        return None
    name, *coordinates = found.groups()
    x, y, z = map(float, coordinates)
    if name in RESERVED_NAMES or max(abs(x), abs(y), abs(z)) > LARGEST_NUMBER:
        return None
    return PreliminaryPoint(name, (x, y, z), None, number)


def _read_point(reader: FieldReader) -> PreliminaryPoint | None:
    form = "name X Y Z, and sX sY sZ if they are known"
    if not reader.has_fields((4, 7), form) or reader.is_heading((1, 2, 3)):
        return None
    name = reader.name(0)
    coordinates = (reader.decimal(1), reader.decimal(2), reader.decimal(3))
    if reader.count == 4:
        return PreliminaryPoint(name, coordinates, None, reader.number)
    deviations = (reader.decimal(4), reader.decimal(5), reader.decimal(6))
    for index, deviation in enumerate(deviations, start=4):
        if deviation < 0:
            reader.complain(f"standard deviation {reader.shown_text(index)} is negative; write 0 or more", index)
    return PreliminaryPoint(name, coordinates, deviations, reader.number)


def preliminary_text(points: Sequence[PreliminaryPoint]) -> str:
    """Return the text of a .PRE file, one point a line; reading it gives the very same numbers.

    Raises
    ------
    ValueError
        If a name is not allowed, a number is not finite or a standard deviation is negative: no reader would take it.
    """
    rows = [_row(point) for point in points]
    name_width = max((len(row[0]) for row in rows), default=0)
    widths = [_widths([row[column] for row in rows if column < len(row)]) for column in range(1, 7)]
    lines = []
    for name, *numbers in rows:
        aligned = [_aligned(number, *width) for number, width in zip(numbers, widths, strict=False)]
        lines.append("  ".join([name.ljust(name_width), *aligned]).rstrip() + "\n")
    return "".join(lines)


def coordinates_text(names: Sequence[str], coordinates: FloatArray) -> str:
    """Return the text of a .PRE file of many points without standard deviations, fields one blank apart.

    Parameters
    ----------
    names : sequence of m str
        Fit for points.
    coordinates : array (m, 3)
        Finite.
    """
    import numpy as np  # reading takes no arrays

    from orip.number_text import shortest_texts

    columns = [shortest_texts(np.ascontiguousarray(values), "nan") for values in coordinates.T]
    return "".join(f"{name} {x} {y} {z}\n" for name, x, y, z in zip(names, *columns, strict=True))


def _row(point: PreliminaryPoint) -> list[str]:
    fault = name_fault(point.name)
    deviations = point.deviations or ()
    if fault is None and not all(math.isfinite(number) for number in (*point.coordinates, *deviations)):
        fault = f"point '{point.name}' has a number that is not finite"
    if fault is None and any(deviation < 0 for deviation in deviations):
        fault = f"point '{point.name}' has a negative standard deviation"
    if fault is not None:
        raise ValueError(fault)
    return [point.name, *(repr(float(number)) for number in (*point.coordinates, *deviations))]


def _parts(number: str) -> tuple[str, str]:
    """Split a number at its decimal point; without a point everything is before it."""
    whole, point, fraction = number.partition(".")
    return whole, point + fraction


def _widths(numbers: Sequence[str]) -> tuple[int, int]:
    parts = [_parts(number) for number in numbers]
    return max((len(p[0]) for p in parts), default=0), max((len(p[1]) for p in parts), default=0)


def _aligned(number: str, before: int, after: int) -> str:
    """Return a number padded so that the decimal points of a column stand below each other."""
    whole, rest = _parts(number)
    return whole.rjust(before) + rest.ljust(after)
