"""Points in result.json, of which a block may have a million: by name, or of a large block as columns.

They are written some thousands at a time, without building a document of them.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from functools import partial

import msgspec
import numpy as np
from msgspec import Struct

from orip.arrays import FloatArray
from orip.number_text import shortest_texts
from orip.records.results.solution import Solution

SINGULAR = "singular"
INDENT = "  "

POINTS_PER_PIECE = 8192
ELEMENTS_PER_LINE = 1024
"""Of columns, which nobody reads element by element."""

compact = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
"""Returns JSON on one line."""


class Points(Struct, frozen=True):
    """The points of a solution, written without building a document of them: blocks have many."""

    solution: Solution

    def pieces(self, margin: str) -> Iterator[str]:
        """Yield the text; `margin` is what the lines of the object around them begin with."""
        points, rays, kinds = self.solution.points, self.solution.point_rays, self.solution.point_kinds
        if not points.names:
            yield "{}"
            return
        one = margin + INDENT
        entries = [f'"{axis}": {{"value": %s, "sd": %s}}' for axis in "XYZ"] + ['"rays": %s', '"kind": "%s"']
        form = f"\n{one}%s: {{" + ",".join(f"\n{one}{INDENT}{entry}" for entry in entries) + f"\n{one}}}"
        between = form.split("%s")
        yield "{"
        for start in range(0, len(points.names), POINTS_PER_PIECE):
            part = slice(start, start + POINTS_PER_PIECE)
            figures = [
                texts
                for k in range(3)
                for texts in (
                    _number_texts(points.values[part, k], "null"),
                    _number_texts(points.sd[part, k], f'"{SINGULAR}"'),
                )
            ]
            columns = [
                list(map(compact, points.names[part])),
                *figures,
                list(map(str, rays[part].tolist())),
                list(kinds[part]),
            ]
            yield ("," if start else "") + _woven(between, columns)
        yield f"\n{margin}}}"


class Column(Struct, frozen=True):
    """A list of `count` elements, of which `rows` returns some."""

    count: int
    rows: Callable[[slice], list[object]]

    def pieces(self, margin: str) -> Iterator[str]:
        """Yield the list as JSON, many elements on a line."""
        yield "["
        for start in range(0, self.count, ELEMENTS_PER_LINE):
            line = msgspec.json.encode(self.rows(slice(start, start + ELEMENTS_PER_LINE))).decode("utf-8")[1:-1]
            yield f"{',' if start else ''}\n{margin}{INDENT}{line}"
        yield f"\n{margin}]"


def point_columns(solution: Solution) -> dict[str, Column]:
    """Return the points of a solution as columns of equal length, by name."""
    points, count = solution.points, len(solution.points.names)
    columns: dict[str, Callable[[slice], list[object]]] = {"name": lambda rows: list(points.names[rows])}
    for k, axis in enumerate("XYZ"):
        columns[axis] = partial(_numbers, points.values[:, k], None)
        columns[f"{axis}_sd"] = partial(_numbers, points.sd[:, k], SINGULAR)
    columns["rays"] = lambda rows: solution.point_rays[rows].tolist()
    columns["kind"] = lambda rows: list(solution.point_kinds[rows])
    return {name: Column(count, rows) for name, rows in columns.items()}


def _numbers(values: FloatArray, infinite: str | None, rows: slice) -> list[object]:
    """Return some numbers as JSON has them: None for NaN, `infinite` for infinity."""
    some = values[rows]
    found: list[object] = some.tolist()
    for place in np.flatnonzero(~np.isfinite(some)).tolist():
        found[place] = None if np.isnan(some[place]) else infinite
    return found


def _woven(between: Sequence[str], columns: Sequence[Sequence[str]]) -> str:
    """Return the rows of columns of texts, separated by commas, with one more text around and between their cells."""
    count, width = len(columns[0]), 2 * len(columns) + 1
    row = [""] * width
    row[::2] = ["," + between[0], *between[1:]]
    cells = row * count
    for place, column in enumerate(columns):
        cells[2 * place + 1 :: width] = column
    cells[0] = between[0]
    return "".join(cells)


def _number_texts(values: FloatArray, infinite: str) -> list[str]:
    """Return numbers as JSON has them; `infinite` for infinity."""
    texts = shortest_texts(values, missing="null")
    for place in np.flatnonzero(np.isinf(values)).tolist():
        texts[place] = infinite
    return texts
