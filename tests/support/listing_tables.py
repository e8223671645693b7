"""Tables read back from listings: columns found by the rules beneath their headings."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple


class ListedTable(NamedTuple):
    """A table of a listing: its section, the last line of text above it, its headings, and its rows by heading.

    Where a section has the value of a heading twice, the second has a ' after its name. What stands under no heading is
    found under "".
    """

    section: str
    caption: str
    columns: tuple[str, ...]
    rows: tuple[dict[str, str], ...]

    def row(self, column: str, name: str) -> dict[str, str]:
        """Return the row with that cell."""
        (found,) = (row for row in self.rows if row[column] == name)
        return found


def listed_tables(text: str) -> Iterator[ListedTable]:
    """Yield all tables of a listing."""
    lines = text.split("\n")
    section = caption = ""
    for i, line in enumerate(lines):
        if re.fullmatch("=+", line):
            section = lines[i - 1]
        elif re.fullmatch(r" +-[- ]*", line):
            # headings, and units where there are any; blank line above them
            start = next(k for k in range(i - 1, 0, -1) if not lines[k] or re.fullmatch("=+", lines[k]))
            above = [line.strip() for line in lines[:start] if line.strip() and not re.fullmatch("=+", line)]
            caption = above[-1] if above else ""
            yield _table(section, caption, lines[start + 1], line, lines[i + 1 :])


def _table(section: str, caption: str, headings: str, rule: str, below: list[str]) -> ListedTable:
    spans = [match.span() for match in re.finditer("-+", rule)]
    columns: list[str] = []
    for a, b in spans:
        name = headings[a:b].strip()
        columns.append(f"{name}'" if name in columns else name)
    rows = []
    for line in below:
        if not line:
            break
        cells = {name: line[a:b].strip() for name, (a, b) in zip(columns, spans, strict=True)}
        cells[""] = f"{line[: spans[0][0]].strip()} {line[spans[-1][1] :].strip()}".strip()
        rows.append(cells)
    return ListedTable(section, caption, tuple(columns), tuple(rows))
