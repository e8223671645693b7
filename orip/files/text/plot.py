"""A plot in characters: curves and points over one axis, for terminals and listings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray


class Characters(NamedTuple):
    """What a plot is drawn with."""

    curve: str
    point: str
    zero: str
    side: str
    corner: str
    base: str


UNICODE = Characters("•", "◇", "╌", "│", "└", "─")
ASCII = Characters("*", "o", "-", "|", "+", "-")


def text_plot(
    curve: tuple[FloatArray, FloatArray],
    points: tuple[FloatArray, FloatArray],
    size: tuple[int, int],
    labels: tuple[str, str],
    characters: Characters,
) -> list[str]:
    """Return the lines of a plot; where a point meets the curve, the point is drawn.

    Parameters
    ----------
    curve, points : pairs of arrays
        x and y; a curve is interpolated between its values. x counts from 0.
    size : (int, int)
        Columns and lines of the field inside the axes.
    labels : (str, str)
        What x and y are, with units.
    characters : Characters
    """
    width, height = size
    y_all = np.concatenate([curve[1], points[1], [0.0]])
    low, high = float(y_all.min()), float(y_all.max())
    if low == high:
        low, high = -1.0, 1.0
    end = float(max(curve[0].max(initial=0.0), points[0].max(initial=0.0)))
    field = [[" "] * width for _ in range(height)]

    def row_of(y: float) -> int:
        return round((high - y) / (high - low) * (height - 1))

    field[row_of(0.0)] = [characters.zero] * width
    at = np.linspace(0.0, end, width)
    for column, y in enumerate(np.interp(at, *curve).tolist()):
        field[row_of(y)][column] = characters.curve
    for x, y in zip(points[0].tolist(), points[1].tolist(), strict=True):
        field[row_of(y)][round(x / end * (width - 1))] = characters.point
    return _framed(field, (low, high, end), row_of(0.0), labels, characters)


def _framed(
    field: Sequence[Sequence[str]],
    ends: tuple[float, float, float],
    zero: int,
    labels: tuple[str, str],
    characters: Characters,
) -> list[str]:
    low, high, end = ends
    marks = {0: f"{high:z.4g}", len(field) - 1: f"{low:z.4g}", zero: "0"}
    margin = max(map(len, marks.values()))
    lines = [f"{labels[1]}"]
    for row, cells in enumerate(field):
        lines.append(f"{marks.get(row, ''):>{margin}} {characters.side}{''.join(cells)}".rstrip())
    lines.append(f"{'':>{margin}} {characters.corner}{characters.base * len(field[0])}")
    last = f"{end:.4g}  {labels[0]}"
    lines.append(f"{'':>{margin}}  0{last:>{len(field[0]) - 1}}")
    return lines
