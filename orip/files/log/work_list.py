"""A list of points to digitise: names, or a measurement file of which the names count.

    1001                      a point, wherever it is to be found
    POINTS MAIN P101          what follows is meant in that photo
      1002   ! predicted 1.2 3.4
      1003   35.2310  -12.0040

What follows a name is ignored, as are blocks of templates and photos, and edits.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from orip.errors import Complaint
from orip.files.log.headers import ACTIONS, BLOCK_KINDS
from orip.files.text.lines import TextLine, field_lines, field_name_fault, read_lines
from orip.files.text.parsed import Parsed
from orip.files.text.shown import shown_token

_POINTS = "POINTS"


class ListedPoint(NamedTuple):
    """A point, and where it is meant if the list says so; `line` is where it stands."""

    point: str
    photo: str | None
    bundle: str | None
    line: int


def read_work_list(path: Path, shown: str) -> Parsed[tuple[ListedPoint, ...]]:
    """Read a list of points.

    Parameters
    ----------
    path : Path
    shown : str
        The file as the user would name it.
    """
    text = read_lines(path, shown)
    listed = work_list(field_lines(text.value), shown)
    return Parsed(listed.value, (*text.complaints, *listed.complaints))


def work_list(lines: Iterable[TextLine], shown: str) -> Parsed[tuple[ListedPoint, ...]]:
    """Return the points of lines."""
    points: list[ListedPoint] = []
    complaints: list[Complaint] = []
    bundle: str | None = None
    photo: str | None = None
    counts = True
    for line in lines:
        words = [field.text for field in line.fields]
        keyword = words[0].upper()
        if keyword in ACTIONS:
            continue
        if keyword in BLOCK_KINDS and len(words) > 1:
            counts = keyword == _POINTS
            if counts and len(words) != 3:
                complaints.append(Complaint(f"write POINTS bundle photo, not {len(words)} words", shown, line.number))
            bundle, photo = words[1], words[-1]
            continue
        fault = field_name_fault(words[0])
        if fault is not None:
            complaints.append(Complaint(f"{shown_token(words[0])}: {fault}", shown, line.number))
        elif counts:
            points.append(ListedPoint(words[0], photo, bundle, line.number))
    return Parsed(tuple(points), tuple(complaints))
