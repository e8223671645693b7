"""Drawings as SVG text: elements, axes with round numbers, line charts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from html import escape

from markupsafe import Markup
from msgspec import Struct


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
