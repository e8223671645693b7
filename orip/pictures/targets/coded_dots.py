"""Coded dots: a dark dot with a ring of dark and light fields about it, whose order is the dot's number.

With the dot's radius as unit the ring reaches from 2 to 3, and the ground is light from 1 to 2 and from 3 to 3.5. The
code is the circular word of the fields, read clockwise from wherever it is least, as of PhotoModeler's RAD targets and
Schneider's ring codes. Between any two codes of a family, and the mirror image of any, at least four fields differ
however they are turned: up to three fields that are misread, or a mirrored picture, give no code of the family.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from orip.arrays import FloatArray
from orip.pictures.targets.dots import Dot, as_bytes, find_dots
from orip.pictures.targets.marks import FoundTargets, Mark, Rejected

FAMILIES = {"RINGS_16": 16, "RINGS_20": 20}
"""Names of families of codes, and their numbers of fields: 31 codes of 16, 289 of 20."""

INNER, OUTER = 2.0, 3.0
"""Radii of the ring, in those of the dot."""

_APART = 4
"""Fields that differ between two codes, at least."""

_RING = np.array([2.3, 2.4, 2.5, 2.6, 2.7])
_GROUND = np.array([1.45, 1.55, 3.25, 3.35])
"""Radii that are read: away from the edges, which are blurred."""

_REACH = 1.6
"""Radii within which a dot is measured: its blurred edge, and not that of its ring."""

_SAMPLES = 24
"""Of each field."""

_MIDDLE = slice(5, 19)
"""Of a field, what is read of it: edges are blurred."""

_LIGHT, _DARK = 0.25, 0.75
"""Parts of the dot's contrast below which a field is light, and above which it is dark."""


@cache
def codes_of(family: str) -> tuple[int, ...]:
    """Return the codes of a family in the order of their numbers: words of the fields, the first one highest.

    Each word that differs enough from all that are taken, and their mirror images, is taken (a lexicographic code);
    words of too few dark or light fields are left out.
    """
    count = FAMILIES[family]
    words = np.arange(1 << count, dtype=np.uint32)
    ones = np.bitwise_count(words)
    least = np.minimum.reduce(_turned(words, count))
    left = words[(least == words) & (ones >= count // 4) & (ones <= count - count // 4)]
    left = left[_least_difference(left, _mirrored(left, count), ones, count) >= _APART]
    codes = []
    while len(left):
        codes.append(int(left[0]))
        own = np.minimum(
            _least_difference(left, left[:1], ones, count),
            _least_difference(left, _mirrored(left[:1], count), ones, count),
        )
        left = left[own >= _APART]
    return tuple(codes)


def dark_runs(family: str, number: int) -> list[tuple[float, float]]:
    """Return where dark parts of a ring begin and end, radians clockwise; of a part over the first field past 2 pi."""
    count = FAMILIES[family]
    code = codes_of(family)[number]
    bits = [bool(code >> (count - 1 - field) & 1) for field in range(count)]
    step = 2.0 * np.pi / count
    begins = [field for field in range(count) if bits[field] and not bits[field - 1]]
    runs = []
    for begin in begins:
        end = begin
        while bits[end % count]:
            end += 1
        runs.append((begin * step, end * step))
    return runs


def find_coded(grey: Any, family: str, prefix: str = "") -> FoundTargets:
    """Find all coded dots of a family, wherever they are; they are called ``CODE7``.

    A dot without a ring is passed over; one whose ring is not read with certainty, or is no code of the family, is
    rejected, and so are codes that are in the picture twice.

    Parameters
    ----------
    grey : array (rows, columns) of uint8 or uint16
    family : str
        Of `FAMILIES`.
    """
    picture = as_bytes(grey)
    numbers = {code: number for number, code in enumerate(codes_of(family))}
    read: dict[int, list[Dot]] = {}
    rejected = []
    # the ring is not part of the ground, as which its blurred edge would move the centre
    for dot in find_dots(picture, _REACH).dots:
        word = _word(picture, dot, FAMILIES[family])
        if isinstance(word, str):
            rejected.append(Rejected(dot.column, dot.row, word))
        elif word is not None and word in numbers:
            read.setdefault(numbers[word], []).append(dot)
        elif word is not None:
            rejected.append(Rejected(dot.column, dot.row, f"its ring is no code of {family}"))
    marks = []
    for number, dots in sorted(read.items()):
        name = f"{prefix}CODE{number}"
        if len(dots) == 1:
            marks.append(Mark(name, dots[0].column, dots[0].row, dots[0].deviation))
        else:
            rejected += [Rejected(dot.column, dot.row, "this code is in the picture twice", name) for dot in dots]
    coded = [dot for dots in read.values() for dot in dots]
    rejected = [one for one in rejected if one.name or not any(_is_in_ring(one, dot) for dot in coded)]
    return FoundTargets(tuple(marks), tuple(rejected), "" if marks else f"no coded dot of {family} was measured")


def _is_in_ring(item: Rejected, dot: Dot) -> bool:
    """Tell whether something is part of a ring that was read: single fields may look like dots."""
    away = np.array([item.column - dot.column, item.row - dot.row])
    return bool(np.linalg.norm(dot.shape @ away) < _GROUND[-1])


def _word(picture: Any, dot: Dot, count: int) -> int | str | None:
    """Return the least word of a dot's ring; why it is not read, or None where there is no ring."""
    ground = _darkness(picture, dot, _GROUND, count)
    ring = _darkness(picture, dot, _RING, count).mean(axis=0)
    if not np.isfinite(ring).all() or ring.max() < _DARK:
        return None
    # what touches the dot, or reaches beyond the ring all round, is something else
    if not np.isfinite(ground).all() or ground.mean(axis=1).max() > _LIGHT:
        return None
    shifted = np.stack([np.roll(ring, -shift).reshape(count, _SAMPLES) for shift in range(_SAMPLES)])
    fields = shifted[:, :, _MIDDLE].mean(axis=2)
    values = fields[np.argmax(np.abs(fields - 0.5).sum(axis=1))]
    if ((values > _LIGHT) & (values < _DARK)).any():
        return "its ring is not read with certainty"
    word = 0
    for is_dark in (values > 0.5).tolist():
        word = word << 1 | is_dark
    return int(min(int(turned[0]) for turned in _turned(np.array([word], dtype=np.uint32), count)))


def _darkness(picture: Any, dot: Dot, radii: FloatArray, count: int) -> FloatArray:
    """Return how dark it is at radii (rows) and clockwise about a dot: 0 as the ground, 1 as the dot; NaN outside."""
    from scipy.ndimage import map_coordinates

    angles = np.arange(count * _SAMPLES) * (2.0 * np.pi / (count * _SAMPLES))
    circle = np.linalg.inv(dot.shape) @ np.stack([np.cos(angles), np.sin(angles)])
    column, row = np.array([dot.column, dot.row])[:, None, None] - 0.5 + circle[:, None, :] * radii[:, None]
    reach = np.ceil([np.abs(row - dot.row).max(), np.abs(column - dot.column).max()]).astype(int) + 2
    low = np.maximum(np.array([int(dot.row), int(dot.column)]) - reach, 0)
    window = picture[low[0] : int(dot.row) + reach[0] + 1, low[1] : int(dot.column) + reach[1] + 1].astype(np.float64)
    values = map_coordinates(window, [row - low[0], column - low[1]], order=1, cval=np.nan)
    return np.asarray((dot.ground - values) / dot.contrast)


def _turned(words: Any, count: int) -> list[Any]:
    """Return words turned by 0, 1, 2 ... fields."""
    whole = np.uint32((1 << count) - 1)
    return [words, *(((words << np.uint32(k)) | (words >> np.uint32(count - k))) & whole for k in range(1, count))]


def _mirrored(words: Any, count: int) -> Any:
    found = np.zeros_like(words)
    for field in range(count):
        found |= (words >> np.uint32(field) & np.uint32(1)) << np.uint32(count - 1 - field)
    return found


def _least_difference(words: Any, others: Any, ones: Any, count: int) -> Any:
    """Return how many fields differ at least between words (n,) and others (n,) or (1,), however these are turned."""
    return np.minimum.reduce([ones[words ^ turned] for turned in _turned(others, count)])
