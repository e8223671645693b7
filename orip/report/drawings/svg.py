"""Drawings as SVG text: elements, axes, line charts, histograms; the plane of a map with its frame, grid and names."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from html import escape
from typing import NamedTuple

import numpy as np
from markupsafe import Markup
from msgspec import Struct
from numpy.typing import NDArray

from orip.arrays import FloatArray, IntArray


class Curve(Struct, frozen=True):
    """A curve of a chart: points (x, y), the name in the key, and its style class."""

    points: Sequence[tuple[float, float]]
    name: str
    style: str


class ChartFrame(Struct, frozen=True):
    """Size of a chart in pixels, and the labels of its axes; counts are whole numbers from zero upwards."""

    across: str
    up: str
    width: float = 360.0
    height: float = 220.0
    whole_across: bool = False
    logarithmic: bool = False
    counts: bool = False


Place = Callable[[float, float], tuple[float, float]]
"""Pixels for the numbers at the axes."""

LEFT, RIGHT, TOP, BOTTOM = 52.0, 12.0, 12.0, 40.0


def element(tag: str, content: str = "", **attributes: object) -> str:
    """Return an element; underscores of attribute names become hyphens, ``class_`` is class."""
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{escape(number(value) if isinstance(value, float) else str(value))}"'
        for name, value in attributes.items()
    )
    return f"<{tag}{written}>{content}</{tag}>" if content else f"<{tag}{written}/>"


def number(value: float) -> str:
    """Return a coordinate of a drawing, to a hundredth of a pixel."""
    return f"{value:z.2f}".rstrip("0").rstrip(".")


def numbers(values: Iterable[float]) -> list[str]:
    """Return many coordinates of a drawing as `number` does, in one call: reports have a hundred thousand."""
    every = tuple(values)
    text = "<%.2f>" * len(every) % every
    # ends of numbers: whole ones are set apart, so that only zeros behind a point are taken away
    text = text.replace("<-0.00>", "<0.00>").replace(".00>", "!").replace("0>", ">").replace("!", ">")
    return text[1:-1].split("><") if every else []


def drawing(width: float, height: float, label: str, parts: Iterable[str], style: str = "") -> Markup:
    """Return an SVG drawing that shrinks with the page; the label is read out to those who cannot see it."""
    content = element("title", escape(label)) + "".join(parts)
    return Markup(
        element(
            "svg", content, class_=f"drawing {style}".strip(), viewBox=f"0 0 {number(width)} {number(height)}",
            style=f"--width:{number(width)}px", role="img", aria_label=label,
        )
    )  # fmt: skip


def text(x: float, y: float, words: str, **attributes: object) -> str:
    """Return text at a place."""
    return element("text", escape(words), x=x, y=y, **attributes)


def round_step(span: float, parts: int) -> float:
    """Return 1, 2 or 5 times a power of ten that divides a span into about `parts` steps."""
    if not (span > 0.0 and math.isfinite(span)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(span / parts))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power * parts >= span * 0.999)


def ticks(low: float, high: float, parts: int = 5, *, whole: bool = False) -> list[float]:
    """Return round numbers between two bounds."""
    step = round_step(high - low, parts)
    if whole:
        step = max(1.0, step)
    first = math.ceil(low / step - 1e-9)
    return [place * step for place in range(first, math.floor(high / step + 1e-9) + 1)]


def shown_tick(value: float) -> str:
    """Return the number at a tick."""
    return f"{value:.6g}".replace("-", "−")


def line_chart(label: str, frame: ChartFrame, lines: Sequence[Curve]) -> Markup:
    """Return a chart of curves over a common axis."""
    finite = [[(x, y) for x, y in line.points if math.isfinite(x) and math.isfinite(y)] for line in lines]
    ups = [y for points in finite for _, y in points]
    acrosses = [x for points in finite for x, _ in points]
    if not ups:
        return Markup("")
    x0, x1 = _widened(min(acrosses), max(acrosses), 0.0)
    scaled = [math.log10(y) for y in ups if y > 0.0] if frame.logarithmic else ups
    y0, y1 = _widened(0.0, max(1.0, *scaled), 0.06) if frame.counts else _widened(min(scaled), max(scaled), 0.06)

    def place(x: float, y: float) -> tuple[float, float]:
        height = math.log10(max(y, 1e-300)) if frame.logarithmic else y
        return (
            LEFT + (x - x0) / (x1 - x0) * (frame.width - LEFT - RIGHT),
            frame.height - BOTTOM - (height - y0) / (y1 - y0) * (frame.height - TOP - BOTTOM),
        )

    parts = [*_across(frame, x0, x1, place, y0), *_up(frame, y0, y1, place, x0)]
    for line, points in zip(lines, finite, strict=True):
        if points:
            path = "M" + "L".join(" ".join(map(number, place(*point))) for point in points)
            parts.append(element("path", d=path, class_=f"curve {line.style}"))
            parts += [_dot(place(*point), line.style) for point in points if len(points) <= 40]
    return drawing(frame.width, frame.height, label, parts, "chart")


def _dot(at: tuple[float, float], style: str) -> str:
    return element("circle", cx=at[0], cy=at[1], r=2.2, class_=f"dot {style}")


def _across(frame: ChartFrame, x0: float, x1: float, place: Place, y0: float) -> Iterable[str]:
    base = frame.height - BOTTOM
    for tick in ticks(x0, x1, 6, whole=frame.whole_across):
        x, _ = place(tick, 10.0**y0 if frame.logarithmic else y0)
        yield element("line", x1=x, x2=x, y1=base, y2=base + 4, class_="axis")
        yield text(x, base + 16, shown_tick(tick), text_anchor="middle")
    yield element("line", x1=LEFT, x2=frame.width - RIGHT, y1=base, y2=base, class_="axis")
    yield text((LEFT + frame.width - RIGHT) / 2, frame.height - 6, frame.across, text_anchor="middle", class_="label")


def _up(frame: ChartFrame, y0: float, y1: float, place: Place, x0: float) -> Iterable[str]:
    if frame.logarithmic:
        levels = [power * 10.0**place_ for place_ in range(math.floor(y0), math.ceil(y1) + 1) for power in (1, 2, 5)]
        levels = [level for level in levels if y0 <= math.log10(level) <= y1]
        if len(levels) > 7:
            levels = [level for level in levels if math.log10(level) == round(math.log10(level))]
    else:
        levels = ticks(y0, y1, whole=frame.counts)
    for level in levels:
        _, y = place(x0, level)
        yield element("line", x1=LEFT, x2=frame.width - RIGHT, y1=y, y2=y, class_="zero" if level == 0 else "grid")
        yield text(LEFT - 6, y + 4, shown_tick(level), text_anchor="end")
    middle = (TOP + frame.height - BOTTOM) / 2
    yield text(
        12.0, middle, frame.up, text_anchor="middle", class_="label", transform=f"rotate(-90 12 {number(middle)})"
    )


def _widened(low: float, high: float, part: float) -> tuple[float, float]:
    span = high - low
    if span <= 0.0:
        return low - 0.5, high + 0.5
    return low - part * span, high + part * span


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
