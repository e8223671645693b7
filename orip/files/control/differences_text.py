"""Differences between exposure stations as text (.REL)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from orip.errors import Complaint
from orip.files.control.correlations import CORRELATION_KEYS, correlation_cells, read_covariance
from orip.files.control.stations_text import observed_triple, radians
from orip.files.text.lines import FieldReader, field_lines, read_lines
from orip.files.text.shown import Parsed
from orip.records.control import ANGLE_ERRORS, GROUND_ERRORS, NOT_GIVEN, StationDifference
from orip.records.names import record_key
from orip.units import RADIANS_PER_DEGREE

DIFFERENCE_KEYS = (
    "first", "second", "dX", "dY", "dZ", "aX", "aY", "aZ", "dOMEGA", "dPHI", "dKAPPA", "aOMEGA", "aPHI", "aKAPPA",
    *CORRELATION_KEYS,
)  # fmt: skip
"""Fields of a line; those from the ninth on may be missing in the groups of `OPTIONAL_DIFFERENCE_KEYS`."""

OPTIONAL_DIFFERENCE_KEYS = (DIFFERENCE_KEYS[8:14], DIFFERENCE_KEYS[14:])

_FORM = (
    "first second dX dY dZ aX aY aZ, then dOMEGA dPHI dKAPPA aOMEGA aPHI aKAPPA, "
    f"{len(CORRELATION_KEYS)} coefficients of correlation {CORRELATION_KEYS[0]} {CORRELATION_KEYS[1]} ... "
    f"{CORRELATION_KEYS[-1]} as far as known"
)
_COUNTS = (8, 14, len(DIFFERENCE_KEYS))
_UNKNOWN = "-"


def read_differences(path: Path, shown: str) -> Parsed[tuple[StationDifference, ...]]:
    """Read differences between stations: see `DIFFERENCE_KEYS`; a file that is absent has no records."""
    return parse_differences(read_lines(path, shown, may_be_absent=True), shown)


def parse_differences(text: Parsed[list[str]], shown: str) -> Parsed[tuple[StationDifference, ...]]:
    """Read a text as `read_differences` reads a file."""
    found: list[StationDifference] = []
    complaints: list[Complaint] = list(text.complaints)
    first_lines: dict[frozenset[str], int] = {}
    for line in field_lines(text.value):
        reader = FieldReader(line, shown)
        difference = _read_difference(reader)
        if difference is not None:
            pair = frozenset({record_key(difference.first), record_key(difference.second)})
            first = first_lines.setdefault(pair, line.number)
            if len(pair) == 1:
                reader.complain(f"photo '{reader.shown_text(0)}' is both the first and the second; name two photos", 1)
            elif first != line.number:
                reader.complain(f"these two photos are already on line {first}; keep one of the two lines")
        complaints += reader.complaints
        if difference is not None and not reader.complaints:
            found.append(difference)
    return Parsed(tuple(found), tuple(complaints))


def _read_difference(reader: FieldReader) -> StationDifference | None:
    if not reader.has_fields(_COUNTS, _FORM) or reader.is_heading(range(2, 8)):
        return None
    first, second = reader.name(0), reader.name(1)
    position, position_error = observed_triple(reader, 2, GROUND_ERRORS, "position", "dX, dY and dZ")
    angles, angle_error = NOT_GIVEN, NOT_GIVEN
    if reader.count >= _COUNTS[1]:
        angles, angle_error = observed_triple(reader, 8, ANGLE_ERRORS, "rotation", "dOMEGA, dPHI and dKAPPA")
    if math.isnan(position[0]) and math.isnan(angles[0]) and not reader.complaints:
        reader.complain("the line has neither a difference of positions nor a rotation; remove it")
    errors = (*position_error, *(error * RADIANS_PER_DEGREE for error in angle_error))
    if 0.0 in errors:
        reader.complain("an error of 0; differences are observed, not constant: write an error above 0")
    return StationDifference(
        first, second, position, position_error, radians(angles), radians(angle_error),
        read_covariance(reader, errors, _COUNTS[1], len(CORRELATION_KEYS)), reader.number,
    )  # fmt: skip


_LENGTHS, _DEGREES, _COEFFICIENTS = 5, 7, 7
"""Decimals: a hundredth of a millimetre, a ten-millionth of a degree; rounded coefficients are to stay possible."""


def differences_text(differences: Sequence[StationDifference]) -> str:
    """Return the lines of differences, in columns."""
    rows = [_fields(line) for line in differences]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "".join(
        "  ".join(
            text.ljust(width) if n < 2 else text.rjust(width)
            for n, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        + "\n"
        for row in rows
    )


def _fields(line: StationDifference) -> list[str]:
    lengths = [*line.position, *line.position_error]
    degrees = [angle / RADIANS_PER_DEGREE for angle in (*line.angles, *line.angle_error)]
    return [
        line.first,
        line.second,
        *(_fixed(value, _LENGTHS) for value in lengths),
        *(_fixed(value, _DEGREES) for value in degrees),
        *correlation_cells(line.covariance, _COEFFICIENTS),
    ]


def _fixed(value: float, decimals: int) -> str:
    return _UNKNOWN if math.isnan(value) else f"{value:.{decimals}f}"
