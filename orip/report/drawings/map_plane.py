"""The plane of a map: from ground coordinates to pixels, its frame and grid, and a scale bar."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import FloatArray
from orip.report.drawings.labels import Box
from orip.report.drawings.svg import element, number, shown_tick, text, ticks

WIDTH = 620.0
"""Width of the widest map, pixels."""

_TALLEST, _SHORTEST = 560.0, 60.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 64.0, 14.0, 12.0, 46.0


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
