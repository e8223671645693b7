"""Names beside the marks of a drawing, none over another name or mark."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
