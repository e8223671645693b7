"""Histograms: bars of counts, and the curve that is expected."""

from __future__ import annotations

from typing import NamedTuple

from markupsafe import Markup

from orip.arrays import FloatArray, IntArray
from orip.report.drawings.svg import BOTTOM, LEFT, RIGHT, TOP, drawing, element, number, shown_tick, text, ticks

_WIDTH, _HEIGHT = 460.0, 220.0


class Bars(NamedTuple):
    """Bars between edges (n + 1,) with counts (n,), and the numbers (n,) that are expected, or None."""

    edges: FloatArray
    counts: IntArray
    expected: FloatArray | None


def histogram(label: str, across: str, bars: Bars) -> Markup:
    """Return a histogram."""
    low, high = float(bars.edges[0]), float(bars.edges[-1])
    top = max(float(bars.counts.max()), float(bars.expected.max()) if bars.expected is not None else 0.0, 1.0) * 1.05
    base = _HEIGHT - BOTTOM

    def x_of(value: float) -> float:
        return LEFT + (value - low) / (high - low) * (_WIDTH - LEFT - RIGHT)

    def y_of(count: float) -> float:
        return base - count / top * (base - TOP)

    parts = []
    for level in ticks(0.0, top, 4, whole=True):
        y = y_of(level)
        parts.append(element("line", x1=LEFT, x2=_WIDTH - RIGHT, y1=y, y2=y, class_="grid"))
        parts.append(text(LEFT - 6.0, y + 4.0, shown_tick(level), text_anchor="end"))
    for left, right, count in zip(bars.edges[:-1].tolist(), bars.edges[1:].tolist(), bars.counts.tolist(), strict=True):
        if count:
            a, b = x_of(left) + 0.5, x_of(right) - 0.5
            parts.append(
                element("rect", x=a, y=y_of(count), width=b - a, height=base - y_of(count), class_="histogram")
            )
    if bars.expected is not None:
        middles = ((bars.edges[:-1] + bars.edges[1:]) / 2.0).tolist()
        places = zip(map(x_of, middles), map(y_of, bars.expected.tolist()), strict=True)
        path = "L".join(f"{number(x)} {number(y)}" for x, y in places)
        parts.append(element("path", d=f"M{path}", class_="curve third"))
    steps = ticks(low, high, 8, whole=True)
    parts += [text(x_of(step), base + 16.0, shown_tick(step), text_anchor="middle") for step in steps]
    parts.append(element("line", x1=LEFT, x2=_WIDTH - RIGHT, y1=base, y2=base, class_="axis"))
    parts.append(text((LEFT + _WIDTH - RIGHT) / 2.0, _HEIGHT - 6.0, across, text_anchor="middle", class_="label"))
    return drawing(_WIDTH, _HEIGHT, label, parts, "chart")
