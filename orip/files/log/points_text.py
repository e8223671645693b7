"""Blocks of photo points (.MEA) of many measurements at once, with numbers that read back exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.files.log.writing import points_header
from orip.number_text import shortest_texts


def points_blocks(
    bundle: str, photo: str, names: Sequence[str], image: FloatArray, errors: FloatArray, is_active: BoolArray
) -> str:
    """Return the measurements of a photo: a block, and further ones for points that are measured again.

    Parameters
    ----------
    bundle, photo : str
    names : sequence of k str
        Of points.
    image : array (k, 2)
        Pixels or millimetres, as the photo is measured.
    errors : array (k,)
        A-priori errors of both coordinates, pixels; NaN: that of the bundle.
    is_active : array (k,) of bool
        False: the line is disregarded.
    """
    columns, rows = (shortest_texts(values, "nan") for values in np.ascontiguousarray(image.T))
    ends = [""] * len(names)
    if np.isfinite(errors).any() or not is_active.all():
        texts = shortest_texts(errors, "")
        ends = [_end(error, active) for error, active in zip(texts, is_active.tolist(), strict=True)]
    lines = [f"  {name} {x} {y}{end}" for name, x, y, end in zip(names, columns, rows, ends, strict=True)]
    header = points_header(bundle, photo)
    return "".join("\n".join([header, *(lines[n] for n in block.tolist()), ""]) for block in _blocks(names))


def _end(error: str, is_active: bool) -> str:
    own = f" {error}px {error}px" if error else ""
    return own if is_active else f"{own} -"


def _blocks(names: Sequence[str]) -> list[IntArray]:
    """Return the places of names in blocks in which none occurs twice."""
    left = list(range(len(names)))
    if len(set(names)) == len(names):
        return [np.arange(len(names))]
    blocks = []
    while left:
        seen: set[str] = set()
        block = [n for n in left if not (names[n] in seen or seen.add(names[n]))]  # type: ignore[func-returns-value]
        blocks.append(np.array(block, dtype=np.int64))
        left = sorted(set(left) - set(block))
    return blocks
