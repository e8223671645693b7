"""Names of points that are numbered while they are measured."""

from __future__ import annotations

import re
from collections.abc import Container, Iterator
from itertools import count


def numbered(first: str) -> Iterator[str]:
    """Yield 1000, 1001 ... or G1, G2 ...; a name without a number gets one."""
    stem, digits = re.fullmatch(r"(.*?)([0-9]*)", first).groups()  # type: ignore[union-attr]  # matches anything
    for number in count(int(digits or 1)):
        yield f"{stem}{number:0{len(digits)}d}"


def next_name(first: str, taken: Container[str]) -> str:
    """Return the first name of a series that is not taken."""
    return next(name for name in numbered(first) if name not in taken)
