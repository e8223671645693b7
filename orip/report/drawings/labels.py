"""The plane of a map with its frame, grid and scale bar; names beside marks; histograms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray
from orip.report.drawings.svg import BOTTOM, LEFT, RIGHT, TOP, drawing, element, number, shown_tick, text, ticks

_CHARACTER, _HEIGHT, _MARK = 5.6, 9.0, 4.0
"""Width and height of a letter of a small name, and half the side of a mark, pixels."""

_SIDES = ((5.0, -4.0, "start"), (5.0, 10.0, "start"), (-5.0, -4.0, "end"), (-5.0, 10.0, "end"))
"""Where a name may be: shift of its base from the mark, and which of its ends is there."""


class Box(NamedTuple):
    """A part of a drawing, in pixels; y points down."""

    left: float
    top: float
    right: float
    bottom: float

    def meets(self, other: Box) -> bool:
        """Tell whether the two overlap."""
        apart = other.right <= self.left or self.right <= other.left
        return not (apart or other.bottom <= self.top or self.bottom <= other.top)

    def holds(self, other: Box) -> bool:
        """Tell whether the other is inside."""
        across = self.left <= other.left and other.right <= self.right
        return across and self.top <= other.top and other.bottom <= self.bottom


class Label(NamedTuple):
    """A name, the place of its base (pixels), and which end of it is there: ``start`` or ``end``."""

    name: str
    x: float
    y: float
    anchor: str


def labels(marks: NDArray[np.float64], names: Sequence[str], frame: Box) -> list[Label]:
    """Return the names that find room beside their marks (n, 2) within a frame; those named first go first."""
    places = [(x, y, name) for (x, y), name in zip(marks.tolist(), names, strict=True) if np.isfinite([x, y]).all()]
    taken = [Box(x - _MARK, y - _MARK, x + _MARK, y + _MARK) for x, y, _ in places]
    found = []
    for x, y, name in places:
        for label, box in _sides(x, y, name):
            if frame.holds(box) and not any(box.meets(other) for other in taken):
                taken.append(box)
                found.append(label)
                break
    return found


def _sides(x: float, y: float, name: str) -> Iterator[tuple[Label, Box]]:
    width = _CHARACTER * len(name)
    for right, down, anchor in _SIDES:
        base = y + down
        left = x + right - (width if anchor == "end" else 0.0)
        yield Label(name, x + right, base, anchor), Box(left, base - _HEIGHT + 1.0, left + width, base + 1.0)


WIDTH = 620.0
"""Width of the widest map, pixels."""

_TALLEST, _SHORTEST = 560.0, 60.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 78.0, 14.0, 12.0, 46.0


class MapPlane(NamedTuple):
    """The plane of a map: lower left corner, scale (pixels a ground unit), and its size in pixels without margins."""

    low: FloatArray
    scale: float
    width: float
    height: float

    @property
    def size(self) -> tuple[float, float]:
        """Return the size of the whole drawing, pixels."""
        return self.width + _LEFT + _RIGHT, self.height + _TOP + _BOTTOM

    @property
    def frame(self) -> Box:
        """Return the frame of the map in the drawing."""
        return Box(_LEFT, _TOP, _LEFT + self.width, _TOP + self.height)

    def place(self, at: FloatArray) -> FloatArray:
        """Return pixels (n, 2) of coordinates (n, 2)."""
        x = _LEFT + (at[:, 0] - self.low[0]) * self.scale
        y = _TOP + self.height - (at[:, 1] - self.low[1]) * self.scale
        return np.stack([x, y], axis=1)

    def clipped(self, drawn: Iterable[str]) -> str:
        """Return a drawing within the drawing, which cuts off what is beyond the frame."""
        return element(
            "svg", "".join(drawn), x=_LEFT, y=_TOP, width=self.width, height=self.height,
            viewBox=" ".join(map(number, (_LEFT, _TOP, self.width, self.height))),
        )  # fmt: skip

    def axes(self, names: Sequence[str]) -> list[str]:
        """Return the frame, a grid of round coordinates, their labels, and the names of the axes."""
        right, base = _LEFT + self.width, _TOP + self.height
        high = self.low + np.array([self.width, self.height]) / self.scale
        parts = [element("rect", x=_LEFT, y=_TOP, width=self.width, height=self.height, class_="frame")]
        for tick in ticks(float(self.low[0]), float(high[0]), 6):
            x = _LEFT + (tick - self.low[0]) * self.scale
            parts.append(element("line", x1=x, x2=x, y1=_TOP, y2=base, class_="grid"))
            parts.append(text(x, base + 16.0, _tick(tick), text_anchor="middle"))
        for tick in ticks(float(self.low[1]), float(high[1]), max(int(self.height / 70), 3)):
            y = base - (tick - self.low[1]) * self.scale
            parts.append(element("line", x1=_LEFT, x2=right, y1=y, y2=y, class_="grid"))
            parts.append(text(_LEFT - 6.0, y + 4.0, _tick(tick), text_anchor="end"))
        across, up = names
        y = _TOP + self.height / 2.0
        label = {"text_anchor": "middle", "class_": "label"}
        return [
            *parts,
            text(_LEFT, base + 34.0, across, class_="label"),
            text(12.0, y, up, transform=f"rotate(-90 12 {number(y)})", **label),
        ]

    def scale_bar(self, length: float, words: str) -> list[str]:
        """Return a bar of a length (pixels) below the map on the right, and the words before it."""
        x, y = _LEFT + self.width - length - 8.0, _TOP + self.height + 30.0
        bar = element("path", d=f"M{number(x)} {number(y)}h{number(length)}", class_="bar")
        return [bar, text(x - 5.0, y + 4.0, words, text_anchor="end")]


def map_plane(low: FloatArray, high: FloatArray) -> MapPlane:
    """Return the plane of a map that reaches from one corner to the other, ground units."""
    width, height = (high - low).tolist()
    scale = min((WIDTH - _LEFT - _RIGHT) / width, (_TALLEST - _TOP - _BOTTOM) / height)
    if height * scale < _SHORTEST:
        low = low - [0.0, (_SHORTEST / scale - height) / 2.0]
        height = _SHORTEST / scale
    return MapPlane(low, scale, width * scale, height * scale)


def labels_of(axes: Sequence[int], unit: str) -> list[str]:
    """Return the names of coordinate axes with their unit."""
    return [f"{'XYZ'[axis]} ({unit})" for axis in axes]


def _tick(value: float) -> str:
    return shown_tick(value) if abs(value) < 1e6 else f"{value:,.0f}".replace(",", "\N{NARROW NO-BREAK SPACE}")


_WIDTH, _HISTOGRAM_HEIGHT = 460.0, 220.0


class Bars(NamedTuple):
    """Bars between edges (n + 1,) with counts (n,), and the numbers (n,) that are expected, or None."""

    edges: FloatArray
    counts: IntArray
    expected: FloatArray | None


def histogram(label: str, across: str, bars: Bars) -> Markup:
    """Return a histogram."""
    low, high = float(bars.edges[0]), float(bars.edges[-1])
    top = max(float(bars.counts.max()), float(bars.expected.max()) if bars.expected is not None else 0.0, 1.0) * 1.05
    base = _HISTOGRAM_HEIGHT - BOTTOM

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
    parts.append(
        text((LEFT + _WIDTH - RIGHT) / 2.0, _HISTOGRAM_HEIGHT - 6.0, across, text_anchor="middle", class_="label")
    )
    return drawing(_WIDTH, _HISTOGRAM_HEIGHT, label, parts, "chart")
